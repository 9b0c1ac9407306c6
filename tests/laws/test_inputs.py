"""Laws that every registered input obeys: what a message says is what the signal holds, whatever the encoding."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cwcli import lazy_dataclass
from cwcli.logs.read.reader import Log
from cwcli.signals.builders.base import Reading
from cwcli.signals.builders.path import PathSignal
from cwcli.signals.canonical import CameraInfoSignal, DetectionSignal
from cwcli.signals.columns import Columns, Field, Ragged, encode_strings
from cwcli.signals.contract import SIGNAL_TYPES_BY_ROLE, check_builder_result
from cwcli.signals.inputs import _BUILTIN_INPUTS as BUILTIN
from cwcli.signals.inputs import INPUTS_BY_SCHEMA_NAME, normalise_schema_name
from cwcli.signals.role import Role
from tests.laws.input_logs import write_log
from tests.laws.input_messages import DELAY_NS, N, sample_of, stamp_of
from tests.laws.osi_messages import OSI_SAMPLES
from tests.laws.perceived_messages import PERCEIVED_SAMPLES
from tests.unit.signals.signal_columns import T0_NS, columns_of
from tests.unit.signals.signal_columns import build_known_signal as build_signal
from tests.work import count_lines, growing_functions

NO_SUCH_THING = {("foxglove", "cdr"), ("foxglove_msgs", "protobuf")}
"""foxglove's messages are called `foxglove_msgs/...` in CDR, and `foxglove....` in protobuf."""
BUILT = [
    pytest.param(schema, entry, encoding, id=f"{schema}-{entry.role}-{encoding}")
    for schema, entries in INPUTS_BY_SCHEMA_NAME.items()
    for entry in entries
    if entry.build is not None
    for encoding in entry.fields
    if (schema.partition("/")[0].partition(".")[0], encoding) not in NO_SUCH_THING
]
every_input = pytest.mark.parametrize(("schema", "entry", "encoding"), BUILT)
FEW = 40
"""Messages of the shorter channel whose reading is counted."""
READ_MESSAGE_BY_MESSAGE = {
    *("nmea_msgs/Sentence", "etsi_its_denm_msgs/DENM"),
    *("sensor_msgs/CameraInfo", "foxglove.CameraCalibration", "foxglove_msgs/CameraCalibration"),
}
"""Messages that are text, or so rare that they are read one by one."""
GROWING_WITH_BYTES_OR_BINS = (
    "InputFile._read",
    "_variance_factor_of_slow_errors",
    "_variance_factor_of_slow_errors.<locals>.<listcomp>",
    "_huber_intercept_and_sigma",
    "median_of_values",
)
"""Functions that run for each block of a file, and for each of a bounded number of bins of a signal, or steps of a
fit."""
DOCS = Path(__file__).parents[2] / "docs"
CAMERAS = {
    *("sensor_msgs/CompressedImage", "sensor_msgs/Image"),
    *(
        f"{p}{name}"
        for p in ("foxglove.", "foxglove_msgs/")
        for name in ("CompressedImage", "RawImage", "CompressedVideo")
    ),
}
"""Streamed frame by frame; tests/unit/logs_read/test_frames.py has logs of them."""
STATIONS = ("1001", "2a3c603c")

PACKED = {
    *("carma_driver_msgs/ByteArray", "udp_msgs/UdpPacket"),
    *("cwcli_radio/J2735", "cwcli_radio/Btp", "cwcli_radio/Its"),
}
"""V2X messages as a radio hands them over."""


def station_of(schema: str) -> str:
    is_etsi = (
        "CAM" in schema or "VAM" in schema or schema in ("udp_msgs/UdpPacket", "cwcli_radio/Btp", "cwcli_radio/Its")
    )
    return STATIONS[0] if is_etsi else STATIONS[1]


def topic_of(role: Role) -> str:
    return "/truth/targets" if role is Role.TARGET_TRUTH else "/truth" if role is Role.TRUTH else "/some/topic"


OF_EVENTS = {"etsi_its_denm_msgs/DENM"}
"""They tell of no road user (tests/peers/test_denm.py)."""


@pytest.mark.parametrize(("schema", "entry", "encoding"), [each for each in BUILT if each.values[0] not in OF_EVENTS])
def test_what_a_message_says_is_what_the_signal_holds(schema, entry, encoding, tmp_path: Path) -> None:
    samples = [(OSI_SAMPLES.get(schema) or sample_of(schema, entry.role))(k) for k in range(N)]
    is_v2x = Role.REMOTE in samples[0][1] and schema not in OSI_SAMPLES
    topic = topic_of(entry.role)
    path = write_log(tmp_path / "log.mcap", schema, encoding, topic, [message for message, _ in samples])
    with Log.open(path) as log:
        columns = log.columns(topic, fields=entry.fields[encoding])
    assert normalise_schema_name(columns.schema_name) == schema
    reading: dict[str, Any] = {"ego_station": station_of(schema)} if is_v2x and entry.role != Role.REMOTE else {}
    signal, quality = build_signal(entry.role, columns, is_override=True, **reading)
    check_builder_result((signal, quality), columns, Reading(entry.role))
    assert not quality.rejected and not quality.repaired
    assert sum(quality.set_aside.values()) == (N if schema in PERCEIVED_SAMPLES else 0)  # their objects count
    message = samples[0][0]
    frame = message.get("frame_id", message.get("header", {}).get("frame_id", "map" if "x_m" in message else ""))
    if schema in PACKED:  # positions on the globe, whatever carried them
        frame = ""
    if schema in OSI_SAMPLES:
        frame = "" if entry.role in (Role.TARGET_TRUTH, Role.DETECTIONS) else "osi"
    if isinstance(signal, DetectionSignal):
        assert set(signal.frame.values) == {frame} - {""}
    elif hasattr(signal, "frame_id"):
        assert signal.frame_id == (frame if frame != "map" or entry.role is Role.TARGET_TRUTH else "")
    means = [meant[entry.role] for _, meant in samples]
    if isinstance(signal, CameraInfoSignal):
        for name, value in means[0].items():
            np.testing.assert_equal(getattr(signal, name), value)
        return
    if "stamp_ns" not in means[0]:  # of messages without a time it is the log's
        assert signal.stamp_ns.tolist() == [stamp_of(k) for k in range(N)]
    assert signal.log_time_ns.tolist() == [stamp_of(k) + DELAY_NS for k in range(N)]
    for name in means[0]:
        expected = [meant[name] for meant in means]
        if isinstance(signal, DetectionSignal | PathSignal):
            expected = [row for rows in expected for row in rows]
        np.testing.assert_allclose(getattr(signal, name), expected, rtol=1e-9, atol=1e-9, err_msg=name)


@every_input
def test_an_empty_channel_gives_an_empty_signal(schema, entry, encoding) -> None:
    without_rows: dict[str, Any] = dict.fromkeys(entry.fields[encoding], np.zeros(0))
    for fields in ({}, without_rows):
        columns = channel(schema, encoding, 0, fields)
        signal, quality = build_signal(entry.role, columns)
        check_builder_result((signal, quality), columns, Reading(entry.role))
        assert quality.used == 0


@pytest.mark.parametrize("n_channels", [20, pytest.param(60, marks=pytest.mark.long)])
@every_input
def test_a_field_that_is_missing_or_of_another_kind_is_counted(schema, entry, encoding, n_channels: int) -> None:
    rng, leaves = np.random.default_rng(4), entry.fields[encoding]
    for _ in range(n_channels):
        n = int(rng.integers(1, 6))
        kept = [leaf for leaf in leaves if rng.random() < 0.8]
        columns = channel(schema, encoding, n, {leaf: odd_field(rng, n) for leaf in kept})
        with np.errstate(all="ignore"):
            built = build_signal(entry.role, columns, ego_station=str(rng.choice(STATIONS)))
        check_builder_result(built, columns, Reading(entry.role))


def test_every_role_but_the_camera_has_its_signals() -> None:
    built = {entry.role for entries in INPUTS_BY_SCHEMA_NAME.values() for entry in entries if entry.build is not None}
    assert built == set(SIGNAL_TYPES_BY_ROLE)


def told() -> set[str]:
    """The types in the docs' tables, with what they hold and what to beware of: `package/Type`, or `Type` behind it."""
    found: set[str] = set()
    for name in ("signals", "v2x", "detections"):
        for line in (DOCS / f"{name}.md").read_text(encoding="utf-8").splitlines():
            first, *others = line.strip("| ").split(" | ")
            if not line.startswith("| `") or len(others) < 2 or not all(other.strip() for other in others[:2]):
                continue
            package = ""
            for one in re.findall(r"`([^`]+)`", first):
                package = one.rpartition("/")[0] if "/" in one else package
                found |= {one, f"{package}/{one}"}
    return found


def test_every_type_has_a_row_with_its_fields_and_traps_and_a_message_in_the_tests() -> None:
    rows = told()
    assert len(rows) > 60
    types = set(BUILTIN)
    assert sorted(types - rows) == []
    streamed = {
        schema for schema, entries in INPUTS_BY_SCHEMA_NAME.items() if all(entry.build is None for entry in entries)
    }
    assert streamed == {*CAMERAS, "cwcli.v1.LateralState"}
    for schema in types - streamed - OF_EVENTS:
        assert schema in OSI_SAMPLES or callable(sample_of(schema, INPUTS_BY_SCHEMA_NAME[schema][0].role))


def channel(schema: str, encoding: str, n: int, fields: dict[str, Field]) -> Columns:
    made = columns_of(schema, {"n": np.zeros(n)}, message_encoding=encoding, n_undecodable=1)
    return Columns(**{**vars(made), "fields": fields})


def odd_field(rng: np.random.Generator, n: int) -> Field:
    """A field of any kind with any values."""
    odd = np.array([0.0, -1.0, 1.0, 0.5, 1e-300, 1e300, np.nan, np.inf, -np.inf, 2.0**63, T0_NS / 1e9, 33.0, 255.0])
    kind = rng.integers(6)
    if kind == 0:
        return rng.choice(odd, n)
    if kind == 1:
        return rng.choice(np.array([0, 1, -1, 7, 2**31, 2**62, T0_NS // 10**9], np.int64), n)
    if kind == 2:
        return rng.choice(odd, (n, int(rng.choice([3, 9, 36]))))
    if kind == 3:
        lengths = rng.integers(0, 4, n)
        return Ragged(rng.choice(odd, lengths.sum()), np.concatenate([[0], np.cumsum(lengths)]))
    if kind == 4:
        return encode_strings(
            [str(each) for each in rng.choice(["", "1001", "map", "EV", "-1e9", "nan", "reverse"], n)]
        )
    return np.clip(rng.choice(odd, n), -1e30, 1e30).astype(np.float32)


@pytest.mark.parametrize(
    ("schema", "entry", "encoding"), [each for each in BUILT if each.values[0] not in READ_MESSAGE_BY_MESSAGE]
)
def test_a_channel_is_read_without_python_for_each_message(
    schema, entry, encoding, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # else the methods of a class are compiled between the two readings
    monkeypatch.setattr(lazy_dataclass, "MAX_INSTANCES_BEFORE_COMPILATION", 0)
    lines = []
    for n in (FEW, 2 * FEW):
        samples = [(OSI_SAMPLES.get(schema) or sample_of(schema, entry.role))(k) for k in range(n)]
        path = write_log(tmp_path / f"{n}.mcap", schema, encoding, "/t", [message for message, _ in samples])

        def read(path: Path = path) -> None:
            with Log.open(path) as log:
                build_signal(entry.role, log.columns("/t", fields=entry.fields[encoding]), is_override=True)

        read()
        lines.append(count_lines(read))
    growing = growing_functions(lines[0], lines[1], allowance=FEW - 1)
    own = {name for name in growing if "/cwcli/" in name}  # what it calls in libraries, it calls from loops of its own
    assert {name for name in own if not name.endswith(GROWING_WITH_BYTES_OR_BINS)} == set()
