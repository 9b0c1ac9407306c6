"""CAN frames by a DBC file, against cantools message by message."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cantools
import numpy as np
import pytest
from cantools.database.can import Database

from cwcli.errors import UsageError
from cwcli.signals.can import FRAME_TOO_SHORT_REASON, NOT_AVAILABLE_REASON, OTHER_MESSAGE_REASON, OUT_OF_RANGE_REASON
from cwcli.signals.mapping import parse_field_mappings
from cwcli.signals.quality import Quality
from cwcli.signals.role import Role
from tests.unit.signals.signal_columns import T0_NS, build_mapped, columns_of, stamp_fields

DBC = """VERSION ""
BS_:
BU_: ECU
BO_ 256 Motion: 8 ECU
 SG_ Speed : 0|12@1+ (0.125,0) [0|400] "km/h" ECU
 SG_ Yaw : 23|13@0- (0.0625,-2) [-128|128] "deg/s" ECU
 SG_ Gear : 40|4@1+ (1,0) [0|0] "" ECU
 SG_ Rpm : 48|16@1+ (0.25,0) [0|16383] "rpm" ECU
BO_ 2566844672 Wheels: 4 ECU
 SG_ Real : 0|32@1- (1,0) [0|0] "" ECU
BO_ 512 Muxed: 4 ECU
 SG_ Which M : 0|8@1+ (1,0) [0|255] "" ECU
 SG_ Steer m1 : 8|16@1- (0.01,0) [0|0] "deg" ECU
VAL_ 256 Speed 4095 "SNA" ;
SIG_VALTYPE_ 2566844672 Real : 1 ;
"""


@pytest.fixture
def dbc(tmp_path: Path) -> Path:
    path = tmp_path / "car.dbc"
    path.write_text(DBC)
    return path


def frames(rows: list[tuple[int, bool, bytes]], **more):
    octets = np.array([list(data.ljust(8, b"\0")) for _, _, data in rows], np.uint8)
    fields = {
        **stamp_fields(T0_NS + 10**7 * np.arange(len(rows))),
        "id": np.array([each[0] for each in rows], np.uint32),
        "is_extended": np.array([each[1] for each in rows]),
        "dlc": np.array([len(each[2]) for each in rows], np.uint8),
        "data": octets,
        **more,
    }
    return columns_of("can_msgs/msg/Frame", fields)


def load_dbc(path: Path) -> Database:
    database = cantools.database.load_file(path)
    assert isinstance(database, Database)
    return database


def built(role: Role, text: str, columns, dbc: Path) -> tuple[Any, Quality]:
    return build_mapped(role, columns, parse_field_mappings(role, f"/can:{text};{dbc}")[0])


def test_signals_are_those_of_cantools(dbc: Path) -> None:
    rng, theirs = np.random.default_rng(1), load_dbc(dbc)
    rows = [(256, False, rng.bytes(8)) for _ in range(500)]
    signal, quality = built(Role.EGO_SPEED, "Motion.Speed,Motion.Yaw", frames(rows), dbc)
    decoded: list[Any] = [theirs.decode_message(256, data, decode_choices=False) for _, _, data in rows]
    good = [each for each in decoded if each["Speed"] <= 400.0 and -128 <= each["Yaw"] <= 128]
    n_none = sum(each["Speed"] == 4095 * 0.125 for each in decoded)
    assert quality.used == len(good) > 100
    np.testing.assert_allclose(signal.speed_mps, [each["Speed"] / 3.6 for each in good])
    np.testing.assert_allclose(signal.yaw_rate_radps, np.radians([each["Yaw"] for each in good]))
    assert quality.read == 500
    assert quality.rejected.get(NOT_AVAILABLE_REASON, 0) == n_none
    assert quality.rejected[OUT_OF_RANGE_REASON] == 500 - len(good) - n_none
    assert quality.notes == [
        "Motion.Speed is in km/h, as the DBC file says",
        "Motion.Yaw is in deg/s, as the DBC file says",
    ]


def test_extended_identifier_and_a_real_number(dbc: Path) -> None:
    extended = 2566844672 & 0x1FFFFFFF
    theirs = load_dbc(dbc)
    data = theirs.encode_message(extended, {"Real": 12.5})
    rows = [(extended, True, data), (extended, False, data), (257, False, b"")]
    signal, quality = built(Role.EGO_SPEED, "Wheels.Real", frames(rows), dbc)
    assert signal.speed_mps.tolist() == [12.5]
    assert quality.set_aside == {OTHER_MESSAGE_REASON: 2}


def test_frames_that_do_not_fit_are_counted(dbc: Path) -> None:
    whole = bytes([80, 0, 0, 0, 0, 0, 0, 0])
    rows = [(256, False, whole), (256, False, b"\x50"), (256, False, b"\xff\x0f" + bytes(6)), (256, False, whole)]
    columns = frames(rows, is_rtr=np.array([False, False, False, True]))
    signal, quality = built(Role.EGO_SPEED, "Motion.Speed*kmh", columns, dbc)
    np.testing.assert_allclose(signal.speed_mps, [10.0 / 3.6])
    assert quality.rejected == {FRAME_TOO_SHORT_REASON: 1, NOT_AVAILABLE_REASON: 1}
    assert quality.set_aside == {OTHER_MESSAGE_REASON: 1}


def test_multiplexed_signal(dbc: Path) -> None:
    rows = [(512, False, bytes([1, 0xE8, 0x03, 0])), (512, False, bytes([2, 0xE8, 0x03, 0]))]
    signal, quality = built(Role.EGO_STEER, "Muxed.Steer", frames(rows), dbc)
    np.testing.assert_allclose(signal.steer_rad, [np.radians(10.0)])
    assert quality.set_aside == {OTHER_MESSAGE_REASON: 1}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("Motion.Rpm", "rpm"),
        ("Motion.Nothing", "no signal Nothing"),
        ("Motion", "no signal"),
        ("Nothing.Speed", "no message Nothing"),
        ("Motion.Speed,Wheels.Real", "different CAN messages"),
    ],
)
def test_dbc_that_does_not_fit_is_refused(dbc: Path, text: str, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        built(Role.EGO_SPEED, text, frames([(256, False, bytes(8))]), dbc)


@pytest.mark.parametrize("content", ["", "BO_ 256 Motion: eight ECU", "\0\0\0", "BU_: (("])
def test_file_that_is_no_dbc_is_refused(tmp_path: Path, content: str) -> None:
    path = tmp_path / "odd.dbc"
    path.write_text(content)
    with pytest.raises(UsageError):
        built(Role.EGO_SPEED, "Motion.Speed", frames([(256, False, bytes(8))]), path)
    with pytest.raises(UsageError):
        built(Role.EGO_SPEED, "Motion.Speed", frames([(256, False, bytes(8))]), tmp_path / "none.dbc")
    columns = frames([(256, False, bytes(8))])
    with pytest.raises(UsageError, match="need the file"):
        build_mapped(Role.EGO_SPEED, columns, parse_field_mappings(Role.EGO_SPEED, "/can:Motion.Speed")[0])


LONG = (
    DBC
    + """BO_ 768 Long: 16 ECU
 SG_ Late : 96|16@1+ (0.125,0) [0|0] "km/h" ECU
 SG_ Wide : 0|65@1+ (1,0) [0|0] "km/h" ECU
 SG_ Which M : 120|8@1+ (1,0) [0|255] "" ECU
 SG_ Chosen m1 : 0|16@1+ (0.125,0) [0|0] "km/h" ECU
"""
)


def test_what_lies_behind_the_frame_s_array_is_too_short(tmp_path: Path) -> None:
    path = tmp_path / "long.dbc"
    path.write_text(LONG)
    columns = frames([(768, False, bytes(8)), (256, False, bytes(8))])
    for name in ("Late", "Chosen"):  # the value, or what says whether it is there
        signal, quality = built(Role.EGO_SPEED, f"Long.{name}", columns, path)
        assert len(signal.stamp_ns) == 0
        assert quality.rejected == {FRAME_TOO_SHORT_REASON: 1}
    with pytest.raises(UsageError, match="Wide has 65 bits"):
        built(Role.EGO_SPEED, "Long.Wide", columns, path)


def test_a_degree_sign_of_one_byte_is_one(tmp_path: Path) -> None:
    path = tmp_path / "car.dbc"
    path.write_bytes(DBC.replace('"deg/s"', '"\u00b0/s"').encode("cp1252"))
    columns = frames([(256, False, bytes(8))])
    signal, _ = built(Role.EGO_SPEED, "Motion.Speed,Motion.Yaw", columns, path)
    np.testing.assert_allclose(signal.yaw_rate_radps, [np.radians(-2.0)])  # raw 0: the offset
