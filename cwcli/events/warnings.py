"""Warnings of any rule, and those with each verdict."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from cwcli.errors import MissingSignalError
from cwcli.evaluation.conflicts import (
    VERDICT_FALSE,
    VERDICT_LATE,
    VERDICT_TRUE,
    VERDICT_UNDECIDED,
    judge_warning,
)
from cwcli.events.base import EventKind, Moment, severity_as_ratio_to_threshold
from cwcli.events.evidence import EventEvidence

VERDICT_OF_WARNING_WITHOUT_TRACK = "no verdict"
"""The verdict on a warning about something without a track, such as a lane boundary."""
DISTANCE_THRESHOLD_OF_WARNING_SEVERITY_TEXT = (
    "for the severity: 2.5 m between the centres, or `--distance` of `cwcli warn`"
)
"""Threshold that the severity of a warning compares the least distance with; the words of the table of events."""


def find_warnings(evidence: EventEvidence, verdict: str | None = None) -> Iterator[Moment]:
    """Yield the warnings with a verdict; None: all."""
    if verdict is not None and evidence.outcomes is None:
        raise MissingSignalError(
            "verdicts on warnings need the states of both", where=evidence.log.name, hint="run `cwcli run` on it first"
        )
    for warning in evidence.warnings:
        outcomes = evidence.outcomes  # a log without warnings needs none
        kind, lead_s, closest_m = VERDICT_OF_WARNING_WITHOUT_TRACK, np.nan, np.nan
        if outcomes is not None and warning.other_id in outcomes.pairs:
            conflicts, pair = outcomes.conflicts[warning.other_id], outcomes.pairs[warning.other_id]
            outcome = judge_warning(warning.raised_ns, warning.last_ns, conflicts, pair, outcomes.config)
            kind, lead_s, closest_m = outcome.kind, outcome.lead_time_s, outcome.closest_m
        if verdict in (None, kind):
            severity = 1.0
            if outcomes is not None and np.isfinite(closest_m):
                severity = severity_as_ratio_to_threshold(closest_m, outcomes.config.distance_m, "low")
            actors = ("ego", warning.other_id)
            words = _describe_verdict(warning.rule, kind, lead_s)
            yield Moment(warning.raised_ns, warning.last_ns, actors, lead_s, severity, f"{warning.rule}: {kind}", words)


def _describe_verdict(rule: str, verdict: str, lead_s: float) -> str:
    """Return rule and verdict of a warning in words, with its lead time [s] where it has one."""
    if verdict == VERDICT_TRUE:
        return f"rule {rule}, {lead_s:.1f} s before the conflict"
    described = {
        VERDICT_LATE: "during the conflict, too late",
        VERDICT_FALSE: "no conflict followed: a false warning",
        VERDICT_UNDECIDED: "the other was not seen for long enough to judge it",
        VERDICT_OF_WARNING_WITHOUT_TRACK: "not judged: what it warns of has no track",
    }
    return f"rule {rule}, {described[verdict]}"


def _event_of_verdict(verdict: str, summary: str) -> EventKind:
    """Return the event of the warnings with one verdict."""
    return EventKind(
        summary=summary,
        value_name="lead_time_s",
        threshold=DISTANCE_THRESHOLD_OF_WARNING_SEVERITY_TEXT,
        source="the verdicts of `cwcli evaluate`",
        needs="warnings, states of others",
        find=partial(find_warnings, verdict=verdict),
    )


EVENT = EventKind(
    summary="a warning of any rule",
    value_name="lead_time_s",
    threshold=DISTANCE_THRESHOLD_OF_WARNING_SEVERITY_TEXT,
    source="the rules of `cwcli warn`",
    needs="warnings",
    find=find_warnings,
)
TRUE_EVENT = _event_of_verdict(VERDICT_TRUE, "a warning before a conflict")
LATE_EVENT = _event_of_verdict(VERDICT_LATE, "a warning during a conflict")
FALSE_EVENT = _event_of_verdict(VERDICT_FALSE, "a warning that no conflict followed")
UNDECIDED_EVENT = _event_of_verdict(VERDICT_UNDECIDED, "a warning after which the other was not seen for long enough")
