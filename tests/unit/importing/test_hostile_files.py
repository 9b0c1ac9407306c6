"""Damaged and hostile files: an error in words or the right values, and never a traceback, a flood or a wrong value."""

from __future__ import annotations

import json
import os
import struct
import tracemalloc
import warnings
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cwcli.errors import CwcliError, DataError, InputError, OutputError, UsageError
from cwcli.importing.mapping import parse_table_quantity_and_column_unit, read_mapping
from cwcli.importing.readers import load_kind
from cwcli.importing.run import ImportPlan, plan_import, write_import
from cwcli.importing.tables import AmbiguousError, Answers, SourceTable
from cwcli.input import InputFile
from cwcli.logs.read.reader import Log
from tests.unit.importing.drive import DRIVE, START_S, N, digits, epoch, iso, write_table
from tests.unit.importing.files import can_dump
from tests.unit.importing.other_tables import rtklib, vbo
from tests.unit.importing.real_tables import rtklib_gpst

D = DRIVE
T, LAT, LON = epoch(), digits(D.lat_deg, 8), digits(D.lon_deg, 8)
SINCE_START = digits(D.t_s, 3)
UTC = iso(D)


def plan(path: Path, **answers: Any) -> ImportPlan:
    return plan_import([str(path)], Answers(**answers))


def table(folder: Path, times: list[str], names: str = "time,lat,lon", *more: list[str]) -> Path:
    repeats = len(times) // N
    return write_table(folder / "drive.csv", names, [times, LAT * repeats, LON * repeats, *more])


def replaced(texts: list[str], row: int, text: str) -> list[str]:
    return [*texts[:row], text, *texts[row + 1 :]]


def log_times(made: ImportPlan) -> np.ndarray:
    (channel,) = [each for _, each in made.channels if each.topic == "/gps/fix"]
    return np.asarray(channel.log_time_ns)


def notes(made: ImportPlan) -> str:
    return "\n".join(note for each in made.notes.values() for note in each)


@pytest.mark.parametrize(
    ("names", "times"),
    [
        ("time_s,lat,lon", SINCE_START * 2),
        ("time,lat,lon", [*T, *digits(START_S + D.t_s + 3.013, 3)]),
        ("time,lat,lon", [*UTC, *UTC]),
    ],
    ids=["from the start", "overlapping", "dates"],
)
def test_two_drives_in_one_table_are_not_mixed(names: str, times: list[str], tmp_path: Path) -> None:
    """The row where the second one begins is named: N rows stand before it."""
    with pytest.raises(DataError, match=f"row {N + 1} begins again") as found:
        plan(table(tmp_path, times, names))
    assert found.value.hint


def test_rows_out_of_order_are_put_into_order(tmp_path: Path) -> None:
    """A block that was written late is no second drive: no other row lies among its rows."""
    half = N // 2
    columns = [each[half:] + each[:half] for each in (T, LAT, LON)]
    made = plan(write_table(tmp_path / "drive.csv", "time,lat,lon", columns))
    np.testing.assert_array_equal(log_times(made), np.rint((START_S + D.t_s) * 1e3).astype(np.int64) * 1_000_000)


@pytest.mark.parametrize("time", ["2147483647", "1700000300"])
def test_memory_does_not_grow_with_the_time_between_two_rows(time: str, tmp_path: Path) -> None:
    tracemalloc.start()
    made = plan(table(tmp_path, replaced(T, N - 1, time)))
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert log_times(made)[-1] == int(time) * 1_000_000_000
    assert most < 100_000_000


@pytest.mark.parametrize(
    "time",
    [
        "9999-12-31T23:59:59Z",
        "2300-01-01T00:00:00Z",
        "0001-01-01T00:00:00Z",
        "2023-02-31T00:00:00Z",
        "1969-12-31T23:59:59Z",
        "2023-11-14T22:13:20+99:99",
        "2023-13-14T22:13:20Z",
    ],
)
def test_row_with_an_impossible_date_is_left_out(time: str, tmp_path: Path) -> None:
    made = plan(table(tmp_path, replaced(UTC, 5, time)))
    assert "1 row without a time is left out" in notes(made)
    np.testing.assert_array_equal(log_times(made), np.delete(log_times(plan(table(tmp_path, UTC))), 5))


@pytest.mark.parametrize("time", ["2147483648", "9999999999999999999", "999999999999", "-1e18", "1e300"])
def test_row_with_an_impossible_number_of_time_is_left_out(time: str, tmp_path: Path) -> None:
    made = plan(table(tmp_path, replaced(T, 5, time)))
    assert "1 row without a time is left out" in notes(made)
    expected = np.delete(np.rint((START_S + D.t_s) * 1e3).astype(np.int64) * 1_000_000, 5)
    assert np.abs(log_times(made) - expected).max() < 1000  # a double resolves 240 ns


@pytest.mark.parametrize("year", ["9999", "2900"])
def test_dates_of_the_far_future_are_refused(year: str, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="behind January 2038"):
        plan(table(tmp_path, [text.replace("2023", year) for text in UTC]))


@pytest.mark.parametrize("start", ["9" * 400, "99999999999999", "9999-12-31T23:59:59Z", "0001-01-01T00:00:00Z"])
def test_impossible_start_is_wrong_usage(start: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="--start"):
        plan(table(tmp_path, SINCE_START, "time_s,lat,lon"), start=start)


def phone_zip(folder: Path, start: str = "", method: int = zipfile.ZIP_DEFLATED) -> Path:
    rows = zip(SINCE_START, LAT, LON, strict=True)
    path = folder / "phone.zip"
    with zipfile.ZipFile(path, "w", method) as archive:
        archive.writestr("Location.csv", "Time (s),Latitude (°),Longitude (°)\n" + "\n".join(map(",".join, rows)))
        if start:
            archive.writestr("meta/time.csv", f'"event","experiment time","system time"\n"START",{start}\n')
    return path


@pytest.mark.parametrize("start", ["1e400,1700000000", "0," + "9" * 400, "0,99999999999999", "-1e18,1700000000"])
def test_impossible_start_of_a_phone_is_no_start(start: str, tmp_path: Path) -> None:
    assert log_times(plan(phone_zip(tmp_path, start)))[0] == 0


@pytest.mark.parametrize("method", [zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
@pytest.mark.parametrize("at", [45, 60, 300, 2000])
def test_zip_with_damaged_data_is_refused(method: int, at: int, tmp_path: Path) -> None:
    path = phone_zip(tmp_path, method=method)
    data = bytearray(path.read_bytes())
    data[at : at + 12] = b"\xff" * 12
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"the zip is damaged|unpacks"):
        plan(path)


def sentence(text: str) -> str:
    checksum = 0
    for character in text:
        checksum ^= ord(character)
    return f"${text}*{checksum:02X}"


@pytest.mark.parametrize(
    "text",
    [
        "GPZDA,221323.0,14,11,2023.5,00,00",
        "GPZDA,221323.0,,,2023,00,00",
        "GPZDA,221323.0,14,11,99999,00,00",
        "GPZDA,221323.0,14,11,1e9,00,00",
        "GPRMC,996199.00,V,4808.0,N,01134.0,E,19.0,010.0,141123,,",
    ],
)
def test_nmea_with_an_impossible_time_is_read_without_it(text: str, tmp_path: Path) -> None:
    lines = [
        sentence(f"GPRMC,2213{20 + k:02d}.00,A,48{8 + k / 100:07.4f},N,01134.0000,E,36.0,000.0,141123,,")
        for k in range(30)
    ]
    path = tmp_path / "drive.nmea"
    path.write_text("\n".join([*lines[:3], sentence(text), *lines[3:]]))
    np.testing.assert_array_equal(log_times(plan(path)), (START_S + np.arange(30)) * 1_000_000_000)


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ("speed=v*foo", "no such unit"),
        ("speed=v*deg", "no such unit"),
        ("latitude=lat*m", "no such unit"),
        ("time=time*foo", "no such unit"),
        ("time=time*s-foo", "no such unit"),
        ("heading=v*deg-foo", "no such unit"),
        ("vehicle_id=text*m", "no such unit"),
        ("speed=velocity", "no column 'velocity'"),
        ("speed@other.csv=v", "no such table"),
        ("speed=text", "are no numbers"),
    ],
)
def test_answer_that_fits_nothing_is_refused(option: str, words: str, tmp_path: Path) -> None:
    path = table(tmp_path, T, "time,lat,lon,v,text", digits(D.speed_mps, 3), ["a"] * N)
    with pytest.raises((UsageError, DataError), match=words):
        plan_import([str(path)], Answers(dict([parse_table_quantity_and_column_unit(option)])))


@pytest.mark.parametrize(("unit", "factor"), [("kmh", 1 / 3.6), ("km/h", 1 / 3.6), ("m/s", 1.0), ("mph", 0.44704)])
def test_unit_of_an_answer_may_be_spelled_as_in_a_header(unit: str, factor: float, tmp_path: Path) -> None:
    path = write_table(tmp_path / "drive.csv", "time,v", [T, digits(D.speed_mps, 3)])
    made = plan_import([str(path)], Answers(dict([parse_table_quantity_and_column_unit(f"speed=v*{unit}")])))
    (channel,) = [each for _, each in made.channels]
    np.testing.assert_allclose(np.asarray(channel.fields["twist.linear.x"]), D.speed_mps * factor, atol=0.002)


def test_pipe_is_refused_at_once(tmp_path: Path) -> None:
    """It would be read twice: the second time without its beginning."""
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(InputError, match="it is a pipe"):
        plan(tmp_path / "pipe.csv")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('[answers]\ndate_order = "xyz"\n', "date_order: 'xyz' is none of dmy, mdy, ymd"),
        ('[answers]\ndecimal = "point"\n', "decimal: 'point' is none of"),
        ('[[table]]\nname = "a.csv"\nspeed = 3\n', "speed is not of the form COLUMN"),
    ],
)
def test_mapping_with_an_impossible_value_is_refused(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "mapping.toml"
    path.write_text(text)
    with pytest.raises(UsageError, match=words):
        read_mapping(str(path))


def test_gpx_point_inside_of_another_is_read(tmp_path: Path) -> None:
    points = [
        f'<trkpt lat="{lat}" lon="{lon}"><time>{time}</time></trkpt>'
        for time, lat, lon in zip(UTC, LAT, LON, strict=True)
    ]
    points[5] = points[5].replace("</trkpt>", f"<extensions>{points[6]}</extensions></trkpt>")
    path = tmp_path / "drive.gpx"
    path.write_text(f"<gpx><trk><trkseg>{''.join(points)}</trkseg></trk></gpx>")
    assert len(plan(path).channels) == 1


def fcd_file(folder: Path, steps: list[tuple[str, str]]) -> Path:
    """Two vehicles side by side at 10 m/s to the north; a step is its time and the other one's speed."""
    path = folder / "fcd.xml"
    vehicle = '<vehicle id="{}" x="{}" y="{}" angle="0.0" speed="{}"/>'
    path.write_text(
        "<fcd-export>"
        + "".join(
            f'<timestep time="{time}">{vehicle.format("ego", 0, k, 10.0)}{vehicle.format("b", 3, k, speed)}</timestep>'
            for k, (time, speed) in enumerate(steps)
        )
        + "</fcd-export>"
    )
    return path


@pytest.mark.parametrize(
    ("step", "n_messages"),
    [(("5.0", "10.0"), 60), (("5.0", "nan"), 59), (("5.0", "inf"), 59), (("5.0", "1e300"), 59), (("nan", "10.0"), 59)],
    ids=["time twice", "no speed", "infinite speed", "absurd speed", "no time"],
)
def test_fcd_with_an_unusable_row_loses_that_row(step: tuple[str, str], n_messages: int, tmp_path: Path) -> None:
    steps = [(f"{k / 10:.1f}", "10.0") for k in range(60)]
    steps[50:51] = [steps[50], step] if step[0] == "5.0" and step[1] == "10.0" else [step]
    made = plan(fcd_file(tmp_path, steps), vehicle="ego")
    assert made.recordings[0].topics[0][2] == n_messages
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write_import(made, str(tmp_path / "log.mcap"))
    with Log.open(tmp_path / "log.mcap") as log:
        payloads = json.dumps([tree for _, tree in log.iter_message_trees("/v2x/bsm")])
    assert payloads.count("speed") >= n_messages
    assert "NaN" not in payloads
    assert "Infinity" not in payloads


@pytest.mark.parametrize("time", ["-5", "1e300", "1e10"])
def test_fcd_with_an_impossible_time_is_refused(time: str, tmp_path: Path) -> None:
    steps = [(f"{k / 10:.1f}", "10.0") for k in range(60)]
    with pytest.raises(DataError, match="a time step is at"):
        plan(fcd_file(tmp_path, [*steps, (time, "10.0")]), vehicle="ego")


@pytest.mark.parametrize(("separator", "quote"), [(",", '"'), (";", "")])
def test_commas_before_thousands_are_asked_about(separator: str, quote: str, tmp_path: Path) -> None:
    """1,100 m beside 48.137 degrees is no height of 1.1 m."""
    heights = [f"{quote}1,{100 + k}{quote}" for k in range(N)]
    names = separator.join(["time", "lat", "lon", "altitude"])
    path = write_table(tmp_path / "drive.csv", names, [T, LAT, LON, heights], separator)
    with pytest.raises(AmbiguousError, match="before thousands"):
        plan(path)


@pytest.mark.parametrize("column", [1, 2], ids=["in a row", "at its end"])
def test_quote_that_is_not_closed_loses_no_rows(column: int, tmp_path: Path) -> None:
    columns = [T, LAT, LON]
    columns[column] = replaced(columns[column], 300, '"' + columns[column][300])
    with pytest.raises(DataError, match="not closed"):
        plan(write_table(tmp_path / "drive.csv", "time,lat,lon", columns))


def test_two_drives_of_one_of_several_vehicles_are_not_mixed(tmp_path: Path) -> None:
    """Rows of vehicles take turns, so that times repeat; the rows of one of them advance."""
    columns = [np.repeat(each, 2).tolist() for each in (SINCE_START, LAT, LON)]
    names, columns = "time_s,lat,lon,id", [*columns, ["a", "b"] * N]
    plan(write_table(tmp_path / "drive.csv", names, columns), vehicle="a")
    with pytest.raises(DataError, match="begins again"):
        plan(write_table(tmp_path / "drive.csv", names, [each * 2 for each in columns]), vehicle="a")


@pytest.mark.parametrize("byte", [b"\x81", b"\x9d", b"\xff", b"\xe4"])
@pytest.mark.parametrize("at", [5, N - 5])
def test_byte_that_is_no_text_costs_no_more_than_its_row(byte: bytes, at: int, tmp_path: Path) -> None:
    path = table(tmp_path, replaced(T, at, "#"))
    path.write_bytes(path.read_bytes().replace(b"#", byte))
    assert len(log_times(plan(path))) == N - 1


def test_broken_utf_16_is_an_error_in_words(tmp_path: Path) -> None:
    """Half of a surrogate pair behind the part of the file that is looked at first."""
    path = table(tmp_path, T)
    data = path.read_text().encode("utf-16-le")
    path.write_bytes(b"\xff\xfe" + data * 30 + b"\x00\xdc" * 9 + data)
    with pytest.raises(CwcliError):
        plan(path)


def ubx_message(kind: bytes, payload: bytes) -> bytes:
    """A message with the checksum of the u-blox specification, octet by octet."""
    body = kind + len(payload).to_bytes(2, "little") + payload
    first = second = 0
    for octet in body:
        first = (first + octet) & 0xFF
        second = (second + first) & 0xFF
    return b"\xb5\x62" + body + bytes([first, second])


def solution(year: int, second: int = 0) -> bytes:
    """NAV-PVT of 2023-11-14T22:13 and a second, another year, with a fix."""
    head = struct.pack("<IHBBBBBBIiBB", 0, year, 11, 14, 22, 13, second, 7, 0, 0, 3, 1)
    return ubx_message(
        b"\x01\x07", (head + bytes(2) + struct.pack("<iii", 115_750_000, 481_370_000, 5000)).ljust(92, b"\0")
    )


@pytest.mark.parametrize(
    ("others", "note"),
    [
        ([solution(65_535), solution(2262)], "no time: 2 messages"),
        ([solution(2023)[:-1] + b"\xff"], "damaged: 1 messages"),
        ([b"\xb5\x62\x02\x15\xff\xff"], ""),
        ([ubx_message(b"\x02\x15", solution(2023, 9))], ""),
    ],
    ids=["years", "checksum", "a length of 64 kB", "a message inside of another"],
)
def test_damaged_ubx_messages_are_counted_and_the_others_read(tmp_path: Path, others: list[bytes], note: str) -> None:
    """The year 65535 ended with exit code 70: its nanoseconds have more than 64 bits."""
    path = tmp_path / "rover.ubx"
    path.write_bytes(b"".join([solution(2023, 20), *others, *(solution(2023, 21 + k) for k in range(9))]))
    made = plan(path)
    np.testing.assert_array_equal(log_times(made), (START_S + np.arange(10)) * 1_000_000_000)
    assert note in notes(made)


def test_nmea_sentences_without_a_time_are_counted(tmp_path: Path) -> None:
    """A GGA whose time is empty took that of the sentence before, and a VTG before the first time was lost."""
    lines = [
        sentence(f"GPGGA,2213{20 + k:02d}.00,48{8 + k / 100:07.4f},N,01134.0000,E,1,09,0.9,475.0,M,45.0,M,,")
        for k in range(30)
    ]
    lines[3] = lines[3].replace(",221323.00,", ",,")
    lines[3] = sentence(lines[3][1 : lines[3].index("*")])
    vtg = sentence("GPVTG,000.0,T,,M,19.4,N,36.0,K,A")
    path = tmp_path / "drive.nmea"
    path.write_text("\n".join([vtg, *lines]))
    made = plan(path, start="2023-11-14T00:00:00Z")
    assert len(log_times(made)) == 29
    assert "GGA without a time: 1 sentence" in notes(made)
    assert "VTG without a time: 1 sentence" in notes(made)


@pytest.mark.parametrize("time", ["99999999999999999999.5", "1e300"])
def test_can_frames_of_an_impossible_time_are_counted(tmp_path: Path, time: str) -> None:
    """Their nanoseconds have more than 64 bits: exit code 70."""
    trace, dbc = can_dump(tmp_path)
    lines = trace.read_text().splitlines()
    lines[300] = f"({float(time):f}) {lines[300].split(' ', 1)[1]}"
    trace.write_text("\n".join(lines) + "\n")
    made = plan_import([str(trace), str(dbc)], Answers())
    assert "1 frames have an impossible time" in notes(made)


def test_error_frames_that_candump_shows_are_counted(tmp_path: Path) -> None:
    trace, dbc = can_dump(tmp_path)
    shown = []
    for line in trace.read_text().splitlines():
        time, bus, frame, *_ = line.split()
        name, _, data = frame.partition("#")
        shown.append(f" {time}  {bus}  {name:>8}   [{len(data) // 2}]  {bytes.fromhex(data).hex(' ').upper()}")
    n_stamps = len(log_times(plan_import([str(trace), str(dbc)], Answers())))
    time = shown[9].split()[0]
    shown.insert(9, f" {time}  can0  20000004   [8]  00 04 00 00 00 00 00 00   ERRORFRAME")
    shown.insert(10, "\tcontroller-problem{rx-overflow}")
    trace.write_text("\n".join(shown) + "\n")
    made = plan_import([str(trace), str(dbc)], Answers())
    assert len(log_times(made)) == n_stamps
    assert "2 lines of error frames" in notes(made)


def test_one_row_without_a_time_costs_no_other(tmp_path: Path) -> None:
    """A clock of 92 hours made every row of a VBOX file one without a time; a 13th month became 1970 in RTKLIB's."""
    for make, before, after in ((vbo, b" 2213", b" 9213"), (rtklib, b"2023/11/14", b"2023/13/14")):
        (path,) = make(tmp_path)
        lines = path.read_bytes().splitlines(keepends=True)
        n_rows = sum(before in line for line in lines)
        whole = log_times(plan(path))
        row = next(k for k, line in enumerate(lines) if before in line) + 9
        path.write_bytes(b"".join((*lines[:row], lines[row].replace(before, after), *lines[row + 1 :])))
        made = plan(path)
        np.testing.assert_array_equal(log_times(made), np.delete(whole, 9))
        assert n_rows > 100
        assert "1 row without a time" in notes(made)


def test_names_and_dates_that_no_logger_writes(tmp_path: Path) -> None:
    """Two columns of one name, a week of a million years, a quote, a year 202: none of them is a bug."""
    (path,) = rtklib(tmp_path)
    whole = path.read_bytes()
    path.write_bytes(whole.replace(b"Q  ns", b"Q  Q"))
    n_rows = len(log_times(plan(path)))
    path.write_bytes(whole.replace(b"  12\n", b'  "12\n', 1))
    assert len(log_times(plan(path))) == n_rows
    (path,) = rtklib_gpst(tmp_path)
    whole = path.read_bytes()
    path.write_bytes(whole.replace(b"2304 6047", b"23040000 6047", 1))
    assert len(log_times(plan(path))) == whole.count(b"\n230") - 1
    (path,) = vbo(tmp_path)
    path.write_bytes(path.read_bytes().replace(b"/2023", b"/0202"))
    assert "is no date" in notes(plan(path))


def test_times_and_places_of_kml(tmp_path: Path) -> None:
    """A place's own time is none of the track's; what is no number is left out alone."""
    path = tmp_path / "a.kml"
    points = "".join(f"<when>2024-03-09T10:00:{k:02}Z</when><gx:coord>11.0000{k:02} 48 5</gx:coord>" for k in range(60))
    points = points.replace("11.000007 48 5", "11.000007 48 1_0").replace("11.000009 48", "11.000009 4_8")
    place = "<Placemark><TimeStamp><when>2020-01-01T00:00:00Z</when></TimeStamp></Placemark>"
    path.write_text(f'<kml xmlns:gx="x">{place}<Placemark><gx:Track>{points}</gx:Track></Placemark>{place}</kml>')
    (channel,) = [each for _, each in plan(path).channels if each.topic == "/gps/fix"]
    start_ns = 1_709_978_400 * 10**9
    seconds = (np.asarray(channel.log_time_ns) - start_ns) // 10**9
    assert seconds.tolist() == [k for k in range(60) if k != 9]
    altitude_m = np.asarray(channel.fields["altitude"])
    assert np.flatnonzero(np.isnan(altitude_m)).tolist() == [7]


def test_longitudes_without_a_latitude_stay_what_they_are(tmp_path: Path) -> None:
    """A scale that puts every latitude beyond 90 degrees: there was a note of a pairing, and no longitude."""
    trace, dbc = can_dump(tmp_path)
    dbc.write_text(dbc.read_text().replace("GPS_Latitude : 0|32@1- (1E-007", "GPS_Latitude : 0|32@1- (3E-007"))
    tables = load_kind("candump").read(str(trace), Answers(dbc=(str(dbc),)))
    (table,) = [each for each in tables if isinstance(each, SourceTable) and "GPS_Longitude" in each.columns]
    (batch,) = table.read_batches(["GPS_Latitude", "GPS_Longitude"])
    assert not np.isfinite(batch["GPS_Latitude"]).any()
    assert np.isfinite(batch["GPS_Longitude"]).all()
    assert not any("is put to the times" in note for note in table.notes)


def test_log_and_mapping_file_are_written_together(tmp_path: Path) -> None:
    """Neither is there where the log fails when the mapping file is already written, nor the other way round."""
    path = table(tmp_path, T)
    made, target, mapping = plan(path), tmp_path / "log.mcap", tmp_path / "log.import.toml"
    opened = InputFile.open(path)
    os.utime(path, (0, 0))
    with pytest.raises(InputError, match="changed"):
        write_import(made, str(target), mapping_file=str(mapping), inputs=[opened])
    opened.close()
    with pytest.raises(OutputError):
        write_import(made, str(target), mapping_file=str(tmp_path / "no folder" / mapping.name))
    assert [*tmp_path.iterdir()] == [path]
    write_import(made, str(target), mapping_file=str(mapping))
    assert target.exists() and mapping.read_text() == made.mapping_text()
