"""The event flags of BSMs: the same events from JSON and ROS 2 as off the radio."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cwcli.logs.read.reader import Log
from cwcli.signals.bsm_flags import read_json_event_flags_and_unreadable
from cwcli.signals.build import build_signal
from cwcli.signals.canonical import RemoteSignal
from cwcli.signals.inputs import find_input_for_role
from cwcli.signals.quality import Quality
from cwcli.signals.road_events import HARD_BRAKING_KIND, RoadEvents
from cwcli.signals.role import Role
from tests.laws.input_logs import write_log
from tests.laws.input_messages import DELAY_NS, SAMPLES, stamp_of
from tests.unit.signals.signal_columns import columns_of

BRAKING, WIPERS, TYRE = "eventHardBraking", "eventWipersChanged", "eventFlatTire"
OTHER = {"partII-Id": 2, "partII-Value": {"classification": 5}}
NAMED = {BRAKING: True, WIPERS: True, TYRE: False}
ODE_OTHER = {"id": "SupplementalVehicleExtensions", "value": {}}
FORMS: dict[str, tuple[str, Any]] = {
    "bits": ("BasicSafetyMessage", {"partII-Id": 0, "partII-Value": {"events": "0000000101000"}}),
    "bits, fourteen": ("MessageFrame", {"partII-Id": 0, "partII-Value": {"events": "00000001010001"}}),
    "octets": ("BasicSafetyMessage", {"partII-Id": 0, "partII-Value": {"events": "0140"}}),
    "octets and length": (
        "OdeMessageFrameData",
        {"partII-Id": 0, "partII-Value": {"events": {"value": "0140", "length": 13}}},
    ),
    "number": ("BasicSafetyMessage", {"partII-Id": 0, "partII-Value": {"events": 0b0000000101000}}),
    "type's name": (
        "MessageFrame",
        {"partII-Id": 0, "partII-Value": {"VehicleSafetyExtensions": {"events": "0000000101000"}}},
    ),
    "flags by name": ("BasicSafetyMessage", {"partII-Id": 0, "partII-Value": {"events": NAMED}}),
    "ODE": (
        "OdeBsmData",
        {"id": "VehicleSafetyExtensions", "value": {"events": NAMED, "lights": {"fogLightOn": True}}},
    ),
}


def core(schema: str, message: dict[str, Any]) -> dict[str, Any]:
    """The object that holds a BSM's core data."""
    inside = message
    while "coreData" not in inside:
        (inside,) = (each for each in inside.values() if isinstance(each, dict))
    return inside


def read(path: Path, schema: str, encoding: str, messages: list[dict[str, Any]], **how: Any) -> tuple[Any, Quality]:
    with Log.open(write_log(path / "log.mcap", schema, encoding, "/bsm", messages)) as log:
        found = find_input_for_role(Role.REMOTE, schema)
        assert found is not None
        return build_signal(Role.REMOTE, log.columns("/bsm", fields=found.fields[encoding]), **how)


def told(events: RoadEvents | None) -> list[tuple[str, str, int]]:
    assert events is not None
    names = zip(events.station.codes.tolist(), events.kind.codes.tolist(), events.stamp_ns.tolist(), strict=True)
    return sorted((events.station.values[who], events.kind.values[what], stamp) for who, what, stamp in names)


@pytest.mark.parametrize("as_list", [True, False], ids=["list", "alone"])
@pytest.mark.parametrize("form", FORMS)
def test_flags_of_json_messages_are_events(form: str, as_list: bool, tmp_path: Path) -> None:
    schema, extension = FORMS[form]
    messages = [SAMPLES[schema](k)[0] for k in range(3)]
    other = ODE_OTHER if form == "ODE" else OTHER
    core(schema, messages[1])["partII"] = [other, extension] if as_list else extension
    core(schema, messages[2])["partII"] = [other] if as_list else other
    signal, quality = read(tmp_path, schema, "json", messages)
    assert isinstance(signal, RemoteSignal)
    assert len(signal.stamp_ns) == 3
    assert told(signal.events) == [("2a3c603c", WIPERS, stamp_of(1)), ("2a3c603c", HARD_BRAKING_KIND, stamp_of(1))]
    assert signal.events is not None
    assert signal.events.log_time_ns.tolist() == [stamp_of(1) + DELAY_NS] * 2
    np.testing.assert_allclose(signal.events.latitude_deg, 40.8646987, atol=1e-9)
    np.testing.assert_allclose(signal.events.longitude_deg, -77.8304602, atol=1e-9)
    assert "1 messages of 1 stations flag hard braking (over 0.4 g)" in quality.notes


@pytest.mark.parametrize("schema", ["j2735_v2x_msgs/BSM", "carma_v2x_msgs/BSM"])
def test_flags_of_ros_messages_are_events(schema: str, tmp_path: Path) -> None:
    """The constants of the message: EVENT_HARD_BRAKING is 64, EVENT_WIPERS_CHANGED 256, and 8192 none of ours."""
    messages = [SAMPLES[schema](k)[0] for k in range(4)]

    def extension(flags: int, presence: int, n_crumbs: int) -> dict[str, Any]:
        crumbs = [{"lat_offset": 1, "lon_offset": 2}] * n_crumbs
        inside = {"presence_vector": presence, "events": {"vehicle_event_flag": flags}}
        return {"part_ii_id": 0, "vehicle_safety_extensions": inside | {"path_history": {"crumb_data": crumbs}}}

    messages[0]["part_ii"] = [extension(64, 3, 1)]
    messages[1]["part_ii"] = [extension(512, 2, 3), extension(64 + 256 + 8192, 1, 2)]
    messages[2]["part_ii"] = []
    messages[3]["part_ii"] = [extension(64, 2, 5)]  # it has a history, and no events
    signal, quality = read(tmp_path, schema, "cdr", messages)
    expected = [(HARD_BRAKING_KIND, stamp_of(0)), (HARD_BRAKING_KIND, stamp_of(1)), (WIPERS, stamp_of(1))]
    assert sorted((kind, stamp) for _, kind, stamp in told(signal.events)) == sorted(expected)
    assert {who for who, _, _ in told(signal.events)} == {"2a3c603c"}
    np.testing.assert_allclose(signal.events.latitude_deg, 40.8646987, atol=1e-9)
    assert "2 messages of 1 stations flag hard braking (over 0.4 g)" in quality.notes


def test_what_is_no_flag_tells_nothing_and_is_counted() -> None:
    """A number of more than 13 bits, half a flag, another text, truth values; 1.0 may have been one."""
    for values, n_unread in (
        ([8192.0, -1.0, 0.5, np.nan], 3),
        (["01", "hard", "00800", "eventHardBraking"], 4),
        ([True, False, True, True], 4),
        ([1.0, np.nan, 0.0, 0.0], 1),
    ):
        columns = columns_of("BasicSafetyMessage", {"partII.partII-Value.events": values}, message_encoding="json")
        flags, is_unread = read_json_event_flags_and_unreadable(columns, ("",))
        assert flags.tolist() == [0, 0, 0, 0]
        assert np.count_nonzero(is_unread) == n_unread


BITS = [{"partII-Id": 0, "partII-Value": {"events": "0000000100000"}}]
OCTETS = [{"partII-Id": 0, "partII-Value": {"events": "0100"}}]
NUMBER = [{"partII-Id": 0, "partII-Value": {"events": 32}}]
BY_NAME = [{"partII-Id": 0, "partII-Value": {"events": {BRAKING: True, WIPERS: False}}}]


@pytest.mark.parametrize("usual", [BITS, OCTETS, NUMBER, BY_NAME], ids=["bits", "octets", "number", "by name"])
@pytest.mark.parametrize(
    ("odd", "n_unread"),
    [
        ([{"partII-Id": 0, "partII-Value": {}}], 0),
        ([*BITS, OTHER], None),
        ([*BITS, {"partII-Id": 1, "partII-Value": {"events": "x"}}], 1),
        ([{"partII-Id": 0, "partII-Value": {"events": "hard"}}], 1),
        ([{"partII-Id": 0, "partII-Value": {"events": 1e300}}], 1),
        ([{"partII-Id": 0, "partII-Value": {"events": True}}], 1),
        ([{"partII-Id": 0, "partII-Value": {"events": None}}], None),
    ],
)
def test_one_odd_message_leaves_the_flags_of_the_others(
    usual: list[Any], odd: list[Any], n_unread: int | None, tmp_path: Path
) -> None:
    """Three messages brake hard, the second of four is odd; null is counted where numbers are usual, as an odd text."""
    schema = "BasicSafetyMessage"
    messages = [SAMPLES[schema](k)[0] for k in range(4)]
    for k, message in enumerate(messages):
        core(schema, message)["partII"] = odd if k == 1 else usual
    signal, quality = read(tmp_path, schema, "json", messages)
    braking = {stamp for _, kind, stamp in told(signal.events) if kind == HARD_BRAKING_KIND}
    assert braking >= {stamp_of(0), stamp_of(2), stamp_of(3)}
    assert len(told(signal.events)) == len(braking)  # no other flag
    said = [note for note in quality.notes if note.endswith("can't be read and are left out")]
    if n_unread is not None and not (usual is BY_NAME and len(odd) == 2):  # lists of texts alone are no column
        assert said == ["the event flags of 1 messages can't be read and are left out"] * n_unread


def test_ros_flags_whose_extensions_do_not_say_that_they_have_some_are_counted(tmp_path: Path) -> None:
    schema = "j2735_v2x_msgs/BSM"
    messages = [SAMPLES[schema](k)[0] for k in range(3)]
    flags = {"events": {"vehicle_event_flag": 64}}
    for k, said in enumerate(({"presence_vector": 1}, {}, {"presence_vector": 1})):
        messages[k]["part_ii"] = [{"part_ii_id": 0, "vehicle_safety_extensions": flags | said}]
    signal, quality = read(tmp_path, schema, "json", messages)
    assert [stamp for _, _, stamp in told(signal.events)] == [stamp_of(0), stamp_of(2)]
    assert "the event flags of 1 messages can't be read and are left out" in quality.notes


@pytest.mark.parametrize("role", [Role.EGO_POSITION, Role.EGO_SPEED])
def test_flags_are_noted_once(role: Role, tmp_path: Path) -> None:
    """With the remote vehicles, and not with the ego's own signals."""
    schema, extension = FORMS["bits"]
    messages = [SAMPLES[schema](k)[0] for k in range(2)]
    for message in messages:
        core(schema, message)["partII"] = [extension]
    with Log.open(write_log(tmp_path / "log.mcap", schema, "json", "/bsm", messages)) as log:
        found = find_input_for_role(role, schema)
        assert found is not None
        _, quality = build_signal(role, log.columns("/bsm", fields=found.fields["json"]), ego_station="2a3c603c")
    assert not [note for note in quality.notes if "flag" in note]


def test_what_the_ego_flags_is_no_news_to_it(tmp_path: Path) -> None:
    schema, extension = FORMS["bits"]
    messages = [SAMPLES[schema](k)[0] for k in range(2)]
    for k, message in enumerate(messages):
        core(schema, message)["partII"] = [extension]
        core(schema, message)["coreData"]["id"] = f"0000000{k}"
    signal, quality = read(tmp_path, schema, "json", messages, ego_station="00000000")
    assert {who for who, _, _ in told(signal.events)} == {"00000001"}
    assert "1 messages of 1 stations flag hard braking (over 0.4 g)" in quality.notes
