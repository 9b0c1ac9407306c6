"""Prepare measurements for the filter: clean, sort and level them, and choose their initial noise."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from cwcli.estimation.coarse_fixes import find_coarse_east_north_steps_m, note_on_coarse_fixes
from cwcli.estimation.imu import ImuMounting, LevelledImu, level_imu_by_gravity
from cwcli.estimation.measurements import KINDS_THAT_IMU_MEASURES_TOO, QUANTITY_BY_KIND, Kind, Measurements
from cwcli.estimation.odd_sensors import begin_and_end_of_true_stretches, is_first_row_contradicted, stuck_row_mask
from cwcli.estimation.passes import PitchRateSeries, SensorSeries
from cwcli.estimation.repeated_rows import NO_STALE_ROWS, find_stale_rows, quantisation_step_or_zero_or_infinity
from cwcli.estimation.sensor_limits import WHITE_NOISE_RANGE_BY_KIND
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.signals.columns import FloatArray, Int64Array, ValueRows, median_of_values
from cwcli.signals.units import NS_PER_S

NO_KNOWN_MOUNTINGS: Mapping[str, ImuMounting] = {}
"""Empty mapping: no mounting is known."""
MIN_ROWS_OF_CONSTANT_FIELD = 50
"""Least number of rows from which a rate that never changes counts as an unfilled field. Chosen by hand."""
MIN_DIFFERENT_VALUES_OF_COPY, MIN_EQUAL_VALUES_OF_COPY_SHARE = 50, 0.9
"""Least number of different values, and least share of equal ones, of two sources of which one is a copy. Chosen by
hand: noise never repeats so often."""
MIN_BURST_GAPS, MAX_BURST_GAP_TO_USUAL_GAP_RATIO = 4, 0.5
"""Least number of short gaps in a burst, and the part of the usual gap below which one is short. Chosen by hand."""
MIN_FITTED_IMU_NOISE_TO_ROUGHNESS = 0.5
"""Least noise that is fitted to an IMU, as a share of the noise that its second differences show. Chosen by hand; not
fitted."""
_NAME_OF_RATE_KIND: Mapping[Kind, str] = {Kind.ACCEL: "the acceleration", Kind.YAW_RATE: "the yaw rate"}
"""Names of the rates in notes, without unit."""
MIN_COARSE_HEADING_STEP_RAD = math.radians(3.0)
"""Least step of a heading that counts as coarse, rad. Chosen by hand: finer ones err by less than a compass does."""
MAX_DIFFERENCE_OF_SAME_HEADING_RAD = 1e-6
"""Greatest difference of two headings that are the same, rad: rounding of numbers."""
MAX_HEADING_CHANGE_DURATION_S = 1.0
"""Longest time between the two rows of a change, s: a car turns by 30 degrees in it. Chosen by hand."""


@dataclass(frozen=True)
class CoarseHeadings:
    """Where headings that are rounded to coarse steps, such as the sixteen points of a compass, change by one step.

    On a straight road such a heading errs by the same angle for minutes, which no filter averages out. Only where it
    changes by one step is the true heading known: it is halfway.

    Attributes:
        step_rad: The step.
        time_s, heading_rad: Shape (k,): time and heading halfway through each change.
        rows: Shape (k,): the row behind each change.
    """

    step_rad: float
    time_s: FloatArray
    heading_rad: FloatArray
    rows: npt.NDArray[np.intp]

    def note_for_user(self, source: str) -> str:
        """Return what the user is told."""
        return (
            f"{source}: its headings are rounded to steps of {math.degrees(self.step_rad):.3g} degrees: only the "
            f"{len(self.time_s)} changes from one step to the next are used"
        )


@dataclass(frozen=True)
class PreparedSeries:
    """A series with counts of the rows that were left out.

    Attributes:
        series: The series, stamps relative to the common zero time.
        has_bias: Whether it comes from an IMU, so that its bias is estimated.
        n_read: Rows handed in.
        n_not_finite: Rows left out because a value or stamp was not finite.
        n_interpolated: Rows left out because they were interpolated before the log was made.
        n_repeated: Rows left out because they repeat the value before them (see `repeated_rows`).
        n_held_back: Rows left out because they came in a burst (see `burst_row_mask`).
        mounting: How the IMU was levelled, or None.
        mean_force_mps2: Shape (3,): an IMU's mean specific force (forward, left, up) in m/s^2, or None.
    """

    series: SensorSeries
    has_bias: bool
    n_read: int
    n_not_finite: int
    n_interpolated: int = 0
    n_repeated: int = 0
    n_held_back: int = 0
    mounting: ImuMounting | None = None
    mean_force_mps2: FloatArray | None = None


def earliest_stamp_ns(measurements: Sequence[Measurements]) -> int:
    """Return the earliest stamp."""
    return min(int(m.stamp_ns.min()) for m in measurements if len(m))


def seconds_since_zero_time(stamp_ns: Int64Array, zero_ns: int) -> FloatArray:
    """Convert stamps (n,), ns, to seconds (n,) since `zero_ns` (ns); the difference is taken in integers."""
    return (stamp_ns - zero_ns) / NS_PER_S


def finite_rows_by_stamp(m: Measurements) -> Int64Array:
    """Return the numbers of the rows (n,) whose values are all finite, in the order of their stamps."""
    finite = np.flatnonzero(np.isfinite(m.values).all(axis=1))
    return np.asarray(finite[np.argsort(m.stamp_ns[finite], kind="stable")])


def clean_and_sort_measurements_and_note(
    measurements: Sequence[Measurements], zero_ns: int, mountings: Mapping[str, ImuMounting] = NO_KNOWN_MOUNTINGS
) -> tuple[list[PreparedSeries], list[str]]:
    """Clean, sort and split the measurements.

    Args:
        zero_ns: Stamp (ns) that becomes zero.
        mountings: Source -> mounting of its IMU, where that is known.

    Returns:
        The series, and notes on sources that were left out.
    """
    prepared: list[PreparedSeries] = []
    notes: list[str] = []
    for m in measurements:
        finite = np.isfinite(m.values).all(axis=1)
        n_not_finite = int((~finite).sum())
        time = seconds_since_zero_time(m.stamp_ns[finite], zero_ns)
        order = np.argsort(time, kind="stable")
        time, values = time[order], m.values[finite][order]
        covariance = None if m.covariance is None else m.covariance[finite][order]
        stale = NO_STALE_ROWS if m.is_exact else find_stale_rows(m.kind, time, values)
        if stale.n_rows:
            notes += stale.notes_for_user(m.source, m.kind)
            time, values = (
                time[~stale.repeated_or_interpolated_row_mask],
                values[~stale.repeated_or_interpolated_row_mask],
            )
            covariance = None if covariance is None else covariance[~stale.repeated_or_interpolated_row_mask]
        stuck = stuck_row_mask(m.kind, time, values) if not m.is_exact else np.zeros(len(time), np.bool_)
        if stuck.any():
            left_out_text = (
                f"{int(stuck.sum())} {m.kind.name.lower()} rows repeat one value for long (stuck sensor), left out"
            )
            notes.append(f"{m.source}: {left_out_text}")
            time, values = time[~stuck], values[~stuck]
            covariance = None if covariance is None else covariance[~stuck]
        if not m.is_exact and is_first_row_contradicted(m.kind, time, values):
            notes.append(f"{m.source}: the first {m.kind.name.lower()} row contradicts the following rows, left out")
            time, values = time[1:], values[1:]
            covariance = None if covariance is None else covariance[1:]
        if m.kind is Kind.IMU:
            variance = None if covariance is None else np.diagonal(covariance, axis1=1, axis2=2)
            imu = level_imu_by_gravity(time, values, variance, mountings.get(m.source))
            if imu.n_interpolated:
                notes.append(f"{m.source}: {imu.n_interpolated} interpolated IMU samples left out")
            for series, note in _accel_and_yaw_rate_series_with_notes(m.source, imu):
                notes += note
                prepared.append(
                    PreparedSeries(
                        series, True, len(m), n_not_finite, imu.n_interpolated, stale.n_repeated,
                        mounting=imu.mounting, mean_force_mps2=values[:, :3].mean(axis=0) if len(values) else None,
                    )
                )  # fmt: skip
            continue
        late = burst_row_mask(time) if not m.is_exact else np.zeros(len(time), np.bool_)
        if late.any():
            left_out_text = f"{int(late.sum())} {m.kind.name.lower()} rows arrived in bursts with late stamps, left out"
            notes.append(f"{m.source}: {left_out_text}")
            time, values = time[~late], values[~late]
            covariance = None if covariance is None else covariance[~late]
        time, values, covariance = _select_changes_of_coarse_headings_and_note(m, time, values, covariance, notes)
        if (original := find_copied_source(m, measurements)) or _is_unfilled_rate_field(m.kind, values):
            why = f"is a copy of {original}, left out" if original else "never changes; taken as not measured"
            notes.append(f"{m.source}: {m.kind.name.lower()} {why}")
            prepared.append(
                PreparedSeries(
                    _build_series_with_noise(m.source, m.kind, time[:0], values[:0], None), False, len(m), n_not_finite
                )
            )
            continue
        series = _build_series_with_noise(m.source, m.kind, time, values, covariance)
        series = _add_coarse_steps_and_note(replace(series, is_exact=m.is_exact), notes)
        prepared.append(
            PreparedSeries(series, False, len(m), n_not_finite, stale.n_interpolated, stale.n_repeated, int(late.sum()))
        )
    return prepared, notes


def prepare_without_looking_ahead(
    measurements: Sequence[Measurements], zero_ns: int, mountings: Mapping[str, ImuMounting]
) -> list[PreparedSeries]:
    """Sort and split the measurements without using later rows: nothing is cleaned.

    A rate is not used until it changes, because until then the field may be unfilled. Noise that no message states is
    that of `QUANTITY_BY_KIND`.

    Args:
        measurements, zero_ns: See `clean_and_sort_measurements_and_note`.
        mountings: Source -> mounting of its IMU; without one its axes are used unchanged.
    """
    prepared = []
    for m in measurements:
        rows = finite_rows_by_stamp(m)
        n_left_out = len(m) - len(rows)
        if m.kind in KINDS_THAT_IMU_MEASURES_TOO:
            changes = np.flatnonzero((m.values[rows] != m.values[rows[:1]]).any(axis=1))
            rows = rows[changes[0] :] if len(changes) else rows[:0]
        time = seconds_since_zero_time(m.stamp_ns[rows], zero_ns)
        covariance = None if m.covariance is None else m.covariance[rows]
        if m.kind is not Kind.IMU:
            series = _build_series_with_noise(m.source, m.kind, time, m.values[rows], covariance, looks_ahead=False)
            series = replace(series, is_exact=m.is_exact)
            prepared.append(PreparedSeries(series, False, len(m), n_left_out))
            continue
        mounting = mountings.get(m.source, ImuMounting(0.0, 0.0))
        for kind, values, axis in (
            (Kind.ACCEL, m.values[rows, 0], 0),
            (Kind.YAW_RATE, m.values[rows, 3:] @ mounting.up_unit_vector_in_imu_axes, 5),
        ):
            variance = None if covariance is None else covariance[:, axis : axis + 1, axis : axis + 1]
            series = _build_series_with_noise(m.source, kind, time, values[:, None], variance, looks_ahead=False)
            force = m.values[rows, :3].mean(axis=0) if len(rows) else None
            prepared.append(PreparedSeries(series, True, len(m), n_left_out, mounting=mounting, mean_force_mps2=force))
    return prepared


def burst_row_mask(time_s: FloatArray) -> npt.NDArray[np.bool_]:
    """Find rows of a burst: messages that a stalled link delivered all at once with late stamps.

    Only the last row of a burst is current; the others are older than their stamps, and the car seems too fast. A burst
    is `MIN_BURST_GAPS` or more gaps in a row, shorter than `MAX_BURST_GAP_TO_USUAL_GAP_RATIO` of the median gap.

    Returns:
        Shape (n,), True for rows of a burst except its last.
    """
    late = np.zeros(len(time_s), bool)
    if len(time_s) < 10 * MIN_BURST_GAPS:
        return late
    gap = np.diff(time_s)
    short = gap < MAX_BURST_GAP_TO_USUAL_GAP_RATIO * median_of_values(gap)
    for begin, end in begin_and_end_of_true_stretches(short, MIN_BURST_GAPS):
        late[begin:end] = True
    return late


def _select_changes_of_coarse_headings_and_note(
    m: Measurements, time_s: FloatArray, values: ValueRows, covariance: FloatArray | None, notes: list[str]
) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """Return times, values and covariance; of coarse headings those halfway through each change, with a note."""
    coarse = find_coarse_headings(time_s, values[:, 0]) if m.kind is Kind.HEADING and not m.is_exact else None
    if coarse is None:
        return time_s, values, covariance
    notes.append(coarse.note_for_user(m.source))
    return coarse.time_s, coarse.heading_rad[:, None], None if covariance is None else covariance[coarse.rows]


def _add_coarse_steps_and_note(series: SensorSeries, notes: list[str]) -> SensorSeries:
    """Return positions with the step to which they are rounded; adds a note if there is one."""
    if (
        series.kind is not Kind.POSITION
        or series.is_exact
        or not any(steps_m := find_coarse_east_north_steps_m(series.values))
    ):
        return series
    notes.append(note_on_coarse_fixes(series.source, steps_m))
    return replace(series, coarse_steps_m=steps_m)


def find_copied_source(m: Measurements, measurements: Sequence[Measurements]) -> str:
    """Return the name of an earlier source whose values a source repeats, as a topic published twice; else ""."""
    for other in measurements:
        if other is m:
            break
        if other.kind is m.kind and other.source != m.source and len(m) >= MIN_DIFFERENT_VALUES_OF_COPY:
            known = {row.tobytes() for row in other.values}
            if (
                len(known) >= MIN_DIFFERENT_VALUES_OF_COPY
                and np.mean([row.tobytes() in known for row in m.values]) > MIN_EQUAL_VALUES_OF_COPY_SHARE
            ):
                return other.source
    return ""


def _is_unfilled_rate_field(kind: Kind, values: ValueRows) -> bool:
    """Whether a yaw rate or acceleration has one value for the whole log: then its field is not filled."""
    if kind not in KINDS_THAT_IMU_MEASURES_TOO or len(values) < MIN_ROWS_OF_CONSTANT_FIELD:
        return False
    return bool((values == values[0]).all())


def _build_series_with_noise(
    source: str,
    kind: Kind,
    time_s: FloatArray,
    values: ValueRows,
    covariance: FloatArray | None,
    *,
    looks_ahead: bool = True,
) -> SensorSeries:
    """Build a series with the covariance of the messages where they state one, else with an initial guess.

    The guess comes from the roughness of the signal. Without `looks_ahead` it is the default, and the interval of the
    rows is unknown.
    """
    n, width = len(time_s), values.shape[1]
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
            said = (noise[:, 0] > 0) & np.isfinite(noise[:, 0]) & ~_stated_sigma_beyond_limit_mask(kind, noise[:, 0])
    guess = (_initial_noise_sigma(kind, time_s, values) if looks_ahead else QUANTITY_BY_KIND[kind].default_sigma) ** 2
    noise[~said] = (guess, 0.0, guess)
    if width == 1:
        noise[:, 1:] = 0.0
    origin = "message" if n and said.mean() > 0.5 else "default"
    padded = np.zeros((n, 2))
    padded[:, :width] = values
    floor = QUANTITY_BY_KIND[kind].floor_sigma
    if kind in KINDS_THAT_IMU_MEASURES_TOO:
        floor = max(floor, MIN_FITTED_IMU_NOISE_TO_ROUGHNESS * guess**0.5)
    interval_s = float("nan") if looks_ahead else float("inf")
    return SensorSeries(source, kind, time_s, padded, noise, noise_origin=origin, floor=floor, interval_s=interval_s)


def _accel_and_yaw_rate_series_with_notes(source: str, imu: LevelledImu) -> Iterator[tuple[SensorSeries, list[str]]]:
    """Yield the two series of a levelled IMU, each with notes on its stated noise."""
    for kind, value, variance in (
        (Kind.ACCEL, imu.accel_mps2, imu.accel_variance),
        (Kind.YAW_RATE, imu.yaw_rate_radps, imu.yaw_rate_variance),
    ):
        series = _build_series_with_noise(source, kind, imu.time_s, value[:, None], variance[:, None, None])
        if kind is Kind.ACCEL and len(series):
            series = replace(series, pitch_rate=PitchRateSeries(imu.time_s, imu.pitch_rate_radps))
        beyond = variance[_stated_sigma_beyond_limit_mask(kind, variance)]
        yield series, [_note_on_sigma_beyond_limit(source, kind, beyond)] if len(beyond) else []


def _stated_sigma_beyond_limit_mask(kind: Kind, variance: FloatArray) -> npt.NDArray[np.bool_]:
    """Whether a message states more noise of a rate than such a sensor has, as where the field is filled with ones."""
    if kind not in KINDS_THAT_IMU_MEASURES_TOO:  # a fix may be that bad, and then its row counts little
        return np.zeros(len(variance), np.bool_)
    return variance >= WHITE_NOISE_RANGE_BY_KIND[kind].high ** 2


def _note_on_sigma_beyond_limit(source: str, kind: Kind, variance: FloatArray) -> str:
    limit = WHITE_NOISE_RANGE_BY_KIND[kind]
    return (
        f"{source}: {len(variance)} messages state a sigma of {_NAME_OF_RATE_KIND[kind]} of up to "
        f"{np.sqrt(variance.max()):.3g} {limit.unit}, and no such sensor has {limit.high:g} {limit.unit}: the noise is "
        "found from the log instead"
    )


def _initial_noise_sigma(kind: Kind, time_s: FloatArray, values: ValueRows) -> float:
    """Return a starting sigma: an IMU's from its second differences, which the motion hardly touches at its rate."""
    default = QUANTITY_BY_KIND[kind].default_sigma
    if kind not in KINDS_THAT_IMU_MEASURES_TOO or len(time_s) < 200:
        return default
    second = values[2:, 0] - 2.0 * values[1:-1, 0] + values[:-2, 0]
    rough = median_of_values(np.abs(second)) / 0.6745 / np.sqrt(6.0)
    return float(max(rough, 0.1 * default))


def average_row_blocks(series: SensorSeries, factor: int) -> SensorSeries:
    """Average blocks of `factor` rows, which suffices for slow parameters; blocks with a gap are dropped."""
    if factor < 2 or len(series) < 10 * factor:
        return series
    n = len(series) // factor * factor
    shape = (n // factor, factor)
    time = series.time_s[:n].reshape(shape)
    whole = np.ptp(time, axis=1) < 2.0 * factor * median_of_values(np.diff(series.time_s))
    return replace(
        series,
        time_s=time.mean(axis=1)[whole],
        values=series.values[:n].reshape(*shape, 2).mean(axis=1)[whole],
        noise=series.noise[:n].reshape(*shape, 3).mean(axis=1)[whole] / factor,
    )


def average_rows_to_rate(series: SensorSeries, rate_hz: float) -> SensorSeries:
    """Average an inertial series or a speed down to about `rate_hz`; other series are returned unchanged."""
    if series.kind not in (*KINDS_THAT_IMU_MEASURES_TOO, Kind.SPEED) or len(series) < 3:
        return series
    return average_row_blocks(series, int(1.0 / (rate_hz * max(median_of_values(np.diff(series.time_s)), 1e-4)) + 0.25))


def find_coarse_headings(time_s: FloatArray, heading_rad: FloatArray) -> CoarseHeadings | None:
    """Return the changes of headings (n,) at times (n,) that are rounded to coarse steps; None where they are fine."""
    change_rad = np.diff(heading_rad)
    change_rad = (change_rad + math.pi) % (2.0 * math.pi) - math.pi
    step_rad = quantisation_step_or_zero_or_infinity(np.abs(change_rad), MAX_DIFFERENCE_OF_SAME_HEADING_RAD)
    if not math.isfinite(step_rad) or step_rad < MIN_COARSE_HEADING_STEP_RAD:
        return None
    duration_s = np.diff(time_s)
    is_one_step = (np.abs(change_rad) > MAX_DIFFERENCE_OF_SAME_HEADING_RAD) & (np.abs(change_rad) < 1.5 * step_rad)
    rows = np.flatnonzero(is_one_step & (duration_s <= MAX_HEADING_CHANGE_DURATION_S))
    return CoarseHeadings(
        step_rad,
        time_s[rows] + 0.5 * duration_s[rows],
        heading_rad[rows] + 0.5 * change_rad[rows],
        rows + 1,
    )
