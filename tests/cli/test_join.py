"""`cwcli join`: the log of a second car, recorded by a computer whose clock is 3.2 s ahead."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from cwcli.channels.vehicle_state import read_vehicle_states
from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_BAD_DATA, EXIT_MISSING_SIGNAL, EXIT_NOT_WRITTEN
from cwcli.logs.read.reader import Log

SAMPLE = Path(__file__).parents[2] / "sample_logs" / "intersection.mcap"
AHEAD_NS = 3_200_000_000
SENSORS = {"/gps/fix", "/gps/heading", "/vehicle/velocity", "/imu/data"}


def copied(
    source: Path,
    target: Path,
    later: Callable[[int], int],
    topics: set[str] = SENSORS,
    *,
    twin: str = "",
    empty: str = "",
    has_fix: bool = True,
) -> Path:
    """The topics of a log with other log times; the fixes a second time as `twin`, and `empty` without its messages."""
    with source.open("rb") as stream, target.open("wb") as sink:
        reader = make_reader(stream)
        writer = Writer(sink)
        writer.start("ros2", "test")
        ids: dict[int, int] = {}
        second = 0
        for schema, channel, message in reader.iter_messages():
            if channel.topic in topics and schema is not None:
                if channel.id not in ids:
                    schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
                    ids[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, schema_id)
                    if twin and channel.topic == "/gps/fix":
                        second = writer.register_channel(twin, channel.message_encoding, schema_id)
                if channel.topic == empty:
                    continue
                data = bytearray(message.data)
                if channel.topic == "/gps/fix" and not has_fix:  # the status, behind the frame's name
                    data[16 + int.from_bytes(data[12:16], "little")] = 0xFF
                writer.add_message(ids[channel.id], later(message.log_time), bytes(data), message.publish_time)
                if twin and channel.topic == "/gps/fix":
                    writer.add_message(second, later(message.log_time), message.data, message.publish_time)
        for metadata in reader.iter_metadata():
            writer.add_metadata(metadata.name, metadata.metadata)
        writer.finish()
    return target


@pytest.fixture(scope="module")
def cars(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The same drive, recorded by two computers."""
    folder = tmp_path_factory.mktemp("cars")
    return (
        copied(SAMPLE, folder / "ego.mcap", lambda log_time: log_time),
        copied(SAMPLE, folder / "truck.mcap", lambda log_time: log_time + AHEAD_NS),
    )


@pytest.fixture(scope="module")
def estimated(cars: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("estimated") / "ego.mcap"
    assert run_command_line(["estimate", str(cars[0]), "-o", str(target), "--quiet"]) == 0
    return target


def test_the_second_car_is_a_remote_vehicle(
    cars: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    both = tmp_path / "both.mcap"
    assert run_command_line(["join", *map(str, cars), "--role", "remote", "-o", str(both), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["clock_offset_s"] == pytest.approx(AHEAD_NS / 1e9, abs=1e-6)
    assert any("recorder is 3.200 s ahead of this one's" in note for note in said["notes"])
    with Log.open(both) as log:
        ego = read_vehicle_states(log.columns("/cwcli/ego/state"))
        truck = read_vehicle_states(log.columns("/cwcli/remote/state"))
        online = read_vehicle_states(log.columns("/cwcli/ego/online"))
        truck_online = read_vehicle_states(log.columns("/cwcli/remote/online"))
        assert dict(log.metadata)["cwcli.join"]["id"] == "truck"
    assert truck.ids.values == ("truck",)
    np.testing.assert_array_equal(truck.stamp_ns, ego.stamp_ns)
    np.testing.assert_allclose(truck.state, ego.state, atol=1e-5)
    np.testing.assert_allclose(truck.covariance, ego.covariance, atol=1e-6)
    np.testing.assert_array_equal(truck_online.stamp_ns, online.stamp_ns)
    assert np.abs(truck_online.log_time_ns - online.log_time_ns).max() < 1_000_000


def test_clocks_three_tenths_apart_do_not_move_the_second_car(
    cars: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Delays of 0 to 20 ms of each message beside: at 12 m/s, 0.3 s would be 3.6 m."""
    rng = np.random.default_rng(5)
    other = copied(SAMPLE, tmp_path / "truck.mcap", lambda at: at + 300_000_000 + int(rng.integers(20_000_000)))
    both = tmp_path / "both.mcap"
    assert run_command_line(["join", str(cars[0]), str(other), "-o", str(both), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["clock_offset_s"] == pytest.approx(0.31, abs=0.003)
    assert any("recorder is 0.3" in note and "(scatter 0.0" in note for note in said["notes"])
    with Log.open(both) as log:
        ego, truck = (read_vehicle_states(log.columns(f"/cwcli/{who}/state")) for who in ("ego", "remote"))
        online = read_vehicle_states(log.columns("/cwcli/remote/online"))
    at_ego = np.searchsorted(ego.stamp_ns, truck.stamp_ns)
    apart_m = np.hypot(*(truck.state[:, :2] - ego.state[at_ego, :2]).T)
    assert apart_m.max() < 0.1
    known_late_s = (online.log_time_ns - online.stamp_ns) / 1e9
    assert -0.05 < np.median(known_late_s) < 0.1


def test_a_log_whose_positions_are_mapped_is_joined_too(cars: tuple[Path, Path], tmp_path: Path) -> None:
    mapped, both = tmp_path / "mapped.mcap", tmp_path / "both.mcap"
    fields = ["ego_position=/gps/fix:latitude", "ego_position=/gps/fix:longitude,altitude"]
    maps = [word for each in fields for word in ("--map", each)]
    assert run_command_line(["estimate", str(cars[0]), *maps, "-o", str(mapped), "--quiet"]) == 0
    assert run_command_line(["join", str(mapped), str(cars[1]), "-o", str(both), "--quiet"]) == 0


def test_stages_go_on_from_the_joined_log(
    cars: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    both, annotated = tmp_path / "both.mcap", tmp_path / "annotated.mcap"
    assert run_command_line(["join", *map(str, cars), "-o", str(both), "--id", "b", "--quiet"]) == 0
    assert run_command_line(["run", str(both), "--stage", "predict,warn,measure", "-o", str(annotated), "--quiet"]) == 0
    with Log.open(annotated) as log:
        assert {"/cwcli/remote/path", "/cwcli/measures"} <= {channel.topic for channel in log.channels}


def test_a_log_with_remote_vehicles_keeps_them(cars: tuple[Path, Path], tmp_path: Path) -> None:
    both = tmp_path / "both.mcap"
    assert run_command_line(["join", str(SAMPLE), str(cars[1]), "-o", str(both), "--quiet"]) == 0
    with Log.open(both) as log:
        found = read_vehicle_states(log.columns("/cwcli/remote/state"))
    assert len(found.ids.values) == 2
    assert "truck" in found.ids.values
    assert (np.diff(found.log_time_ns) >= 0).all()


def test_logs_without_a_common_moment_are_refused(
    cars: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    both = tmp_path / "both.mcap"
    assert run_command_line(["join", *map(str, cars), "--late", "60", "-o", str(both)]) == EXIT_BAD_DATA
    assert "no moment in common" in capsys.readouterr().err
    assert not both.exists()


def test_stamps_that_are_late_are_corrected(
    cars: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    both = tmp_path / "both.mcap"
    assert run_command_line(["join", *map(str, cars), "--late", "1", "-o", str(both), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["clock_offset_s"] == pytest.approx(AHEAD_NS / 1e9 + 1.0, abs=1e-6)
    with Log.open(both) as log:
        ego, truck = (read_vehicle_states(log.columns(f"/cwcli/{who}/state")) for who in ("ego", "remote"))
    shifted = np.searchsorted(ego.stamp_ns, truck.stamp_ns[0] + 1_000_000_000)
    np.testing.assert_allclose(truck.state[0], ego.state[shifted], atol=1e-5)
    assert said["outside"] > 0


@pytest.mark.parametrize("which", [0, 1])
def test_no_input_is_overwritten(cars: tuple[Path, Path], which: int, capsys: pytest.CaptureFixture[str]) -> None:
    before = cars[which].read_bytes()
    assert run_command_line(["join", *map(str, cars), "-o", str(cars[which]), "--force"]) == EXIT_NOT_WRITTEN
    assert "the input itself" in capsys.readouterr().err
    assert cars[which].read_bytes() == before


def test_positions_of_two_topics_are_chosen_where_the_estimate_is_made(
    cars: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    two = copied(cars[0], tmp_path / "two.mcap", lambda log_time: log_time, twin="/gps/other")
    both, estimated = tmp_path / "both.mcap", tmp_path / "estimated.mcap"
    assert run_command_line(["join", str(two), str(cars[1]), "-o", str(both)]) == EXIT_MISSING_SIGNAL
    assert "`cwcli estimate" in capsys.readouterr().err
    assert (
        run_command_line(["estimate", str(two), "--topic", "ego_position=/gps/other", "-o", str(estimated), "--quiet"])
        == 0
    )
    assert run_command_line(["join", str(estimated), str(cars[1]), "-o", str(both), "--quiet"]) == 0


@pytest.mark.parametrize("which", [0, 1])
@pytest.mark.parametrize("lack", ["/cwcli/ego/state", "fix"])
def test_a_log_that_holds_none_of_what_its_channels_are_for_is_refused(
    cars: tuple[Path, Path], estimated: Path, tmp_path: Path, which: int, lack: str, capsys: pytest.CaptureFixture[str]
) -> None:
    topics = SENSORS | {"/cwcli/ego/state", "/cwcli/ego/online"}
    lacking = copied(estimated, tmp_path / "b.mcap", lambda at: at, topics, empty=lack, has_fix=lack != "fix")
    logs = [cars[0], cars[1]]
    logs[which] = lacking
    assert run_command_line(["join", *map(str, logs), "-o", str(tmp_path / "both.mcap")]) == EXIT_MISSING_SIGNAL
    assert str(lacking) in capsys.readouterr().err


def test_online_states_may_be_missing(cars: tuple[Path, Path], estimated: Path, tmp_path: Path) -> None:
    topics = SENSORS | {"/cwcli/ego/state", "/cwcli/ego/online"}
    lacking = copied(estimated, tmp_path / "b.mcap", lambda at: at, topics, empty="/cwcli/ego/online")
    both = tmp_path / "both.mcap"
    assert run_command_line(["join", str(cars[0]), str(lacking), "-o", str(both), "--quiet"]) == 0
    with Log.open(both) as log:
        assert "/cwcli/remote/online" not in {channel.topic for channel in log.channels}


def test_names_of_others_move_no_cursor(
    cars: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hostile = tmp_path / "x\x1b[31m.mcap"
    hostile.write_bytes(cars[1].read_bytes())
    for k, more in enumerate(([], ["--id", "y\x1b]0;z\x07"])):
        assert run_command_line(["join", str(cars[0]), str(hostile), "-o", str(tmp_path / f"both{k}.mcap"), *more]) == 0
        said = "".join(capsys.readouterr())
        assert "\x1b" not in said and "\x07" not in said
        assert ("y\\x1b]0;z\\x07" if more else "x\\x1b[31m") in said
