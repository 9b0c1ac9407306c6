"""The warnings of a drive as encounters: who, when, from where, and what became of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from cwcli.channels.warning import WarningEvent, warning_events_with_known_start
from cwcli.digest.drive import Drive, OtherTrack, ego_length_and_width_m
from cwcli.evaluation.conflicts import RealConflict, WarningVerdict, find_real_conflicts, judge_warning
from cwcli.lazy_dataclass import dataclass
from cwcli.measures.distances import GAP
from cwcli.measures.pair import ActualTrack, Pair, interpolate_x_y_speed_heading
from cwcli.signals.angles import wrap_angle
from cwcli.signals.columns import Int64Array
from cwcli.signals.row_order import rows_by_stamp_without_repeats
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import SPEED
from cwcli.warning.lane_departure import LANE_DEPARTURE_RULE_NAME as LANE_DEPARTURE
from cwcli.warning.pair import MAX_STANDSTILL_SPEED_MPS

MAX_VEHICLES_WITH_COMPUTED_DISTANCE_TO_EGO = 400
"""Greatest number of others whose distance to the ego is computed: those warned of, then the longest tracks. Chosen by
hand; not fitted."""
MAX_HEADING_DIFFERENCE_OF_SAME_DIRECTION_RAD = math.radians(45.0)
"""Greatest difference of two headings, rad, that count as the same direction; within it of pi they count as opposite.
Chosen by hand; not fitted."""
MAX_BEARING_AHEAD_RAD = math.radians(60.0)
"""Greatest bearing, rad, that counts as ahead; bearings within it of pi count as behind, others as beside. Chosen by
hand; not fitted."""


@dataclass(frozen=True)
class Encounter:
    """One warning, its vehicles and its verdict.

    Attributes:
        other: The other vehicle; None where its track is not in the log.
        raised_ns, last_ns: First and last evaluation at which it stood.
        time_to_event_s, predicted_distance_m, probability, alert_probability: As the warning said when it was raised;
            NaN: not computed.
        rows: Rows of the warnings channel in which it stood, by time.
        pair: Both over the drive, or None.
        verdict: What became of it, or None where the tracks do not tell.
        conflict: The one that it is about, or None.
        least_gap_m: Least distance of the outlines while the warning can come true; negative: they overlap.
        direction: Where the other came from, in words: `coming from the right`; "" where not known.
    """

    event_id: int
    other: OtherTrack | None
    other_id: str
    rule: str
    raised_ns: int
    last_ns: int
    time_to_event_s: float
    predicted_distance_m: float
    probability: float
    alert_probability: float
    rows: Int64Array
    pair: Pair | None
    verdict: WarningVerdict | None
    conflict: RealConflict | None
    least_gap_m: float
    direction: str

    @property
    def is_lane_departure(self) -> bool:
        """Whether the warning is about the car's own lane, not about another vehicle."""
        return self.rule == LANE_DEPARTURE


@dataclass(frozen=True)
class Conflict:
    """A conflict that really happened, with whom, and the numbers of the warnings about it."""

    other: OtherTrack
    conflict: RealConflict
    warning_ids: tuple[int, ...] = ()


@dataclass(frozen=True)
class NearestApproach:
    """The nearest approach of a drive: the other vehicle, how near it came, the time, and the pair.

    Attributes:
        distance_m: Distance of the outlines, negative where they overlap; of the centres where `is_of_centres`.
        is_of_centres: The two were never near enough for their outlines to be compared.
        is_parked: The two stood whenever both were known: how near they came is where they were parked.
    """

    other: OtherTrack
    distance_m: float
    stamp_ns: int
    pair: Pair
    is_of_centres: bool = False
    is_parked: bool = False


@dataclass(frozen=True)
class DriveEncounters:
    """All warnings, conflicts and approaches between the ego and the others.

    Attributes:
        missed_conflicts: Conflicts without a warning, in order of time; none where nobody warned.
        nearest: The other that came nearest while one of the two moved; None where nobody was near.
        n_not_compared: Others whose distance was not computed, because there are so many.
        conflicts: All of them, in order of time.
        pairs: The others whose distance was computed, with it.
    """

    encounters: tuple[Encounter, ...]
    missed_conflicts: tuple[Conflict, ...]
    nearest: NearestApproach | None
    n_not_compared: int
    conflicts: tuple[Conflict, ...] = ()
    pairs: tuple[tuple[OtherTrack, Pair], ...] = ()


def find_encounters(drive: Drive) -> DriveEncounters:
    """Match the warnings with the tracks. What really happened comes from the tracks, as in `cwcli warn`."""
    alerts = [] if drive.warnings is None else warning_events_with_known_start(drive.warnings)
    if drive.ego is None:
        return DriveEncounters(tuple(_encounter_from_channel(drive, alert) for alert in alerts), (), None, 0)
    rows = rows_by_stamp_without_repeats(drive.ego.stamp_ns)
    host = ActualTrack(drive.ego.stamp_ns[rows], drive.ego.state[rows])
    warned = {entry.other_id for entry in alerts}
    ranked = sorted(drive.others, key=lambda other: (other.id not in warned, -len(other.track.stamp_ns)))
    pairs: dict[int, Pair] = {}
    for other in ranked[:MAX_VEHICLES_WITH_COMPUTED_DISTANCE_TO_EGO]:
        pairs[id(other)] = _pair_with_host(drive, host, other)
    by_id: dict[str, OtherTrack] = {}
    for other in drive.others:
        by_id.setdefault(other.id, other)
    conflicts = {key: find_real_conflicts(pair, drive.warning_config) for key, pair in pairs.items()}
    encounters: list[Encounter] = []
    warned_by: dict[tuple[int, int], list[int]] = {}
    for alert in alerts:
        other_track = None if alert.rule == LANE_DEPARTURE else by_id.get(alert.other_id)
        encounter = _build_encounter(drive, alert, other_track, host, pairs, conflicts)
        if other_track is not None and encounter.verdict is not None and encounter.verdict.conflict_index >= 0:
            key = id(other_track), encounter.verdict.conflict_index
            warned_by.setdefault(key, []).append(encounter.event_id)
        encounters.append(encounter)
    compared = ranked[:MAX_VEHICLES_WITH_COMPUTED_DISTANCE_TO_EGO]
    happened = [
        Conflict(other, conflict, tuple(warned_by.get((id(other), index), ())))
        for other in compared
        if other is by_id[other.id]
        for index, conflict in enumerate(conflicts[id(other)])
    ]
    happened.sort(key=lambda entry: entry.conflict.onset_ns)
    missed = [each for each in happened if not each.warning_ids]
    return DriveEncounters(
        encounters=tuple(encounters),
        missed_conflicts=tuple(missed) if drive.warnings is not None else (),
        nearest=_find_nearest_moving_approach(compared, pairs),
        n_not_compared=max(0, len(ranked) - MAX_VEHICLES_WITH_COMPUTED_DISTANCE_TO_EGO),
        conflicts=tuple(happened),
        pairs=tuple((other, pairs[id(other)]) for other in compared),
    )


def _pair_with_host(drive: Drive, host: ActualTrack, other: OtherTrack) -> Pair:
    """Pair the ego with another vehicle at those of the ego's stamps at which the other is known."""
    assert drive.ego is not None
    margin_ns = round(drive.warning_config.max_gap_s * NS_PER_S)
    first = int(np.searchsorted(host.stamp_ns, other.track.stamp_ns[0] - margin_ns))
    last = int(np.searchsorted(host.stamp_ns, other.track.stamp_ns[-1] + margin_ns, side="right"))
    part = ActualTrack(host.stamp_ns[first:last], host.state[first:last])
    return Pair(part, other.track, ego_length_and_width_m(drive.ego), other.size_m, drive.warning_config.max_gap_s)


def _build_encounter(
    drive: Drive,
    alert: WarningEvent,
    other: OtherTrack | None,
    host: ActualTrack,
    pairs: dict[int, Pair],
    conflicts: dict[int, list[RealConflict]],
) -> Encounter:
    """Build the encounter of a warning, with its verdict where both tracks are known."""
    pair = pairs.get(id(other)) if other is not None else None
    verdict, conflict, gap, direction = None, None, math.nan, ""
    if other is not None and pair is not None and len(pair.stamp_ns):
        verdict = judge_warning(alert.raised_ns, alert.last_ns, conflicts[id(other)], pair, drive.warning_config)
        conflict = conflicts[id(other)][verdict.conflict_index] if verdict.conflict_index >= 0 else None
        gap = _least_gap_m(pair, alert.raised_ns, alert.raised_ns + round(drive.warning_config.max_lead_s * NS_PER_S))
        direction = _direction_phrase_or_empty(host, other, alert.raised_ns, drive.warning_config.max_gap_s)
    from_channel = _encounter_from_channel(drive, alert)
    return replace(
        from_channel, other=other, pair=pair, verdict=verdict, conflict=conflict, least_gap_m=gap, direction=direction
    )


def _encounter_from_channel(drive: Drive, alert: WarningEvent) -> Encounter:
    """Build the encounter of a warning from its channel alone."""
    assert drive.warnings is not None
    said, row = drive.warnings, alert.rows[0]
    return Encounter(
        event_id=alert.event_id,
        other=None,
        other_id=alert.other_id,
        rule=alert.rule,
        raised_ns=alert.raised_ns,
        last_ns=alert.last_ns,
        time_to_event_s=float(said.time_to_event_s[row]),
        predicted_distance_m=float(said.predicted_distance_m[row]),
        probability=float(said.probability[row]),
        alert_probability=float(said.alert_probability[row]),
        rows=alert.rows,
        pair=None,
        verdict=None,
        conflict=None,
        least_gap_m=math.nan,
        direction="",
    )


def _least_gap_m(pair: Pair, begin_ns: int, end_ns: int) -> float:
    """Return the least distance of the outlines between two stamps, in m; NaN if it is not known."""
    inside = pair.evaluate_measure(GAP)[(pair.stamp_ns >= begin_ns) & (pair.stamp_ns <= end_ns)]
    known = inside[np.isfinite(inside)]
    return float(known.min()) if len(known) else math.nan


def _direction_phrase_or_empty(host: ActualTrack, other: OtherTrack, at_ns: int, max_gap_s: float) -> str:
    """Describe where the other vehicle comes from, seen from the driver's seat, when the warning is given."""
    stamps = np.array([at_ns], np.int64)
    own = interpolate_x_y_speed_heading(host, stamps, max_gap_s)[0]
    theirs = interpolate_x_y_speed_heading(other.track, stamps, max_gap_s)[0]
    if not (np.isfinite(own).all() and np.isfinite(theirs).all()):
        return ""
    bearing = wrap_angle(math.atan2(theirs[1] - own[1], theirs[0] - own[0]) - float(own[3]))
    heading_difference_rad = wrap_angle(float(theirs[3] - own[3]))
    side = "left" if bearing > 0.0 else "right"
    if abs(heading_difference_rad) <= MAX_HEADING_DIFFERENCE_OF_SAME_DIRECTION_RAD:
        if abs(bearing) < MAX_BEARING_AHEAD_RAD:
            return "ahead in the same direction"
        return "coming from behind" if abs(bearing) > math.pi - MAX_BEARING_AHEAD_RAD else f"beside it on the {side}"
    if abs(heading_difference_rad) >= math.pi - MAX_HEADING_DIFFERENCE_OF_SAME_DIRECTION_RAD:
        return "coming towards it"
    return f"coming from the {'right' if heading_difference_rad > 0.0 else 'left'}"


def rows_of_moving_pair_and_if_always_standing(pair: Pair) -> tuple[npt.NDArray[np.intp], bool]:
    """Return the rows at which both are known and one moves; all known rows and True if both always stood."""
    is_known = np.isfinite(pair.distance_m)
    moves = np.abs(pair.host.state[:, SPEED]) > MAX_STANDSTILL_SPEED_MPS
    moves |= np.abs(pair.other_states[:, SPEED]) > MAX_STANDSTILL_SPEED_MPS
    is_parked = not (is_known & moves).any()
    return np.flatnonzero(is_known if is_parked else is_known & moves), is_parked


def _find_nearest_moving_approach(others: Sequence[OtherTrack], pairs: dict[int, Pair]) -> NearestApproach | None:
    """Find the nearest approach of the outlines; pairs that always stood count only if there is no other pair."""
    candidates = []
    for other in others:
        rows, is_parked = rows_of_moving_pair_and_if_always_standing(pairs[id(other)])
        if len(rows):
            candidates.append((is_parked, float(pairs[id(other)].distance_m[rows].min()), other, rows))
    nearest: NearestApproach | None = None
    for is_parked, centres_m, other, rows in sorted(candidates, key=lambda each: each[:2]):
        pair = pairs[id(other)]
        least_m = centres_m - 0.5 * (math.hypot(*pair.host_size) + math.hypot(*pair.other_size))
        if nearest is None or (is_parked, least_m) < (nearest.is_parked, nearest.distance_m):
            approach = _nearest_approach_of_pair(other, pair, rows, is_parked)
            if nearest is None or (is_parked, approach.distance_m) < (nearest.is_parked, nearest.distance_m):
                nearest = approach
    return nearest


def _nearest_approach_of_pair(
    other: OtherTrack, pair: Pair, rows: npt.NDArray[np.intp], is_parked: bool
) -> NearestApproach:
    """Return the nearest approach within some rows of a pair, by the outlines where they can be compared."""
    gap_m = pair.evaluate_measure(GAP)[rows]
    is_of_centres = not np.isfinite(gap_m).any()
    apart_m = pair.distance_m[rows] if is_of_centres else gap_m
    row = int(np.nanargmin(apart_m))
    return NearestApproach(other, float(apart_m[row]), int(pair.stamp_ns[rows[row]]), pair, is_of_centres, is_parked)
