"""ROS 1 bags and rosbag2's databases are logs: written by the library `rosbags`, read as the same log in MCAP."""

from __future__ import annotations

import errno
import hashlib
import os
import sqlite3
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
import zstandard
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_NOT_WRITTEN, EXIT_USAGE, InputError, OutputError, UsageError
from cwcli.input import InputFile
from cwcli.logs.codecs.compressed_messages import decompress_message
from cwcli.logs.format.message_log import MessageLog
from cwcli.logs.read.bags import convert_bag
from cwcli.logs.read.read_bounds import ReadBounds
from cwcli.logs.read.reader import Log
from cwcli.logs.read.ros2_database import iter_schemas_and_channels
from cwcli.logs.read.source_format import SourceFormat
from cwcli.logs.read.sqlite_files import open_database
from cwcli.logs.write.annotate import annotate_log
from tests.unit.logs_read.part_builders import official

T0_NS = 1_700_000_000_000_000_000
N = 50
N_IN_PROCESSES = 2
"""Damaged files that go the whole way; the others are converted in the process of the test, which is quicker."""
FIX, IMU, TF = "sensor_msgs/msg/NavSatFix", "sensor_msgs/msg/Imu", "tf2_msgs/msg/TFMessage"


def content(store: Any, *, is_ros1: bool) -> list[tuple[str, str, int, Any]]:
    """Topic, type, log time and message: fixes, rates of turn, and a transform that is said once."""
    types = store.types

    def header(k: int, frame: str) -> Any:
        stamp = types["builtin_interfaces/msg/Time"](sec=1_700_000_000 + k // 10, nanosec=k % 10 * 100_000_000)
        more = {"seq": k} if is_ros1 else {}
        return types["std_msgs/msg/Header"](**more, stamp=stamp, frame_id=frame)

    def vector(x: float) -> Any:
        return types["geometry_msgs/msg/Vector3"](x=x, y=0.0, z=0.0)

    turn = types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
    mounted = types["geometry_msgs/msg/TransformStamped"](
        header=header(0, "base_link"),
        child_frame_id="camera",
        transform=types["geometry_msgs/msg/Transform"](translation=vector(1.5), rotation=turn),
    )
    made = [("/tf_static", TF, T0_NS, types[TF](transforms=[mounted]))]
    for k in range(N):
        status = types["sensor_msgs/msg/NavSatStatus"](status=0, service=1)
        fix = types[FIX](
            header=header(k, "gps"),
            status=status,
            latitude=48.0 + k * 1e-5,
            longitude=11.0,
            altitude=500.0,
            position_covariance=np.eye(3).ravel(),
            position_covariance_type=2,
        )
        none = np.zeros(9)
        imu = types[IMU](
            header=header(k, "imu"),
            orientation=turn,
            orientation_covariance=none,
            angular_velocity=vector(k / 10),
            angular_velocity_covariance=none,
            linear_acceleration=vector(1.0),
            linear_acceleration_covariance=none,
        )
        made += [("/fix", FIX, T0_NS + k * 100_000_000, fix), ("/imu", IMU, T0_NS + k * 100_000_000 + 5, imu)]
    return made


def bag(path: Path, compression: Writer1.CompressionFormat | None = None) -> Path:
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))
    writer = Writer1(path)
    if compression is not None:
        writer.set_compression(compression)
    with writer:
        connections: dict[str, Any] = {}
        for topic, kind, log_time_ns, message in content(store, is_ros1=True):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], log_time_ns, store.serialize_ros1(message, kind))
    return path


def recording(
    folder: Path, storage: StoragePlugin, mode: CompressionMode | None = None, version: Literal[8, 9] = 9
) -> Path:
    store = get_typestore(Stores.ROS2_JAZZY)
    writer = Writer2(folder, version=version, storage_plugin=storage)
    if mode is not None:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections: dict[str, Any] = {}
        for topic, kind, log_time_ns, message in content(store, is_ros1=False):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], log_time_ns, store.serialize_cdr(message, kind))
    return folder


RECORDINGS: dict[str, Callable[[Path], Path]] = {
    "bag": lambda folder: bag(folder / "drive.bag"),
    "bag with bz2": lambda folder: bag(folder / "drive.bag", Writer1.CompressionFormat.BZ2),
    "bag with lz4": lambda folder: bag(folder / "drive.bag", Writer1.CompressionFormat.LZ4),
    "database in a folder": lambda folder: recording(folder / "drive", StoragePlugin.SQLITE3),
    "database of ROS 2 Humble": lambda folder: recording(folder / "drive", StoragePlugin.SQLITE3, version=8),
    "database alone": lambda folder: next(recording(folder / "drive", StoragePlugin.SQLITE3).glob("*.db3")),
    "database, files compressed": lambda folder: recording(
        folder / "drive", StoragePlugin.SQLITE3, CompressionMode.FILE
    ),
    "database, messages compressed": lambda folder: recording(
        folder / "drive", StoragePlugin.SQLITE3, CompressionMode.MESSAGE
    ),
    "MCAP in a folder": lambda folder: recording(folder / "drive", StoragePlugin.MCAP),
    "MCAP, messages compressed": lambda folder: recording(
        folder / "drive", StoragePlugin.MCAP, CompressionMode.MESSAGE
    ),
    "MCAP, messages compressed, alone": lambda folder: next(
        recording(folder / "drive", StoragePlugin.MCAP, CompressionMode.MESSAGE).glob("*.mcap")
    ),
    "MCAP, files compressed": lambda folder: recording(folder / "drive", StoragePlugin.MCAP, CompressionMode.FILE),
}


@pytest.mark.parametrize("kind", RECORDINGS)
def test_a_recording_of_any_kind_is_a_log(tmp_path: Path, kind: str) -> None:
    with Log.open(RECORDINGS[kind](tmp_path)) as log:
        assert log.faults.counts_by_reason() == {}
        assert {(each.topic, each.schema_name, each.message_count) for each in log.channels} == {
            ("/tf_static", TF, 1),
            ("/fix", FIX, N),
            ("/imu", IMU, N),
        }
        fixes, rates = log.columns("/fix"), log.columns("/imu")
        assert fixes.log_time_ns.tolist() == [T0_NS + k * 100_000_000 for k in range(N)]
        np.testing.assert_array_equal(np.asarray(fixes.fields["latitude"]), [48.0 + k * 1e-5 for k in range(N)])
        np.testing.assert_array_equal(np.asarray(fixes.fields["position_covariance"])[:, 4], np.ones(N))
        stamps = np.asarray(fixes.fields["header.stamp.sec"]), np.asarray(fixes.fields["header.stamp.nanosec"])
        assert stamps[0].tolist() == [1_700_000_000 + k // 10 for k in range(N)]
        assert stamps[1].tolist() == [k % 10 * 100_000_000 for k in range(N)]
        np.testing.assert_array_equal(np.asarray(rates.fields["angular_velocity.x"]), np.arange(N) / 10)
        (transforms,) = log.transforms("/tf_static")
        assert transforms is not None
        assert [(each.parent, each.child, each.translation_m[0]) for each in transforms] == [
            ("base_link", "camera", 1.5)
        ]


def test_packed_messages_that_are_damaged_or_too_large_are_counted_as_undecodable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = recording(tmp_path / "drive", StoragePlugin.MCAP, CompressionMode.MESSAGE)
    path = next(folder.glob("*.mcap"))
    monkeypatch.setattr("cwcli.logs.codecs.compressed_messages.MAX_DECOMPRESSED_BATCH_BYTES", 700)
    monkeypatch.setattr("cwcli.logs.codecs.compressed_messages.MAX_BATCH_COMPRESSION_RATIO", 0)
    with Log.open(path) as log:
        fixes = log.columns("/fix")
        assert 0 < len(fixes) < N
        assert len(fixes) + fixes.n_undecodable == N
    broken = b"\x28\xb5\x2f\xfd broken"
    assert decompress_message(broken) == broken
    assert decompress_message(zstandard.compress(b"\0" * 1000), 999)[:4] == broken[:4]
    assert decompress_message(zstandard.compress(b"\0" * 1000), 1000) == b"\0" * 1000
    assert decompress_message(memoryview(b"\0\1\0\0")) == b"\0\1\0\0"


def test_the_annotated_bag_is_a_log_of_ros_2(tmp_path: Path) -> None:
    path = bag(tmp_path / "drive.bag")
    with Log.open(path) as log:
        assert log.begin_sha256().result() == hashlib.sha256(path.read_bytes()).hexdigest()
        annotate_log(log, (), {}, tmp_path / "drive.mcap")
    found = list(official(tmp_path / "drive.mcap"))
    assert [(topic, schema) for topic, schema, _, _ in found[:3]] == [("/tf_static", TF), ("/fix", FIX), ("/imu", IMU)]
    store = get_typestore(Stores.ROS2_JAZZY)
    fix: Any = store.deserialize_cdr(found[1][3], FIX)
    assert (fix.latitude, fix.header.frame_id) == (48.0, "gps")


def test_bags_are_parts_of_a_log_too(tmp_path: Path) -> None:
    one = bag(tmp_path / "a_0.bag")
    two = recording(tmp_path / "rest", StoragePlugin.MCAP)
    with Log.open([str(one), str(next(two.glob("*.mcap")))]) as log:
        assert log.n_messages == 2 * (2 * N + 1)
        assert {each.topic for each in log.channels} == {"/tf_static", "/fix", "/imu"}


def test_no_output_overwrites_the_bag(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = bag(tmp_path / "drive.bag")
    before = path.read_bytes()
    assert run_command_line(["estimate", str(path), "-o", str(path), "--force"]) != 0
    assert "the input itself" in capsys.readouterr().err
    assert path.read_bytes() == before


def test_without_the_library_one_line_names_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bags and databases with definitions need no library; a database of ROS 2 Humble has none."""
    path = next(RECORDINGS["database of ROS 2 Humble"](tmp_path).glob("*.db3"))
    with closing(sqlite3.connect(path)) as database, database:
        database.execute("DROP TABLE IF EXISTS message_definitions")
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    with pytest.raises(UsageError, match="a database without its message definitions needs a package") as told:
        convert(path, journals=[])
    assert told.value.exit_code == EXIT_USAGE
    assert "pip install 'cwcli-drive[bags]'" in told.value.hint
    path = RECORDINGS["database in a folder"](tmp_path / "iron")
    convert(next(path.glob("*.db3")), journals=[])
    convert(RECORDINGS["bag"](tmp_path), journals=None)


def convert(path: Path, journals: list[InputFile] | None) -> None:
    """Convert a file in this process."""
    with tempfile.TemporaryFile() as target, InputFile.open(path) as file:
        convert_bag(file, SourceFormat("a recording"), journals, ReadBounds(), target)


@pytest.mark.parametrize("kind", ["bag", "bag with lz4", "database alone"])
def test_a_damaged_bag_is_an_error_or_read(tmp_path: Path, kind: str) -> None:
    path = RECORDINGS[kind](tmp_path)
    data = path.read_bytes()
    rng = np.random.default_rng(3)
    n_errors = 0
    for k in range(40):
        broken = bytearray(data)
        for at in rng.integers(20, len(data), 20):
            broken[at] = rng.integers(256)
        path.write_bytes(broken[: rng.integers(100, len(data))] if rng.random() < 0.5 else broken)
        try:
            if k < N_IN_PROCESSES:
                with Log.open(path, recover=True) as log:
                    for topic in {each.topic for each in log.channels}:
                        log.columns(topic)
            else:
                convert(path, None if path.suffix == ".bag" else [])
        except InputError:
            n_errors += 1
    assert n_errors > 5


@pytest.mark.parametrize("method", ["add_schema", "add_channel", "add_message", "finish"])
def test_what_fails_in_writing_is_no_fault_of_the_bag(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    def fails(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "no room")

    path = bag(tmp_path / "drive.bag")
    monkeypatch.setattr(MessageLog, method, fails)
    with pytest.raises(OSError, match="no room"):
        convert(path, journals=None)


def test_no_room_for_what_a_bag_becomes_is_told_so(tmp_path: Path) -> None:
    """The system's own limit on files is a full disk; the process that converts it inherits it."""
    path = bag(tmp_path / "drive.bag")
    words = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096)); from cwcli.cli.main import main"
    command = [sys.executable, "-c", f"{words}; main()", "info", str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == EXIT_NOT_WRITTEN
    assert done.stderr.startswith(f"error: {tempfile.gettempdir()}: {path} can't be converted: File too large\n")


def test_no_room_for_the_copy_of_a_database_without_a_name_is_told_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(**_: Any) -> None:
        raise OSError(errno.ENOSPC, "no room")

    path = RECORDINGS["database alone"](tmp_path)
    monkeypatch.setattr(tempfile, "TemporaryDirectory", fails)
    with tempfile.TemporaryFile() as stream:
        stream.write(path.read_bytes())
        stream.flush()
        file = InputFile(os.dup(stream.fileno()), "drive.db3")
        with file, pytest.raises(OutputError, match="no room"), open_database(file, [], 1000, {}):
            pass


@pytest.mark.parametrize("change", ["timestamp = -1", "timestamp = 'soon'", "data = 'text'"])
def test_a_database_whose_messages_no_log_can_hold_is_refused(tmp_path: Path, change: str) -> None:
    path = RECORDINGS["database alone"](tmp_path)
    with sqlite3.connect(path) as database:
        database.execute(f"UPDATE messages SET {change}")
    database.close()
    with pytest.raises(InputError):
        Log.open(path)


def test_a_connection_whose_id_no_log_can_hold_gets_another(tmp_path: Path) -> None:
    """A log has ids of 16 bits, a bag of 32: the file that cwcli reads has its own ids."""
    path = bag(tmp_path / "drive.bag")
    with Log.open(path) as log:
        expected = {channel.topic: log.columns(channel.topic).log_time_ns.tolist() for channel in log.channels}
    path.write_bytes(path.read_bytes().replace(b"conn=\x01\0\0\0", b"conn=\x01\0\1\0"))
    with Log.open(path) as log:
        found = {channel.topic: log.columns(channel.topic).log_time_ns.tolist() for channel in log.channels}
    assert found == expected
    assert {*found} == {"/fix", "/imu", "/tf_static"}


def test_more_topics_than_a_log_has_ids_for_are_refused() -> None:
    connections = range(0x10000)
    with pytest.raises(ValueError, match="it has 65536 topics, and a log has room for 65535"):
        next(iter_schemas_and_channels(connections, {}, None, {}))
