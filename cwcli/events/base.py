"""An event that can be found in a log, and a moment in which it happened."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Literal

from cwcli.events.evidence import EventEvidence
from cwcli.lazy_dataclass import dataclass

MAX_SEVERITY = 10.0
"""Greatest severity; chosen by hand, so that a value near zero does not hide all others."""


@dataclass(frozen=True)
class Moment:
    """One occurrence of an event.

    Attributes:
        start_ns, end_ns: When it began and ended, on the clock of the states [ns].
        actors: Ids of the vehicles, the ego first, or the topic that it is about.
        value: The number that makes it an event; `EventKind.value_name` says which and its unit. NaN: there is none.
        severity: How many times the value is beyond the event's threshold: 1 at the threshold, at most `MAX_SEVERITY`.
        detail: Which of several kinds it is; a part of the event's id.
        words: What happened, with the value and its unit, for people; "": the name of the value and the value.
    """

    start_ns: int
    end_ns: int
    actors: tuple[str, ...]
    value: float
    severity: float
    detail: str = ""
    words: str = ""


@dataclass(frozen=True)
class EventKind:
    """A kind of event.

    Attributes:
        summary: One line for the help and the documentation.
        value_name: Name of the value with its unit: `peak_deceleration_mps2`.
        threshold: From which value on it is an event; "" where there is none.
        source: Where the threshold comes from.
        needs: What the log must hold, in words.
        find: Returns the moments in a log, in order of time.
    """

    summary: str
    value_name: str
    threshold: str
    source: str
    needs: str
    find: Callable[[EventEvidence], Iterable[Moment]]


def severity_as_ratio_to_threshold(value: float, threshold: float, critical: Literal["low", "high"]) -> float:
    """Return how many times a value is beyond a threshold, 1 at the threshold, from 0 to `MAX_SEVERITY`.

    Below zero the magnitudes count: -6 is twice beyond a threshold of -3 where low values are critical.
    """
    if threshold < 0.0:
        return severity_as_ratio_to_threshold(-value, -threshold, "high" if critical == "low" else "low")
    if critical == "low":
        return min(threshold / value, MAX_SEVERITY) if value > 0.0 else MAX_SEVERITY
    return min(max(value / threshold, 0.0), MAX_SEVERITY)
