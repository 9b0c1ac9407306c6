"""`cwcli info` leads on: what it says to try works as it stands, and one line says how well the log was recorded."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from mcap.writer import Writer as JsonWriter
from mcap_ros2.writer import Writer

from cwcli.channels import reasons as reasons_module
from cwcli.channels.binding import bind_roles
from cwcli.channels.reasons import (
    FIELDS_NOT_SEARCHED_TEXT,
    UNKNOWN_TYPE_TEXT,
    UnboundReason,
    explain_unknown_type_by_fields,
    format_map_option_if_readable,
    suggest_system_warning_commands,
    unbound_reasons_by_topic,
    warning_condition_of_diagnostics_or_empty,
)
from cwcli.cli.info_texts import health_verdict, unused_channel_rows
from cwcli.logs.codecs import ros2msg
from cwcli.logs.read.channels import ChannelInfo
from cwcli.logs.read.reader import Log
from cwcli.pipeline import message_fields
from tests.cli.conftest import SAMPLES, Run
from tests.laws.receiver_messages import HEADER, LINE, TOP

T0_NS = 1_700_000_000_000_000_000
N, STEP_NS = 100, 100_000_000
SPEED_KMH = 36.0
M_PER_DEG = 111_229.0
"""Length of a degree of latitude at 50 degrees north, WGS84, m."""


def write_json_log(path: Path, channels: dict[str, tuple[str, Any]]) -> Path:
    """A log of JSON channels: topic -> schema and a function from the message's number to its content."""
    with path.open("wb") as stream:
        writer = JsonWriter(stream)
        writer.start()
        for topic, (schema, make) in channels.items():
            schema_id = writer.register_schema(schema, "jsonschema", b"{}") if schema else 0
            channel_id = writer.register_channel(topic, "json", schema_id)
            for k in range(N):
                at_ns = T0_NS + STEP_NS * k
                writer.add_message(channel_id, at_ns, json.dumps(make(k)).encode(), at_ns)
        writer.finish()
    return path


@pytest.fixture
def json_log(tmp_path: Path) -> Path:
    """A car that drives north at 36 km/h, in JSON of its maker's own; one channel without a schema."""
    return write_json_log(
        tmp_path / "json.mcap",
        {
            "/car": ("Car", lambda k: {"motion": {"speed_kmh": SPEED_KMH, "gear": 3}, "name": "x", "on": True}),
            "/place": ("", lambda k: {"lat": 50.0 + k / M_PER_DEG, "lon": 8.0}),
            "/odd": ("Odd", lambda k: {"my speed": 1.0, "n": k}),
        },
    )


def channel(document: dict[str, Any], topic: str) -> dict[str, Any]:
    [found] = [each for each in document["channels"] if each["topic"] == topic]
    return found


def tries(shown: bytes) -> list[str]:
    return re.findall(r"^try: (.*)$", shown.decode(), re.MULTILINE)


def test_fields_of_json_are_listed_and_the_pasted_lines_work(cwcli: Run, json_log: Path) -> None:
    document = json.loads(cwcli("info", json_log, "--json").stdout)
    assert channel(document, "/car")["fields"] == ["motion.speed_kmh", "motion.gear", "name", "on"]
    assert channel(document, "/place")["fields"] == ["lat", "lon"]
    shown = cwcli("info", json_log).stdout
    assert tries(shown) == ["--map 'ego_speed=/car:motion.speed_kmh*kmh'", "--map ego_position=/place:lat,lon"]
    assert "fields: motion.speed_kmh, motion.gear, name and on" in " ".join(shown.decode().split())
    pasted = [argument for line in tries(shown) for argument in shlex.split(line)]
    done = cwcli("estimate", json_log, *pasted, "-o", "out.mcap", "--metrics-dir", "m", "--json")
    assert done.returncode == 0, done.stderr.decode()
    inputs = {each["role"]: each for each in json.loads(done.stdout)["stages"]["estimate"]["inputs"]}
    assert {role: each["used"] for role, each in inputs.items()} == {"ego_position": N, "ego_speed": N}


def test_fields_of_custom_ros_messages_are_listed_without_reading_them(cwcli: Run, tmp_path: Path) -> None:
    path = tmp_path / "ros.mcap"
    definition = LINE.join([TOP + "bool armed\nstring label\nfloat64 vehicle_speed\nfloat64[3] axes", *HEADER])
    with path.open("wb") as stream:
        writer = Writer(stream)
        schema = writer.register_msgdef("my_msgs/msg/Status", definition)
        for k in range(3):
            stamp = {"sec": T0_NS // 10**9, "nanosec": k}
            header = {"stamp": stamp, "frame_id": ""}
            made = {"header": header, "armed": True, "label": "x", "vehicle_speed": 1.0, "axes": [0.0] * 3}
            writer.write_message("/status", schema, made, T0_NS + k, T0_NS + k)
        writer.finish()
    document = json.loads(cwcli("info", path, "--json").stdout)
    assert channel(document, "/status")["fields"] == [
        "header.stamp.sec",
        "header.stamp.nanosec",
        "armed",
        "vehicle_speed",
        "axes[0]",
    ]
    assert channel(document, "/status")["try"] == ["--map ego_speed=/status:vehicle_speed"]


def test_the_warnings_of_another_system_get_the_command_that_judges_them(cwcli: Run, tmp_path: Path) -> None:
    cwcli("run", SAMPLES / "intersection.mcap", "-o", "annotated.mcap", "-q")
    source = write_json_log(tmp_path / "fcw.mcap", {"/adas/fcw": ("Fcw", lambda k: {"active": 40 <= k < 60})})
    [line] = tries(cwcli("info", source).stdout)
    assert line == "cwcli evaluate annotated.mcap --topic warning=/adas/fcw:active==true"
    done = cwcli(*shlex.split(line)[1:])
    assert (
        "the log has no such topic" in done.stderr.decode()
    )  # it is understood; this log has another system's no more


def test_a_suggested_condition_is_judged(cwcli: Run, tmp_path: Path) -> None:
    """The warnings of the other system are in the log, so the pasted line gives their metrics."""
    with_warnings = tmp_path / "drive.mcap"
    _copy_with_json_warnings(SAMPLES / "intersection.mcap", with_warnings)
    [line] = [line for line in tries(cwcli("info", with_warnings).stdout) if "evaluate" in line]
    assert cwcli("run", with_warnings, "-o", "annotated.mcap", "-q").returncode == 0
    done = cwcli(*shlex.split(line)[1:], "--json")
    assert done.returncode == 0, done.stderr.decode()
    assert json.loads(done.stdout)["pooled"]["system.warnings.count"]["value"] == 1


def _copy_with_json_warnings(source: Path, target: Path) -> None:
    """Copy a log with a further channel, which warns for a second."""
    from mcap.reader import make_reader

    with source.open("rb") as old, target.open("wb") as new:
        reader, writer = make_reader(old), JsonWriter(new)
        writer.start()
        schema_ids: dict[int, int] = {}
        channel_ids: dict[int, int] = {}
        first_ns = 0
        for schema, each, message in reader.iter_messages():
            first_ns = first_ns or message.log_time
            assert schema is not None
            if schema.id not in schema_ids:
                schema_ids[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
            if each.id not in channel_ids:
                made = writer.register_channel(each.topic, each.message_encoding, schema_ids[schema.id])
                channel_ids[each.id] = made
            writer.add_message(channel_ids[each.id], message.log_time, message.data, message.publish_time)
        fcw = writer.register_channel("/adas/fcw", "json", 0)
        for k in range(N):
            at_ns = first_ns + k * STEP_NS
            writer.add_message(fcw, at_ns, json.dumps({"fcw": {"raised": 50 <= k < 60, "id": 3}}).encode(), at_ns)
        writer.finish()


@pytest.mark.parametrize(
    ("topic", "kinds", "expected"),
    [
        ("/adas/fcw", {"data": "truth value"}, "/adas/fcw:data==true"),
        ("/adas/fcw", {"header.stamp.sec": "number", "level": "number"}, "'warning=/adas/fcw:level>=1'"),
        ("/adas/fcw", {"valid": "truth value", "active": "truth value"}, "/adas/fcw:active==true"),
        ("/bus", {"aeb.collision_alert": "truth value"}, "/bus:aeb.collision_alert==true"),
        ("/adas/fcw", {"ttc": "number"}, ""),
        ("/door", {"open": "truth value"}, ""),
        ("/adas/fcw", {"a b": "truth value"}, ""),
        ("/a:fcw", {"data": "truth value"}, ""),
        ("/fcw\x1b[2J", {"data": "truth value"}, ""),
    ],
)
def test_conditions_by_hand(topic: str, kinds: dict[str, Any], expected: str) -> None:
    found = suggest_system_warning_commands(topic, kinds)
    assert len(found) == bool(expected)
    assert all(line.startswith("cwcli evaluate annotated.mcap --topic ") and expected in line for line in found)


def test_the_status_of_diagnostics_that_tells_of_warnings_is_chosen() -> None:
    trees: list[object] = [{"status": [{"name": "disk", "level": 0}]}, {"status": [{"name": "ADAS: fcw", "level": 0}]}]
    assert warning_condition_of_diagnostics_or_empty(trees) == "status[name=='ADAS: fcw'].level>=1"
    assert warning_condition_of_diagnostics_or_empty(trees[:1]) == ""


@pytest.mark.parametrize("topic", ["/a\x1b[2Jspeed", "/a\nb", "/a:b", "/a;b"])
def test_what_cannot_be_typed_or_parsed_is_not_suggested(topic: str) -> None:
    assert explain_unknown_type_by_fields(topic, {"speed": "number"}).tries == ()
    assert explain_unknown_type_by_fields("/a", {topic: "number"}).tries == ()


def test_a_suggestion_is_quoted_for_the_shell() -> None:
    assert format_map_option_if_readable("ego_speed", "/my car", "speed*kmh") in (
        [],
        ["--map 'ego_speed=/my car:speed*kmh'"],
    )
    [line] = format_map_option_if_readable("ego_speed", "/car", "axes[0]*kmh")
    assert shlex.split(line) == ["--map", "ego_speed=/car:axes[0]*kmh"]


def test_equal_reasons_are_one_row() -> None:
    def unused(topic: str, why: str | None, *fields: str) -> dict[str, Any]:
        return {"topic": topic, "why_not": why, "fields": list(fields)}

    channels = [
        unused("/a", "no role takes this type"),
        unused("/b", None),
        unused("/c", "no role takes this type", "x"),
        *(unused(f"/d{k}", "no role takes this type") for k in range(4)),
    ]
    assert unused_channel_rows(channels) == [
        ("/a, /d0, /d1 and 2 more", "no role takes this type"),
        ("/c", "no role takes this type; fields: x"),
    ]


def test_the_verdict_names_what_is_wrong() -> None:
    well = {
        "topic": "/a",
        "undecodable": 0,
        "gaps": 0,
        "longest_gap_s": 0.0,
        "drift_ms_per_min": 0.0,
        "out_of_order": 0,
    }
    unread = {"faults": {}, "channels": [{"topic": "/a", "messages": 3}]}
    assert health_verdict(unread) == "no fault in the index; --doctor reads the messages"
    empty = {"faults": {"lost chunks": 2}, "channels": [{"topic": "/a", "messages": 0}]}
    assert health_verdict(empty) == "lost chunks: 2; no messages on /a; --doctor reads the messages"
    read = unread | {"health": [well, well | {"topic": "/b"}]}
    assert health_verdict(read) == "2 topics without gaps, drift, disorder or damage"
    sick = [
        well | {"topic": "/b", "gaps": 1, "longest_gap_s": 3.14, "drift_ms_per_min": 60.0},
        well | {"topic": "/c", "undecodable": -1},
        well | {"topic": "/d", "out_of_order": 2, "undecodable": 5},
    ]
    assert health_verdict(unread | {"health": [well, *sick]}) == (
        "trouble on 3 of 4 topics: /b (1 gap, the longest 3.1 s, the clock drifts by 60.0 ms/min), /c (it can't be "
        "read) and /d (2 out of order, 5 damaged)"
    )


def test_the_verdict_is_one_line_of_info_with_and_without_the_doctor(cwcli: Run, json_log: Path) -> None:
    for arguments in ((), ("--doctor",)):
        shown = cwcli("info", json_log, *arguments).stdout.decode()
        assert len(re.findall(r"^health  ", shown, re.MULTILINE)) == 1
        assert json.loads(cwcli("info", json_log, *arguments, "--json").stdout)["verdict"]


def test_a_large_message_is_not_decoded_for_its_fields(cwcli: Run, tmp_path: Path) -> None:
    log = write_json_log(tmp_path / "big.mcap", {"/cloud": ("Cloud", lambda k: {"speed": 1.0, "x": [0.5] * 20_000})})
    found = channel(json.loads(cwcli("info", log, "--json").stdout), "/cloud")
    assert (found["fields"], found["try"]) == ([], [])
    assert np.isfinite(found["messages"])


def test_channels_whose_messages_are_not_read_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One is read, however large the chunk is, and the others say that they are not."""
    monkeypatch.setattr(message_fields, "MAX_BYTES_UNPACKED_FOR_FIELDS", 1)
    log = write_json_log(tmp_path / "json.mcap", {f"/t{k}": ("T", lambda k: {"n": k}) for k in range(3)})
    with Log.open(log) as opened:
        reasons = {f"/t{k}": UnboundReason(UNKNOWN_TYPE_TEXT) for k in range(3)}
        message_fields.complete_reasons_of_unknown_channels(opened, reasons)
    assert reasons["/t0"].fields == ("n",)
    assert [reasons[f"/t{k}"].why for k in (1, 2)] == [FIELDS_NOT_SEARCHED_TEXT] * 2


def test_fields_of_all_channels_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    """A channel with two numbers costs 12, so that two are searched within a bound of 23; the type is parsed once."""
    parse = Mock(wraps=ros2msg.parse_message_definitions)
    monkeypatch.setattr(ros2msg, "parse_message_definitions", parse)
    monkeypatch.setattr(reasons_module, "MAX_FIELDS_SEARCHED_OF_ALL_CHANNELS", 23)
    definition = b"float64 speed\nfloat64 other"
    channels = [ChannelInfo(k, f"/t{k}", "p/msg/T", "ros2msg", "cdr", 9, {}, definition) for k in range(4)]
    found = unbound_reasons_by_topic(channels, bind_roles(channels, {}, required=()))
    assert [found[f"/t{k}"].fields for k in range(4)] == [("speed", "other")] * 2 + [()] * 2
    assert [found[f"/t{k}"].why for k in (2, 3)] == [FIELDS_NOT_SEARCHED_TEXT] * 2
    assert parse.call_count == 1
