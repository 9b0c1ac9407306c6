"""The estimator's front door: measurements in, a track with diagnostics out."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np

from cwcli.errors import DataError
from cwcli.estimation.config import EstimatorConfig
from cwcli.estimation.consistency import effective_count
from cwcli.estimation.latency import NO_LATENCY, Latency, LatencyStatus
from cwcli.estimation.measurements import RATES, Kind, Measurements
from cwcli.estimation.model import ModelParameters
from cwcli.estimation.passes import BEFORE_START, N_MOTION, PassResult, Start, old_rows, run_pass, unsmoothed_note
from cwcli.estimation.prepare import PreparedSeries, epoch_ns, prepare, seconds
from cwcli.estimation.start import hold_before_start, start_with_parameters
from cwcli.estimation.tune import TunedSeries, tune
from cwcli.kernels.ekf import UpdateStatus
from cwcli.metrics.chi_square import mean_bounds
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.units import NS_PER_S

MIN_NIS_ROWS = 20
LONG_LEAD_IN_S = 3.0  # without a position
MOST_STARTS = 6
STARTS_AGREE_M = 0.5


@dataclass(frozen=True)
class SourceReport:
    """What became of one source's measurements of one kind.

    Attributes:
        source: Name of the source.
        kind: What it measures; an IMU appears as ACCEL and as YAW_RATE.
        n_read: Rows handed in.
        n_used: Rows that changed the estimate.
        n_gated: Rows that the chi-square gate rejected.
        n_not_finite: Rows left out because a value or stamp was not finite.
        n_interpolated: IMU rows left out because they were interpolated before the log was made.
        n_held_back: Rows left out because they came in a burst, older than their stamps say.
        n_resets: Times that the gate gave in after too many rejections in a row (for ACCEL and YAW_RATE: after two,
            because an inertial sensor that stays off for longer shows a manoeuvre).
        nis_mean: Mean normalised innovation squared over the used rows; expectation `nis_dof`.
        nis_dof: Degrees of freedom of one row.
        nis_bounds: 95 % chi-square bounds of the mean for as many independent rows as the autocorrelation of
            the series leaves (`consistency.effective_count`).
        nis_inside: True if the mean lies inside the bounds; None with fewer than 20 rows.
        sigma: One-sigma measurement noise used (root mean variance over rows and axes).
        noise_origin: "message", "message, scaled" (raised until the innovations agree), "log" (found from the
            innovations) or "default".
        latency: What was found or given, its sigma, and what was made of it.
        bias: Additive bias at the middle of the log in the unit of the kind, NaN where none is modelled.
        bias_sigma: One sigma of the bias.
    """

    source: str
    kind: Kind
    n_read: int = 0
    n_used: int = 0
    n_gated: int = 0
    n_not_finite: int = 0
    n_interpolated: int = 0
    n_held_back: int = 0
    n_resets: int = 0
    nis_mean: float = float("nan")
    nis_dof: int = 1
    nis_bounds: tuple[float, float] = (float("nan"), float("nan"))
    nis_inside: bool | None = None
    sigma: float = float("nan")
    noise_origin: str = "default"
    latency: Latency = NO_LATENCY
    bias: float = float("nan")
    bias_sigma: float = float("nan")


@dataclass(frozen=True)
class Track:
    """An estimated track.

    Attributes:
        stamp_ns: Shape (m,), int64: the output stamps asked for, on the reference source's clock (on the
            position's where that one leads the reference: see `notes`).
        state: Shape (m, 8), order `vehicle_state.STATE_NAMES`; the heading is unwrapped (continuous).
        covariance: Shape (m, 8, 8), symmetric, positive semi-definite; grows where nothing is measured.
        sources: One report per source and kind.
        log_likelihood: Of the innovations of the forward pass.
        notes: One-line remarks for the user (resets, what could not be observed).
    """

    stamp_ns: Int64Array
    state: FloatArray
    covariance: FloatArray
    sources: tuple[SourceReport, ...] = ()
    log_likelihood: float = float("nan")
    notes: tuple[str, ...] = field(default=())


def estimate_track(
    measurements: Sequence[Measurements],
    config: EstimatorConfig,
    output_stamp_ns: Int64Array | None = None,
) -> Track:
    """Estimate one vehicle's track.

    Args:
        measurements: Any mix of sources and kinds; at least one POSITION.
        config: Settings.
        output_stamp_ns: Shape (m,), increasing: where the state is wanted. None: a grid of `config.rate_hz` over
            the span of the measurements.

    Returns:
        The track at the output stamps.

    Raises:
        DataError: If no position is finite.
    """
    if config.model == "song2016":
        from cwcli.estimation.song2016 import estimate_song2016

        return estimate_song2016(measurements, config, output_stamp_ns)
    if not any(m.kind is Kind.POSITION and np.isfinite(m.values).all(axis=1).any() for m in measurements):
        raise DataError("no finite position among the measurements")
    epoch = epoch_ns(measurements)
    prepared, notes = prepare(measurements, epoch)
    if output_stamp_ns is None:
        output_stamp_ns = _grid(measurements, config.rate_hz)
    tuned = tune(prepared, config, ModelParameters())
    start = start_with_parameters(tuned.series, tuned.prior, causal=config.causal)
    if not config.causal:
        start = _start_again(tuned, start, config.reset_after)
    late_s, remark = _late_reference(tuned)
    notes += remark
    output_s = seconds(output_stamp_ns, epoch) + late_s
    result = run_pass(
        tuned.series, start, tuned.motion, output_s,
        smooth=not config.causal, reset_after=config.reset_after,
    )  # fmt: skip
    if config.causal:
        hold_before_start(
            result.state, result.covariance, tuned.series, start_s=start.time_s, output_s=output_s, prior=tuned.prior
        )
        notes += old_rows(tuned.series, result)
    reports = tuple(_report(p, tuned, i, result) for i, p in enumerate(prepared))
    notes += [*tuned.notes, *unsmoothed_note(result.is_unsmoothed)]
    for r in reports:
        if r.n_resets and r.kind not in RATES:
            often = "once" if r.n_resets == 1 else f"{r.n_resets} times"
            notes.append(f"{r.source}: {r.kind.name.lower()} believed again after rejections, {often}")
    return Track(
        output_stamp_ns,
        np.ascontiguousarray(result.state[:, :N_MOTION]),
        np.ascontiguousarray(result.covariance[:, :N_MOTION, :N_MOTION]),
        reports,
        result.log_likelihood,
        tuple(notes),
    )


def _start_again(tuned: TunedSeries, start: Start, reset_after: int) -> Start:
    """Where no position comes for long after the start, begin about what the smoother finds there.

    Until the first position the state hardly has a place, a speed or a heading, and the filter's expansion about a
    guess that is far off makes it sure of what is wrong. The covariance stays that of the guess.
    """
    first_s = min(float(s.time_s[0] - s.latency_s) for s in tuned.series if s.kind is Kind.POSITION and len(s))
    if first_s - start.time_s < LONG_LEAD_IN_S:
        return start
    here = np.array([start.time_s])
    for _ in range(MOST_STARTS):
        found = run_pass(tuned.series, start, tuned.motion, here, smooth=True, reset_after=reset_after)
        state = found.state[0]
        if not np.isfinite(state).all():
            break
        moved_m = float(np.hypot(*(state[:2] - start.state[:2])))
        start = replace(start, state=state)
        if moved_m < STARTS_AGREE_M:
            break
    return start


def _grid(measurements: Sequence[Measurements], rate_hz: float) -> Int64Array:
    """Return stamps at `rate_hz` over the span of the measurements."""
    first = epoch_ns(measurements)
    last = max(int(m.stamp_ns.max()) for m in measurements if len(m))
    step = round(NS_PER_S / rate_hz)
    return np.arange(first, last + 1, step, dtype=np.int64)


def _late_reference(tuned: TunedSeries) -> tuple[float, list[str]]:
    """Return by how much the reference is late, in seconds, with a note; 0 where nothing says so.

    A position can't be stamped before it was there. Where one clearly comes out earlier than the reference, the
    reference (an IMU behind a filter or a bus) is late, and the receiver's satellite clock is better. The filter runs
    on the reference's clock; the output is asked for on the receiver's.
    """
    late_s, source = 0.0, ""
    for s, latency in zip(tuned.series, tuned.latencies, strict=True):
        if s.kind is Kind.POSITION and latency.status is LatencyStatus.APPLIED and latency.found_s < -late_s:
            late_s, source = -latency.found_s, s.source
    if not source:
        return 0.0, []
    return late_s, [
        f"{source}: positions lead the reference by {1000.0 * late_s:.0f} ms, so the reference is late; "
        f"states are on the clock of {source}"
    ]


def _report(p: PreparedSeries, tuned: TunedSeries, i: int, result: PassResult) -> SourceReport:
    """Sum up one series."""
    s, latency = tuned.series[i], tuned.latencies[i]
    nis, status = result.nis[i][:, 0], result.status[i]
    mean, bounds, inside = float("nan"), (float("nan"), float("nan")), None
    if int((status != BEFORE_START).sum()) >= MIN_NIS_ROWS:
        kept = (
            nis[status >= UpdateStatus.USED]
            if (status >= UpdateStatus.USED).any()
            else nis[status == UpdateStatus.GATED]
        )
        mean = float(kept.mean())
        bounds = mean_bounds(s.width, effective_count(kept))
        inside = bounds[0] <= mean <= bounds[1]
    bias, bias_sigma = float("nan"), float("nan")
    if s.bias_state >= 0 and len(result.state):
        middle = len(result.state) // 2
        bias = float(result.state[middle, s.bias_state])
        bias_sigma = float(np.sqrt(max(result.covariance[middle, s.bias_state, s.bias_state], 0.0)))
    variance = s.noise[:, 0] if s.width == 1 else 0.5 * (s.noise[:, 0] + s.noise[:, 2])
    return SourceReport(
        source=s.source,
        kind=s.kind,
        n_read=p.n_read,
        n_used=int((status >= UpdateStatus.USED).sum()),
        n_gated=int((status == UpdateStatus.GATED).sum()),
        n_not_finite=p.n_not_finite,
        n_interpolated=p.n_interpolated,
        n_held_back=p.n_held_back,
        n_resets=int((status == UpdateStatus.USED_AFTER_RESET).sum()),
        nis_mean=mean,
        nis_dof=s.width,
        nis_bounds=bounds,
        nis_inside=inside,
        sigma=float(np.sqrt(variance.mean())) if len(s) else float("nan"),
        noise_origin=s.noise_origin,
        latency=latency,
        bias=bias,
        bias_sigma=bias_sigma,
    )


def estimate_tracks(
    groups: Sequence[tuple[Sequence[Measurements], Int64Array | None]],
    config: EstimatorConfig,
) -> list[Track]:
    """Estimate many vehicles' tracks, in threads: `estimate_track` for each (measurements, output stamps).

    A worker process uses one thread: the other processors are the other workers'.
    """
    if len(groups) < 2 or multiprocessing.parent_process() is not None:
        return [estimate_track(measurements, config, stamps) for measurements, stamps in groups]
    with ThreadPoolExecutor(max_workers=min(len(groups), os.cpu_count() or 1)) as pool:
        return list(pool.map(lambda group: estimate_track(group[0], config, group[1]), groups))
