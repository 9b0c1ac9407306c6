"""Compare the clock of each source with the log's: steps in mid-log, and constant offsets between sources.

The delay of a message is its log time less its stamp. A clock that steps changes the delay of all later messages at
once, while neither the messages nor the other sources pause. A clock that is ahead gives stamps that are later than the
log times. Both are corrected by the log times. A clock that is behind looks like a slow transmission: it is corrected
where the motion then fits.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.median import median_of_finite_values
from cwcli.estimation.model import MotionParameters
from cwcli.estimation.noise import estimate_noise_and_manoeuvres
from cwcli.estimation.prepare import clean_and_sort_measurements_and_note, earliest_stamp_ns
from cwcli.estimation.score import bounded_log_likelihood_without_inertial_sensors
from cwcli.estimation.sensor_model import StateLayout
from cwcli.estimation.trial import FilterTrials, with_outlier_gate
from cwcli.estimation.tune import add_bias_states_and_their_variances
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.signals.columns import FloatArray, Int64Array, median_of_values, sort_distinct_values
from cwcli.signals.units import NS_PER_S

MIN_CLOCK_STEP_S = 0.3
"""Least step or offset of a clock, s. Chosen above the delays of usual links; the search for latencies finds less."""
MIN_ROWS_BESIDE_CLOCK_STEP, MIN_TIME_BESIDE_CLOCK_STEP_S = 10, 3.0
"""Least number of rows and least time (s) on either side of a step for which a delay has to last. Chosen: a recorder
that stalls catches up sooner."""
MAX_TRANSMISSION_DELAY_S = 30.0
"""Longest delay of a transmission, s; a longer one is another clock. Chosen as
`signals.clocks.MAX_FAULTLESS_STEP_OF_STAMP_OFFSET_S`."""
EARLIEST_LOG_TIME_NS = int(np.iinfo(np.int64).min)
"""Log time in ns that is earlier than all others: the least int64."""
MIN_LOG_LIKELIHOOD_GAIN_OF_SHIFT = 25.0
"""Least gain of log-likelihood of a motion with a clock that is behind. Chosen: seven sigma, because errors last."""
MIN_REPEATED_STAMPS_OF_COARSE_STAMPING_SHARE = 0.5
"""Least share of messages with the stamp of the message before them that shows stamps cut to a coarse unit. Chosen: of
two messages a second stamped in whole seconds half have it."""
MAX_CLOCK_RATE_RATIO = 1.01
"""Greatest rate of a clock against the log's, and the inverse of the least one; beyond it the stamps are in another
unit, as milliseconds that are written as seconds, or are counted at a rate that the sensor has not. Chosen far above
the drift of a quartz, 0.01 %."""
WHOLE_SECONDS_TOLERANCE_S = 0.2
"""Greatest distance in s of an offset from whole seconds (time zones, leap seconds) that counts as whole. Chosen above
usual delays."""


@dataclass(frozen=True)
class ClockStep:
    """A lasting change of a source's delay.

    Attributes:
        log_ns: Log time of the first message behind it.
        change_s: Delay after it less the delay before it.
        is_of_stamps: The stamps jumped; else the log times did.
    """

    log_ns: int
    change_s: float
    is_of_stamps: bool


@dataclass(frozen=True)
class SourceClock:
    """Delays of a source.

    Attributes:
        log_ns: Shape (n,), increasing.
        stamp_ns, delay_s: Shape (n,), in the same order.
        steps: In time order.
    """

    log_ns: Int64Array
    stamp_ns: Int64Array
    delay_s: FloatArray
    steps: tuple[ClockStep, ...]

    @property
    def row_slices_between_steps(self) -> list[slice]:
        """Rows between two steps of the stamps."""
        edges = np.searchsorted(self.log_ns, [step.log_ns for step in self.steps if step.is_of_stamps])
        return [slice(i, j) for i, j in zip([0, *edges.tolist()], [*edges.tolist(), len(self.log_ns)], strict=True)]


def align_source_clocks_and_note(
    measurements: Sequence[Measurements], *, corrects: bool = True, trusted: Sequence[str] = ()
) -> tuple[list[Measurements], list[str]]:
    """Correct the stamps of sources whose clock steps or is off by more than a link can delay.

    Args:
        measurements: Measurements as read.
        corrects: Whether stamps are corrected; else only the notes are given.
        trusted: Sources whose stamps stay as they are, because the user said how late they are.

    Returns:
        The measurements, and what the user is told.
    """
    original_measurements = measurements
    # Of stamps that are cut to 1 s a short log shows another rate.
    measurements, coarse = _replace_coarse_stamps_and_note(measurements, trusted)
    measurements, wrong_units = _replace_stamps_of_wrong_rate_and_note(measurements, trusted)
    clocks = {
        source: clock
        for source in dict.fromkeys(m.source for m in measurements)
        if (clock := _delays_of_source_or_none([m for m in measurements if m.source == source])) is not None
    }
    shifts_s: dict[str, list[tuple[int, float]]] = {}
    notes = [*coarse, *wrong_units]
    for source in [s for s in clocks if s not in trusted]:
        found = [
            *_log_times_and_shifts_at_own_clock_steps(source, clocks, notes),
            *_log_times_and_shifts_at_steps_of_log_clock(source, clocks, notes),
        ]
        if found:
            shifts_s[source] = found
    stepped = [
        _shift_stamps_of_measurements(m, shifts_s[m.source]) if m.source in shifts_s else m for m in measurements
    ]
    delays_s = {
        source: _median_delay_after_shifts_s(clock, shifts_s.get(source, [])) for source, clock in clocks.items()
    }
    offsets_s = {
        s: o for s in delays_s if s not in trusted and (o := _offset_from_other_clocks_s(s, delays_s, stepped, notes))
    }
    if not corrects:
        return list(original_measurements), [f"{note}; not corrected, because the stamps are trusted" for note in notes]
    return [
        _shift_stamps_of_measurements(m, [(EARLIEST_LOG_TIME_NS, offsets_s[m.source])]) if m.source in offsets_s else m
        for m in stepped
    ], notes


def _replace_stamps_of_wrong_rate_and_note(
    measurements: Sequence[Measurements], trusted: Sequence[str]
) -> tuple[list[Measurements], list[str]]:
    """Replace stamps that do not run with the log by log times, where half of the sources run with it."""
    rates = [_clock_rate_or_nan_and_time_s(m) for m in measurements]
    is_wrong = [
        (rate > MAX_CLOCK_RATE_RATIO or rate < 1.0 / MAX_CLOCK_RATE_RATIO)
        and abs(rate - 1.0) * log_s > MIN_CLOCK_STEP_S
        for rate, log_s in rates
    ]
    if 2 * sum(is_wrong) > sum(np.isfinite(rate) for rate, _ in rates):
        return list(measurements), []
    notes = {
        m.source: f"{m.source}: its stamps run {rate:.3g} times as fast as the log, as in another unit or counted at "
        "another rate; its log times take their place"
        for m, (rate, _), wrong in zip(measurements, rates, is_wrong, strict=True)
        if wrong and m.source not in trusted
    }
    return [replace(m, stamp_ns=m.received_ns.copy()) if m.source in notes else m for m in measurements], list(
        notes.values()
    )


def _clock_rate_or_nan_and_time_s(m: Measurements) -> tuple[float, float]:
    """Return the time that passes in the stamps over that in the log times, and the latter, s; NaN with too few rows.

    They are medians over a tenth of the rows, which steps and pauses do not change.
    """
    if len(m) < 2 * MIN_ROWS_BESIDE_CLOCK_STEP:
        return float("nan"), 0.0
    order = np.argsort(m.received_ns, kind="stable")
    lag = len(m) // 10
    stamps_ns, log_ns = (
        median_of_finite_values((each[order][lag:] - each[order][:-lag]).astype(np.float64))
        for each in (m.stamp_ns, m.received_ns)
    )
    return (stamps_ns / log_ns, log_ns / NS_PER_S) if log_ns > 0 else (float("nan"), 0.0)


def _replace_coarse_stamps_and_note(
    measurements: Sequence[Measurements], trusted: Sequence[str]
) -> tuple[list[Measurements], list[str]]:
    """Replace stamps that are cut to whole seconds or the like by the log times less the least delay.

    Messages that arrive one after the other have the same stamp there. The least difference of log time and stamp is
    the delay of a message whose stamp lost next to nothing.
    """
    found: list[Measurements] = []
    notes: dict[str, str] = {}
    for m in measurements:
        stamped = m
        if m.source not in trusted and len(m) >= 2 * MIN_ROWS_BESIDE_CLOCK_STEP and not m.is_exact:
            spread = _spread_rows_of_equal_stamp_and_step_s(m) if (m.received_ns == m.stamp_ns).all() else None
            if spread is not None:
                stamped = spread[0]
                notes[m.source] = (
                    f"{m.source}: its stamps are cut to {spread[1]:.2g} s, and its log times too; the rows of each are "
                    "spread evenly"
                )
                found.append(stamped)
                continue
            order = np.argsort(m.received_ns, kind="stable")
            log_ns, stamp_ns = m.received_ns[order], m.stamp_ns[order]
            is_equal = np.diff(stamp_ns) == 0
            is_coarse = (
                is_equal.mean() >= MIN_REPEATED_STAMPS_OF_COARSE_STAMPING_SHARE
                and (np.diff(log_ns)[is_equal] > 0).mean() > 0.9
            )
            if is_coarse and len(sort_distinct_values(stamp_ns)) > MIN_ROWS_BESIDE_CLOCK_STEP:
                step_s = median_of_finite_values(np.diff(sort_distinct_values(stamp_ns))) / NS_PER_S
                least_ns = int((log_ns - stamp_ns).min())
                notes[m.source] = (
                    f"{m.source}: its stamps are cut to {step_s:.2g} s; the log times less {least_ns / NS_PER_S:.3f} s "
                    "take their place"
                )
                stamped = replace(m, stamp_ns=m.received_ns - least_ns)
            elif (
                is_equal.sum() >= MIN_ROWS_BESIDE_CLOCK_STEP
                and (moved := _move_rows_of_equal_stamp_into_pauses_and_count(m)) is not None
            ):
                stamped = moved[0]
                notes[m.source] = (
                    f"{m.source}: its stamps repeat in {moved[1]} of {len(m)} rows with other values, beside pauses: "
                    "those rows are spread over the pauses"
                )
        found.append(stamped)
    return found, list(notes.values())


def _spread_rows_of_equal_stamp_and_step_s(m: Measurements) -> tuple[Measurements, float] | None:
    """Return the measurements with the rows of each cut stamp spread evenly behind it, and the step of the stamps, s.

    Row j of k rows with one stamp is taken to be measured (j + 1/2) / k steps after it. The first stamp may have only
    the last of its rows, and the last stamp only the first ones. None where the stamps are not cut: most rows share
    theirs with another value, and all stamps are whole multiples of one step.
    """
    stamp_ns, first, size = np.unique(m.stamp_ns, return_index=True, return_counts=True)
    if len(stamp_ns) <= MIN_ROWS_BESIDE_CLOCK_STEP or not (np.diff(m.stamp_ns) >= 0).all():
        return None
    is_equal = np.diff(m.stamp_ns) == 0
    is_new = (np.diff(m.values, axis=0) != 0.0).any(axis=1)
    step_ns = int(np.min(np.diff(stamp_ns)))
    if (is_equal & is_new).mean() < MIN_REPEATED_STAMPS_OF_COARSE_STAMPING_SHARE or (stamp_ns % step_ns).any():
        return None
    usual = int(median_of_values(size))
    n_rows = size.copy()
    n_rows[[0, -1]] = np.maximum(size[[0, -1]], usual)
    order = np.arange(len(m)) - np.repeat(first, size)
    order[: size[0]] += n_rows[0] - size[0]
    share = (order + 0.5) / np.repeat(n_rows, size)
    spread_ns = m.stamp_ns + np.rint(share * step_ns).astype(np.int64)
    return replace(m, stamp_ns=spread_ns, log_time_ns=None if m.log_time_ns is None else spread_ns), step_ns / NS_PER_S


def _move_rows_of_equal_stamp_into_pauses_and_count(m: Measurements) -> tuple[Measurements, int] | None:
    """Return the measurements with rows of one stamp spread over the pause beside it, and how many were moved.

    A driver that stamps two rows alike leaves a pause as long as what is missing, before or behind them. None where
    there are hardly any, or stamps are not in order.
    """
    stamp_ns, first, size = np.unique(m.stamp_ns, return_index=True, return_counts=True)
    if len(stamp_ns) < len(m) * MIN_REPEATED_STAMPS_OF_COARSE_STAMPING_SHARE or not (np.diff(m.stamp_ns) >= 0).all():
        return None
    gap_ns = np.diff(stamp_ns)
    usual_ns = median_of_finite_values(gap_ns.astype(np.float64))
    is_long = [
        np.abs(np.append(gap_ns, 0) - size * usual_ns) < 0.25 * usual_ns,
        np.abs(np.append(0, gap_ns) - size * usual_ns) < 0.25 * usual_ns,
    ]
    moved_ns = m.stamp_ns.copy()
    n_moved = 0
    for k in np.flatnonzero((size > 1) & (is_long[0] | is_long[1])).tolist():
        rows = np.arange(first[k], first[k] + size[k])
        if not (np.diff(m.values[rows], axis=0) != 0.0).any(axis=1).all():
            continue
        order = np.arange(size[k]) - (0 if is_long[0][k] else size[k] - 1)
        moved_ns[rows] += np.rint(order * usual_ns).astype(np.int64)
        n_moved += int(size[k]) - 1
    if n_moved < MIN_ROWS_BESIDE_CLOCK_STEP:
        return None
    return replace(m, stamp_ns=moved_ns), n_moved


def notes_on_hidden_clock_steps(measurements: Sequence[Measurements], sources: Sequence[str]) -> list[str]:
    """Return a note for each of some sources whose stamps are its log times: those do not show a step of its clock."""
    return [
        f"{source}: its stamps are its log times, so that a step of its clock cannot be seen: check its recording"
        for source in dict.fromkeys(sources)
        if all(
            m.log_time_ns is not None and (m.log_time_ns == m.stamp_ns).all()
            for m in measurements
            if m.source == source
        )
    ]


def _delays_of_source_or_none(source_measurements: Sequence[Measurements]) -> SourceClock | None:
    """Return the delays of a source by the quantity with the most rows; None with too few rows."""
    m = max(source_measurements, key=len)
    if len(m) < 2 * MIN_ROWS_BESIDE_CLOCK_STEP:
        return None
    order = np.argsort(m.received_ns, kind="stable")
    log_ns, stamp_ns = m.received_ns[order], m.stamp_ns[order]
    delay_s = (log_ns - stamp_ns) / NS_PER_S
    return SourceClock(log_ns, stamp_ns, delay_s, tuple(_find_clock_steps(log_ns, stamp_ns, delay_s)))


def _find_clock_steps(log_ns: Int64Array, stamp_ns: Int64Array, delay_s: FloatArray) -> list[ClockStep]:
    """Find the rows at which the delay changes for good."""
    jumps = np.flatnonzero(np.abs(np.diff(delay_s)) > MIN_CLOCK_STEP_S) + 1
    if not len(jumps):
        return []
    stamp_step_s, log_step_s = np.diff(stamp_ns) / NS_PER_S, np.diff(log_ns) / NS_PER_S
    usual_s = median_of_finite_values(log_step_s)
    reach = max(MIN_ROWS_BESIDE_CLOCK_STEP, int(np.ceil(MIN_TIME_BESIDE_CLOCK_STEP_S / max(usual_s, 1e-3))))
    found = []
    for k in jumps.tolist():
        if min(k, len(log_ns) - k) < MIN_ROWS_BESIDE_CLOCK_STEP:
            continue
        before, after = delay_s[max(k - reach, 0) : k], delay_s[k : k + reach]
        change_s = median_of_finite_values(after) - median_of_finite_values(before)
        scatter_s = max(
            median_of_finite_values(np.abs(part - median_of_finite_values(part))) for part in (before, after)
        )
        if abs(change_s) < max(MIN_CLOCK_STEP_S, 6.0 * scatter_s):
            continue
        is_of_stamps = abs(stamp_step_s[k - 1] - usual_s) > abs(log_step_s[k - 1] - usual_s)
        found.append(ClockStep(int(log_ns[k]), change_s, bool(is_of_stamps)))
    return found


def _log_times_and_shifts_at_own_clock_steps(
    source: str, clocks: dict[str, SourceClock], notes: list[str]
) -> list[tuple[int, float]]:
    """Return from which log time on the stamps of a source move by how many seconds, for steps that it alone has."""
    clock = clocks[source]
    own = [step for step in clock.steps if step.is_of_stamps]
    if not own:
        return []
    pieces_s = [median_of_finite_values(clock.delay_s[piece]) for piece in clock.row_slices_between_steps]
    others_s = [
        median_of_finite_values(other.delay_s) for name, other in clocks.items() if name != source and not other.steps
    ]
    if others_s:
        right_s = min(pieces_s, key=lambda each: abs(each - median_of_finite_values(np.array(others_s))))
    else:
        right_s = pieces_s[int(np.argmax([piece.stop - piece.start for piece in clock.row_slices_between_steps]))]
    shifts, so_far_s = [], 0.0
    for piece, delay_s in zip(clock.row_slices_between_steps, pieces_s, strict=True):
        shift_s = delay_s - right_s if abs(delay_s - right_s) > 0.5 * MIN_CLOCK_STEP_S else 0.0
        if shift_s != so_far_s:
            shifts.append((int(clock.log_ns[piece.start]), shift_s - so_far_s))
        so_far_s = shift_s
        if shift_s:
            span_s = (clock.log_ns[piece.stop - 1] - clock.log_ns[piece.start]) / NS_PER_S
            notes.append(
                f"{source}: its clock is {-shift_s:+.2f} s off for {span_s:.0f} s "
                f"({piece.stop - piece.start} messages), corrected by the log times"
            )
    return shifts


def _log_times_and_shifts_at_steps_of_log_clock(
    source: str, clocks: dict[str, SourceClock], notes: list[str]
) -> list[tuple[int, float]]:
    """Return the shifts of a source whose stamps are made by the log's clock, where that clock steps.

    Another source's stamps run on there, and this source pauses for as long as the clock steps.
    """
    clock = clocks[source]
    shifts: list[tuple[int, float]] = []
    for other, theirs in clocks.items():
        for step in theirs.steps:
            if other == source or step.is_of_stamps or step.change_s < 0.0 or clock.steps:
                continue
            search_ns = step.log_ns - round((step.change_s + 1.0) * NS_PER_S)
            k = max(int(np.searchsorted(clock.log_ns, search_ns)) - 1, 0)
            near = slice(k, int(np.searchsorted(clock.log_ns, step.log_ns + NS_PER_S)) + 1)
            pause_s = np.diff(clock.stamp_ns[near]) / NS_PER_S
            if len(pause_s) and float(pause_s.max()) > 0.9 * step.change_s:
                begin_ns = int(clock.log_ns[k + int(pause_s.argmax()) + 1])
                if any(begin_ns == known_ns for known_ns, _ in shifts):  # another source shows the same step
                    continue
                shifts.append((begin_ns, -step.change_s))
                notes.append(
                    f"{source}: the log's clock steps by {step.change_s:+.2f} s against {other}, and its stamps with "
                    "it, corrected"
                )
    return shifts


def _median_delay_after_shifts_s(clock: SourceClock, shifts: Sequence[tuple[int, float]]) -> float:
    """Return the median delay of a source after its stamps are shifted, s."""
    delay_s = clock.delay_s
    for log_ns, shift_s in shifts:
        delay_s = delay_s - shift_s * (clock.log_ns >= log_ns)
    return median_of_finite_values(delay_s)


def _offset_from_other_clocks_s(
    source: str, delays_s: dict[str, float], measurements: Sequence[Measurements], notes: list[str]
) -> float:
    """Return by how much all stamps of a source move, s; 0 where its clock is that of the others, or may be."""
    delay_s = delays_s[source]
    apart_s = delay_s - _delay_of_most_sources_s(delays_s)
    if abs(apart_s) < MIN_CLOCK_STEP_S:
        return 0.0
    whole_s = float(np.rint(apart_s))
    is_whole = whole_s != 0.0 and abs(apart_s - whole_s) < WHOLE_SECONDS_TOLERANCE_S
    shift_s = whole_s if is_whole else apart_s
    # A message cannot be logged before its stamp; where all stamps are from another time, only much counts.
    is_ahead = apart_s < 0.0 and (delay_s < -MIN_CLOCK_STEP_S or apart_s < -1.0)
    may_be_behind = is_whole and apart_s > 0.0
    is_other_clock = is_ahead or apart_s > MAX_TRANSMISSION_DELAY_S
    same_clock = [name for name, each_s in delays_s.items() if abs(each_s - delay_s) < MIN_CLOCK_STEP_S]
    if is_other_clock or (may_be_behind and is_log_likelier_when_shifted(measurements, same_clock, shift_s)):
        why = "corrected by the log times" if is_other_clock else "corrected, because the motion then fits"
        notes.append(f"{source}: its clock is {-shift_s:+.2f} s off those of the other sources, {why}")
        return shift_s
    return 0.0


def is_log_likelier_when_shifted(measurements: Sequence[Measurements], sources: Sequence[str], shift_s: float) -> bool:
    """Return whether the filter predicts all sources clearly better when the stamps of some move by `shift_s`."""
    shifted = [
        _shift_stamps_of_measurements(m, [(EARLIEST_LOG_TIME_NS, shift_s)]) if m.source in sources else m
        for m in measurements
    ]
    found = [_motion_log_likelihood(each) for each in (measurements, shifted)]
    return found[1] - found[0] > MIN_LOG_LIKELIHOOD_GAIN_OF_SHIFT


def _motion_log_likelihood(measurements: Sequence[Measurements]) -> float:
    """Return the log-likelihood of the rows after all before them, with the noise that goes with them."""
    prepared, _ = clean_and_sort_measurements_and_note(measurements, earliest_stamp_ns(measurements))
    series, walk, prior = add_bias_states_and_their_variances(prepared, MotionParameters())
    if not any(s.kind is Kind.POSITION and len(s) for s in series):
        return float("nan")
    layout = estimate_noise_and_manoeuvres(StateLayout(series, MotionParameters(), walk, prior), every_row=False)
    gated = [with_outlier_gate(s) for s in layout.series]
    return bounded_log_likelihood_without_inertial_sensors(
        gated, FilterTrials().run_filter(replace(layout, series=gated))
    )


def _delay_of_most_sources_s(delays_s: dict[str, float]) -> float:
    """Return the delay (s) on which most sources agree; of as many the one that is nearer to the log times."""
    values_s = np.array(list(delays_s.values()))
    groups = [values_s[np.abs(values_s - each) < MIN_CLOCK_STEP_S] for each in values_s]
    return median_of_finite_values(max(groups, key=lambda group: (len(group), -abs(median_of_finite_values(group)))))


def _shift_stamps_of_measurements(m: Measurements, shifts: Sequence[tuple[int, float]]) -> Measurements:
    """Return the measurements with moved stamps, in the order of their stamps."""
    stamp_ns = m.stamp_ns.copy()
    for log_ns, shift_s in shifts:
        stamp_ns[m.received_ns >= log_ns] += round(shift_s * NS_PER_S)
    shifted = replace(m, stamp_ns=stamp_ns)
    order = np.argsort(stamp_ns, kind="stable")
    if (order == np.arange(len(order))).all():
        return shifted
    return shifted.select_rows(order)
