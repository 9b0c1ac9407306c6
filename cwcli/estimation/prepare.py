"""From measurements to series: clean, sort, level, choose the noise to begin with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from cwcli.estimation.imu import ImuMounting, level_imu
from cwcli.estimation.measurements import QUANTITIES, RATES, Kind, Measurements
from cwcli.estimation.odd_sensors import first_row_is_apart, in_si_units, stuck_rows
from cwcli.estimation.passes import PitchRate, Series
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.units import NS_PER_S

NOTHING_KNOWN: Mapping[str, ImuMounting] = {}
CONSTANT_MIN_ROWS = 50
BURST_ROWS, BURST_PART = 4, 0.5
ROUGHNESS_PART = 0.5  # an IMU's noise is at least this part of what its second differences show


@dataclass(frozen=True)
class PreparedSeries:
    """One series with what happened on the way to it.

    Attributes:
        series: The series, stamps relative to the epoch.
        biased: It comes from an IMU: its bias is estimated.
        n_read: Rows handed in.
        n_not_finite: Rows left out because a value or stamp was not finite.
        n_interpolated: IMU rows left out because they were interpolated before the log was made.
        n_held_back: Rows left out because they came in a burst (see `held_back`).
        mounting: How the IMU was levelled, or None.
        mean_force_mps2: Shape (3,): an IMU's mean specific force (forward, left, up) in m/s^2, or None.
    """

    series: Series
    biased: bool
    n_read: int
    n_not_finite: int
    n_interpolated: int = 0
    n_held_back: int = 0
    mounting: ImuMounting | None = None
    mean_force_mps2: FloatArray | None = None


def epoch_ns(measurements: Sequence[Measurements]) -> int:
    """Return the earliest stamp."""
    return min(int(m.stamp_ns.min()) for m in measurements if len(m))


def seconds(stamp_ns: Int64Array, epoch: int) -> FloatArray:
    """Stamps (n,) in ns as seconds (n,) since `epoch` (ns): subtracted first, then scaled."""
    return (stamp_ns - epoch) / NS_PER_S


def prepare(
    measurements: Sequence[Measurements], epoch: int, mountings: Mapping[str, ImuMounting] = NOTHING_KNOWN
) -> tuple[list[PreparedSeries], list[str]]:
    """Clean, sort and split the measurements.

    Args:
        measurements: As they came.
        epoch: The stamp that becomes zero.
        mountings: Source -> how its IMU is turned, where that is known.

    Returns:
        The series, and notes on sources that were left out.
    """
    prepared: list[PreparedSeries] = []
    notes: list[str] = []
    for m in measurements:
        finite = np.isfinite(m.values).all(axis=1)
        lost = int((~finite).sum())
        time = seconds(m.stamp_ns[finite], epoch)
        order = np.argsort(time, kind="stable")
        time, values = time[order], m.values[finite][order]
        covariance = None if m.covariance is None else m.covariance[finite][order]
        stuck = stuck_rows(m.kind, time, values) if not m.is_exact else np.zeros(len(time), np.bool_)
        if stuck.any():
            told = f"{int(stuck.sum())} {m.kind.name.lower()} rows repeat one number for long: stuck, left out"
            notes.append(f"{m.source}: {told}")
            time, values = time[~stuck], values[~stuck]
            covariance = None if covariance is None else covariance[~stuck]
        if not m.is_exact and first_row_is_apart(m.kind, time, values):
            notes.append(f"{m.source}: the first {m.kind.name.lower()} row contradicts those after it, left out")
            time, values = time[1:], values[1:]
            covariance = None if covariance is None else covariance[1:]
        if m.kind is Kind.IMU:
            variance = None if covariance is None else np.diagonal(covariance, axis1=1, axis2=2)
            values, variance, words = in_si_units(values, variance)
            notes += [f"{m.source}: {each}" for each in words]
            imu = level_imu(time, values, variance, mountings.get(m.source))
            if imu.n_interpolated:
                notes.append(f"{m.source}: {imu.n_interpolated} interpolated IMU samples left out")
            pairs = (
                (Kind.ACCEL, imu.accel_mps2, imu.accel_variance),
                (Kind.YAW_RATE, imu.yaw_rate_radps, imu.yaw_rate_variance),
            )
            for kind, value, var in pairs:
                series = _with_noise(m.source, kind, imu.time_s, value[:, None], var[:, None, None])
                if kind is Kind.ACCEL and len(series):
                    series = replace(series, pitch_rate=PitchRate(imu.time_s, imu.pitch_rate_radps))
                prepared.append(
                    PreparedSeries(
                        series, True, len(m), lost, imu.n_interpolated,
                        mounting=imu.mounting, mean_force_mps2=values[:, :3].mean(axis=0) if len(values) else None,
                    )
                )  # fmt: skip
            continue
        late = held_back(time) if not m.is_exact else np.zeros(len(time), np.bool_)
        if late.any():
            notes.append(f"{m.source}: {int(late.sum())} {m.kind.name.lower()} rows came in bursts, left out")
            time, values = time[~late], values[~late]
            covariance = None if covariance is None else covariance[~late]
        if _is_constant(m.kind, values):
            notes.append(f"{m.source}: {m.kind.name.lower()} never changes; taken as not measured")
            prepared.append(
                PreparedSeries(_with_noise(m.source, m.kind, time[:0], values[:0], None), False, len(m), lost)
            )
            continue
        series = replace(_with_noise(m.source, m.kind, time, values, covariance), is_exact=m.is_exact)
        prepared.append(PreparedSeries(series, False, len(m), lost, n_held_back=int(late.sum())))
    return prepared, notes


def prepare_blind(
    measurements: Sequence[Measurements], epoch: int, mountings: Mapping[str, ImuMounting]
) -> list[PreparedSeries]:
    """Sort and split the measurements as somebody must who does not know what comes later: nothing is cleaned.

    A rate is not used until it changes: until then it may be a field that nobody fills. Noise that no message states
    is that of `QUANTITIES`.

    Args:
        measurements, epoch: See `prepare`.
        mountings: Source -> how its IMU is turned; without one its axes are taken as they are.
    """
    prepared = []
    for m in measurements:
        finite = np.flatnonzero(np.isfinite(m.values).all(axis=1))
        rows = finite[np.argsort(m.stamp_ns[finite], kind="stable")]
        lost = len(m) - len(rows)
        if m.kind in RATES:
            changes = np.flatnonzero((m.values[rows] != m.values[rows[:1]]).any(axis=1))
            rows = rows[changes[0] :] if len(changes) else rows[:0]
        time = seconds(m.stamp_ns[rows], epoch)
        covariance = None if m.covariance is None else m.covariance[rows]
        if m.kind is not Kind.IMU:
            series = _with_noise(m.source, m.kind, time, m.values[rows], covariance, looks_ahead=False)
            series = replace(series, is_exact=m.is_exact)
            prepared.append(PreparedSeries(series, False, len(m), lost))
            continue
        mounting = mountings.get(m.source, ImuMounting(0.0, 0.0))
        for kind, values, axis in (
            (Kind.ACCEL, m.values[rows, 0], 0),
            (Kind.YAW_RATE, m.values[rows, 3:] @ mounting.up, 5),
        ):
            variance = None if covariance is None else covariance[:, axis : axis + 1, axis : axis + 1]
            series = _with_noise(m.source, kind, time, values[:, None], variance, looks_ahead=False)
            force = m.values[rows, :3].mean(axis=0) if len(rows) else None
            prepared.append(PreparedSeries(series, True, len(m), lost, mounting=mounting, mean_force_mps2=force))
    return prepared


def held_back(time_s: FloatArray) -> npt.NDArray[np.bool_]:
    """Find rows of a backlog: messages that were held back and stamped as they came out.

    A link that stalls delivers what it kept all at once. Of such a burst only the last row is fresh; the others are
    older than their stamps say, and a car seems to race. A burst is BURST_ROWS or more gaps in a row that are shorter
    than BURST_PART of the usual gap.

    Args:
        time_s: Shape (n,), sorted.

    Returns:
        Shape (n,), True for rows of a burst except its last.
    """
    late = np.zeros(len(time_s), bool)
    if len(time_s) < 10 * BURST_ROWS:
        return late
    gap = np.diff(time_s)
    short = (gap < BURST_PART * float(np.median(gap))).astype(np.int8)
    edges = np.flatnonzero(np.diff(np.concatenate(([0], short, [0]))))
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        if end - begin >= BURST_ROWS:
            late[begin:end] = True
    return late


def _is_constant(kind: Kind, values: FloatArray) -> bool:
    """A yaw rate or acceleration of exactly one value for a whole log is a field that nobody fills."""
    if kind not in RATES or len(values) < CONSTANT_MIN_ROWS:
        return False
    return bool((values == values[0]).all())


def _with_noise(
    source: str,
    kind: Kind,
    time: FloatArray,
    values: FloatArray,
    covariance: FloatArray | None,
    *,
    looks_ahead: bool = True,
) -> Series:
    """Take the message's covariance where it says something, else a first guess from the signal's own roughness.

    Without `looks_ahead` that guess is the default, and how often rows come is not known either.
    """
    n, width = len(time), values.shape[1]
    noise = np.zeros((n, 3))
    said = np.zeros(n, bool)
    if covariance is not None:
        noise[:, 0] = covariance[:, 0, 0]
        if width == 2:
            noise[:, 1] = 0.5 * (covariance[:, 0, 1] + covariance[:, 1, 0])
            noise[:, 2] = covariance[:, 1, 1]
            determinant = noise[:, 0] * noise[:, 2] - noise[:, 1] ** 2
            said = (noise[:, 0] > 0) & (noise[:, 2] > 0) & (determinant > 0) & np.isfinite(noise).all(axis=1)
        else:
            said = (noise[:, 0] > 0) & np.isfinite(noise[:, 0])
    guess = (_first_guess(kind, time, values) if looks_ahead else QUANTITIES[kind].default_sigma) ** 2
    noise[~said] = (guess, 0.0, guess)
    if width == 1:
        noise[:, 1:] = 0.0
    origin = "message" if n and said.mean() > 0.5 else "default"
    padded = np.zeros((n, 2))
    padded[:, :width] = values
    floor = QUANTITIES[kind].floor_sigma
    if kind in RATES:
        floor = max(floor, ROUGHNESS_PART * guess**0.5)
    interval_s = float("nan") if looks_ahead else float("inf")
    return Series(source, kind, time, padded, noise, noise_origin=origin, floor=floor, interval_s=interval_s)


def _first_guess(kind: Kind, time: FloatArray, values: FloatArray) -> float:
    """Return a starting sigma: an IMU's from its second differences, which the motion hardly touches at its rate."""
    default = QUANTITIES[kind].default_sigma
    if kind not in RATES or len(time) < 200:
        return default
    second = values[2:, 0] - 2.0 * values[1:-1, 0] + values[:-2, 0]
    rough = float(np.median(np.abs(second))) / 0.6745 / np.sqrt(6.0)
    return float(max(rough, 0.1 * default))


def thinned(series: Series, factor: int) -> Series:
    """Average blocks of `factor` rows, which is as good for finding slow parameters and quicker; no block has a gap."""
    if factor < 2 or len(series) < 10 * factor:
        return series
    n = len(series) // factor * factor
    shape = (n // factor, factor)
    time = series.time_s[:n].reshape(shape)
    whole = np.ptp(time, axis=1) < 2.0 * factor * float(np.median(np.diff(series.time_s)))
    return replace(
        series,
        time_s=time.mean(axis=1)[whole],
        values=series.values[:n].reshape(*shape, 2).mean(axis=1)[whole],
        noise=series.noise[:n].reshape(*shape, 3).mean(axis=1)[whole] / factor,
    )


def thinned_to(series: Series, rate_hz: float) -> Series:
    """An inertial series or a speed averaged down to about `rate_hz`; another series as it is."""
    if series.kind not in (*RATES, Kind.SPEED) or len(series) < 3:
        return series
    return thinned(series, int(1.0 / (rate_hz * max(float(np.median(np.diff(series.time_s))), 1e-4)) + 0.25))
