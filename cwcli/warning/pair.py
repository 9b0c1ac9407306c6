"""Evaluate pairs of vehicles: from their predicted paths to warning events."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, fields
from functools import partial
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass, replace
from cwcli.measures.outlines import LengthAndWidthM
from cwcli.signals.columns import BoolArray, FloatArray, Int64Array, sort_distinct_values
from cwcli.signals.vehicle_state import SPEED
from cwcli.warning.braking_horizon import measure_to_braking_horizon
from cwcli.warning.collision import PathPairs
from cwcli.warning.events import EventSpan, EventTiming, find_events
from cwcli.warning.kinds import WarningKind, kind_of_each_warning
from cwcli.warning.measures import (
    MEASURE_ARRAY_NAMES,
    MIN_HORIZON_DISTANCE_ADVANTAGE_OF_ONSET_PATH_M,
    Measures,
    add_contact_probabilities,
    measure_paths,
)
from cwcli.warning.remote_alignment import PathPoints, StatePairing, interpolate_paths, pair_with_newest_state
from cwcli.warning.rule_inputs import OtherRowsPathRowsAges, evaluate_named_measures, pair_states_at_moments
from cwcli.warning.rules.base import Decision, Rule, leave_out_raised_warnings, withhold_warnings
from cwcli.warning.types import PathArrays, VehicleTrack, WarningConfig

Rows = npt.NDArray[np.intp]

MAX_EVALUATED_PAIR_GAP_BEYOND_COLLISION_DISTANCE_M = 15.0
"""Distance in m beyond the collision distance up to which a pair counts as within reach and is evaluated. Chosen by
hand."""
MAX_NEAR_PAIR_GAP_BEYOND_COLLISION_DISTANCE_M = 6.0
"""Distance in m beyond the collision distance up to which a pair is measured at every path point. Chosen by hand."""
PATH_POINT_STRIDE_OF_DISTANT_PAIRS = 5
"""Stride of the path points at which pairs that are not near are measured: every fifth. Chosen by hand."""
MAX_STANDSTILL_SPEED_MPS = 0.5
"""Speed in m/s below which a vehicle counts as standing: its onset of a manoeuvre is noise. Chosen by hand; not
fitted."""


@dataclass(frozen=True)
class PairEvaluation:
    """All evaluations of one pair, and the warnings that follow from them.

    Attributes:
        other: The other vehicle.
        stamp_ns, log_time_ns, age_s: Shape (m,): the evaluations within reach.
        known_ns: Shape (m,): when each could have been known, on the clock of the stamps.
        measures, decision: Their measures and the rule's masks.
        spans: Events, indices into the evaluations.
        is_withheld: Shape (m,): one of the states is starting, after a reset or in a gap, so nothing is raised.
        n_evaluated, n_out_of_reach, n_without_message, n_stale, n_beyond_path, n_not_finite: Counts of host stamps.
        n_withheld: Number of warnings that were not raised because of such states.
        kinds: Shape (m,): the `WarningKind` of each evaluation at which the rule raises.
        n_left_out: Number of warnings that were not given, by the kinds that are off.
    """

    other: VehicleTrack
    stamp_ns: Int64Array
    log_time_ns: Int64Array
    known_ns: Int64Array
    age_s: FloatArray
    measures: Measures
    decision: Decision
    spans: list[EventSpan]
    is_withheld: BoolArray
    n_evaluated: int
    n_out_of_reach: int
    n_without_message: int
    n_stale: int
    n_beyond_path: int
    n_not_finite: int
    n_withheld: int
    kinds: npt.NDArray[np.int8]
    n_left_out: Mapping[WarningKind, int]

    @property
    def probability(self) -> FloatArray:
        """Probability of a collision within the horizon, by the hypothesis that the warning states, (m,)."""
        shown = self.decision.probability
        return self.measures.probability if shown is None else shown

    @property
    def alert_probability(self) -> FloatArray:
        """The probability that the rule compares with its threshold, (m,); NaN for a rule without one."""
        compared = self.decision.alert_probability
        return np.full(len(self.stamp_ns), np.nan) if compared is None else compared


HOST_STAMPS_PER_WINDOW = 512
"""Number of host stamps whose paths are in memory at a time; the result does not depend on it. Chosen by hand."""


def evaluate_pairs(
    host: VehicleTrack,
    others: Sequence[VehicleTrack],
    rule: Rule,
    config: WarningConfig,
    time_s: FloatArray,
    *,
    window_rows: int = HOST_STAMPS_PER_WINDOW,
) -> tuple[PairEvaluation, ...]:
    """Evaluate the host with each of the others at the host's stamps, some stamps at a time.

    Args:
        time_s: Shape (q,): times along the paths, from 0 to the horizon plus the rule's persistence.
    """
    persistence_s = rule.persistence_s if config.persistence_s is None else config.persistence_s
    pairings = [pair_with_newest_state(host, other, config.use, config.max_age_s) for other in others]
    paired = list(zip(others, pairings, strict=True))
    windows_of_pairs = [_PairWindows() for _ in others]
    for first in range(0, len(host.stamp_ns), window_rows):
        last = min(first + window_rows, len(host.stamp_ns))
        own = host.paths.paths_of_rows(np.arange(first, last))
        points = interpolate_paths(own, np.arange(last - first), np.zeros(last - first), time_s)
        for k, (other, pairing) in enumerate(paired):
            a, b = np.searchsorted(pairing.host_row, [first, last])
            if a < b or windows_of_pairs[k].is_empty:  # a pair that never meets has one window without rows
                rows = pairing.host_row[a:b] - first, pairing.other_row[a:b], pairing.age_s[a:b]
                window = _HostWindow(host, other, own, points, first)
                windows_of_pairs[k].append(_evaluate_window(window, rows, rule, config, persistence_s, time_s))
    evaluations = []
    for other, pairing in paired:
        joined = windows_of_pairs.pop(0).join()  # the blocks of the pairs are let go one after the other
        evaluations.append(_find_events_of_pair(host, other, pairing, joined, config, persistence_s))
    return tuple(evaluations)


@dataclass(frozen=True)
class _HostWindow:
    """Some of the host's stamps: its paths there, and their points at the times along them."""

    host: VehicleTrack
    other: VehicleTrack
    paths: PathArrays
    points: PathPoints
    first: int


@dataclass(frozen=True)
class _WindowEvaluation:
    """The evaluations within reach in one window: rows of the whole tracks, measures and decisions."""

    host_row: Rows
    other_row: Rows
    age_s: FloatArray
    measures: Measures
    decision: Decision
    n_beyond_path: int
    kinds: npt.NDArray[np.int8]


MIN_ROWS_PER_BLOCK = 1 << 15
"""Number of evaluations that are joined to one block: its arrays are then large enough for the file of large arrays
(`array_memory`); the result does not depend on it. Chosen by hand."""


@dataclass
class _PairWindows:
    """The evaluations of one pair: windows, joined to a block each time that they have rows enough."""

    _blocks: list[_WindowEvaluation] = field(default_factory=list)
    _windows: list[_WindowEvaluation] = field(default_factory=list)
    _n_rows: int = 0

    @property
    def is_empty(self) -> bool:
        """Whether nothing was appended yet."""
        return not self._blocks and not self._windows

    def append(self, window: _WindowEvaluation) -> None:
        """Append the evaluations of the next window."""
        self._windows.append(window)
        self._n_rows += len(window.host_row)
        if self._n_rows >= MIN_ROWS_PER_BLOCK:
            self._blocks.append(_join_windows(self._windows))
            self._windows.clear()
            self._n_rows = 0

    def join(self) -> _WindowEvaluation:
        """Return the evaluations of all windows as one."""
        return _join_windows([*self._blocks, *self._windows])


def _evaluate_window(
    window: _HostWindow,
    at_moments: OtherRowsPathRowsAges,
    rule: Rule,
    config: WarningConfig,
    persistence_s: float,
    time_s: FloatArray,
) -> _WindowEvaluation:
    """Evaluate one window; the first rows of `at_moments` are those of the window."""
    host, other = window.host, window.other
    chosen, place = np.unique(at_moments[1], return_inverse=True)
    theirs = other.paths.paths_of_rows(chosen)
    looks_farther = rule.uses_braking_horizon and config.max_horizon_s > config.horizon_s
    span_s = max(float(time_s[-1]), config.max_horizon_s + persistence_s) if looks_farther else float(time_s[-1])
    within = np.flatnonzero(_within_reach_mask(window.paths, theirs, at_moments[0], place, span_s, config))
    host_row, other_row, age_s = at_moments[0][within], at_moments[1][within], at_moments[2][within]
    place = place[within]
    near = (host_row, place, age_s)
    sizes = host.length_and_width_m, other.length_and_width_m
    measures, beyond = _measures_and_short_paths_coarse_then_fine(window.points, theirs, near, time_s, config, sizes)
    pairs = PathPairs(window.paths, theirs, *near, *sizes)
    judge_at_times = partial(
        add_contact_probabilities,
        time_s=time_s,
        horizon_s=config.horizon_s,
        min_probability_to_brake=config.probability,
        braking_deceleration_mps2=config.min_deceleration_mps2 if rule.uses_braking else 0.0,
    )
    measures = judge_at_times(measures, pairs)
    onset = None
    if rule.uses_onset and other.onset_paths is not None:
        begun = other.onset_paths.paths_of_rows(chosen)
        onset, _ = _measures_and_short_paths_coarse_then_fine(window.points, begun, near, time_s, config, sizes)
        nearer = onset.horizon_distance_m < measures.horizon_distance_m - MIN_HORIZON_DISTANCE_ADVANTAGE_OF_ONSET_PATH_M
        nearer &= np.abs(other.state[other_row, SPEED]) > MAX_STANDSTILL_SPEED_MPS
        begun_pairs = replace(pairs, other=begun)
        onset = judge_at_times(onset, begun_pairs, is_wanted=nearer)
        if looks_farther:
            onset = replace(
                onset, farther=measure_to_braking_horizon(onset, begun_pairs, config, persistence_s, is_wanted=nearer)
            )
    of_moment = host, other, window.first + host_row, theirs, (other_row, place, age_s)
    states = pair_states_at_moments(*of_moment) if rule.uses_states else None
    measures_with_horizon = replace(measures, by_name=evaluate_named_measures(rule.measures, *of_moment), states=states)
    if looks_farther:
        measures_with_horizon = replace(
            measures_with_horizon, farther=measure_to_braking_horizon(measures, pairs, config, persistence_s)
        )
    decision = rule.decide(measures_with_horizon, onset, config, persistence_s)
    kinds = np.zeros(len(host_row), np.int8)
    if rule.leaves_out_kinds:
        raised = np.flatnonzero(decision.raised if decision.at_once is None else decision.raised | decision.at_once)
        if len(raised):
            at_raised = host, other, window.first + host_row[raised], theirs
            states_at_warnings = pair_states_at_moments(*at_raised, (other_row[raised], place[raised], age_s[raised]))
            kinds[raised] = kind_of_each_warning(states_at_warnings)
    return _WindowEvaluation(window.first + host_row, other_row, age_s, measures, decision, int(beyond.sum()), kinds)


def _join_windows(parts: Sequence[_WindowEvaluation]) -> _WindowEvaluation:
    """Join the evaluations of several windows of one pair."""
    return _WindowEvaluation(
        host_row=np.concatenate([part.host_row for part in parts]),
        other_row=np.concatenate([part.other_row for part in parts]),
        age_s=np.concatenate([part.age_s for part in parts]),
        measures=_stack_rows([part.measures for part in parts]),
        decision=_stack_rows([part.decision for part in parts]),
        n_beyond_path=sum(part.n_beyond_path for part in parts),
        kinds=np.concatenate([part.kinds for part in parts]),
    )


def _find_events_of_pair(
    host: VehicleTrack,
    other: VehicleTrack,
    pairing: StatePairing,
    evaluated: _WindowEvaluation,
    config: WarningConfig,
    persistence_s: float,
) -> PairEvaluation:
    """Find the events in the evaluations of a pair."""
    host_row, decision, kinds = evaluated.host_row, evaluated.decision, evaluated.kinds
    stamp_ns = host.stamp_ns[host_row]
    is_withheld = _flagged_mask(host, host_row) | _flagged_mask(other, evaluated.other_row)
    trusted = withhold_warnings(decision, is_withheld)
    is_kind_on = {
        WarningKind.FROM_BEHIND: config.from_behind,
        WarningKind.BESIDE_LANE: config.beside_lane,
        WarningKind.HOST_STANDS: config.while_standing,
    }
    off = [kind for kind, is_on in is_kind_on.items() if not is_on]
    trusted_warnings = leave_out_raised_warnings(trusted, np.isin(kinds, off)) if kinds.any() else trusted

    def event_spans_of_pair(each: Decision) -> list[EventSpan]:
        timing = EventTiming(host.stamp_ns, persistence_s, config.hold_off_s)
        return find_events(stamp_ns, each.armed, each.raised, each.held, at_once=each.at_once, timing=timing)

    spans, spans_of_all = event_spans_of_pair(trusted_warnings), event_spans_of_pair(decision)
    spans_of_trusted = spans if trusted_warnings is trusted else event_spans_of_pair(trusted)
    return PairEvaluation(
        other=other,
        stamp_ns=stamp_ns,
        log_time_ns=host.log_time_ns[host_row],
        known_ns=host.known_ns[host_row],
        age_s=evaluated.age_s,
        measures=evaluated.measures,
        decision=trusted_warnings,
        spans=spans,
        is_withheld=is_withheld,
        n_evaluated=len(pairing.host_row),
        n_out_of_reach=len(pairing.host_row) - len(host_row),
        n_without_message=pairing.n_without_message,
        n_stale=pairing.n_stale,
        n_beyond_path=evaluated.n_beyond_path,
        n_not_finite=int(np.isnan(evaluated.measures.horizon_distance_m).sum()),
        n_withheld=sum(bool(is_withheld[span.raised]) for span in spans_of_all),
        kinds=kinds,
        n_left_out={kind: sum(bool(kinds[span.raised] == kind) for span in spans_of_trusted) for kind in off},
    )


Stacked = TypeVar("Stacked", Measures, Decision)


def _stack_rows(parts: Sequence[Stacked]) -> Stacked:
    """Concatenate the rows of all parts; a field that is no array is taken from the first part."""
    values: dict[str, Any] = {}
    for name in (entry.name for entry in fields(parts[0])):
        each = [getattr(part, name) for part in parts]
        values[name] = np.concatenate(each) if isinstance(each[0], np.ndarray) else each[0]
    return type(parts[0])(**values)


def _flagged_mask(track: VehicleTrack, rows: Rows) -> BoolArray:
    """Whether the states of the rows are starting, after a reset or in a gap, (m,)."""
    return np.zeros(len(rows), dtype=bool) if track.flags is None else np.asarray(track.flags[rows] > 0)


def _within_reach_mask(
    host: PathArrays, other: PathArrays, host_row: Rows, other_row: Rows, span_s: float, config: WarningConfig
) -> BoolArray:
    """Whether the paths of each row could come near each other, by the top speeds of both, (m,)."""
    top_own = np.abs(host.speed_mps).max(axis=1, initial=0.0)
    top_theirs = np.abs(other.speed_mps).max(axis=1, initial=0.0)
    distance_m = np.hypot(
        other.x_m[other_row, 0] - host.x_m[host_row, 0], other.y_m[other_row, 0] - host.y_m[host_row, 0]
    )
    reach = top_own[host_row] * span_s + top_theirs[other_row] * (span_s + config.max_age_s)
    return np.asarray(~(distance_m > reach + config.distance_m + MAX_EVALUATED_PAIR_GAP_BEYOND_COLLISION_DISTANCE_M))


def _measures_and_short_paths_coarse_then_fine(
    host_points: PathPoints,
    paths: PathArrays,
    at_moments: OtherRowsPathRowsAges,
    time_s: FloatArray,
    config: WarningConfig,
    sizes: tuple[LengthAndWidthM, LengthAndWidthM],
) -> tuple[Measures, BoolArray]:
    """Measure all rows at every fifth point, near ones at every point; also find paths that end too early, (m,)."""
    horizon_index = int(np.searchsorted(time_s, config.horizon_s - 1e-9))
    thinned = sort_distinct_values(
        np.concatenate(
            [np.arange(0, len(time_s), PATH_POINT_STRIDE_OF_DISTANT_PAIRS), [horizon_index, len(time_s) - 1]]
        )
    )
    coarse, beyond = _measures_and_short_paths_at_times(host_points, paths, at_moments, time_s, thinned, config, sizes)
    near = np.flatnonzero(coarse.min_distance_m < config.distance_m + MAX_NEAR_PAIR_GAP_BEYOND_COLLISION_DISTANCE_M)
    at_near = (at_moments[0][near], at_moments[1][near], at_moments[2][near])
    every = np.arange(len(time_s))
    fine, _ = _measures_and_short_paths_at_times(host_points, paths, at_near, time_s, every, config, sizes)
    for name in MEASURE_ARRAY_NAMES:
        getattr(coarse, name)[near] = getattr(fine, name)
    return coarse, beyond


def _measures_and_short_paths_at_times(
    host_points: PathPoints,
    paths: PathArrays,
    at_moments: OtherRowsPathRowsAges,
    time_s: FloatArray,
    chosen: Rows,
    config: WarningConfig,
    sizes: tuple[LengthAndWidthM, LengthAndWidthM],
) -> tuple[Measures, BoolArray]:
    """Measure the rows at the chosen times, and find those whose paths end too early, (m,)."""
    host_row, other_row, age_s = at_moments
    theirs = interpolate_paths(paths, other_row, age_s, time_s[chosen])
    measures = measure_paths(
        host_points.select_rows_and_times(host_row, chosen),
        theirs,
        time_s[chosen],
        horizon_s=config.horizon_s,
        radius_m=config.distance_m,
        host_size=sizes[0],
        other_size=sizes[1],
    )
    return measures, theirs.is_beyond_end
