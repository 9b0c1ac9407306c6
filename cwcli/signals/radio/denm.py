"""ETSI Decentralized Environmental Notification Message in the packed encoding (EN 302 637-3 V1.3.1, BTP port 2002).

It tells of an event on the road, not of its sender. Release 2 (TS 103 831) packs what is read here alike.
"""

from __future__ import annotations

from functools import cache

from cwcli.signals.columns import Int64Array
from cwcli.signals.denm import events_of
from cwcli.signals.radio.messages import Decoded
from cwcli.signals.radio.program import Program, compile_type
from cwcli.signals.radio.tables import load
from cwcli.signals.road_events import RoadEvents

MESSAGE_ID = 1
PROTOCOL_VERSIONS = (2,)

_MANAGEMENT = "denm.management."
PATHS: dict[str, str] = {
    "station": "header.stationID",
    "action_station": _MANAGEMENT + "actionID.originatingStationID",
    "action_number": _MANAGEMENT + "actionID.sequenceNumber",
    "cause": "denm.situation.eventType.causeCode",
    "sub_cause": "denm.situation.eventType.subCauseCode",
    "reference_time_ms": _MANAGEMENT + "referenceTime",
    "termination": _MANAGEMENT + "termination",
    "latitude_deg": _MANAGEMENT + "eventPosition.latitude",
    "longitude_deg": _MANAGEMENT + "eventPosition.longitude",
    "relevance": _MANAGEMENT + "relevanceDistance",
    "validity_s": _MANAGEMENT + "validityDuration",
}
"""Quantity of `signals.denm` -> component."""


@cache
def program() -> Program:
    """The components of `PATHS`."""
    return compile_type(load("denm"), tuple(PATHS.values()))


def events(decoded: Decoded, log_time_ns: Int64Array) -> RoadEvents:
    """The events of the messages that could be decoded; of all of them the log times (n,)."""
    is_ok = decoded.status == 0
    return events_of({name: decoded.numbers(path)[is_ok] for name, path in PATHS.items()}, log_time_ns[is_ok])
