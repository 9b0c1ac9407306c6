"""ETSI Decentralized Environmental Notification Message in the packed encoding (EN 302 637-3 V1.3.1, BTP port 2002).

It describes an event on the road, not its sender. Release 2 (TS 103 831) packs what is read here alike.
"""

from __future__ import annotations

from functools import cache

from cwcli.signals.columns import Int64Array
from cwcli.signals.denm import events_from_codes
from cwcli.signals.radio.messages import DecodedMessages
from cwcli.signals.radio.program import Program, compile_type
from cwcli.signals.radio.tables import load_message_type
from cwcli.signals.road_events import RoadEvents

DENM_MESSAGE_ID = 1
"""The message id of a DENM (TS 102 894-2)."""
DENM_PROTOCOL_VERSIONS = (2,)
"""The protocol versions that are decoded."""

_MANAGEMENT_PREFIX = "denm.management."
"""The path prefix of the management container."""
DENM_COMPONENT_PATHS: dict[str, str] = {
    "station": "header.stationID",
    "action_station": _MANAGEMENT_PREFIX + "actionID.originatingStationID",
    "action_number": _MANAGEMENT_PREFIX + "actionID.sequenceNumber",
    "cause": "denm.situation.eventType.causeCode",
    "sub_cause": "denm.situation.eventType.subCauseCode",
    "reference_time_ms": _MANAGEMENT_PREFIX + "referenceTime",
    "termination": _MANAGEMENT_PREFIX + "termination",
    "latitude_deg": _MANAGEMENT_PREFIX + "eventPosition.latitude",
    "longitude_deg": _MANAGEMENT_PREFIX + "eventPosition.longitude",
    "relevance": _MANAGEMENT_PREFIX + "relevanceDistance",
    "validity_s": _MANAGEMENT_PREFIX + "validityDuration",
}
"""The component of the packed message, by quantity of `signals.denm`."""


@cache
def compile_denm_program() -> Program:
    """Compile the program that decodes the components of a DENM."""
    return compile_type(load_message_type("denm"), tuple(DENM_COMPONENT_PATHS.values()))


def events_from_decoded(decoded: DecodedMessages, log_time_ns: Int64Array) -> RoadEvents:
    """Build the events of the messages that could be decoded; `log_time_ns` (n,) is of all messages."""
    is_ok = decoded.status == 0
    return events_from_codes(
        {name: decoded.component_numbers(path)[is_ok] for name, path in DENM_COMPONENT_PATHS.items()},
        log_time_ns[is_ok],
    )
