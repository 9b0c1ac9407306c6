"""`--map` and `--dbc`: in one command, in a pipeline file, and what is refused."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import pytest
from mcap_ros2.writer import Writer

from tests.cli.conftest import Run
from tests.laws.receiver_messages import HEADER, LINE, TOP

FIX = LINE.join(
    [
        TOP + "sensor_msgs/NavSatStatus status\nfloat64 latitude\nfloat64 longitude\nfloat64 altitude\n"
        "float64[9] position_covariance\nuint8 position_covariance_type",
        "MSG: sensor_msgs/NavSatStatus\nint8 status\nuint16 service",
        *HEADER,
    ]
)
FRAME = LINE.join([TOP + "uint32 id\nbool is_rtr\nbool is_extended\nbool is_error\nuint8 dlc\nuint8[8] data", *HEADER])
STATUS = "float64 kmh\nuint64 micros\nstring mode"
DBC = 'VERSION ""\nBO_ 256 Motion: 8 ECU\n SG_ Speed : 0|12@1+ (0.125,0) [0|400] "km/h" ECU\n'
T0_NS = 1_700_000_000_000_000_000


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return write_log(tmp_path / "my.mcap")


def write_log(path: Path) -> Path:
    """Fixes of a car that drives north at 10 m/s, and its speed in km/h: as a field, and in CAN frames."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        fix = writer.register_msgdef("sensor_msgs/msg/NavSatFix", FIX)
        status = writer.register_msgdef("my_msgs/msg/Status", STATUS)
        frame = writer.register_msgdef("can_msgs/msg/Frame", FRAME)
        for k in range(100):
            at_ns = T0_NS + 100_000_000 * k
            header = {"stamp": dict(zip(("sec", "nanosec"), divmod(at_ns, 10**9), strict=True)), "frame_id": ""}
            where = {"latitude": 50.0 + k / 111_229.0, "longitude": 8.0, "altitude": 0.0, "status": {"status": 0}}
            none = {"position_covariance": [0.0] * 9, "position_covariance_type": 0}
            writer.write_message("/gps", fix, {"header": header, **where, **none}, at_ns, at_ns)
            writer.write_message(
                "/status", status, {"kmh": 36.0, "micros": at_ns // 1000, "mode": "auto"}, at_ns, at_ns
            )
            data = [*(36 * 8).to_bytes(2, "little"), *[0] * 6]
            made = {"header": header, "id": 256 + k % 2, "dlc": 8, "data": data}
            writer.write_message("/can", frame, made, at_ns, at_ns)
        writer.finish()
    return path


def speed_source(document: dict) -> dict:
    inputs = document["stages"]["estimate"]["inputs"]
    return next(each for each in inputs if each["role"] == "ego_speed")


@pytest.mark.parametrize("text", ["kmh*kmh", "kmh/3.6", "kmh*0.277777778@micros*us", "kmh*kmh@micros*us"])
def test_a_field_becomes_the_speed(cwcli: Run, log: Path, text: str) -> None:
    done = cwcli("estimate", log, "--map", f"ego_speed=/status:{text}", "--json")
    assert done.returncode == 0, done.stderr
    source = speed_source(json.loads(done.stdout))
    assert (source["topic"], source["used"]) == ("/status", 100)


def test_can_frames_become_the_speed(cwcli: Run, log: Path, tmp_path: Path) -> None:
    (tmp_path / "car.dbc").write_text(DBC)
    done = cwcli("estimate", log, "--map", "ego_speed=/can:Motion.Speed", "--dbc", tmp_path / "car.dbc", "--json")
    assert done.returncode == 0, done.stderr
    source = speed_source(json.loads(done.stdout))
    assert (source["used"], source["set_aside"]) == (50, {"frame of another message": 50})
    assert any("km/h" in note for note in json.loads(done.stdout)["stages"]["estimate"]["notes"])


def test_info_offers_the_signals_of_a_dbc_file(cwcli: Run, log: Path, tmp_path: Path) -> None:
    dbc = tmp_path / "my car.dbc"
    dbc.write_text(DBC)
    document = json.loads(cwcli("info", log, "--dbc", dbc, "--json").stdout)
    can = next(each for each in document["channels"] if each["topic"] == "/can")
    assert can["try"] == [f"--map ego_speed=/can:Motion.Speed --dbc '{dbc}'"]
    assert "need a DBC" not in can["why_not"]
    mapped = cwcli("estimate", log, *shlex.split(can["try"][0]), "--json")
    assert speed_source(json.loads(mapped.stdout))["used"] == 50


def test_info_says_that_a_dbc_file_is_no_such_file(cwcli: Run, log: Path, tmp_path: Path) -> None:
    done = cwcli("info", log, "--dbc", tmp_path / "none.dbc")
    assert done.returncode == 2
    assert b"none.dbc: can't read the DBC file" in done.stderr


def test_a_mapping_is_kept_in_the_pipeline_file(cwcli: Run, log: Path, tmp_path: Path) -> None:
    pipeline = tmp_path / "pipeline.toml"
    pipeline.write_text('map = ["ego_speed=/status:kmh*kmh"]\n')
    assert b'map = ["ego_speed=/status:kmh*kmh"]' in cwcli("config", pipeline).stdout
    done = cwcli("estimate", log, "--config", pipeline, "--json")
    assert speed_source(json.loads(done.stdout))["used"] == 100


def write_scattered(path: Path, *, skip: int = 0) -> Path:
    """The car of `write_log`, each of whose numbers has a topic of its own: no header, 2 ms one after the other."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        number = writer.register_msgdef("std_msgs/msg/Float64", "float64 data")
        for k in range(100):
            for j, (name, value) in enumerate(
                {"lat": 50.0 + k / 111_229.0, "lon": 8.0 + 2e-5 * k, "ve": 1.0, "vn": 10.0}.items()
            ):
                at_ns = T0_NS + 100_000_000 * k + 2_000_000 * j
                if name != "lon" or k >= skip:
                    writer.write_message(f"/{name}", number, {"data": value}, at_ns, at_ns)
        writer.finish()
    return path


def test_quantities_of_a_role_in_several_channels_make_one_source(cwcli: Run, tmp_path: Path) -> None:
    """The longitude at the latitude's times: 2 ms before each of its own, and none before the first."""
    log = write_scattered(tmp_path / "my.mcap", skip=30)
    options = [f"ego_position=/{name}:data" for name in ("lat", "lon")]
    options += ["ego_velocity=/ve:data", "ego_velocity=/vn:data"]
    done = cwcli("estimate", log, *(word for one in options for word in ("--map", one)), "--json")
    assert done.returncode == 0, done.stderr
    stage = json.loads(done.stdout)["stages"]["estimate"]
    sources = {each["role"]: each for each in stage["inputs"]}
    assert (sources["ego_position"]["topic"], sources["ego_position"]["used"]) == ("/lat", 69)
    assert sum(sources["ego_position"]["rejected"].values()) == 31
    assert (sources["ego_velocity"]["topic"], sources["ego_velocity"]["used"]) == ("/ve", 99)
    assert "/lat: longitude of /lon (70 messages), interpolated by log time" in stage["notes"]


def test_several_mappings_are_kept_in_the_pipeline_file_and_checked_by_info(cwcli: Run, tmp_path: Path) -> None:
    log, pipeline = write_scattered(tmp_path / "my.mcap"), tmp_path / "pipeline.toml"
    pipeline.write_text('map = ["ego_position=/lat:data", "ego_position=/lon:data"]\n')
    assert b'map = ["ego_position=/lat:data", "ego_position=/lon:data"]' in cwcli("config", pipeline).stdout
    document = json.loads(cwcli("info", log, "--config", pipeline, "--json").stdout)
    (found,) = (each for each in document["inputs"] if each["role"] == "ego_position")
    assert found["used"] == 99
    roles = {each["topic"]: each["roles"] for each in document["channels"]}
    assert (roles["/lat"], roles["/lon"], roles["/ve"]) == (["ego_position"], ["ego_position"], [])


def test_a_quantity_that_may_be_left_out_comes_from_another_channel(cwcli: Run, tmp_path: Path) -> None:
    log = write_scattered(tmp_path / "my.mcap")
    options = ["ego_position=/lat:data", "ego_position=/lon:data", "ego_speed=/vn:data", "ego_speed=/ve:,data*degps"]
    done = cwcli("estimate", log, *(word for one in options for word in ("--map", one)), "--json")
    assert done.returncode == 0, done.stderr
    stage = json.loads(done.stdout)["stages"]["estimate"]
    assert "/vn: heading_rate of /ve (100 messages), interpolated by log time" in stage["notes"]


def test_two_whole_mappings_of_a_role_are_two_sources(cwcli: Run, log: Path) -> None:
    done = cwcli("estimate", log, "--map", "ego_speed=/status:kmh*kmh", "--map", "ego_speed=/gps:altitude", "--json")
    assert done.returncode == 0, done.stderr
    inputs = json.loads(done.stdout)["stages"]["estimate"]["inputs"]
    assert {each["topic"] for each in inputs if each["role"] == "ego_speed"} == {"/status", "/gps"}


@pytest.mark.parametrize(
    ("mappings", "words"),
    [
        (("ego_position=/gps:latitude",), "1 fields for latitude, longitude, altitude"),
        (("ego_position=/gps:latitude", "ego_position=/gps:longitude,altitude,altitude"), "3 fields for longitude"),
        (("ego_speed=/status:kmh", "ego_speed=/status:kmh"), "/status is given twice"),
        (("ego_speed=/status:,kmh",), "it starts with quantity 2"),
        (("ego_position=/gps:latitude,longitude", "ego_position=/status:,kmh"), "it starts with quantity 2"),
        (("ego_steer=/status:kmh", "ego_steer=/gps:latitude"), "ego_steer is given twice"),
        (("ego_position=/gps:latitude", "ego_position=/nothing:lon"), "no topic /nothing"),
    ],
)
def test_mappings_that_do_not_fit_together_are_refused(
    cwcli: Run, log: Path, mappings: tuple[str, ...], words: str
) -> None:
    done = cwcli("estimate", log, *(word for one in mappings for word in ("--map", one)))
    assert done.returncode == 2
    assert words in done.stderr.decode()


@pytest.mark.parametrize(
    ("mapping", "words"),
    [
        ("ego_speed=/status", "expected ROLE=/topic:field"),
        ("ego_speed=/nothing:kmh", "no topic /nothing"),
        ("ego_speed=/status:speed", "has no number in speed"),
        ("ego_speed=/status:mode", "has no number in mode"),
        ("ego_speed=/status:kmh*deg", "deg is not a unit of speed"),
        ("remote=/status:kmh", "can't be mapped"),
        ("ego_speed=/can:Motion.Speed", "need the file that describes them"),
        ("ego_speed=/status:kmh-exit()", "can't be read"),
    ],
)
def test_what_does_not_fit_is_one_line(cwcli: Run, log: Path, mapping: str, words: str) -> None:
    done = cwcli("estimate", log, "--map", mapping)
    assert done.returncode == 2
    assert words in done.stderr.decode()


def test_a_configuration_file_with_a_bad_mapping_is_refused(cwcli: Run, log: Path, tmp_path: Path) -> None:
    pipeline = tmp_path / "pipeline.toml"
    pipeline.write_text('map = ["ego_speed=/status:kmh*parsec"]\n')
    done = cwcli("estimate", log, "--config", pipeline)
    assert done.returncode == 2
    assert "parsec" in done.stderr.decode()
