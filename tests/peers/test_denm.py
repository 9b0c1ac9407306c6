"""DENMs of a ROS channel and off the radio: what is notified, where, until when, and what of it a rule may use."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pycrate_asn1dir import ITS_DENM_3

from cwcli.logs.read.reader import Log
from cwcli.signals.build import build_signal
from cwcli.signals.canonical import RemoteSignal
from cwcli.signals.denm import DENM_PATHS, ROS_LEAF_FIELDS
from cwcli.signals.etsi import CAM_AND_VAM_CODEC
from cwcli.signals.quality import Quality
from cwcli.signals.road_events import HARD_BRAKING_KIND, RoadEvents, empty_road_events, hard_braking_known_mask_or_none
from cwcli.signals.role import Role
from tests.laws.input_logs import write_log
from tests.laws.input_messages import DELAY_NS, stamp_of
from tests.laws.perceived_messages import MS, nested
from tests.unit.signals.signal_columns import columns_of
from tests.unit.signals.v2x_messages import LOG_NS, radio, ros_paths

ROS_PATHS = ros_paths(DENM_PATHS)
ITS_EPOCH_MS = 1_072_915_200_000
S = 1_000_000_000


def message(reference_ms: int, **changes: Any) -> dict[str, Any]:
    """An emergency brake at 50 degrees north, valid for 2 s within 200 m."""
    codes = {
        "station": 1001,
        "action_station": 1001,
        "action_number": 1,
        "cause": 99,
        "sub_cause": 1,
        "has_cause": True,
        "reference_time_ms": reference_ms - ITS_EPOCH_MS + 5000,
        "termination": 0,
        "has_termination": False,
        "latitude_deg": 500_000_000,
        "longitude_deg": 80_000_000,
        "relevance": 2,
        "has_relevance": True,
        "validity_s": 2,
    }
    return nested({ROS_PATHS[name]: code for name, code in (codes | changes).items()})


def notified(path: Path, messages: list[dict[str, Any]]) -> tuple[RoadEvents, Quality]:
    """From a log of the official writer."""
    schema = "etsi_its_denm_msgs/DENM"
    write_log(path / "log.mcap", schema, "cdr", "/denm", messages)
    with Log.open(path / "log.mcap") as log:
        signal, quality = build_signal(Role.REMOTE, log.columns("/denm", fields=ROS_LEAF_FIELDS))
    assert isinstance(signal, RemoteSignal)
    assert signal.events is not None
    assert quality.read == sum(quality.set_aside.values()) == len(messages)
    assert not len(signal.stamp_ns)
    return signal.events, quality


def test_a_ros_channel_is_events_with_place_and_validity(tmp_path: Path) -> None:
    at_ms = stamp_of(0) // MS
    made = [
        message(at_ms),
        message(at_ms, sub_cause=2, action_number=2),  # pre-crash: no braking by itself
        message(at_ms, cause=94, station=7, action_number=3, has_relevance=False, validity_s=600),
        message(at_ms, action_number=4, has_termination=True),
        message(at_ms, action_number=5, has_cause=False),
    ]
    events, quality = notified(tmp_path, made)
    assert [events.kind.values[code] for code in events.kind.codes] == [
        HARD_BRAKING_KIND,
        "dangerous situation",
        "stationary vehicle",
        HARD_BRAKING_KIND,
        "without a cause",
    ]
    assert events.stamp_ns.tolist() == [stamp_of(0)] * 5
    assert ((events.until_ns - events.stamp_ns) / S).tolist() == [2.0, 2.0, 600.0, 0.0, 2.0]
    assert [events.station.values[code] for code in events.station.codes] == ["1001", "1001", "7", "1001", "1001"]
    np.testing.assert_allclose(events.latitude_deg, 50.0)
    np.testing.assert_equal(events.relevance_m, [200.0, 200.0, np.nan, 200.0, 200.0])
    assert quality.set_aside == {"DENM (a road event)": 5}
    assert quality.notes[0].startswith("5 DENMs of 2 stations: 2 hard braking")


@pytest.mark.parametrize("validity_s", [None, 2])
def test_off_the_radio_it_is_the_same(validity_s: int | None) -> None:
    management = {
        "actionID": {"originatingStationID": 1001, "sequenceNumber": 1},
        "detectionTime": 5,
        "referenceTime": int(LOG_NS[0]) // MS - ITS_EPOCH_MS + 5000 - 30,
        "eventPosition": {
            "latitude": 500_000_000,
            "longitude": 80_000_000,
            "positionConfidenceEllipse": dict.fromkeys(("semiMajorConfidence", "semiMinorConfidence"), 4095)
            | {"semiMajorOrientation": 3601},
            "altitude": {"altitudeValue": 800_001, "altitudeConfidence": "unavailable"},
        },
        "relevanceDistance": "lessThan200m",
        "stationType": 5,
    }
    management |= {} if validity_s is None else {"validityDuration": validity_s}
    situation = {"eventType": {"causeCode": 99, "subCauseCode": 5}, "informationQuality": 3}
    header = {"protocolVersion": 2, "messageID": 1, "stationID": 1001}
    official = ITS_DENM_3.DENM_PDU_Descriptions.DENM
    official.set_val({"header": header, "denm": {"management": management, "situation": situation}})
    signal, _ = build_signal(Role.REMOTE, radio("udp_msgs/UdpPacket", "data", b"\x07\xd2\x00\x00" + official.to_uper()))
    assert isinstance(signal, RemoteSignal)
    events = signal.events
    assert events is not None
    assert events.kind.values == (HARD_BRAKING_KIND,)
    assert events.stamp_ns.tolist() == [int(LOG_NS[0]) - 30 * MS]
    assert ((events.until_ns - events.stamp_ns) / S).tolist() == [600.0 if validity_s is None else 2.0]  # the default
    assert events.relevance_m.tolist() == [200.0]


def test_who_says_so_brakes_hard_from_then_on_and_only_as_far_as_it_was_known(tmp_path: Path) -> None:
    events, _ = notified(tmp_path, [message(stamp_of(0) // MS)])
    state_ns = stamp_of(0) + np.array([-1, 0, 1, 2, 3]) * S
    known = hard_braking_known_mask_or_none(events, "1001", state_ns, state_ns + DELAY_NS)
    assert known is not None
    assert known.tolist() == [False, True, True, True, False]
    early = hard_braking_known_mask_or_none(events, "1001", state_ns, state_ns)  # known before the message had come
    assert early is not None
    assert early.tolist() == [False, False, True, True, False]
    assert hard_braking_known_mask_or_none(events, "1002", state_ns, state_ns) is None
    assert hard_braking_known_mask_or_none(empty_road_events(), "1001", state_ns, state_ns) is None


@pytest.mark.parametrize(
    ("later", "expected"),
    [
        ({"has_termination": True}, [False, False]),
        ({"sub_cause": 2}, [False, False]),
        ({"has_termination": True, "action_number": 2}, [True, True]),  # of another event
        ({"has_termination": True, "action_station": 1002}, [True, True]),
        ({}, [True, True]),  # it goes on
    ],
)
def test_a_later_denm_of_the_same_action_takes_the_place_of_the_earlier(
    later: dict[str, Any], expected: list[bool], tmp_path: Path
) -> None:
    first_ns, second_ns = stamp_of(0), stamp_of(1)
    messages = [message(first_ns // MS, validity_s=600), message(second_ns // MS, validity_s=600, **later)]
    events, _ = notified(tmp_path, messages)
    received_ns = second_ns + DELAY_NS
    state_ns = np.array([received_ns - 1, received_ns + 1, received_ns + S])
    said = hard_braking_known_mask_or_none(events, "1001", state_ns, state_ns + DELAY_NS)
    assert said is not None
    assert said.tolist() == [True, *expected]


def test_no_car_brakes_hard_for_ten_minutes(tmp_path: Path) -> None:
    events, _ = notified(tmp_path, [message(stamp_of(0) // MS, validity_s=600)])
    state_ns = stamp_of(0) + np.array([1, 5, 6, 60]) * S
    said = hard_braking_known_mask_or_none(events, "1001", state_ns, state_ns)
    assert said is not None
    assert said.tolist() == [True, True, False, False]


NO_CODES: dict[str, tuple[float, str]] = {
    "station": (2.0**32, "StationID"),
    "action_station": (-1.0, "StationID"),
    "action_number": (65_536.0, "SequenceNumber"),
    "cause": (256.0, "CauseCodeType"),
    "sub_cause": (1.5, "SubCauseCodeType"),
    "termination": (2.0, "Termination"),
    "relevance": (8.0, "RelevanceDistance"),
    "validity_s": (86_401.0, "ValidityDuration"),
    "reference_time_ms": (float("inf"), "TimestampIts"),
    "latitude_deg": (1e300, "Latitude"),
}
"""Quantity -> what a JSON message can hold there that no DENM can, and the element."""


@pytest.mark.parametrize("name", NO_CODES)
def test_a_number_that_is_no_code_tells_nothing_and_is_counted(name: str) -> None:
    code, element = NO_CODES[name]
    codes: dict[str, float] = {
        "station": 7,
        "cause": 94,
        "sub_cause": 0,
        "reference_time_ms": 0,
        "has_cause": 1,
        "validity_s": 60,
    }
    codes |= {"action_station": 7, "action_number": 1, "termination": np.nan, "relevance": 3, "has_relevance": 1}
    codes |= {"has_termination": 1, "latitude_deg": 500_000_000, "longitude_deg": 80_000_000}
    rows = {ROS_PATHS[each]: [float(value), code if each == name else float(value)] for each, value in codes.items()}
    signal, quality = build_signal(Role.REMOTE, columns_of("etsi_its_denm_msgs/DENM", rows, message_encoding="json"))
    assert isinstance(signal, RemoteSignal)
    events = signal.events
    assert events is not None
    assert len(events) == 2
    assert quality.repaired[f"{element} outside its range, left out"] == 1
    assert not np.isin(code, [events.cause, events.sub_cause]).any()
    assert [events.station.values[k] for k in events.station.codes] == ["7", "unknown" if name == "station" else "7"]
    held_s = (events.until_ns - events.stamp_ns)[1] / S
    assert held_s == {"validity_s": 600.0}.get(name, 60.0)  # also where the cancellation is none


def test_no_two_senders_become_one_where_numbers_are_no_station_ids() -> None:
    paths = {"header.station_id.value": [7.0, 7.25, 2.0**32, -7.0]}
    columns = columns_of("etsi_its_cam_msgs/CAM", paths, message_encoding="json")
    senders = CAM_AND_VAM_CODEC.identify(columns)
    assert senders.station.values == ("7",)
    assert senders.station.codes.tolist() == [0, -1, -1, -1]
    _, quality = build_signal(Role.REMOTE, columns)
    assert quality.repaired["StationID outside its range, left out"] == 3
