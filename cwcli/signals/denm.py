"""ETSI decentralized notifications (EN 302 637-3): `etsi_its_denm_msgs/DENM`, and as received by radio.

Codes after TS 102 894-2.
"""

from __future__ import annotations

import numpy as np

from cwcli.signals.columns import BoolArray, Columns, FloatArray, Int64Array, encode_strings, sort_distinct_values
from cwcli.signals.leaf_fields import read_numbers
from cwcli.signals.perceived import unknown_senders
from cwcli.signals.quality import RowLedger
from cwcli.signals.road_events import HARD_BRAKING_KIND, RoadEvents
from cwcli.signals.units import NS_PER_S
from cwcli.signals.v2x_codec import RemoteRows, V2xCodec, empty_remote_rows
from cwcli.signals.v2x_elements import decode_codes_to_values, decode_enumeration, decode_identifier_codes
from cwcli.signals.v2x_tables import (
    load_message_table,
    ros_leaf_fields_of_components,
    ros_leaf_path,
    ros_presence_paths,
)
from cwcli.signals.v2x_time import NO_TIME_REASON, stamps_ns_and_validity_from_timestamp_its

CAUSE_TEXTS_BY_CODE: dict[int, str] = {
    1: "traffic condition",
    2: "accident",
    3: "roadworks",
    6: "adhesion",
    9: "surface condition",
    10: "obstacle on the road",
    11: "animal on the road",
    12: "people on the road",
    14: "wrong-way driving",
    15: "rescue work",
    17: "extreme weather",
    18: "visibility",
    19: "precipitation",
    26: "slow vehicle",
    27: "end of a queue",
    91: "vehicle breakdown",
    92: "post crash",
    93: "human problem",
    94: "stationary vehicle",
    95: "emergency vehicle approaching",
    96: "dangerous curve",
    97: "collision risk",
    98: "signal violation",
    99: "dangerous situation",
}
"""The text of each cause, by CauseCodeType (TS 102 894-2)."""
DANGEROUS_SITUATION_CODE = 99
"""The cause code of a dangerous situation (TS 102 894-2)."""
EMERGENCY_BRAKING_SUB_CAUSES = (1, 5)
"""The sub-causes of a dangerous situation that mean hard braking: electronic brake lights on, automatic emergency brake
engaged."""
DEFAULT_VALIDITY_S = 600.0
"""The validity of a DENM that gives none, in seconds (EN 302 637-3)."""
RELEVANCE_DISTANCE_M_BY_CODE: dict[int, float] = dict(
    enumerate((50.0, 100.0, 200.0, 500.0, 1000.0, 5000.0, 10_000.0, np.inf))
)
"""The distance in metres within which a DENM matters, by RelevanceDistance; code 7 is over 10 km."""
_DENM_QUANTITY_TABLE = load_message_table("denm", "etsi")
"""The quantities of a DENM: their data elements, and their paths."""
DENM_PATHS = _DENM_QUANTITY_TABLE.columns["denm"]
"""The component of a DENM, by quantity."""
_MEASURED_DENM_QUANTITIES_THAT_ARE_NO_CODES = ("latitude_deg", "longitude_deg")
"""The quantities that are measured; all others are codes that must be whole numbers."""
ROS_LEAF_FIELDS = ros_leaf_fields_of_components(DENM_PATHS)
"""The leaf fields of the ROS message that are read."""


def read_ros_events_and_unreadable_mask(columns: Columns) -> tuple[RoadEvents, BoolArray]:
    """Read the events of a ROS channel; invalid codes are counted where the channel is decoded."""
    return road_events_from_denm_codes(_read_denm_codes_by_quantity(columns), columns.log_time_ns), np.zeros(
        len(columns), np.bool_
    )


def _read_denm_codes_by_quantity(columns: Columns, ledger: RowLedger | None = None) -> dict[str, FloatArray]:
    """Return the codes of the ROS fields, NaN where absent or not in the standard; the ledger counts the latter."""
    raw = {name: read_numbers(columns, ros_leaf_path(path)) for name, path in DENM_PATHS.items()}
    for name, flag in ros_presence_paths(DENM_PATHS).items():
        raw[name] = np.where(read_numbers(columns, flag) == 0, np.nan, raw[name])
    for name, element in _DENM_QUANTITY_TABLE.elements.items():
        if name not in _MEASURED_DENM_QUANTITIES_THAT_ARE_NO_CODES:
            raw[name] = decode_identifier_codes(element, raw[name], ledger)
    return raw


def road_events_from_denm_codes(codes_by_quantity: dict[str, FloatArray], log_time_ns: Int64Array) -> RoadEvents:
    """Build events from the codes of n messages, NaN where a component is absent."""
    stamp_ns, has_time = stamps_ns_and_validity_from_timestamp_its(codes_by_quantity["reference_time_ms"], log_time_ns)
    stamp_ns = np.where(has_time, stamp_ns, log_time_ns)
    validity_s = np.where(
        np.isfinite(codes_by_quantity["validity_s"]), codes_by_quantity["validity_s"], DEFAULT_VALIDITY_S
    )
    validity_s = np.where(np.isfinite(codes_by_quantity["termination"]), 0.0, validity_s)
    kinds = [
        cause_text(*pair)
        for pair in zip(codes_by_quantity["cause"].tolist(), codes_by_quantity["sub_cause"].tolist(), strict=True)
    ]
    station = [str(int(code)) if np.isfinite(code) else "unknown" for code in codes_by_quantity["station"].tolist()]
    return RoadEvents(
        station=encode_strings(station),
        kind=encode_strings(kinds),
        stamp_ns=stamp_ns,
        log_time_ns=log_time_ns,
        until_ns=_validity_ends_at_next_denm_ns(
            stamp_ns + (np.clip(validity_s, 0.0, 86_400.0) * NS_PER_S).astype(np.int64), codes_by_quantity, log_time_ns
        ),
        cause=codes_by_quantity["cause"],
        sub_cause=codes_by_quantity["sub_cause"],
        latitude_deg=decode_codes_to_values(
            _DENM_QUANTITY_TABLE.elements["latitude_deg"], codes_by_quantity["latitude_deg"]
        ),
        longitude_deg=decode_codes_to_values(
            _DENM_QUANTITY_TABLE.elements["longitude_deg"], codes_by_quantity["longitude_deg"]
        ),
        relevance_m=decode_enumeration(RELEVANCE_DISTANCE_M_BY_CODE, codes_by_quantity["relevance"]),
    )


def _validity_ends_at_next_denm_ns(
    until_ns: Int64Array, codes_by_quantity: dict[str, FloatArray], log_time_ns: Int64Array
) -> Int64Array:
    """Return until when each DENM is valid, in ns (n,): at most until the next DENM of the same action was received."""
    ends_ns = until_ns.copy()
    next_ns: dict[tuple[float, float], int] = {}
    actions = list(
        zip(codes_by_quantity["action_station"].tolist(), codes_by_quantity["action_number"].tolist(), strict=True)
    )
    for k in np.argsort(log_time_ns, kind="stable")[::-1].tolist():
        if np.isfinite(actions[k]).all():
            ends_ns[k] = min(ends_ns[k], next_ns.get(actions[k], ends_ns[k]))
            next_ns[actions[k]] = int(log_time_ns[k])
    return ends_ns


def cause_text(cause: float, sub_cause: float) -> str:
    """Return the text of a DENM's cause."""
    if not np.isfinite(cause):
        return "without a cause"
    if cause == DANGEROUS_SITUATION_CODE and sub_cause in EMERGENCY_BRAKING_SUB_CAUSES:
        return HARD_BRAKING_KIND
    return CAUSE_TEXTS_BY_CODE.get(int(cause), f"cause {int(cause)}")


def event_counts_notice_or_empty(events: RoadEvents) -> str:
    """Format a notice such as `3 DENMs of 2 stations: 2 stationary vehicle, 1 roadworks`; "" without events."""
    if not len(events):
        return ""
    kinds, counts = np.unique([events.kind.values[code] for code in events.kind.codes], return_counts=True)
    order = np.argsort(-counts, kind="stable")
    said = ", ".join(f"{counts[k]} {kinds[k]}" for k in order)
    return f"{len(events)} DENMs of {len(sort_distinct_values(events.station.codes))} stations: {said}"


def _count_faults_and_set_all_aside(columns: Columns, ledger: RowLedger) -> RemoteRows:
    raw = _read_denm_codes_by_quantity(columns, ledger)
    for name in _MEASURED_DENM_QUANTITIES_THAT_ARE_NO_CODES:
        decode_codes_to_values(_DENM_QUANTITY_TABLE.elements[name], raw[name], ledger)
    ledger.count_repaired(np.isnan(raw["reference_time_ms"]), NO_TIME_REASON)
    said = event_counts_notice_or_empty(road_events_from_denm_codes(raw, columns.log_time_ns))
    if said:
        ledger.add_note(said)
    ledger.set_aside(np.ones(len(columns), np.bool_), "DENM (a road event)")
    return empty_remote_rows(len(columns))


ROS_DENM_CODEC = V2xCodec(unknown_senders, _count_faults_and_set_all_aside, events=read_ros_events_and_unreadable_mask)
"""The codec of a ROS channel of DENMs."""
