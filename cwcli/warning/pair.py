"""One pair of cars from paths to events."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import partial

import numpy as np
import numpy.typing as npt

from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.vehicle_state import SPEED
from cwcli.warning.align import Points, pair_up, read_paths
from cwcli.warning.collision import PathPairs
from cwcli.warning.events import Span, find_events
from cwcli.warning.measures import ONSET_MATTERS_M, Measures, measure, with_probabilities
from cwcli.warning.rules.base import BoolArray, Decision, Rule, withheld
from cwcli.warning.types import PathArrays, VehicleTrack, WarningConfig

REACH_M = 15.0  # beyond the collision distance: what can't come this near is not evaluated
NEAR_M = 6.0  # beyond the collision distance: such rows get every path point, others every fifth
COARSE = 5
STANDING_MPS = 0.5  # who is slower has begun no manoeuvre: what looks like one is the noise of standing


@dataclass(frozen=True)
class PairEvaluation:
    """Everything about one pair.

    Attributes:
        other: The other vehicle.
        stamp_ns, log_time_ns, age_s: Shape (m,): the evaluations within reach.
        known_ns: Shape (m,): when each could have been known, on the clock of the stamps.
        measures, decision: Their measures and the rule's masks.
        spans: Events, indices into the evaluations.
        is_withheld: Shape (m,): one of the states is starting, after a reset or in a gap, so nothing is raised.
        n_evaluated, n_out_of_reach, n_unheard, n_stale, n_beyond, n_not_finite: Counts of host stamps.
        n_withheld: Warnings that would have been raised of such states.
    """

    other: VehicleTrack
    stamp_ns: Int64Array
    log_time_ns: Int64Array
    known_ns: Int64Array
    age_s: FloatArray
    measures: Measures
    decision: Decision
    spans: list[Span]
    is_withheld: BoolArray
    n_evaluated: int
    n_out_of_reach: int
    n_unheard: int
    n_stale: int
    n_beyond: int
    n_not_finite: int
    n_withheld: int

    @property
    def probability(self) -> FloatArray:
        """Of a collision within the horizon, by the hypothesis that the decision shows, shape (m,)."""
        shown = self.decision.probability
        return self.measures.probability if shown is None else shown

    @property
    def alert_probability(self) -> FloatArray:
        """What the rule compares with its threshold, shape (m,); NaN: it has none."""
        compared = self.decision.alert_probability
        return np.full(len(self.stamp_ns), np.nan) if compared is None else compared


def evaluate_pair(
    host: VehicleTrack,
    host_points: Points,
    other: VehicleTrack,
    rule: Rule,
    config: WarningConfig,
    time_s: FloatArray,
) -> PairEvaluation:
    """Evaluate one pair at the host's stamps.

    Args:
        host_points: The host's n paths read at `time_s`.
        time_s: Shape (q,): times along the paths, from 0 past the horizon by the rule's persistence.
    """
    persistence_s = rule.persistence_s if config.persistence_s is None else config.persistence_s
    pairing = pair_up(host, other, config.use, config.max_age_s)
    within = _within_reach(host, other, pairing.host_row, pairing.other_row, float(time_s[-1]), config)
    host_row, other_row = pairing.host_row[within], pairing.other_row[within]
    age_s = pairing.age_s[within]
    at = (host_row, other_row, age_s)
    measures, beyond = _measures(host, host_points, other, other.paths, at, time_s, config)
    pairs = PathPairs(host.paths, other.paths, *at, host.outline_m, other.outline_m)
    judged = partial(
        with_probabilities,
        time_s=time_s,
        horizon_s=config.horizon_s,
        threshold=config.probability,
        deceleration_mps2=config.min_deceleration_mps2 if rule.uses_braking else 0.0,
    )
    measures = judged(measures, pairs)
    onset = None
    if rule.uses_onset and other.onset_paths is not None:
        onset, _ = _measures(host, host_points, other, other.onset_paths, at, time_s, config)
        nearer = onset.horizon_distance_m < measures.horizon_distance_m - ONSET_MATTERS_M
        nearer &= np.abs(other.state[other_row, SPEED]) > STANDING_MPS
        onset = judged(onset, replace(pairs, other=other.onset_paths), wanted=nearer)
    decision = rule.decide(measures, onset, config, persistence_s)
    stamp_ns = host.stamp_ns[host_row]
    is_withheld = _flagged(host, host_row) | _flagged(other, other_row)
    trusted = withheld(decision, is_withheld)
    spans, untold = (
        find_events(
            stamp_ns,
            each.armed,
            each.raised,
            each.held,
            at_once=each.at_once,
            clock_ns=host.stamp_ns,
            persistence_s=persistence_s,
            hold_off_s=config.hold_off_s,
        )
        for each in (trusted, decision)
    )
    return PairEvaluation(
        other=other,
        stamp_ns=stamp_ns,
        log_time_ns=host.log_time_ns[host_row],
        known_ns=host.known_ns[host_row],
        age_s=age_s,
        measures=measures,
        decision=trusted,
        spans=spans,
        is_withheld=is_withheld,
        n_evaluated=len(pairing.host_row),
        n_out_of_reach=len(pairing.host_row) - len(host_row),
        n_unheard=pairing.n_unheard,
        n_stale=pairing.n_stale,
        n_beyond=int(beyond.sum()),
        n_not_finite=int(np.isnan(measures.horizon_distance_m).sum()),
        n_withheld=sum(bool(is_withheld[span.raised]) for span in untold),
    )


def _flagged(track: VehicleTrack, rows: npt.NDArray[np.intp]) -> BoolArray:
    """Whether the states of the rows (m,) are to be trusted less, for whatever reason."""
    return np.zeros(len(rows), dtype=bool) if track.flags is None else np.asarray(track.flags[rows] > 0)


def _within_reach(
    host: VehicleTrack,
    other: VehicleTrack,
    host_row: npt.NDArray[np.intp],
    other_row: npt.NDArray[np.intp],
    span_s: float,
    config: WarningConfig,
) -> npt.NDArray[np.bool_]:
    """Rows whose paths could come near each other: neither car can get farther than its top speed allows."""
    own, theirs = host.paths, other.paths
    top_own = np.abs(own.speed_mps).max(axis=1, initial=0.0)
    top_theirs = np.abs(theirs.speed_mps).max(axis=1, initial=0.0)
    apart = np.hypot(theirs.x_m[other_row, 0] - own.x_m[host_row, 0], theirs.y_m[other_row, 0] - own.y_m[host_row, 0])
    reach = top_own[host_row] * span_s + top_theirs[other_row] * (span_s + config.max_age_s)
    return np.asarray(~(apart > reach + config.distance_m + REACH_M))


Rows = tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], FloatArray]
"""Host rows, other rows, ages, each (m,)."""


def _measures(
    host: VehicleTrack,
    host_points: Points,
    other: VehicleTrack,
    paths: PathArrays,
    at: Rows,
    time_s: FloatArray,
    config: WarningConfig,
) -> tuple[Measures, npt.NDArray[np.bool_]]:
    """Measures of all rows from every fifth point; of those that come near, from every point."""
    thinned = np.union1d(np.arange(0, len(time_s), COARSE), [_horizon_index(time_s, config), len(time_s) - 1])
    coarse, beyond = _read_and_measure(host, host_points, other, paths, at, time_s, thinned, config)
    near = np.flatnonzero(coarse.min_distance_m < config.distance_m + NEAR_M)
    at_near = (at[0][near], at[1][near], at[2][near])
    every = np.arange(len(time_s))
    fine, _ = _read_and_measure(host, host_points, other, paths, at_near, time_s, every, config)
    for name in (entry.name for entry in fields(Measures)):
        getattr(coarse, name)[near] = getattr(fine, name)
    return coarse, beyond


def _horizon_index(time_s: FloatArray, config: WarningConfig) -> int:
    return int(np.searchsorted(time_s, config.horizon_s - 1e-9))


def _read_and_measure(
    host: VehicleTrack,
    host_points: Points,
    other: VehicleTrack,
    paths: PathArrays,
    at: Rows,
    time_s: FloatArray,
    chosen: npt.NDArray[np.intp],
    config: WarningConfig,
) -> tuple[Measures, npt.NDArray[np.bool_]]:
    """Measures of the rows from the chosen times, and which were read past their path's end."""
    host_row, other_row, age_s = at
    theirs = read_paths(paths, other_row, age_s, time_s[chosen])
    measures = measure(
        host_points.rows(host_row, chosen),
        theirs,
        time_s[chosen],
        horizon_s=config.horizon_s,
        radius_m=config.distance_m,
        host_size=host.outline_m,
        other_size=other.outline_m,
    )
    return measures, theirs.beyond
