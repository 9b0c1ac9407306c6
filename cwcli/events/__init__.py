"""What can be found in a log: named events, one file each or each family, and one line each here; expressions.

Other packages add theirs in the group `cwcli.events`. `cwcli find`, its help and completion, and the table in
docs/find.md take them from here.
"""

from __future__ import annotations

from collections.abc import Iterable

from cwcli.events.base import EventKind, Moment
from cwcli.events.evidence import EventEvidence
from cwcli.registry import Registry, accept_dataclass_of


def _check_moments(found: Iterable[Moment], evidence: EventEvidence) -> list[Moment]:
    """Check what a plug-in's event found, and return it.

    Raises:
        TypeError: It is not an iterable of `Moment`s.
        ValueError: A moment ends before it starts.
    """
    moments = list(found)
    for each in moments:
        if not isinstance(each, Moment):
            raise TypeError(f"a {type(each).__name__}, no Moment")
        if each.end_ns < each.start_ns:
            raise ValueError(f"a moment that ends {each.start_ns - each.end_ns} ns before it starts")
    return moments


EVENTS: Registry[EventKind] = Registry(
    "event",
    "cwcli.events",
    {
        "near-miss": "cwcli.events.near_miss:EVENT",
        "hard-brake": "cwcli.events.braking:EGO_EVENT",
        "hard-brake-other": "cwcli.events.braking:OTHER_EVENT",
        "tailgating": "cwcli.events.tailgating:EVENT",
        "cut-in": "cwcli.events.cutting:CUT_IN_EVENT",
        "cut-out": "cwcli.events.cutting:CUT_OUT_EVENT",
        "turn-across": "cwcli.events.turn_across:EVENT",
        "overtaking": "cwcli.events.overtaking:EVENT",
        "lane-change": "cwcli.events.lane_change:EVENT",
        "lane-departure": "cwcli.events.lane_departure:EVENT",
        "stop-and-go": "cwcli.events.stop_and_go:EVENT",
        "gnss-outage": "cwcli.events.gaps:OUTAGE_EVENT",
        "sensor-gap": "cwcli.events.gaps:GAP_EVENT",
        "warning": "cwcli.events.warnings:EVENT",
        "warning-true": "cwcli.events.warnings:TRUE_EVENT",
        "warning-late": "cwcli.events.warnings:LATE_EVENT",
        "warning-false": "cwcli.events.warnings:FALSE_EVENT",
        "warning-undecided": "cwcli.events.warnings:UNDECIDED_EVENT",
        "disagreement": "cwcli.events.disagreement:EVENT",
        "doubt": "cwcli.events.doubtful:EVENT",
    },
    accept_dataclass_of(EventKind, {"find": _check_moments}),
)
