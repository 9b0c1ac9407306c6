"""What a file does not say is asked, and never assumed; the answer makes it right."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cwcli.errors import CwcliError, DataError, InputError
from cwcli.importing.mapping import parse_table_quantity_and_column_unit
from cwcli.importing.names import quantities_of_name
from cwcli.importing.readers import DESCRIPTION_PLACE_BY_FILE_KIND, load_kind
from cwcli.importing.run import ImportPlan, plan_import
from cwcli.importing.tables import AmbiguousError, Answers
from tests.unit.importing.drive import DRIVE, START_S, N, digits, epoch, iso, write_table

D = DRIVE
T, LAT, LON = epoch(), digits(D.lat_deg, 8), digits(D.lon_deg, 8)
MPS, KMH, COURSE = digits(D.speed_mps, 3), digits(D.speed_mps * 3.6, 3), digits(D.course_deg, 2)
AMERICAN = iso(D, "", "%m/%d/%Y %H:%M:%S")
UNCLEAR = [text.replace("11/14", "05/04") for text in AMERICAN]

ASKED: dict[str, tuple[str, list[list[str]], str]] = {
    "speed without a unit and positions": ("time,speed", [T, KMH], "has no unit, and no motion in the positions"),
    "speed of another unit than the header says": ("time,lat,lon,speed_mps", [T, LAT, LON, KMH], "says kmh"),
    "speed_ms that is in km/h": ("time,lat,lon,speed_ms", [T, LAT, LON, KMH], "says kmh"),
    "two speeds": ("time,lat,lon,speed1,speed2", [T, LAT, LON, KMH, MPS], "can each be the speed"),
    "two latitudes": ("time,lat,latitude,lon", [T, LAT, digits(D.lat_deg + 0.001, 8), LON], "can each be the latitude"),
    "swapped, with a course": ("time,lat,lon,course", [T, LON, LAT, COURSE], "swapped"),
    "swapped, with a speed": ("time,lat,lon,speed_mps", [T, LON, LAT, MPS], "swapped"),
    "swapped, beyond 90 degrees": ("time,lat,lon", [T, digits(D.lon_deg + 100, 8), LAT], "swapped"),
    "degrees or radians": (
        "time,lat,lon",
        [T, digits(np.deg2rad(D.lat_deg), 10), digits(np.deg2rad(D.lon_deg), 10)],
        "radians",
    ),
    "degrees and minutes": (
        "time,lat,lon",
        [T, digits(4800 + (D.lat_deg - 48) * 60, 6), digits(1100 + (D.lon_deg - 11) * 60, 6)],
        "degrees and minutes",
    ),
    "local time": ("time,lat,lon", [iso(D, "", "%Y-%m-%d %H:%M:%S"), LAT, LON], "without a zone"),
    "month behind the day or before it": ("time,lat,lon", [UNCLEAR, LAT, LON], "day and month"),
    "month before the day, local time": ("time,lat,lon", [AMERICAN, LAT, LON], "without a zone"),
    "date of six digits": (
        "DATE,TIME,LAT,LON",
        [["231114"] * N, [f"{221320 + k // 20:06d}" for k in range(N)], LAT, LON],
        "day and month",
    ),
    "steps of 1": ("time,lat,lon", [[str(k) for k in range(N)], LAT, LON], "unit of the time"),
    "milliseconds called seconds": (
        "time_s,lat,lon",
        [[f"{START_S}{k:03d}" for k in range(N)], LAT, LON],
        "do not fit the unit s",
    ),
    "two clocks": (
        "time,timestamp,lat,lon",
        [T, digits(START_S + D.t_s * 1.01, 3), LAT, LON],
        "do not advance together",
    ),
    "vectors or positions": (
        "time,x,y,z",
        [T, digits(D.accel_mps2, 3), digits(D.yaw_rate_radps, 3), ["9.81"] * N],
        "may be positions",
    ),
    "x and y in degrees": ("time,x,y", [T, LON, LAT], "may be degrees"),
    "two vehicles": ("time,id,lat,lon", [T, ["a", "b"] * (N // 2), LAT, LON], "names 2 vehicles"),
    "accelerations without gravity": (
        "time,ax,ay,az",
        [T, digits(D.accel_mps2, 3), ["0.1"] * N, ["0.0"] * N],
        "has no unit",
    ),
    "accelerations of another unit": (
        "time,ax [g],ay [g],az [g]",
        [T, digits(D.accel_mps2, 3), ["0.1"] * N, ["9.81"] * N],
        "the header says g, but gravity is 9.8",
    ),
    "slow turn rates": (
        "time,gx,gy,gz",
        [T, ["0.01"] * N, ["0.02"] * N, digits(D.yaw_rate_radps, 4)],
        "fits rad/s and deg/s",
    ),
    "yaw without positions": ("time,yaw", [T, COURSE], "unit or sense"),
    "no names": (",".join([T[0], LAT[0], LON[0]]), [T, LAT, LON], "no line of names"),
    "course in the other sense, or swapped": ("time,lat,lon,course", [T, LON, LAT, COURSE], "swapped"),
}


def plan(path: Path, *columns: str, **answers: Any) -> ImportPlan:
    return plan_import([str(path)], Answers(dict(map(parse_table_quantity_and_column_unit, columns)), **answers))


def table(folder: Path, names: str, columns: Sequence[list[str]], separator: str = ",") -> Path:
    return write_table(folder / "drive.csv", names, list(columns), separator)


@pytest.mark.parametrize("name", ASKED)
def test_is_asked(name: str, tmp_path: Path) -> None:
    names, columns, words = ASKED[name]
    with pytest.raises(CwcliError, match=words) as found:
        plan(table(tmp_path, names, columns))
    assert found.value.exit_code in {4, 5}
    assert found.value.hint
    assert "drive.csv" in found.value.where


def values(made: ImportPlan, topic: str, path: str) -> np.ndarray:
    (channel,) = [each for _, each in made.channels if each.topic == topic]
    return np.asarray(channel.fields[path])


def notes(made: ImportPlan) -> str:
    return "\n".join(note for each in made.notes.values() for note in each)


def test_answer_about_a_unit(tmp_path: Path) -> None:
    path = table(tmp_path, "time,speed", [T, KMH])
    made = plan(path, "speed=speed*kmh")
    np.testing.assert_allclose(values(made, "/vehicle/twist", "twist.linear.x"), D.speed_mps, atol=1e-3)
    assert made.tables[0][1][1].confidence == "given"


def test_answer_that_swaps(tmp_path: Path) -> None:
    path = table(tmp_path, "time,lat,lon,course", [T, LON, LAT, COURSE])
    made = plan(path, "latitude=lon", "longitude=lat")
    np.testing.assert_allclose(values(made, "/gps/fix", "latitude"), D.lat_deg, atol=1e-8)


@pytest.mark.parametrize("bad", ["195.0", "-4.8e18"])
def test_few_rows_that_are_no_place_on_earth_are_left_out_and_counted(bad: str, tmp_path: Path) -> None:
    latitudes = [*LAT[:50], bad, *LAT[51:]]
    made = plan(table(tmp_path, "time,lat,lon", [T, latitudes, LON]))
    assert "1 row with a latitude beyond 90" in notes(made)
    np.testing.assert_allclose(values(made, "/gps/fix", "latitude"), np.delete(D.lat_deg, 50), atol=1e-8)


@pytest.mark.parametrize(("north", "east"), [("91", "181"), ("90.0000001", "180.0000001"), ("91", "181.0")])
def test_codes_of_no_position_are_left_out_and_counted(north: str, east: str, tmp_path: Path) -> None:
    """AIS, ETSI and SAE have such codes; a receiver in a tunnel sends them for long."""
    made = plan(table(tmp_path, "time,lat,lon", [T, [*LAT[:30], *[north] * (N - 30)], [*LON[:30], *[east] * (N - 30)]]))
    assert f"{N - 30} rows at latitude {north} and longitude {float(east):.10g}" in notes(made)
    np.testing.assert_allclose(values(made, "/gps/fix", "latitude"), D.lat_deg[:30], atol=1e-8)


def test_rows_of_a_few_degrees_of_too_much_are_asked_about(tmp_path: Path) -> None:
    """A drive over the line of 180 degrees may count on from there; nothing is left out unasked."""
    east = digits(np.linspace(179.999, 180.00001, N), 8)
    with pytest.raises(AmbiguousError, match="are no longitude"):
        plan(table(tmp_path, "time,lat,lon", [T, LAT, east]))


def test_answer_about_a_zone(tmp_path: Path) -> None:
    path = table(tmp_path, "time,lat,lon", [iso(D, "", "%Y-%m-%d %H:%M:%S", hours=1), LAT, LON])
    made = plan(path, timezone="Europe/Berlin")  # winter time: one hour ahead of UTC
    assert values(made, "/gps/fix", "header.stamp")[0] == START_S * 10**9


def test_answer_about_the_order_of_a_date(tmp_path: Path) -> None:
    path = table(tmp_path, "time,lat,lon", [UNCLEAR, LAT, LON])
    first = {
        order: values(plan(path, timezone="UTC", date_order=order), "/gps/fix", "header.stamp")[0]
        for order in ("dmy", "mdy")
    }
    moments = {order: str(np.datetime64(int(stamp), "ns"))[:10] for order, stamp in first.items()}
    assert moments == {"dmy": "2023-04-05", "mdy": "2023-05-04"}


def test_answer_about_a_vehicle(tmp_path: Path) -> None:
    made = plan(table(tmp_path, "time,id,lat,lon", [T, ["a", "b"] * (N // 2), LAT, LON]), vehicle="b")
    np.testing.assert_allclose(values(made, "/gps/fix", "latitude"), D.lat_deg[1::2], atol=1e-8)


GPS_S = [f"{START_S - 315_964_800 + 18 + t:.2f}" for t in D.t_s.tolist()]
"""The drive's times in seconds since the GPS epoch, 6 January 1980, with the 18 leap seconds of 2023 (IERS)."""


@pytest.mark.parametrize("name", ["time", "t", "timestamp", "time [s]"])
def test_seconds_that_may_count_from_the_gps_epoch_are_asked_about(name: str, tmp_path: Path) -> None:
    """November 2023 since the GPS epoch is November 2013 since 1970."""
    path = table(tmp_path, f"{name},lat,lon", [GPS_S, LAT, LON])
    column = name.partition(" ")[0]
    with pytest.raises(AmbiguousError, match="since 1980, as GPS counts them, or since 1970") as found:
        plan(path)
    assert f"--column time='{name}*s-gps', or '{name}*s-1970'" in str(found.value.hint), column
    with pytest.raises(AmbiguousError, match="since 1970"):  # the unit alone does not answer
        plan(path, f"time={name}*s")
    made = plan(path, f"time={name}*s-gps")
    assert values(made, "/gps/fix", "header.stamp")[0] == START_S * 10**9
    made = plan(path, f"time={name}*s-1970")
    assert values(made, "/gps/fix", "header.stamp")[0] == (START_S - 315_964_800 + 18) * 10**9


@pytest.mark.parametrize("name", ["unix_time", "time (UTC)", "epoch", "system_time"])
def test_seconds_whose_name_says_the_clock_are_not_asked_about(name: str, tmp_path: Path) -> None:
    made = plan(table(tmp_path, f"{name},lat,lon", [GPS_S, LAT, LON]))
    assert values(made, "/gps/fix", "header.stamp")[0] == (START_S - 315_964_800 + 18) * 10**9


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_single_turn_rate_is_read_as_the_course_shows(sign: float, unit: str, tmp_path: Path) -> None:
    rate = sign * (D.yaw_rate_radps if unit == "rad" else np.degrees(D.yaw_rate_radps))
    made = plan(table(tmp_path, "time,lat,lon,speed_mps,gyro_z", [T, LAT, LON, MPS, digits(rate, 6)]))
    np.testing.assert_allclose(values(made, "/vehicle/twist", "twist.angular.z"), D.yaw_rate_radps, atol=1e-5)
    (guess,) = [each for each in made.tables[0][1] if each.column == "gyro_z"]
    assert guess.quantity == "yaw_rate"


def test_single_turn_rate_that_nothing_shows_is_left_out_with_the_option(tmp_path: Path) -> None:
    straight = digits(np.linspace(48.0, 48.001, N), 8)
    path = table(tmp_path, "time,lat,lon,gyro_z", [T, straight, ["11.0"] * N, digits(D.yaw_rate_radps, 6)])
    made = plan(path)
    assert [channel.topic for _, channel in made.channels] == ["/gps/fix"]
    assert any("--column yaw_rate='gyro_z*degps'" in note for notes in made.notes.values() for note in notes)
    given = plan(path, "yaw_rate=gyro_z*degps")
    np.testing.assert_allclose(
        values(given, "/imu/data", "angular_velocity.z"), np.radians(D.yaw_rate_radps), atol=1e-6
    )


def test_quantity_that_is_left_out(tmp_path: Path) -> None:
    made = plan(table(tmp_path, "time,lat,lon,speed_mps", [T, LAT, LON, KMH]), "speed=")
    assert [channel.topic for _, channel in made.channels] == ["/gps/fix"]


def test_two_tables_of_positions_are_asked_about(tmp_path: Path) -> None:
    files = [str(write_table(tmp_path / name, "time,lat,lon", [T, LAT, LON])) for name in ("a.csv", "b.csv")]
    with pytest.raises(AmbiguousError, match="holds the same"):
        plan_import(files, Answers())
    answers = Answers(dict(map(parse_table_quantity_and_column_unit, ["latitude@b.csv=", "longitude@b.csv="])))
    with pytest.raises(CwcliError):
        plan_import([files[1]], answers)
    assert len(plan_import(files, answers).channels) == 1


def test_times_from_the_start_beside_times_since_1970_are_asked_about(tmp_path: Path) -> None:
    gps = write_table(tmp_path / "gps.csv", "time,lat,lon", [T, LAT, LON])
    car = write_table(tmp_path / "car.csv", "t [s],speed [m/s]", [digits(D.t_s, 2), MPS])
    with pytest.raises(AmbiguousError, match="count from the start"):
        plan_import([str(gps), str(car)], Answers())
    made = plan_import([str(gps), str(car)], Answers(start="2023-11-14T22:13:20Z"))
    assert values(made, "/vehicle/twist", "header.stamp")[0] == START_S * 10**9


@pytest.mark.parametrize(
    ("sense", "column"),
    [("yaw", np.degrees(D.heading_rad)), ("yaw_deg", D.course_deg), ("yaw", D.heading_rad)],
    ids=["counter-clockwise degrees", "compass", "radians"],
)
def test_sense_of_a_yaw_is_that_of_the_way(sense: str, column: np.ndarray, tmp_path: Path) -> None:
    made = plan(table(tmp_path, f"time,lat,lon,speed_mps,{sense},roll", [T, LAT, LON, MPS, digits(column, 6), MPS]))
    z, w = (values(made, "/vehicle/heading", f"quaternion.{axis}") for axis in "zw")
    error = np.angle(np.exp(1j * (2 * np.arctan2(z, w) - D.heading_rad)))
    assert np.abs(error).max() < 1e-4


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_sense_and_unit_of_a_yaw_rate_are_those_of_the_way(sign: float, unit: str, tmp_path: Path) -> None:
    rate = D.yaw_rate_radps if unit == "rad" else np.degrees(D.yaw_rate_radps)
    made = plan(table(tmp_path, "time,lat,lon,speed_mps,yaw_rate", [T, LAT, LON, MPS, digits(sign * rate, 6)]))
    np.testing.assert_allclose(values(made, "/vehicle/twist", "twist.angular.z"), D.yaw_rate_radps, atol=1e-5)


def test_position_that_is_repeated_until_the_next_fix(tmp_path: Path) -> None:
    held = [[column[k // 10 * 10] for k in range(N)] for column in (LAT, LON)]
    made = plan(table(tmp_path, "time,lat,lon,speed_kmh", [T, *held, KMH]))
    np.testing.assert_allclose(values(made, "/gps/fix", "latitude"), D.lat_deg[::10], atol=1e-8)
    assert any("repeat the position" in note for notes in made.notes.values() for note in notes)


@pytest.mark.parametrize("axes", ["down", "turned"])
def test_axes_of_an_imu_are_those_that_speed_and_course_show(axes: str, tmp_path: Path) -> None:
    """Mounted with z down (a roll of half a turn), or with x to the right (a quarter to the right)."""
    matrix = (
        np.diag([1.0, -1.0, -1.0]) if axes == "down" else np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0, 0, 1.0]])
    )
    force = np.stack([D.accel_mps2, D.speed_mps * D.yaw_rate_radps, np.full(N, 9.80665)], axis=1) @ matrix.T
    turn = np.stack([np.zeros(N), np.zeros(N), D.yaw_rate_radps], axis=1) @ matrix.T
    columns = [T, LAT, LON, *(digits(vector[:, k], 6) for vector in (force, turn) for k in range(3))]
    names = "time,lat,lon,ax [m/s^2],ay [m/s^2],az [m/s^2],gx [rad/s],gy [rad/s],gz [rad/s]"
    made = plan(table(tmp_path, names, columns))
    for axis, expected in zip("xyz", (D.accel_mps2, D.speed_mps * D.yaw_rate_radps, np.full(N, 9.80665)), strict=True):
        np.testing.assert_allclose(values(made, "/imu/data", f"linear_acceleration.{axis}"), expected, atol=0.08)
    np.testing.assert_allclose(values(made, "/imu/data", "angular_velocity.z"), D.yaw_rate_radps, atol=1e-5)


BAD: dict[str, tuple[bytes, type[CwcliError], str]] = {
    "empty": (b"", InputError, "it is empty"),
    "blank lines": (b"\n\n\n", InputError, "it is empty"),
    "names alone": (b"time,lat,lon\n", InputError, "no rows"),
    "one row": (b"time,lat,lon\n1700000000,48.1,11.5\n", DataError, "1 row with a time"),
    "no text": (bytes(range(256)) * 40, InputError, "no text"),
    "decimal commas between commas": (b"time,lat,lon\n" + b"0,1,48,1,11,5\n" * 9, DataError, "decimal commas"),
    "comma and point": (
        b"time;lat;lon\n" + b"1700000000;48,1;11.5\n1700000001;48.1;11.5\n" * 9,
        AmbiguousError,
        "comma",
    ),
    "one time": (b"time,lat,lon\n" + b"1.70E+09,48.1,11.5\n" * 9, DataError, "same time"),
    "words for numbers": (b"time,lat,lon\n1700000000,north,11\n1700000001,south,11\n", DataError, "no numbers"),
    "ragged rows": (b"time,lat,lon\n" + b"1700000000,48.1,11.5\n1,2\n" * 9, DataError, "rows"),
    "nothing known": (b"a,b\n" + b"1,2\n3,4\n", CwcliError, "no column is"),
    "gpx that is cut": (b'<?xml version="1.0"?><gpx><trk><trkseg><trkpt lat="1" lon="2">', InputError, "damaged"),
    "zip that is cut": (b"PK\x03\x04" + b"\0" * 60, InputError, "damaged"),
    "parquet that is cut": (b"PAR1" + b"\0" * 60, InputError, "damaged"),
    "ubx without solutions": (b"\xb5\x62\x01\x07" + b"\0" * 60, DataError, "NAV-PVT"),
    "nmea without a sound sentence": (b"$GPGGA,1,2,3*00\r\n" * 9, DataError, "no sentence can be used"),
}


@pytest.mark.parametrize("suffix", [".csv", ".gpx", ".mcap"])
@pytest.mark.parametrize("name", BAD)
def test_bad_file_is_refused_in_words(name: str, suffix: str, tmp_path: Path) -> None:
    """Whatever its name ends in."""
    data, kind, words = BAD[name]
    path = tmp_path / f"file{suffix}"
    path.write_bytes(data)
    with pytest.raises(kind, match=words):
        plan(path)


def test_zip_that_unpacks_to_too_much_is_not_unpacked(tmp_path: Path) -> None:
    import zipfile

    path = tmp_path / "bomb.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("Location.csv", b"0" * 20_000_000)
    with pytest.raises(InputError, match="it is not a recording"):
        plan(path)


def test_wrong_suffix_is_read_by_its_content(tmp_path: Path) -> None:
    from tests.unit.importing.files import gpx_plain

    (path,) = gpx_plain(tmp_path)
    wrong = path.rename(tmp_path / "track.csv")
    assert set(plan(wrong).kinds.values()) == {"gpx"}


def test_other_separator_between_names_is_told(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("time;lat,lon\n1700000000;52,1,10,2\n1700000001;52,1,10,3\n")
    with pytest.raises(CwcliError, match="no column is a position") as found:
        plan(tmp_path / "a.csv")
    assert "'lat,lon' may be several columns" in str(found.value.hint)


def test_accelerations_of_a_phone_without_gravity_are_no_empty_tables(tmp_path: Path) -> None:
    import zipfile

    rows = "".join(f"{(START_S * 100 + k) * 10**7},{k / 100},0.1,0.2,0.1\n" for k in range(50))
    with zipfile.ZipFile(tmp_path / "drive.zip", "w") as archive:
        archive.writestr("Accelerometer.csv", f"time,seconds_elapsed,z,y,x\n{rows}")
    with pytest.raises(DataError, match="accelerations without gravity"):
        plan(tmp_path / "drive.zip")
    with zipfile.ZipFile(tmp_path / "empty.zip", "w") as archive:
        archive.writestr("Accelerometer.csv", "time,seconds_elapsed,z,y,x\n")
        archive.writestr("Location.csv", "time,seconds_elapsed,latitude,longitude\n")
    with pytest.raises(InputError, match="its tables have no rows"):
        plan(tmp_path / "empty.zip")


@pytest.mark.parametrize("name", DESCRIPTION_PLACE_BY_FILE_KIND)
def test_every_kind_is_where_the_table_says(name: str) -> None:
    assert load_kind(name).summary


@pytest.mark.parametrize(
    ("name", "quantities"),
    [
        ("GSpd(kmh)", ["speed"]),
        ("GCrs", ["course"]),
        ("HH:MM:SS", ["time"]),
        ("mSec", ["millisecond"]),
        ("ms_today", ["time"]),
        ("NedVelX", ["velocity_north"]),
        ("EnuVelX", ["velocity_east"]),
        ("H-Ell", ["altitude"]),
        ("angvel_z", ["gyro_z"]),
        ("gsensor_x_g", ["accel_x"]),
        ("vitesse est", []),  # to the east, and no estimate
        ("max speed", []),
    ],
)
def test_name_of_a_column_says_what_it_is(name: str, quantities: list[str]) -> None:
    assert quantities_of_name(name) == quantities


def test_velocity_that_may_be_to_the_east_is_no_speed_of_the_car(tmp_path: Path) -> None:
    """TwistWithCovarianceStamped of a receiver has x to the east; Odometry has it in the axes of the car."""
    east, north = digits(D.speed_mps * np.cos(D.heading_rad), 4), digits(D.speed_mps * np.sin(D.heading_rad), 4)
    twist = "fix_velocity/twist/twist/linear"
    names = f"time,/fix/header/seq,/fix/latitude,/fix/longitude,/{twist}/x,/{twist}/y"
    made = plan(table(tmp_path, names, [T, ["7"] * N, LAT, LON, east, north]))
    assert "/vehicle/twist" not in {channel.topic for _, channel in made.channels}
    assert "its axes may be east and north" in notes(made)
    place, speed = "/odom/pose/pose/position", "/odom/twist/twist/linear/x"
    names = f"time,/odom/header/seq,{place}/x,{place}/y,{speed}"
    made = plan(table(tmp_path, names, [T, ["7"] * N, digits(D.x_m, 3), digits(D.y_m, 3), MPS]))
    np.testing.assert_allclose(values(made, "/vehicle/twist", "twist.linear.x"), D.speed_mps, atol=1e-3)


def test_motion_of_another_vehicle_is_not_that_of_the_car(tmp_path: Path) -> None:
    lead = "/lead/pose/pose/position/x,/lead/pose/pose/position/y,/lead/twist/twist/linear/x"
    names = f"time,/lead/header/seq,/fix/latitude,/fix/longitude,{lead}"
    made = plan(table(tmp_path, names, [T, ["7"] * N, LAT, LON, digits(D.x_m + 30, 3), digits(D.y_m, 3), MPS]))
    assert {channel.topic for _, channel in made.channels} == {"/gps/fix"}


def test_zone_of_ros_messages_in_a_grid_is_asked(tmp_path: Path) -> None:
    place = "/odom/pose/pose/position"
    columns = [T, ["7"] * N, digits(D.x_m + 500_000, 3), digits(D.y_m + 5_300_000, 3)]
    path = table(tmp_path, f"time,/odom/header/seq,{place}/x,{place}/y", columns)
    with pytest.raises(CwcliError, match="of a grid, whose zone is not known"):
        plan(path)
    made = plan(path, f"x={place}/x*utm32n")  # 500 km lie on its middle meridian, 9 degrees
    assert abs(values(made, "/gps/fix", "longitude")[0] - 9.0) < 1e-6


@pytest.mark.parametrize("answers", [{}, {"date_order": "dmy"}])
def test_date_of_eight_digits_with_the_year_last(answers: dict[str, str], tmp_path: Path) -> None:
    clock = iso(D, "", "%H:%M:%S")
    path = table(tmp_path, "date,time,latitude,longitude", [["14112023"] * N, clock, LAT, LON])
    made = plan(path, timezone="UTC", **answers)
    assert values(made, "/gps/fix", "header.stamp")[0] == START_S * 10**9
    path = table(tmp_path, "date,time,latitude,longitude", [["04052023"] * N, clock, LAT, LON])
    if not answers:
        with pytest.raises(CwcliError, match="the order of day and month"):
            plan(path, timezone="UTC")
        return
    made = plan(path, timezone="UTC", **answers)
    assert values(made, "/gps/fix", "header.stamp")[0] == 1_683_238_400 * 10**9  # 2023-05-04T22:13:20Z


BICYCLE = [T, digits(D.x_m, 3), digits(D.y_m, 3), digits(D.heading_rad, 5), digits(D.yaw_rate_radps * 0.27, 5), MPS]


@pytest.mark.parametrize("answer", [(), ("heading=theta",)])
def test_theta_of_a_bicycle_model_is_a_heading(answer: tuple[str, ...], tmp_path: Path) -> None:
    """Pose and angle of the wheels: time, x, y, theta, phi, v."""
    made = plan(table(tmp_path, "time,x,y,theta,phi,v", BICYCLE), *answer)
    assert ("theta", "heading") in {(guess.column, guess.quantity) for guess in made.tables[0][1]}


@pytest.mark.parametrize(
    ("names", "columns"),
    [
        ("time,latitude,longitude,speed_mps,roll,theta", [T, LAT, LON, MPS, ["0.01"] * N, ["0.02", "0.03"] * (N // 2)]),
        ("time,latitude,longitude,theta", [T, LAT, LON, ["1.5", "2.5"] * (N // 2)]),
        ("time,theta,speed_mps", [T, ["0.02", "0.03"] * (N // 2), MPS]),
    ],
)
def test_theta_that_nothing_shows_to_be_a_heading_is_left_out(
    names: str, columns: list[list[str]], tmp_path: Path
) -> None:
    made = plan(table(tmp_path, names, columns))
    assert "'theta' is left out" in notes(made)
    assert "theta" not in {guess.column for guess in made.tables[0][1]}


@pytest.mark.parametrize(
    ("names", "answer", "is_altitude"),
    [
        ("height,lane_width", (), True),
        ("height,width", (), False),
        ("height,width", ("altitude=height",), True),
    ],
)
def test_height_beside_the_width_of_the_same_thing_is_no_altitude(
    names: str, answer: tuple[str, ...], is_altitude: bool, tmp_path: Path
) -> None:
    path = table(tmp_path, f"time,latitude,longitude,{names}", [T, LAT, LON, ["480"] * N, ["3.5"] * N])
    made = plan(path, *answer)
    assert ("altitude" in {guess.quantity for guess in made.tables[0][1]}) == is_altitude
    assert ("beside a width" in notes(made)) != is_altitude


def test_own_speed_of_a_parked_car_is_kept_beside_the_noise_of_a_receiver(tmp_path: Path) -> None:
    noise = [f"{k % 4 / 10}" for k in range(N)]
    made = plan(table(tmp_path, "time,vehicle_speed_kmh,gps_speed_mps", [T, ["0"] * N, noise]))
    assert not values(made, "/vehicle/twist", "twist.linear.x").any()


@pytest.mark.parametrize("answer", [(), ("time=sec*s",)])
@pytest.mark.parametrize(("part", "unit_s"), [("usec", 1e-6), ("msec", 1e-3)])
def test_seconds_since_the_start_are_joined_with_their_parts(
    answer: tuple[str, ...], part: str, unit_s: float, tmp_path: Path
) -> None:
    """10 Hz: the parts rise by a tenth of a second and fall back at each of the 59 steps of the seconds."""
    parts = [f"{k % 10 * 0.1 / unit_s:.0f}" for k in range(N)]
    columns = [[str(k // 10) for k in range(N)], parts, LAT, LON, MPS]
    made = plan(table(tmp_path, f"sec,{part},latitude,longitude,speed_mps", columns), *answer)
    stamp_ns = values(made, "/gps/fix", "header.stamp")
    np.testing.assert_array_equal(stamp_ns - stamp_ns[0], np.arange(N) * 100_000_000)


def test_parts_that_do_not_fall_back_at_the_seconds_are_not_joined(tmp_path: Path) -> None:
    """Milliseconds of another clock fall back half a second later."""
    parts = [str((k + 5) % 10 * 100) for k in range(N)]
    columns = [[str(k // 10) for k in range(N)], parts, LAT, LON]
    with pytest.raises(CwcliError, match="unit of the time"):
        plan(table(tmp_path, "sec,msec,latitude,longitude", columns))


def test_seconds_of_a_minute_stay_a_part_of_their_date(tmp_path: Path) -> None:
    date = [[part] * 300 for part in ("2023", "11", "14", "22", "13")]
    columns = [*date, [str(20 + k // 10) for k in range(300)], [str(k % 10 * 100) for k in range(300)], LAT[:300]]
    names = "year,month,day,hour,minute,second,msec,latitude,longitude"
    made = plan(table(tmp_path, names, [*columns, LON[:300]]), timezone="UTC")
    assert values(made, "/gps/fix", "header.stamp")[1] == START_S * 10**9 + 100_000_000
