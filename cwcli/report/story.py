"""What happened in a drive, in sentences for somebody who has never heard of cwcli."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from cwcli.estimation.known import THIS_LOG
from cwcli.evaluation.conflicts import FALSE, LATE, TRUE, UNDECIDED
from cwcli.evaluation.estimate import driven_m
from cwcli.evaluation.preventable import careful_driver
from cwcli.evaluation.records import warn_record
from cwcli.pipeline.records import configuration_of
from cwcli.report.drive import Drive
from cwcli.report.encounters import Encounter, Meetings
from cwcli.signals.units import NS_PER_S
from cwcli.text import count, duration, join_names, printable
from cwcli.warning.types import WarningConfig

Tone = Literal["good", "bad", "alert", "plain"]
MAX_ID = 40
"""The greatest length of a vehicle's id in a sentence, in characters. Chosen by hand; not fitted."""
LANE = "lane"
"""The kind under which lane departures are counted."""
SAID = {
    TRUE: "came true",
    LATE: "came late",
    FALSE: "false",
    UNDECIDED: "not decided",
    LANE: "of lane departure",
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
        headline: One sentence or two.
        more: Further sentences.
        badges: Verdicts on the warnings.
    """

    headline: str
    more: tuple[str, ...]
    badges: tuple[Badge, ...]


def tell(drive: Drive, drive_encounters: Meetings, left_out: str = "", doubts: Sequence[str] = ()) -> Story:
    """Build the story of a drive.

    Args:
        left_out: Why the warnings were not computed, where they were not.
        doubts: What makes the estimate hard to believe; it is said first.
    """
    story = _story(drive, drive_encounters, left_out)
    if knowledge := _knowledge(drive):
        story = replace(story, more=(knowledge, *story.more))
    if not doubts:
        return story
    first = f"Do not trust this estimate as it is: it has {join_names(doubts)}."
    badges = (Badge("not to be trusted", "bad"), *story.badges)
    return replace(story, headline=f"{first} {story.headline}", badges=badges)


def _story(drive: Drive, drive_encounters: Meetings, left_out: str) -> Story:
    """Build the story without the reasons to doubt the estimate."""
    more = [_length(drive)]
    if drive.warnings is None:
        return _without_warnings(drive, left_out, more)
    if not drive_encounters.encounters:
        more += _missed(drive, drive_encounters)
        badges = [Badge("no warning", "plain")]
        if drive_encounters.missed:
            badges.append(Badge(f"{count(len(drive_encounters.missed), 'conflict')} without a warning", "bad"))
        return Story(_nobody_near(drive, drive_encounters), tuple(more), tuple(badges))
    if len(drive_encounters.encounters) == 1:
        headline = encounter_sentence(drive, drive_encounters.encounters[0])
        verdict = verdict_sentence(drive.rule, drive_encounters.encounters[0])
        careful = careful_sentence(drive, drive_encounters.encounters[0])
        more = [*filter(None, (verdict, careful)), *more]
    else:
        worst = min(drive_encounters.encounters, key=_urgency)
        headline = f"cwcli gave {len(drive_encounters.encounters)} warnings: {_tally(drive_encounters)}. "
        sentence = encounter_sentence(drive, worst)
        if worst.is_lane_departure:
            headline += f"The first: {sentence[0].lower()}{sentence[1:]}"
        else:
            headline += f"The most critical: {sentence[0].lower()}{sentence[1:]}"
    return Story(headline, (*more, *_missed(drive, drive_encounters)), tuple(_badges(drive_encounters)))


def encounter_sentence(drive: Drive, encounter: Encounter) -> str:
    """Format `At 4.7 s cwcli warned that the car would collide with vehicle 2, coming from the right; ...`."""
    if encounter.is_lane_departure:
        side = encounter.other_id.removesuffix(" boundary")
        where = f" over its {side} boundary" if side in {"left", "right"} else ""
        return f"At {_at(drive, encounter.raised_ns)} cwcli warned that the car would leave its lane{where}."
    direction = f", {encounter.direction}" if encounter.direction else ""
    text = f"At {_at(drive, encounter.raised_ns)} cwcli warned that the car would collide with "
    text += f"{name_of(encounter)}{direction}"
    verdict = encounter.verdict
    if verdict is None or verdict.closest_ns < 0 or not math.isfinite(verdict.closest_m):
        return f"{text}. How near they came is not known."
    apart = f"{verdict.closest_m:.1f} m between their centres"
    at = _at(drive, verdict.closest_ns)
    if encounter.least_gap_m < 0.0:
        return f"{text}; they did: at {at} their outlines overlap, with {apart}."
    if math.isfinite(encounter.least_gap_m):
        apart += f" and {encounter.least_gap_m:.1f} m between their outlines"
    return f"{text}; they came nearest at {at}, with {apart}."


def verdict_sentence(rule: WarningConfig, encounter: Encounter) -> str:
    """Say whether the warning was right."""
    verdict = encounter.verdict
    if encounter.is_lane_departure:
        return ""
    if verdict is None:
        return "Whether the warning was right can't be said: the other's track is not in the log."
    conflict = rule.definition.words
    if verdict.kind == TRUE:
        return f"The warning was right: it came {verdict.lead_time_s:.1f} s before {conflict}."
    if verdict.kind == LATE:
        return f"The warning was late: it came {-verdict.lead_time_s:.1f} s after {conflict}."
    if verdict.kind == FALSE:
        return f"By what followed it was a false alarm: there was no moment when {conflict}."
    return "Whether the warning was right can't be said: the tracks end too early."


def careful_sentence(drive: Drive, encounter: Encounter) -> str:
    """Format `A careful driver would have stayed 4.0 m away, braking at 3.1 s.`; "" without a conflict."""
    if encounter.pair is None or encounter.conflict is None:
        return ""
    found = careful_driver(encounter.pair, encounter.conflict)
    if found is None:
        return ""
    outcome, braked_ns = found.outcome, found.braked_ns
    if outcome.avoided:
        how = "without braking" if braked_ns is None else f"braking at {_at(drive, braked_ns)}"
        return f"A careful driver would have stayed {outcome.least_gap_m:.1f} m away, {how}."
    braked = "would not have braked" if braked_ns is None else f"would have braked at {_at(drive, braked_ns)}"
    return f"A careful driver {braked}, and would have crashed at {outcome.impact_mps:.1f} m/s relative to the other."


def verdict_badge(encounter: Encounter) -> Badge:
    """Return the badge of the verdict on one warning."""
    if encounter.is_lane_departure:
        return Badge("lane departure", "alert")
    kind = encounter.verdict.kind if encounter.verdict is not None else UNDECIDED
    if kind == TRUE:
        assert encounter.verdict is not None
        return Badge(f"came true, {encounter.verdict.lead_time_s:.1f} s ahead", "alert")
    texts: dict[str, tuple[str, Tone]] = {LATE: ("came too late", "bad"), FALSE: ("false alarm", "bad")}
    text, tone = texts.get(kind, ("not decided", "plain"))
    return Badge(text, tone)


def name_of(encounter: Encounter) -> str:
    """Return a name such as `vehicle 17` of whom the warning is about."""
    if encounter.is_lane_departure:
        return printable(encounter.other_id)[:MAX_ID]
    return short_name(encounter.other.kind if encounter.other is not None else "vehicle", encounter.other_id)


def short_name(kind: str, other_id: str) -> str:
    """Return a name such as `vehicle 17`, cut where the id is long."""
    shown = printable(other_id)
    return f"{kind} {shown if len(shown) <= MAX_ID else shown[: MAX_ID - 1] + '…'}"


def _urgency(encounter: Encounter) -> tuple[float, float, int]:
    """Sort key: the least gap first, then the least distance, then the earliest."""
    verdict = encounter.verdict
    nearest = verdict.closest_m if verdict is not None and math.isfinite(verdict.closest_m) else math.inf
    gap = encounter.least_gap_m if math.isfinite(encounter.least_gap_m) else math.inf
    return gap, nearest, encounter.raised_ns


def most_critical(drive_encounters: Meetings) -> list[Encounter]:
    """Sort the warnings, the one with the least distance first."""
    return sorted(drive_encounters.encounters, key=_urgency)


def _at(drive: Drive, stamp_ns: int) -> str:
    """Format a stamp as seconds since the log began."""
    return f"{(stamp_ns - drive.start_ns) / NS_PER_S:.1f} s"


def _kinds(drive_encounters: Meetings) -> Counter[str]:
    """Count the warnings by verdict."""
    return Counter(
        LANE if each.is_lane_departure else each.verdict.kind if each.verdict is not None else UNDECIDED
        for each in drive_encounters.encounters
    )


def _tally(drive_encounters: Meetings) -> str:
    """Format the numbers of warnings by verdict."""
    kinds = _kinds(drive_encounters)
    parts = []
    for kind, said in SAID.items():
        if kinds[kind]:
            parts.append(f"{kinds[kind]} {said}")
    return join_names(parts)


def _badges(drive_encounters: Meetings) -> list[Badge]:
    """Return the badges of the warnings and of the missed conflicts."""
    if len(drive_encounters.encounters) == 1:
        badges = [Badge(f"1 warning: {verdict_badge(drive_encounters.encounters[0]).text}", "alert")]
        kind = _kinds(drive_encounters)
        if kind[LATE] or kind[FALSE]:
            badges = [Badge(badges[0].text, "bad")]
    else:
        kinds = _kinds(drive_encounters)
        tone: Tone = "bad" if kinds[FALSE] or kinds[LATE] else "alert"
        badges = [Badge(f"{len(drive_encounters.encounters)} warnings: {_tally(drive_encounters)}", tone)]
    if drive_encounters.missed:
        badges.append(Badge(f"{count(len(drive_encounters.missed), 'conflict')} without a warning", "bad"))
    return badges


def _missed(drive: Drive, drive_encounters: Meetings) -> list[str]:
    """Return sentences on the first conflicts without a warning."""
    sentences = []
    conflict = drive.rule.definition.words
    for missed in drive_encounters.missed[:3]:
        sentences.append(
            f"No warning came before {_at(drive, missed.conflict.onset_ns)}, when {conflict} "
            f"({missed.other.kind} {printable(missed.other.id)[:MAX_ID]}, nearest {missed.conflict.closest_m:.1f} m)."
        )
    if len(drive_encounters.missed) > len(sentences):
        sentences.append(f"{len(drive_encounters.missed) - len(sentences)} more conflicts had no warning either.")
    return sentences


def _nobody_near(drive: Drive, drive_encounters: Meetings) -> str:
    """Return the headline of a drive without a warning."""
    text = f"In this drive of {duration((drive.end_ns - drive.start_ns) / NS_PER_S)} cwcli gave no warning"
    if drive.ego is None:  # the lane alone was watched
        return f"{text} of leaving the lane; the car's place was not estimated, so no collision was looked for."
    if drive_encounters.nearest is None:
        return f"{text}; no other vehicle was heard while the car's place was known."
    nearest = drive_encounters.nearest
    name = f"{nearest.other.kind} {printable(nearest.other.id)[:MAX_ID]}"
    at = _at(drive, nearest.stamp_ns)
    return f"{text}; the nearest other, {name}, was {nearest.distance_m:.1f} m away (centre to centre) at {at}."


def _knowledge(drive: Drive) -> str:
    """Say which states the warnings started from; "" if there are none or the record does not say."""
    record, _ = warn_record(drive.records)
    states = configuration_of(record).get("states")
    if drive.warnings is None or states is None:
        return ""
    if states != "online":
        return (
            "Warnings are from states in hindsight, which know what came, at their stamps: no car could have given "
            "them like this."
        )
    used = drive.records.get("estimate", {}).get("online_parameters", "")
    but = ", but with noise and latencies from the whole log" if used == THIS_LOG else ""
    return f"Warnings are given when the car could have known{but}; what happened is judged in hindsight."


def _length(drive: Drive) -> str:
    """Say how long and how far the drive was, and how many others were known."""
    text = f"The log is {duration((drive.end_ns - drive.start_ns) / NS_PER_S)} long"
    if drive.ego is not None and len(drive.ego) > 1:
        top = float(np.nanmax(np.abs(drive.ego.state[:, 2])))
        text += f"; the car drove {driven_m(drive.ego):.0f} m, at most {3.6 * top:.0f} km/h"
    heard = sum(other.kind == "vehicle" for other in drive.others)
    seen = sum(other.kind == "target" for other in drive.others)
    if heard:
        text += f"; {count(heard, 'other vehicle')} {'was' if heard == 1 else 'were'} heard by radio"
    if seen:
        text += f"; {count(seen, 'target')} {'was' if seen == 1 else 'were'} tracked by its sensors"
    return text + "."


def _without_warnings(drive: Drive, left_out: str, more: list[str]) -> Story:
    """Build the story of a drive for which no warnings were computed."""
    why = left_out or ("`cwcli warn` was not run" if drive.others else "no other vehicle is in the log")
    reason = f": {printable(why)}" if drive.ego is not None or left_out else ""
    sentences = []
    if drive.lanes is not None and len(drive.lanes):
        both = int(np.count_nonzero(drive.lanes.found.all(axis=1)))
        sentences.append(f"Both lane boundaries were found in {both} of {len(drive.lanes)} camera frames")
    n_targets = sum(other.kind == "target" for other in drive.others)
    if n_targets and drive.ego is None:
        sentences.append(f"{count(n_targets, 'target')} {'was' if n_targets == 1 else 'were'} tracked by the sensors")
    if drive.ego is None:
        sentences.append(f"the car's motion was not estimated{'' if sentences else reason}")
    else:
        sentences.append(f"the car's motion was estimated, but no warnings were computed{reason}")
    text = "; ".join(sentences)
    return Story(f"{text[:1].upper()}{text[1:]}.", tuple(more), (Badge("no warnings computed", "plain"),))
