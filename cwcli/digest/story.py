"""What happened in a drive, in sentences for somebody who has never heard of cwcli."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from cwcli.digest.drive import Drive
from cwcli.digest.drive_sentences import drive_length_sentence, found_lanes_text, tracked_targets_text
from cwcli.digest.encounters import DriveEncounters, Encounter
from cwcli.estimation.online_availability import ORIGIN_NAME_OF_PARAMETERS_FROM_LOG
from cwcli.evaluation.conflicts import VERDICT_FALSE, VERDICT_LATE, VERDICT_TRUE, VERDICT_UNDECIDED
from cwcli.evaluation.doubts.base import Doubt
from cwcli.evaluation.records import find_collision_warning_record_and_is_of_targets
from cwcli.lazy_dataclass import dataclass
from cwcli.pipeline.records import read_configuration
from cwcli.signals.units import NS_PER_S
from cwcli.text import escape_control_characters, format_count, join_names
from cwcli.warning.types import WarningConfig

Tone = Literal["good", "bad", "alert", "plain"]
MAX_DISTANCE_OF_NEAR_MISS_M = 0.5
"""Greatest distance between outlines, in m, that is called near. Chosen by hand: cars pass parked ones farther away."""
MAX_VEHICLE_ID_CHARACTERS = 40
"""The greatest length of a vehicle's id in a sentence, in characters. Chosen by hand; not fitted."""
LANE_DEPARTURE_KIND = "lane"
"""The kind under which lane departures are counted."""
VERDICT_PHRASES = {
    VERDICT_TRUE: "came true",
    VERDICT_LATE: "came late",
    VERDICT_FALSE: "false",
    VERDICT_UNDECIDED: "not decided",
    LANE_DEPARTURE_KIND: "of lane departure",
}
"""Verdict on a warning -> the phrase in a list of counts, in the order of the list."""


@dataclass(frozen=True)
class Badge:
    """A verdict in a few words; the symbol says the same as the colour."""

    text: str
    tone: Tone

    @property
    def symbol(self) -> str:
        """A symbol for readers who do not see the colours."""
        return {"good": "✓", "bad": "✗", "alert": "⚠", "plain": "•"}[self.tone]


@dataclass(frozen=True)
class Story:
    """A drive in words.

    Attributes:
        happened: What happened, one sentence or two.
        more: Further sentences on the warnings.
        badges: Verdicts on the warnings.
        doubts: Reasons not to believe it, the worst first.
        knowledge: What the warnings are made from, "" without any.
        length: How long and how far the drive was.
    """

    happened: str
    more: tuple[str, ...]
    badges: tuple[Badge, ...]
    doubts: tuple[Doubt, ...] = ()
    knowledge: str = ""
    length: str = ""

    @property
    def headline(self) -> str:
        """What happened, behind the worst doubt."""
        return " ".join((*(doubt.headline for doubt in self.doubts[:1]), self.happened))

    @property
    def sentences(self) -> tuple[str, ...]:
        """What follows the headline: the advice on the worst doubt, the other doubts, and the further sentences."""
        advice = tuple(each.advice for each in self.doubts[:1])
        others = tuple(f"{each.sentence} {each.advice}" for each in self.doubts[1:])
        return (*advice, *others, *filter(None, (self.knowledge,)), *self.more, self.length)


def build_story(
    drive: Drive,
    drive_encounters: DriveEncounters,
    why_no_warnings: str = "",
    doubts: Sequence[Doubt] = (),
    confidence: Sequence[str] = (),
    *,
    with_careful_driver: bool = True,
) -> Story:
    """Build the story of a drive.

    Args:
        why_no_warnings: Why the warnings were not computed, where they were not.
        doubts: Reasons not to believe it, the worst first.
        confidence: What is known of its errors, in sentences; said where there is no doubt.
        with_careful_driver: Say what a careful driver would have done, which is simulated.
    """
    story = _build_story_without_doubts(drive, drive_encounters, why_no_warnings, with_careful_driver)
    story = replace(story, knowledge=_state_knowledge_sentence_or_empty(drive))
    if not doubts:
        return replace(story, more=(*confidence, *story.more))
    is_repaired = all(doubt.is_repaired for doubt in doubts)
    badge = Badge("sensor corrected", "alert") if is_repaired else Badge("not to be trusted", "bad")
    return replace(story, badges=(badge, *story.badges), doubts=tuple(doubts))


def _build_story_without_doubts(
    drive: Drive, drive_encounters: DriveEncounters, left_out: str, with_careful_driver: bool
) -> Story:
    """Build the story without the reasons to doubt the estimate."""
    if drive.warnings is None:
        return _build_story_with_warnings_not_computed(drive, left_out)
    length = _drive_length_sentence(drive)
    more: list[str] = []
    if not drive_encounters.encounters:
        badges = [Badge("no warning", "plain")]
        if drive_encounters.missed_conflicts:
            badges.append(
                Badge(f"{format_count(len(drive_encounters.missed_conflicts), 'conflict')} without a warning", "bad")
            )
        more = _missed_conflict_sentences(drive, drive_encounters) or _drive_rightly_without_warnings_sentences(
            drive, drive_encounters
        )
        return Story(_no_warning_sentence(drive, drive_encounters), tuple(more), tuple(badges), length=length)
    if len(drive_encounters.encounters) == 1:
        headline = encounter_sentence(drive, drive_encounters.encounters[0])
        verdict = verdict_sentence(drive.warning_config, drive_encounters.encounters[0])
        careful = careful_driver_sentence(drive, drive_encounters.encounters[0]) if with_careful_driver else ""
        more = [*filter(None, (verdict, careful))]
    else:
        worst = min(drive_encounters.encounters, key=_criticality_sort_key)
        headline = f"cwcli gave {len(drive_encounters.encounters)} warnings: {_verdict_counts_text(drive_encounters)}. "
        sentence = encounter_sentence(drive, worst)
        if worst.is_lane_departure:
            headline += f"The first: {sentence[0].lower()}{sentence[1:]}"
        else:
            headline += f"The most critical: {sentence[0].lower()}{sentence[1:]}"
    return Story(
        headline,
        (*more, *_missed_conflict_sentences(drive, drive_encounters)),
        tuple(_warning_and_missed_conflict_badges(drive_encounters)),
        length=length,
    )


def encounter_sentence(drive: Drive, encounter: Encounter) -> str:
    """Format `At 4.7 s cwcli warned that the car would collide with vehicle 2, coming from the right; ...`."""
    if encounter.is_lane_departure:
        side = encounter.other_id.removesuffix(" boundary")
        where = f" over its {side} boundary" if side in {"left", "right"} else ""
        return (
            f"At {_seconds_since_start_text(drive, encounter.raised_ns)} cwcli warned that the car would leave its "
            f"lane{where}."
        )
    direction = f", {encounter.direction}" if encounter.direction else ""
    text = f"At {_seconds_since_start_text(drive, encounter.raised_ns)} cwcli warned that the car would collide with "
    text += f"{name_of_other(encounter)}{direction}"
    verdict = encounter.verdict
    if verdict is None or verdict.closest_ns < 0 or not math.isfinite(verdict.closest_m):
        return f"{text}. How near they came is not known."
    distance_text = f"{verdict.closest_m:.1f} m between their centres"
    at = _seconds_since_start_text(drive, verdict.closest_ns)
    if encounter.least_gap_m < 0.0:
        return f"{text}; they did: at {at} their outlines overlap, with {distance_text}."
    if math.isfinite(encounter.least_gap_m):
        distance_text += f" and {encounter.least_gap_m:.1f} m between their outlines"
    return f"{text}; they came nearest at {at}, with {distance_text}."


def verdict_sentence(rule: WarningConfig, encounter: Encounter) -> str:
    """Say whether the warning was right."""
    verdict = encounter.verdict
    if encounter.is_lane_departure:
        return ""
    if verdict is None:
        return "Whether the warning was right can't be said: the other's track is not in the log."
    conflict = rule.parsed_conflict_definition.conflict_text
    begin = encounter.conflict.part_text if encounter.conflict is not None else conflict
    if verdict.kind == VERDICT_TRUE:
        return f"The warning was right: it came {verdict.lead_time_s:.1f} s before {begin}."
    if verdict.kind == VERDICT_LATE:
        return f"The warning was late: it came {-verdict.lead_time_s:.1f} s after {begin}."
    if verdict.kind == VERDICT_FALSE:
        return f"By what followed it was a false alarm: there was no moment when {conflict}."
    return "Whether the warning was right can't be said: the tracks end too early."


def careful_driver_sentence(drive: Drive, encounter: Encounter) -> str:
    """Format `A careful driver would have stayed 4.0 m away, braking at 3.1 s.`; "" without a conflict."""
    if encounter.pair is None or encounter.conflict is None:
        return ""
    from cwcli.evaluation.preventable import simulate_careful_driver

    found = simulate_careful_driver(encounter.pair, encounter.conflict)
    if found is None:
        return ""
    outcome, braked_ns = found.outcome, found.first_braking_ns
    if outcome.avoided:
        how = "without braking" if braked_ns is None else f"braking at {_seconds_since_start_text(drive, braked_ns)}"
        return f"A careful driver would have stayed {outcome.least_gap_m:.1f} m away, {how}."
    braked = (
        "would not have braked"
        if braked_ns is None
        else f"would have braked at {_seconds_since_start_text(drive, braked_ns)}"
    )
    return f"A careful driver {braked}, and would have crashed at {outcome.impact_mps:.1f} m/s relative to the other."


def badge_of_warning_verdict(encounter: Encounter) -> Badge:
    """Return the badge of the verdict on one warning."""
    if encounter.is_lane_departure:
        return Badge("lane departure", "alert")
    kind = encounter.verdict.kind if encounter.verdict is not None else VERDICT_UNDECIDED
    if kind == VERDICT_TRUE:
        assert encounter.verdict is not None
        return Badge(f"came true, {encounter.verdict.lead_time_s:.1f} s ahead", "alert")
    texts: dict[str, tuple[str, Tone]] = {VERDICT_LATE: ("came too late", "bad"), VERDICT_FALSE: ("false alarm", "bad")}
    text, tone = texts.get(kind, ("not decided", "plain"))
    return Badge(text, tone)


def name_of_other(encounter: Encounter) -> str:
    """Return a name such as `vehicle 17` of whom the warning is about."""
    if encounter.is_lane_departure:
        return escape_control_characters(encounter.other_id)[:MAX_VEHICLE_ID_CHARACTERS]
    return short_vehicle_name(encounter.other.kind if encounter.other is not None else "vehicle", encounter.other_id)


def short_vehicle_name(kind: str, other_id: str) -> str:
    """Return a name such as `vehicle 17`, cut where the id is long."""
    shown = escape_control_characters(other_id)
    return (
        f"{kind} {shown if len(shown) <= MAX_VEHICLE_ID_CHARACTERS else shown[: MAX_VEHICLE_ID_CHARACTERS - 1] + '…'}"
    )


def _criticality_sort_key(encounter: Encounter) -> tuple[float, float, int]:
    """Sort key: the least gap first, then the least distance, then the earliest."""
    verdict = encounter.verdict
    nearest = verdict.closest_m if verdict is not None and math.isfinite(verdict.closest_m) else math.inf
    gap = encounter.least_gap_m if math.isfinite(encounter.least_gap_m) else math.inf
    return gap, nearest, encounter.raised_ns


def encounters_by_criticality(drive_encounters: DriveEncounters) -> list[Encounter]:
    """Sort the warnings, the one with the least distance first."""
    return sorted(drive_encounters.encounters, key=_criticality_sort_key)


def _seconds_since_start_text(drive: Drive, stamp_ns: int) -> str:
    """Format a stamp as seconds since the log began."""
    return f"{(stamp_ns - drive.start_ns) / NS_PER_S:.1f} s"


def _count_verdict_kinds(drive_encounters: DriveEncounters) -> Counter[str]:
    """Count the warnings by verdict."""
    return Counter(
        LANE_DEPARTURE_KIND
        if each.is_lane_departure
        else each.verdict.kind
        if each.verdict is not None
        else VERDICT_UNDECIDED
        for each in drive_encounters.encounters
    )


def _verdict_counts_text(drive_encounters: DriveEncounters) -> str:
    """Format the numbers of warnings by verdict."""
    kinds = _count_verdict_kinds(drive_encounters)
    parts = []
    for kind, said in VERDICT_PHRASES.items():
        if kinds[kind]:
            parts.append(f"{kinds[kind]} {said}")
    return join_names(parts)


def _warning_and_missed_conflict_badges(drive_encounters: DriveEncounters) -> list[Badge]:
    """Return the badges of the warnings and of the missed conflicts."""
    if len(drive_encounters.encounters) == 1:
        badges = [Badge(f"1 warning: {badge_of_warning_verdict(drive_encounters.encounters[0]).text}", "alert")]
        kind = _count_verdict_kinds(drive_encounters)
        if kind[VERDICT_LATE] or kind[VERDICT_FALSE]:
            badges = [Badge(badges[0].text, "bad")]
    else:
        kinds = _count_verdict_kinds(drive_encounters)
        tone: Tone = "bad" if kinds[VERDICT_FALSE] or kinds[VERDICT_LATE] else "alert"
        badges = [Badge(f"{len(drive_encounters.encounters)} warnings: {_verdict_counts_text(drive_encounters)}", tone)]
    if drive_encounters.missed_conflicts:
        badges.append(
            Badge(f"{format_count(len(drive_encounters.missed_conflicts), 'conflict')} without a warning", "bad")
        )
    return badges


def _missed_conflict_sentences(drive: Drive, drive_encounters: DriveEncounters) -> list[str]:
    """Return sentences on the first conflicts without a warning."""
    sentences = []
    for missed in drive_encounters.missed_conflicts[:3]:
        at = _seconds_since_start_text(drive, missed.conflict.onset_ns)
        sentences.append(
            f"No warning came before {at}, when {missed.conflict.part_text} "
            f"({missed.other.kind} {escape_control_characters(missed.other.id)[:MAX_VEHICLE_ID_CHARACTERS]}, nearest "
            f"{missed.conflict.closest_m:.1f} m)."
        )
    if len(drive_encounters.missed_conflicts) > len(sentences):
        sentences.append(
            f"{len(drive_encounters.missed_conflicts) - len(sentences)} more conflicts had no warning either."
        )
    return sentences


def _no_warning_sentence(drive: Drive, drive_encounters: DriveEncounters) -> str:
    """Return the headline of a drive without a warning."""
    text = "In this drive cwcli gave no warning"
    if drive.ego is None:  # the lane alone was watched
        return f"{text} of leaving the lane; the car's place was not estimated, so no collision was looked for."
    if drive_encounters.nearest is None:
        return f"{text}; no other vehicle was heard while the car's position was known."
    nearest = drive_encounters.nearest
    name = short_vehicle_name(nearest.other.kind, nearest.other.id)
    at = _seconds_since_start_text(drive, nearest.stamp_ns)
    if nearest.distance_m < 0.0:
        return f"{text}, though the outlines of {name} and of the car overlap at {at}."
    between = "centre to centre" if nearest.is_of_centres else "outline to outline"
    return f"{text}; the nearest other, {name}, was {nearest.distance_m:.1f} m away, {between}, at {at}."


def _drive_rightly_without_warnings_sentences(drive: Drive, drive_encounters: DriveEncounters) -> list[str]:
    """Say that no warning was due, by the tracks of all others; [] where they do not tell."""
    if drive.ego is None or drive_encounters.nearest is None or drive_encounters.n_not_compared:
        return []
    conflict = drive.warning_config.parsed_conflict_definition.conflict_text
    nearest = drive_encounters.nearest
    is_near = not nearest.is_of_centres and nearest.distance_m < MAX_DISTANCE_OF_NEAR_MISS_M
    verdict = "it was near, but no conflict" if is_near else "that was right"
    return [f"By the later tracks {verdict}: there was no moment when {conflict}."]


def _state_knowledge_sentence_or_empty(drive: Drive) -> str:
    """Say which states the warnings started from; "" if there are none or the record does not say."""
    record, _ = find_collision_warning_record_and_is_of_targets(drive.records)
    states = read_configuration(record).get("states")
    if drive.warnings is None or states is None:
        return ""
    if states != "online":
        return (
            "Warnings are from states in hindsight, which know what came, at their stamps: no car could have given "
            "them like this."
        )
    used = drive.records.get("estimate", {}).get("online_parameters", "")
    but = ", but with noise and latencies from the whole log" if used == ORIGIN_NAME_OF_PARAMETERS_FROM_LOG else ""
    return f"Warnings are given when the car could have known{but}; what happened is judged in hindsight."


def _drive_length_sentence(drive: Drive) -> str:
    """Say how long and how far the drive was, and how many others were known."""
    kinds = Counter(other.kind for other in drive.others)
    return drive_length_sentence(drive, drive.ego, drive.records, n_heard=kinds["vehicle"], n_tracked=kinds["target"])


def _build_story_with_warnings_not_computed(drive: Drive, left_out: str) -> Story:
    """Build the story of a drive for which no warnings were computed."""
    why = left_out or ("`cwcli warn` was not run" if drive.others else "no other vehicle is in the log")
    reason = f": {escape_control_characters(why)}" if drive.ego is not None or left_out else ""
    length = drive_length_sentence(drive, None, drive.records) if drive.ego is None else _drive_length_sentence(drive)
    sentences = []
    if drive.lanes is not None and len(drive.lanes):
        both = int(np.count_nonzero(drive.lanes.found.all(axis=1)))
        sentences.append(found_lanes_text(both, len(drive.lanes)))
    n_targets = sum(other.kind == "target" for other in drive.others)
    if n_targets and drive.ego is None:
        sentences.append(f"{tracked_targets_text(n_targets)} by the sensors")
    if drive.ego is None:
        sentences.append(f"the car's motion was not estimated{'' if sentences else reason}")
    else:
        sentences.append(f"the car's motion was estimated, but no warnings were computed{reason}")
    text = "; ".join(sentences)
    return Story(f"{text[:1].upper()}{text[1:]}.", (), (Badge("no warnings computed", "plain"),), length=length)
