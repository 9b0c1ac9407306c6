"""One pass of the filter (and smoother) over prepared series: events merged, sorted and handed to the kernel."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import cached_property

import numpy as np
import numpy.typing as npt

from cwcli.estimation.measurements import KINDS_THAT_IMU_MEASURES_TOO, QUANTITY_BY_KIND, Kind
from cwcli.estimation.median import median_of_finite_values
from cwcli.estimation.parameter import NO_STAMP_ERROR, Parameter
from cwcli.kernels import ekf
from cwcli.kernels.estimation import lay_steps
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.signals.columns import FloatArray

N_MOTION_STATES = 8
"""Number of motion states; parameter states follow them."""
MAX_TIME_OF_USED_ROW_BEFORE_FILTER_START_S = 1e-9
"""Time in s by which a row may be earlier than the start of the filter and is still used: rounding of stamps to
floats."""
MAX_PREDICTION_STEP_S = 0.1
"""Longest prediction step, s; chosen because the transition is a first-order expansion in the heading."""
MAX_COUNTED_PREDICTION_STEPS_OF_GAP = 600
"""Greatest number of steps across a gap: a longer gap counts as a minute, so that no covariance overflows."""
MAX_CONSECUTIVE_IMU_REJECTIONS = 2
"""Number of rejections in a row after which an inertial sensor is used again: a longer deviation is a manoeuvre. Chosen
by hand."""
MAX_REJECTION_TIME_OF_SLOW_SOURCE_S = 3.0
"""Time of rejections after which a slow source is used again, s. Chosen by hand; not fitted."""
MAX_PITCH_RATE_GAP_S = 0.2
"""Longest gap of the gyroscope, s, across which the pitch rate is interpolated; in a longer one it is zero. Chosen by
hand; not fitted."""
KINDS_OF_WHOLE_MOTION_MESSAGE = (Kind.POSITION, Kind.SPEED, Kind.HEADING)
"""Kinds that a message of another vehicle holds when it tells the whole motion in the plane."""
STATUS_OF_ROW_BEFORE_START = -1
"""Status of a row that is earlier than the start of the filter."""
IntArray = npt.NDArray[np.int32]


@dataclass(frozen=True)
class PitchRateSeries:
    """Time series of the pitch rate: the turn rate about the body's left axis.

    Attributes:
        time_s: Shape (n,), since the common epoch, sorted; at a SPEED corrected for the IMU's latency.
        value_radps: Shape (n,): nose down positive.
    """

    time_s: FloatArray
    value_radps: FloatArray

    def interpolate_rate_radps(self, time_s: FloatArray) -> FloatArray:
        """Interpolate the rate (rad/s) at times (m,), s; it is zero in gaps longer than `MAX_PITCH_RATE_GAP_S`."""
        value = np.interp(time_s, self.time_s, self.value_radps)
        after = np.clip(np.searchsorted(self.time_s, time_s), 1, len(self.time_s) - 1)
        is_known = self.time_s[after] - self.time_s[after - 1] < MAX_PITCH_RATE_GAP_S
        is_known &= (time_s >= self.time_s[0] - MAX_PITCH_RATE_GAP_S) & (
            time_s <= self.time_s[-1] + MAX_PITCH_RATE_GAP_S
        )
        return np.asarray(np.where(is_known, value, 0.0))


@dataclass(frozen=True)
class SensorSeries:
    """One source's measurements of one kind, ready for the filter.

    Attributes:
        source, kind: See `Measurements`; never IMU.
        time_s: Shape (n,), since the common epoch, sorted; not yet corrected for the latency.
        values: Shape (n, 2); scalars use the first column.
        noise: Shape (n, 3): r00, r01, r11.
        noise_origin: "message", "log" or "default".
        latency_s: Subtracted from time_s.
        stamp_error: One sigma, s, of the random error of each stamp of a POSITION, 0 = none: see `stamp_noise`.
        bias_state, latency_state: Index of the parameter state, or -1.
        slow_state: Index of its slow error (Gauss-Markov), or -1; a POSITION has two, this index and the next.
        scale_state, lever_state: Index of the scale (minus 1) and of the lever arm of a SPEED, or -1.
        place_m: Given lever arm, ahead and to the left of the estimated point, or None.
        ahead_state: Index of the correction of the lever arm ahead (POSITION, VELOCITY and ACCEL), or -1.
        pitch_rate: An IMU's, at its ACCEL; at a SPEED with a lever arm the one that goes with it. None: unknown.
        gate_nis: Limit of the squared normalised innovation, 0 = off; see `metrics.chi_square.nis_gate_limit`.
        floor: Least sigma of noise that is found from the log.
        interval_s: Usual time between two rows from other drives; NaN: take it from the rows; infinite: unknown,
            because later rows must not be used.
        is_exact: See `Measurements`.
        coarse_steps_m: Step of a POSITION on each axis, m, to which it is rounded or cut; see `coarse_fixes`.
    """

    source: str
    kind: Kind
    time_s: FloatArray
    values: FloatArray
    noise: FloatArray
    noise_origin: str = "default"
    latency_s: float = 0.0
    stamp_error: Parameter = NO_STAMP_ERROR
    bias_state: int = -1
    latency_state: int = -1
    slow_state: int = -1
    scale_state: int = -1
    lever_state: int = -1
    place_m: tuple[float, float] | None = None
    ahead_state: int = -1
    pitch_rate: PitchRateSeries | None = None
    gate_nis: float = 0.0
    floor: float = 0.0
    interval_s: float = float("nan")
    is_exact: bool = False
    coarse_steps_m: tuple[float, float] = (0.0, 0.0)

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def n_values_per_row(self) -> int:
        """Number of values in a row, which are its degrees of freedom."""
        return QUANTITY_BY_KIND[self.kind].width

    def select_rows(self, row_mask: npt.NDArray[np.bool_]) -> SensorSeries:
        """Return the series in the rows of a mask (n,); itself if these are all."""
        if row_mask.all():
            return self
        return replace(self, time_s=self.time_s[row_mask], values=self.values[row_mask], noise=self.noise[row_mask])

    def scale_noise_variance(self, factor: float) -> SensorSeries:
        """Return the series with its noise variance multiplied by `factor`; itself if that is 1."""
        return self if factor == 1.0 else replace(self, noise=self.noise * factor)


@dataclass(frozen=True)
class FilterStart:
    """Start of a filter pass: time and the full state with its covariance."""

    time_s: float
    state: FloatArray
    covariance: FloatArray


@dataclass(frozen=True)
class PassResult:
    """Result of a filter pass.

    Attributes:
        state: Shape (m, n): filtered or smoothed states at the output times.
        covariance: Shape (m, n, n).
        last_state, last_covariance: Filter state after the last event, (n,), (n, n).
        log_likelihood: Sum over used innovations.
        nis: Per series: shape (k, 5): see `ekf.Pass`.
        status: Per series: shape (k,): an `ekf.UpdateStatus`, or `STATUS_OF_ROW_BEFORE_START` (its nis is NaN).
    """

    state: FloatArray
    covariance: FloatArray
    last_state: FloatArray
    last_covariance: FloatArray
    log_likelihood: float
    nis: tuple[FloatArray, ...]
    status: tuple[npt.NDArray[np.int8], ...]


@dataclass(frozen=True)
class RowTimeOrder:
    """Time order of the rows of all series; it stays valid while only the noise and the motion model change.

    Attributes:
        in_time: Per series: which rows do not lie before the start.
        time_s, first, out_row, order, index: See `_merge_rows_and_outputs_into_steps`.
        patience: Shape (S,): see `_permitted_consecutive_rejections`.
    """

    in_time: list[npt.NDArray[np.bool_]]
    time_s: FloatArray
    first: IntArray
    out_row: IntArray
    order: npt.NDArray[np.intp]
    index: IntArray
    patience: IntArray

    @cached_property
    def time_rank_of_rows(self) -> npt.NDArray[np.intp]:
        """Place in time order of each row, (U,): the inverse of `order`."""
        place = np.empty_like(self.order)
        place[self.order] = np.arange(len(self.order))
        return place

    @cached_property
    def row_count_before_series(self) -> list[int]:
        """Number of rows in time of all series before each one, and of all (S + 1)."""
        return list(itertools.accumulate(map(np.count_nonzero, self.in_time), initial=0))


def find_row_time_order(
    series: Sequence[SensorSeries], start_s: float, output_s: FloatArray, reset_after: int
) -> RowTimeOrder:
    """Return the time order of the rows of a pass from `start_s` on.

    Args:
        output_s: Shape (m,), increasing, seconds: times of the output states.
        reset_after: Rejections in a row after which a source is used again.
    """
    in_time = [s.time_s - s.latency_s >= start_s - MAX_TIME_OF_USED_ROW_BEFORE_FILTER_START_S for s in series]
    series = [s.select_rows(rows) for s, rows in zip(series, in_time, strict=True)]
    patience = np.array([_permitted_consecutive_rejections(s, reset_after) for s in series], np.int32)
    return RowTimeOrder(in_time, *_merge_rows_and_outputs_into_steps(series, start_s, output_s), patience)


def run_filter_pass(
    series: Sequence[SensorSeries],
    start: FilterStart,
    motion: ekf.ProcessModel,
    output_s: FloatArray,
    *,
    smooth: bool,
    reset_after: int,
    restarts: Sequence[FilterStart] = (),
) -> PassResult:
    """Filter (and smooth) all series from `start` on.

    Args:
        series: The measurements. Rows before `start.time_s` are left out: at the start they would be old.
        start: Initial state, as long as the motion model's.
        output_s: Shape (m,), increasing; rows before the start are taken at the start.
        reset_after: See `EstimatorConfig`.
        restarts: Starts that replace the motion states at their times, in time order: see `ekf.Restarts`.
    """
    prepared = build_pass_input(series, start.time_s, output_s, reset_after=reset_after, restarts=restarts)
    return prepared.split_result_by_series(prepared.run_filter(start, motion, smooth=smooth))


@dataclass(frozen=True)
class PassInput:
    """Series in time order, ready for any number of passes that differ in the motion model alone.

    Attributes:
        values, noise: Shapes (U, 2) and (U, 3), in time order: see `ekf.Events`.
        sources: See `ekf.run`.
        n_output: Number of output states.
        time_order: Time order of the rows.
        restarts: See `run_filter_pass`.
    """

    values: FloatArray
    noise: FloatArray
    sources: ekf.SourceTable
    n_output: int
    time_order: RowTimeOrder
    restarts: ekf.Restarts | None = None

    def replace_noise(self, series: Sequence[SensorSeries]) -> PassInput:
        """Return the input of a pass over series that differ from those of this one in their noise alone."""
        return replace(self, noise=_noise_in_time_order(series, self.time_order))

    def run_filter(self, start: FilterStart, motion: ekf.ProcessModel, *, smooth: bool) -> ekf.Pass:
        """Run a pass; `nis` and `status` of the result are in time order."""
        order_of = self.time_order
        events = ekf.Events(
            time_s=order_of.time_s,
            first=order_of.first,
            out_row=order_of.out_row,
            source=order_of.index,
            values=self.values,
            noise=self.noise,
        )
        return ekf.run(
            events, self.sources, motion, start.state, start.covariance, self.n_output,
            smooth=smooth, restarts=self.restarts,
        )  # fmt: skip

    def split_result_by_series(self, result: ekf.Pass) -> PassResult:
        """Return the result with `nis` and `status` split by series, in the order of their rows."""
        order_of = self.time_order
        nis, status = (
            result.nis.take(order_of.time_rank_of_rows, axis=0),
            result.status.take(order_of.time_rank_of_rows),
        )
        found_nis, found_status = [], []
        for (i, j), rows in zip(itertools.pairwise(order_of.row_count_before_series), order_of.in_time, strict=True):
            if j - i == len(rows):
                found_nis.append(nis[i:j])
                found_status.append(status[i:j])
                continue
            found_nis.append(np.full((len(rows), 5), np.nan))
            found_status.append(np.full(len(rows), STATUS_OF_ROW_BEFORE_START, np.int8))
            found_nis[-1][rows], found_status[-1][rows] = nis[i:j], status[i:j]
        return PassResult(
            result.state,
            result.covariance,
            result.last_state,
            result.last_covariance,
            result.log_likelihood,
            tuple(found_nis),
            tuple(found_status),
        )


def build_pass_input(
    series: Sequence[SensorSeries],
    start_s: float,
    output_s: FloatArray,
    *,
    reset_after: int,
    time_order: RowTimeOrder | None = None,
    restarts: Sequence[FilterStart] = (),
) -> PassInput:
    """Put the series into time order from `start_s` on.

    Args:
        time_order: That of an earlier pass over the same times, start, outputs and patience; None: it is found.
    """
    order_of = time_order or find_row_time_order(series, start_s, output_s, reset_after)
    noise = _noise_in_time_order(series, order_of)
    series = [s.select_rows(rows) for s, rows in zip(series, order_of.in_time, strict=True)]
    values = np.concatenate([np.zeros((0, 2)), *map(_measured_values_with_pitch_rate_if_lever_arm, series)])
    sources = ekf.SourceTable(
        sensor=np.array([s.kind for s in series], np.int32),
        parameters=np.array(
            [
                (s.bias_state, s.slow_state, s.scale_state, s.lever_state, s.ahead_state, s.latency_state)
                for s in series
            ],
            np.int32,
        ).reshape(-1, 6),
        stamp_sigma_s=np.array([s.stamp_error.value for s in series], np.float64),
        place_m=np.array([s.place_m or (0.0, 0.0) for s in series], np.float64).reshape(-1, 2),
        gate_nis=np.array([s.gate_nis for s in series], np.float64),
        patience=order_of.patience,
        sender=_sender_number_by_series(series),
    )
    again = _place_restarts_in_time_order(series, start_s, order_of, restarts) if restarts else None
    values = values.take(order_of.order, axis=0)  # copies whole rows, which indexing does element by element
    return PassInput(values, noise, sources, len(output_s), order_of, again)


def _noise_in_time_order(series: Sequence[SensorSeries], order_of: RowTimeOrder) -> FloatArray:
    """Return the noise of all rows in time, (U, 3)."""
    noise = [s.noise if rows.all() else s.noise[rows] for s, rows in zip(series, order_of.in_time, strict=True)]
    return np.concatenate([np.zeros((0, 3)), *noise]).take(order_of.order, axis=0)


def _sender_number_by_series(series: Sequence[SensorSeries]) -> IntArray:
    """Return the number of the sender of each series, (S,), whose messages hold position, speed and heading; -1: none.

    A message is known by its time, so all three must have the same latency.
    """
    found = np.full(len(series), -1, np.int32)
    rows: dict[tuple[str, float], dict[Kind, int]] = {}
    for i, s in enumerate(series):
        if s.gate_nis > 0.0 and s.kind in KINDS_OF_WHOLE_MOTION_MESSAGE:
            rows.setdefault((s.source, s.latency_s), {})[s.kind] = i
    whole = [own for own in rows.values() if len(own) == len(KINDS_OF_WHOLE_MOTION_MESSAGE)]
    for number, own in enumerate(whole):
        found[list(own.values())] = number
    return found


def _place_restarts_in_time_order(
    series: Sequence[SensorSeries], start_s: float, order_of: RowTimeOrder, restarts: Sequence[FilterStart]
) -> ekf.Restarts:
    """Place each restart before the first update that is not older; restarts after the last update are left out."""
    update_s = np.concatenate([np.maximum(s.time_s - s.latency_s, start_s) for s in series])[order_of.order]
    update = np.searchsorted(update_s, [each.time_s - MAX_TIME_OF_USED_ROW_BEFORE_FILTER_START_S for each in restarts])
    restarts = [each for each, u in zip(restarts, update, strict=True) if u < len(update_s)]
    step = np.searchsorted(order_of.first, update[: len(restarts)], side="right") - 1
    return ekf.Restarts(
        step=step.astype(np.int32),
        state=np.array([each.state[:N_MOTION_STATES] for each in restarts]).reshape(-1, N_MOTION_STATES),
        variance=np.array([np.diagonal(each.covariance)[:N_MOTION_STATES] for each in restarts]).reshape(
            -1, N_MOTION_STATES
        ),
    )


def _measured_values_with_pitch_rate_if_lever_arm(s: SensorSeries) -> FloatArray:
    """Return the values (n, 2) for the kernel; the second column of a speed with a lever arm is the pitch rate."""
    if s.pitch_rate is None or s.lever_state < 0:
        return s.values
    return np.column_stack([s.values[:, 0], s.pitch_rate.interpolate_rate_radps(s.time_s - s.latency_s)])


def notes_on_rows_before_start(series: Sequence[SensorSeries], result: PassResult) -> list[str]:
    """Return notes on rows that are earlier than the start of the filter."""
    return [
        f"{s.source}: {n} {s.kind.name.lower()} rows before the first heading, left out of the filter"
        for s, status in zip(series, result.status, strict=True)
        if (n := int((status == STATUS_OF_ROW_BEFORE_START).sum()))
    ]


def _permitted_consecutive_rejections(s: SensorSeries, reset_after: int) -> int:
    """Return the number of rejections in a row after which a source is used again.

    It is at most `reset_after`, and at most `MAX_REJECTION_TIME_OF_SLOW_SOURCE_S` of a slow source. Where the rate of
    the rows is unknown it is two, and the kernel's own limit in seconds applies.
    """
    if s.kind in KINDS_THAT_IMU_MEASURES_TOO:
        return MAX_CONSECUTIVE_IMU_REJECTIONS
    interval_s = s.interval_s
    if not interval_s > 0.0:
        if len(s) < 2:
            return reset_after
        interval_s = median_of_finite_values(np.diff(s.time_s))
    return int(np.clip(MAX_REJECTION_TIME_OF_SLOW_SOURCE_S / max(interval_s, 1e-3), 2, reset_after))


def _merge_rows_and_outputs_into_steps(
    series: Sequence[SensorSeries], start_s: float, output_s: FloatArray
) -> tuple[FloatArray, IntArray, IntArray, npt.NDArray[np.intp], IntArray]:
    """Merge measurement and output times into steps.

    Returns:
        Step times; first update of each step; output row of each step; update order; series of each update.
    """
    stamps = [np.maximum(s.time_s - s.latency_s, start_s) for s in series]
    update_s = np.concatenate(stamps) if stamps else np.zeros(0)
    which = np.repeat(np.arange(len(series), dtype=np.int32), [len(s) for s in series])
    order = np.argsort(update_s, kind="stable")
    update_s = update_s[order]
    time, first, out_row = lay_steps(
        update_s,
        np.maximum(output_s, start_s),
        start_s=start_s,
        max_step_s=MAX_PREDICTION_STEP_S,
        max_pieces=MAX_COUNTED_PREDICTION_STEPS_OF_GAP,
    )
    return _shorten_long_pauses(time), first, out_row, order, np.ascontiguousarray(which[order])


def _shorten_long_pauses(time_s: FloatArray) -> FloatArray:
    """Return the step times with each gap of more than `MAX_COUNTED_PREDICTION_STEPS_OF_GAP` steps shortened to that.

    Only differences matter. Times before a gap stay the same to the bit, so that the gap changes no earlier state.
    """
    step_s = np.diff(time_s)
    is_long = step_s > MAX_PREDICTION_STEP_S + MAX_TIME_OF_USED_ROW_BEFORE_FILTER_START_S
    if not is_long.any():
        return np.ascontiguousarray(time_s)
    excess_s = np.where(is_long, step_s - MAX_PREDICTION_STEP_S, 0.0)
    return np.ascontiguousarray(time_s - np.concatenate(([0.0], np.cumsum(excess_s))))
