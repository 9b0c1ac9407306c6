"""Channels of octets as a whole: mixed messages, security headers, broken frames; and logs by an official writer."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap_ros2.writer import Writer
from pycrate_asn1dir import ITS_DENM_3, ITS_IEEE1609_2

from cwcli.channels.binding import bind_roles
from cwcli.errors import UsageError
from cwcli.logs.read.reader import Log
from cwcli.pipeline.stations import count_stations_by_topic
from cwcli.signals.build import build_signal
from cwcli.signals.canonical import RemoteQuantities, RemoteSignal
from cwcli.signals.clocks import Clock
from cwcli.signals.columns import Columns, Ragged, Strings
from cwcli.signals.j2735 import JSON_LEAF_FIELDS
from cwcli.signals.quality import Quality
from cwcli.signals.radio.frames import OCTET_FIELD_NAMES
from cwcli.signals.role import Role
from cwcli.stages.inputs.sources import SourceConfig, read_sensor_signals
from tests.unit.signals.radio import packing
from tests.unit.signals.radio.security import secured
from tests.unit.signals.v2x_messages import LOG_NS, packed_bsm, packed_cam, radio

SAMPLES = Path(__file__).parents[2] / "sample_logs"
BTP_CAM = b"\x07\xd1\x00\x00"


def remote(schema: str, *messages: bytes) -> tuple[RemoteSignal, Quality]:
    signal, quality = build_signal(Role.REMOTE, radio(schema, "data", *messages))
    assert isinstance(signal, RemoteSignal)
    assert (
        quality.read == len(messages) == quality.used + sum(quality.rejected.values()) + sum(quality.set_aside.values())
    )
    return signal, quality


def official_secured(message: bytes, *, signed: bool) -> bytes:
    """A message inside IEEE 1609.2, by an independent encoder (canonical OER)."""
    data = ITS_IEEE1609_2.Ieee1609Dot2.Ieee1609Dot2Data
    plain = {"protocolVersion": 3, "content": ("unsecuredData", message)}
    signature = ("ecdsaNistP256Signature", {"rSig": ("x-only", b"\x01" * 32), "sSig": b"\x02" * 32})
    content = {
        "hashId": "sha256",
        "tbsData": {"payload": {"data": plain}, "headerInfo": {"psid": 32, "generationTime": 5}},
        "signer": ("digest", b"\x07" * 8),
        "signature": signature,
    }
    data.set_val({"protocolVersion": 3, "content": ("signedData", content)} if signed else plain)
    packed: bytes = data.to_coer()
    return packed


@pytest.mark.parametrize("signed", [False, True])
def test_the_hand_written_envelope_is_that_of_the_encoder(signed: bool) -> None:
    for message in (b"four", bytes(200)):
        assert secured(message, signed=signed) == official_secured(message, signed=signed)


def test_what_is_secured_is_unwrapped_and_what_is_signed_is_said() -> None:
    bare = packed_bsm()
    for message, n_signed in ((secured(bare, signed=False), 0), (secured(bare, signed=True), 1)):
        assert bare in message
        signal, quality = remote("carma_driver_msgs/ByteArray", message)
        assert signal.station.values == ("2a3c603c",)
        assert signal.latitude_deg[0] == pytest.approx(40.8646987)
        assert sum("not verified" in note for note in quality.notes) == n_signed


def test_a_long_message_is_unwrapped_too() -> None:
    crumbs = [dict.fromkeys(packing.CRUMB, 5)] * 23
    codes = dict.fromkeys(packing.CORE, 1) | {"part_two": [(0, packing.safety_bits({"crumbs": crumbs}))]}
    bare = packing.framed(packing.bsm(codes))
    assert len(bare) > 200
    for message in (bare, secured(bare, signed=False), secured(bare, signed=True)):
        signal, _ = remote("carma_driver_msgs/ByteArray", message)
        assert signal.station.values == ("00000001",)


def test_other_messages_are_set_aside_and_broken_ones_rejected_by_name() -> None:
    bare = packed_bsm()
    _, quality = remote(
        "carma_driver_msgs/ByteArray",
        bare,
        packing.framed(b"\x00" * 9, message_id=19),
        packing.framed(b"\x00" * 9, message_id=77),
        bare[:-1],
        packing.framed(packing.bsm(dict.fromkeys(packing.CORE, 0))[:30]),
        b"\x03\x82\x00\x00",
        b"\x03\x83\x00\x00",
        b"\x03\x99\x00\x00",
        b"",
    )
    assert quality.used == 1
    assert quality.set_aside == {"SPaT (not about its sender)": 1, "message 77 (not about its sender)": 1}
    assert quality.rejected == {
        "truncated frame": 2,
        "encrypted (IEEE 1609.2)": 1,
        "IEEE 1609.2 without a message": 1,
        "not a frame of the format": 1,
        "truncated message": 1,
    }


def test_etsi_messages_are_told_by_their_port_and_checked_by_their_header() -> None:
    message = packed_cam()
    signal, quality = remote(
        "udp_msgs/UdpPacket",
        BTP_CAM + message,
        b"\x07\xd2\x00\x00" + message,
        BTP_CAM + b"\x01" + message[1:],
        BTP_CAM + b"\x02\x01" + message[2:],
        BTP_CAM + message[:-1],
        BTP_CAM[:3],
    )
    assert signal.station.values == ("1001",)
    assert not quality.set_aside
    assert quality.rejected == {
        "unsupported protocol version": 1,
        "message type does not match its port": 2,
        "truncated message": 1,
        "truncated frame": 1,
    }


def test_denms_are_events_that_the_notes_tell() -> None:
    position = {
        "latitude": 400_000_000,
        "longitude": 80_000_000,
        "positionConfidenceEllipse": dict.fromkeys(("semiMajorConfidence", "semiMinorConfidence"), 4095)
        | {"semiMajorOrientation": 3601},
        "altitude": {"altitudeValue": 800_001, "altitudeConfidence": "unavailable"},
    }
    official = ITS_DENM_3.DENM_PDU_Descriptions.DENM
    packed = []
    for station, cause in ((5, 94), (5, 94), (6, 99), (6, 200), (6, None)):
        management = {
            "actionID": {"originatingStationID": station, "sequenceNumber": 1},
            "detectionTime": 5,
            "referenceTime": 6,
            "eventPosition": position,
            "stationType": 5,
        }
        event = {"eventType": {"causeCode": cause, "subCauseCode": 1}, "informationQuality": 3}
        content = {"management": management} | ({} if cause is None else {"situation": event})
        header = {"protocolVersion": 2, "messageID": 1, "stationID": station}
        official.set_val({"header": header, "denm": content})
        packed.append(b"\x07\xd2\x00\x00" + official.to_uper())
    _, quality = remote("udp_msgs/UdpPacket", *packed, packed[0][:20])
    assert quality.set_aside == {"DENM (not about its sender)": 5}
    assert quality.rejected == {"truncated message": 1}
    said = "5 DENMs of 2 stations: 2 stationary vehicle, 1 cause 200, 1 hard braking, 1 without a cause"
    assert quality.notes == [said]


def test_hard_braking_is_told() -> None:
    codes = dict.fromkeys(packing.CORE, 1)
    parts = [[(0, packing.safety_bits({"events": flags}))] for flags in (0b0000000100000, 0b1111111011111)]
    braking, not_braking = (packing.framed(packing.bsm(codes | {"part_two": part})) for part in parts)
    _, quality = remote("carma_driver_msgs/ByteArray", braking)
    assert "1 messages of 1 stations flag hard braking (over 0.4 g)" in quality.notes
    _, quality = remote("carma_driver_msgs/ByteArray", not_braking)
    assert not any("braking" in note for note in quality.notes)


@pytest.mark.parametrize("clock", ["stamp", "log"])
def test_a_flag_stands_at_the_stamp_that_its_message_is_given(clock: Clock) -> None:
    codes = dict.fromkeys(packing.CORE, 1)  # secMark 1 ms: the minute's begin
    part = [(0, packing.safety_bits({"events": 0b0000000100000}))]
    columns = radio("carma_driver_msgs/ByteArray", "data", packing.framed(packing.bsm(codes | {"part_two": part})))
    signal, _ = build_signal(Role.REMOTE, columns, clock)
    assert isinstance(signal, RemoteSignal)
    assert signal.events is not None
    assert signal.stamp_ns.tolist() == LOG_NS.tolist()  # 10 s later: no clock to go by
    assert signal.events.stamp_ns.tolist() == signal.events.until_ns.tolist() == signal.stamp_ns.tolist()


def test_numbers_that_are_no_octets_make_no_message() -> None:
    columns = radio("carma_driver_msgs/ByteArray", "content", packed_bsm(), packed_bsm())
    field = columns.fields["content"]
    assert isinstance(field, Ragged)
    values = field.values.astype(np.float64)
    values[3] = 256.0
    broken = {"content": Ragged(values, field.offsets)}
    _, quality = build_signal(Role.REMOTE, type(columns)(**{**vars(columns), "fields": broken}))
    assert quality.rejected["truncated frame"] == 1


@pytest.mark.parametrize(
    ("schema", "definition", "message", "station"),
    [
        ("carma_driver_msgs/msg/ByteArray", "string message_type\nuint8[] content", packed_bsm(), "2a3c603c"),
        ("udp_msgs/msg/UdpPacket", "string address\nuint16 src_port\nuint8[] data", BTP_CAM + packed_cam(), "1001"),
    ],
    ids=["bsm", "cam"],
)
def test_a_log_of_the_official_writer_is_read(
    tmp_path: Path, schema: str, definition: str, message: bytes, station: str
) -> None:
    path = tmp_path / "log.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        registered = writer.register_msgdef(schema, definition)
        texts: dict[str, Any] = {"message_type": "BSM", "content": [*message]} if "content" in definition else {}
        texts = texts or {"address": "::1", "src_port": 4401, "data": [*message]}
        for at in (int(LOG_NS[0]), int(LOG_NS[0]) + 100_000_000):
            writer.write_message("/comms/inbound", registered, texts, log_time=at, publish_time=at)
        writer.finish()
    with Log.open(path) as log:
        bound = bind_roles(log.channels, {}, required=[Role.REMOTE])
        columns = log.load_topics(bound.fields_to_load())["/comms/inbound"]
        assert list(count_stations_by_topic(log).values()) == [{station: 1}]
    signal, quality = build_signal(Role.REMOTE, columns)
    assert isinstance(signal, RemoteSignal)
    assert (quality.read, quality.used) == (2, 1)  # the second repeats the first
    assert signal.station.values == (station,)
    assert signal.speed_mps.tolist() == pytest.approx([10.0])


def test_a_topic_of_any_schema_can_be_named_with_its_format(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        registered = writer.register_msgdef("some_radio/msg/Raw", "uint8[] payload")
        at = int(LOG_NS[0])
        writer.write_message("/raw", registered, {"payload": [*packed_cam()]}, log_time=at, publish_time=at)
        writer.finish()
    with Log.open(path) as log:
        sources = read_sensor_signals(
            log, SourceConfig(topics={"remote": "/raw:its"}), command="estimate", required=(Role.REMOTE,)
        )
        (signal,) = sources.by_role[Role.REMOTE]
        assert isinstance(signal, RemoteSignal)
        assert signal.station.values == ("1001",)
        for named, said in (("/raw:uper", "there is no format uper"), ("/other:its", "the log has no topic /other")):
            with pytest.raises(UsageError, match=said):
                bind_roles(log.channels, {"remote": named}, required=[Role.REMOTE])


def test_the_same_drive_as_octets_gives_the_same_signal(tmp_path: Path) -> None:
    """The BSMs of a simulated drive, packed bit by bit and written by the official writer."""
    with Log.open(SAMPLES / "rear-end.mcap") as log:
        said = log.columns("/v2x/bsm", fields=JSON_LEAF_FIELDS)
    path = tmp_path / "packed.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        registered = writer.register_msgdef("carma_driver_msgs/msg/ByteArray", "string message_type\nuint8[] content")
        for row, at in enumerate(said.log_time_ns.tolist()):
            codes = {name: code_of(said, name, row) for name in packing.CORE if name in JSON_LEAF_FIELDS}
            packed = packing.framed(packing.bsm(dict.fromkeys(packing.CORE, 0) | codes))
            message = {"message_type": "BSM", "content": [*packed]}
            writer.write_message("/comms/inbound", registered, message, log_time=at, publish_time=at)
        writer.finish()
    with Log.open(path) as log:
        packed_columns = log.columns("/comms/inbound", fields=OCTET_FIELD_NAMES)
    expected, _ = build_signal(Role.REMOTE, said)
    found, quality = build_signal(Role.REMOTE, packed_columns)
    assert isinstance(expected, RemoteSignal)
    assert isinstance(found, RemoteSignal)
    assert quality.used == len(expected.stamp_ns) > 150
    assert found.station.values == expected.station.values
    for entry in fields(RemoteQuantities):
        np.testing.assert_array_equal(getattr(found, entry.name), getattr(expected, entry.name), err_msg=entry.name)
    np.testing.assert_array_equal(found.stamp_ns, expected.stamp_ns)


def code_of(said: Columns, name: str, row: int) -> int:
    """A component of a JSON message as its code."""
    field = said.fields[name]
    if not isinstance(field, Strings):
        return int(np.asarray(field)[row])
    text = field.values[field.codes[row]]
    return int(text, 16) if name.endswith(".id") else {"forwardGears": 2, "reverseGears": 3}[text]
