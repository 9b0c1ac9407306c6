"""Receivers' own messages that are not sound: no fix, reserved values, checksums, rounds of weeks, leap seconds."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pynmea2
import pytest

from cwcli.signals.builders.nmea import (
    BAD_CHECKSUM_REASON,
    NO_CHECKSUM_REASON,
    NO_SENTENCE_REASON,
    OTHER_SENTENCE_REASON,
    SENTENCE_TOO_SHORT_REASON,
    parse_number_or_nan,
)
from cwcli.signals.builders.sbg import UNKNOWN_AXES_REASON
from cwcli.signals.gnss_time import (
    GPS_EPOCH_UNIX_S,
    LEAP_SECOND_INSTANTS_UNIX_S,
    SECONDS_PER_WEEK,
    WEEK_ROLLOVER_REASON,
    utc_ns_and_is_time_from_date,
    utc_ns_from_gps_unix_ns,
)
from cwcli.signals.role import Role
from tests.laws.receiver_messages import WEEK, WEEK_MS, sentence
from tests.unit.signals.signal_columns import T0_NS, columns_of, stamp_fields
from tests.unit.signals.signal_columns import build_known_signal as build_signal

GGA = "GPGGA,080710.00,4807.50000,N,01130.00000,E,4,12,0.8,500.0,M,47.0,M,,"
RMC = "GPRMC,080710.00,A,4807.50000,N,01130.00000,E,10.0,90.0,081019,,,A"
TRUE_NS = round(datetime(2019, 10, 8, 8, 0, 30, 80_000, UTC).timestamp() * 1000) * 10**6
"""Of `WEEK` and `WEEK_MS`."""


def nmea(*texts: str):
    stamps = stamp_fields(T0_NS + 10**8 * np.arange(len(texts)))
    return columns_of("nmea_msgs/msg/Sentence", {**stamps, "sentence": list(texts)})


def test_sentences_are_rejected_by_reason() -> None:
    good = sentence(GGA)
    texts = [
        good,
        good.replace("4807", "4907"),
        good.partition("*")[0],
        "",
        "@@@",
        sentence("GPGGA,080710.00,48"),
        good,
    ]
    signal, quality = build_signal(Role.EGO_POSITION, nmea(*texts))
    assert quality.rejected == {
        BAD_CHECKSUM_REASON: 1,
        NO_CHECKSUM_REASON: 1,
        NO_SENTENCE_REASON: 2,
        SENTENCE_TOO_SHORT_REASON: 1,
    }
    assert signal.latitude_deg.tolist() == [48.125, 48.125]
    assert signal.altitude_m.tolist() == [547.0, 547.0]


@pytest.mark.parametrize(
    "content",
    [
        pytest.param(GGA.replace(",E,4,", ",E,0,"), id="quality-0"),
        pytest.param(GGA.replace(",E,4,", ",E,7,"), id="typed-in"),
        pytest.param(GGA.replace(",E,4,", ",E,,"), id="no-quality"),
        pytest.param(RMC.replace(",A,48", ",V,48"), id="rmc-void"),
        pytest.param(RMC.replace(",,,A", ",,,N"), id="rmc-mode-N"),
    ],
)
def test_sentence_without_a_fix_gives_no_position(content: str) -> None:
    _, quality = build_signal(Role.EGO_POSITION, nmea(sentence(content)))
    assert quality.rejected == {"no fix": 1}


@pytest.mark.parametrize(
    "change", [("4807.5", "4867.5"), (",N,", ",E,"), (",N,", ",,"), ("4807.50000", ""), ("4807.50000", "-4807.5")]
)
def test_place_that_is_none_is_rejected(change: tuple[str, str]) -> None:
    _, quality = build_signal(Role.EGO_POSITION, nmea(sentence(GGA.replace(*change, 1))))
    assert quality.rejected == {"latitude or longitude not a number": 1}


def test_kinds_of_sentences_share_a_channel() -> None:
    texts = [sentence(each) for each in (GGA, RMC, "GPVTG,90.0,T,,M,10.0,N,18.52,K,A", "GPHDT,45.0,T", "PASHR,1")]
    columns = nmea(*texts)
    position, of_position = build_signal(Role.EGO_POSITION, columns)
    velocity, _ = build_signal(Role.EGO_VELOCITY, columns)
    heading, _ = build_signal(Role.EGO_HEADING, columns)
    assert of_position.set_aside == {OTHER_SENTENCE_REASON: 4}
    assert position.stamp_ns.tolist() == [T0_NS]
    assert velocity.stamp_ns.tolist() == [T0_NS + 10**8]
    np.testing.assert_allclose(velocity.east_mps, [10.0 * 1852 / 3600])
    np.testing.assert_allclose(heading.heading_rad, [np.pi / 4])


def test_velocity_of_vtg_where_there_is_no_rmc_and_without_a_course_at_standstill() -> None:
    texts = ["GPVTG,,T,,M,0.000,N,0.000,K,A", "GPVTG,,T,,M,0.1,N,0.2,K,A", "GPVTG,180.0,T,,M,10.0,N,36.0,K,A"]
    velocity, quality = build_signal(Role.EGO_VELOCITY, nmea(*map(sentence, texts)))
    np.testing.assert_allclose(velocity.north_mps, [0.0, -10.0])
    assert quality.rejected == {"no velocity": 1}  # its direction is not known


def test_a_sentence_with_one_letter_changed_or_cut_gives_no_other_position() -> None:
    rng, letters = np.random.default_rng(7), "0123456789.,NSEWAVM*$ABCDEF\n -"
    good = sentence(GGA)
    odd = []
    for _ in range(3000):
        at = int(rng.integers(len(good)))
        change = good[:at] + letters[rng.integers(len(letters))] * int(rng.integers(2)) + good[at + 1 :]
        odd += [change, good[:at]]
    signal, quality = build_signal(Role.EGO_POSITION, nmea(*odd))
    assert quality.used + sum(quality.rejected.values()) + sum(quality.set_aside.values()) == len(odd)
    assert set(zip(signal.latitude_deg.tolist(), signal.longitude_deg.tolist(), strict=True)) <= {(48.125, 11.5)}


@pytest.mark.parametrize(
    ("text", "expected"),
    [("-4807.5", -4807.5), ("+12", 12.0), ("+-5", np.nan), ("--5", np.nan), ("-", np.nan), ("", np.nan), (".", np.nan)],
)
def test_a_number_has_one_sign_at_most(text: str, expected: float) -> None:
    assert parse_number_or_nan(text) == pytest.approx(expected, nan_ok=True)


def test_positions_agree_with_pynmea2() -> None:
    rng = np.random.default_rng(5)
    contents = []
    for _ in range(300):
        latitude, longitude = rng.integers(0, 90), rng.integers(0, 180)
        where = f"{latitude:02d}{rng.random() * 60:08.5f},{rng.choice(['N', 'S'])}"
        where += f",{longitude:03d}{rng.random() * 60:08.5f},{rng.choice(['E', 'W'])}"
        where = where.replace("60.00000", "59.99999")
        contents.append(sentence(f"GNGGA,080710.00,{where},1,12,0.8,{rng.random() * 900:.3f},M,{rng.normal():.2f},M,,"))
    signal, quality = build_signal(Role.EGO_POSITION, nmea(*contents))
    theirs = [pynmea2.parse(each, check=True) for each in contents]
    assert quality.used == 300
    np.testing.assert_allclose(signal.latitude_deg, [each.latitude for each in theirs], atol=1e-12)
    np.testing.assert_allclose(signal.longitude_deg, [each.longitude for each in theirs], atol=1e-12)
    above_sea = [each.altitude + float(each.geo_sep) for each in theirs]
    np.testing.assert_allclose(signal.altitude_m, above_sea, atol=1e-9)


def test_week_and_leap_seconds() -> None:
    """1980-01-06 is week 0; 2017-01-01T00:00:00Z is GPS second 18 of the Sunday that begins week 1930."""
    week = np.array([0, 1930, 1930, 1930, WEEK])
    ms = np.array([0, 17_000, 18_000, 16_999, WEEK_MS])
    stamp_ns = utc_ns_from_gps_unix_ns((GPS_EPOCH_UNIX_S + SECONDS_PER_WEEK * week) * 10**9 + ms * 10**6)
    expected = ["1980-01-06T00:00:00", "2017-01-01T00:00:00", "2017-01-01T00:00:00", "2016-12-31T23:59:59.999"]
    assert [np.datetime64(int(each), "ns") for each in stamp_ns[:4]] == [np.datetime64(each, "ns") for each in expected]
    assert stamp_ns[4] == TRUE_NS
    assert len(LEAP_SECOND_INSTANTS_UNIX_S) == 18


@pytest.mark.parametrize("bad", [{"month": 13}, {"month": 2, "day": 30}, {"day": 0}, {"year": 0}, {"nano": 2e9}])
def test_date_that_is_none(bad: dict[str, float]) -> None:
    parts = {"year": 2019, "month": 10, "day": 8, "seconds_of_day": 3600, "nano": -5.0} | bad
    assert not utc_ns_and_is_time_from_date(*(np.array([float(each)]) for each in parts.values()))[1].any()


def best_pos(log_time_ns: int = T0_NS, **more: float):
    fields: dict[str, float] = {"nov_header.gps_week_number": WEEK, "nov_header.gps_week_milliseconds": WEEK_MS}
    fields |= {"sol_status.status": 0, "pos_type.type": 50, "lat": 48.0, "lon": 11.0, "hgt": 1.0, "undulation": 1.0}
    named = {name: np.array([value]) for name, value in (fields | more).items()}
    return columns_of("novatel_oem7_msgs/msg/BESTPOS", named, log_time_ns=[log_time_ns])


def test_message_without_a_stamp_takes_the_week_and_a_rolled_over_one_is_moved() -> None:
    whole, clean = build_signal(Role.EGO_POSITION, best_pos(TRUE_NS + 10**7))
    rolled, counted = build_signal(
        Role.EGO_POSITION, best_pos(TRUE_NS + 10**7, **{"nov_header.gps_week_number": WEEK - 1024})
    )
    assert whole.stamp_ns.tolist() == rolled.stamp_ns.tolist() == [TRUE_NS]
    assert not clean.repaired
    assert counted.repaired == {WEEK_ROLLOVER_REASON: 1}


def test_round_of_weeks_is_not_told_by_a_clock_that_was_never_set() -> None:
    _, quality = build_signal(Role.EGO_POSITION, best_pos(10**18))  # 2001
    assert WEEK_ROLLOVER_REASON not in quality.repaired


@pytest.mark.parametrize("bad", [{"sol_status.status": 1}, {"pos_type.type": 0}, {"sol_status.status": np.nan}])
def test_best_pos_that_is_not_computed(bad: dict[str, Any]) -> None:
    assert build_signal(Role.EGO_POSITION, best_pos(**bad))[1].rejected == {"no fix": 1}


def test_best_vel_was_measured_before_its_stamp() -> None:
    fields = {"sol_status.status": [0], "vel_type.type": [8], "latency": [0.15], "hor_speed": [5.0], "trk_gnd": [0.0]}
    columns = columns_of("novatel_oem7_msgs/msg/BESTVEL", {**stamp_fields([T0_NS]), **fields}, log_time_ns=[T0_NS])
    assert build_signal(Role.EGO_VELOCITY, columns)[0].stamp_ns.tolist() == [T0_NS - 150_000_000]


def septentrio(**more: float):
    fields = {"mode": 1, "error": 0, "latitude": 0.8, "longitude": 0.2, "height": 1.0, "vn": 1.0, "ve": 1.0}
    fields |= {"h_accuracy": 100, "block_header.tow": WEEK_MS, "block_header.wnc": WEEK} | more
    named = {name: np.array([value]) for name, value in fields.items()}
    return columns_of("septentrio_gnss_driver/msg/PVTGeodetic", {**stamp_fields([T0_NS]), **named})


@pytest.mark.parametrize(
    ("more", "role", "reason"),
    [
        pytest.param({"mode": 0}, Role.EGO_POSITION, "no fix", id="no-pvt"),
        pytest.param({"mode": 64}, Role.EGO_POSITION, "no fix", id="only-flags"),
        pytest.param({"error": 1}, Role.EGO_POSITION, "no fix", id="error"),
        pytest.param({"latitude": -2e10}, Role.EGO_POSITION, "latitude or longitude not a number", id="do-not-use"),
        pytest.param({"vn": -2e10}, Role.EGO_VELOCITY, "no velocity", id="velocity-do-not-use"),
    ],
)
def test_septentrio_says_do_not_use(more: dict[str, float], role: Role, reason: str) -> None:
    assert build_signal(role, septentrio(**more))[1].rejected == {reason: 1}


def test_septentrio_accuracy_that_is_not_there() -> None:
    assert np.isnan(build_signal(Role.EGO_POSITION, septentrio(h_accuracy=65_535))[0].covariance_m2).all()


def nav_pvt(**more: float):
    fields: dict[str, float] = {
        "year": 2019,
        "month": 10,
        "day": 8,
        "hour": 8,
        "min": 7,
        "sec": 10,
        "nano": 0,
        "valid": 7,
        "flags": 1,
    }
    fields |= {"fix_type": 3, "lat": 480_000_000, "lon": 110_000_000, "height": 0, "h_acc": 20} | more
    return columns_of("ublox_msgs/msg/NavPVT", {name: np.array([value]) for name, value in fields.items()})


@pytest.mark.parametrize("bad", [{"fix_type": 0}, {"fix_type": 5}, {"flags": 0}, {"reserved1": [1, 0, 0, 0, 0, 0]}])
def test_nav_pvt_without_a_fix(bad: dict[str, float]) -> None:
    assert build_signal(Role.EGO_POSITION, nav_pvt(**bad))[1].rejected == {"no fix": 1}


@pytest.mark.parametrize(("behind_s", "is_told"), [(0.1, False), (5.0, True), (-3.0, True)])
def test_nav_pvt_whose_clock_is_not_the_recorders_is_told(behind_s: float, is_told: bool) -> None:
    columns = nav_pvt()
    logged = replace(columns, log_time_ns=columns.log_time_ns + round(behind_s * 1e9))
    _, quality = build_signal(Role.EGO_POSITION, logged)
    assert [note for note in quality.notes if "--clock log" in note] == quality.notes
    assert bool(quality.notes) == is_told


def test_nav_pvt_takes_the_log_time_until_its_own_is_resolved() -> None:
    signal, quality = build_signal(Role.EGO_POSITION, nav_pvt(valid=3))
    assert quality.repaired == {"no stamp, log time used": 1}
    assert signal.stamp_ns.tolist() == [T0_NS]


@pytest.mark.parametrize(
    ("frame", "east"), [("imu_link_ned", 4.0), ("sbg/ENU", 3.0), ("imu_link", 3.0), ("antenned", None), ("sbg", None)]
)
def test_axes_of_sbg_are_told_by_the_name_of_the_frame(frame: str, east: float | None) -> None:
    fields = {"status.vel_status": [0], "status.vel_type": [2], "velocity.x": [3.0], "velocity.y": [4.0]}
    columns = columns_of("sbg_driver/msg/SbgGpsVel", {**stamp_fields([T0_NS]), **fields, "header.frame_id": [frame]})
    signal, quality = build_signal(Role.EGO_VELOCITY, columns)
    assert signal.east_mps.tolist() == ([] if east is None else [east])
    assert quality.rejected == ({UNKNOWN_AXES_REASON: 1} if east is None else {})
