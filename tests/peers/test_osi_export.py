"""States as OSI traces: every rule of the trace format, ASAM's own readers, and back again."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.reader import make_reader
from mcap.records import Chunk, ChunkIndex, Message
from mcap.stream_reader import StreamReader
from osi3.osi_groundtruth_pb2 import GroundTruth
from osi_utilities import MultiTraceReader, create_reader

from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_USAGE
from cwcli.export.osi import _unique_numeric_ids, encode_osi_mcap_trace
from cwcli.export.track_formats import Track
from cwcli.logs.encoders.schemas import OSI_DESCRIPTOR_SET_FILE, _serialize_descriptor_set, schema_folder
from cwcli.logs.read.reader import Log
from tests.osi_traces import Actor, along, time_to_contact_s, write_trace

VERSION = re.compile(r"\d+\.\d+\.\d+")
ATOL_TTC_S = 0.05
HOST = Actor(3, along(0.0, 0.0, 0.3, 20.0), size_m=(4.4, 1.9))
LEAD = Actor(8, along(66.86, 20.68, 0.3, 15.0, -1.5), size_m=(12.0, 2.5))


def run_trace(trace: Path, out: Path) -> Path:
    assert run_command_line(["run", str(trace), "--stage", "estimate,measure", "-o", str(out), "--quiet"]) == 0
    return out


@pytest.fixture(scope="module")
def annotated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("osi")
    return run_trace(write_trace(folder / "trace.mcap", (HOST, LEAD), host=3), folder / "out.mcap")


@pytest.fixture(scope="module")
def exported(annotated: Path) -> Path:
    target = annotated.with_name("exported.mcap")
    assert run_command_line(["export", str(annotated), "--format", "osi", "-o", str(target), "--quiet"]) == 0
    return target


def test_the_schema_is_the_official_one() -> None:
    kept = (schema_folder() / OSI_DESCRIPTOR_SET_FILE).read_bytes()
    assert FileDescriptorSet.FromString(kept) == FileDescriptorSet.FromString(
        _serialize_descriptor_set(GroundTruth.DESCRIPTOR.file)
    )


def test_every_rule_of_the_trace_format_holds(exported: Path) -> None:
    """OSI 3.8.0, trace_file_formats.adoc: indexed, chunked, compressed as allowed, its metadata, schema and channel."""
    with exported.open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert summary is not None
        metadata = [record for record in reader.iter_metadata() if record.name.startswith("net.asam.osi")]
        messages = list(reader.iter_messages())
    with exported.open("rb") as stream:
        records = list(StreamReader(stream, emit_chunks=True).records)
    assert exported.read_bytes()[:8] == b"\x89MCAP0\r\n"
    assert not [record for record in records if isinstance(record, Message)]  # all in chunks
    chunks = [record for record in records if isinstance(record, Chunk)]
    assert len(chunks) == len(summary.chunk_indexes) == len([r for r in records if isinstance(r, ChunkIndex)])
    assert {chunk.compression for chunk in chunks} <= {"", "zstd", "lz4"}
    (record,) = metadata
    assert record.name == "net.asam.osi.trace"
    for key in ("version", "min_osi_version", "max_osi_version", "min_protobuf_version", "max_protobuf_version"):
        assert VERSION.fullmatch(record.metadata[key]), key
    assert "zero_time" not in record.metadata  # the trace counts from the start of a simulation
    (schema,) = summary.schemas.values()
    assert (schema.name, schema.encoding, schema.id > 0) == ("osi3.GroundTruth", "protobuf", True)
    names = [file.name for file in FileDescriptorSet.FromString(schema.data).file]
    assert names[-1].endswith("osi_groundtruth.proto")
    (channel,) = summary.channels.values()
    assert (channel.message_encoding, channel.schema_id, bool(channel.topic)) == ("protobuf", schema.id, True)
    for key in ("osi_version", "protobuf_version"):
        assert VERSION.fullmatch(channel.metadata[f"net.asam.osi.trace.channel.{key}"])
    for _, _, message in messages:
        world = GroundTruth.FromString(message.data)
        stamp_ns = world.timestamp.seconds * 10**9 + world.timestamp.nanos
        assert message.publish_time == message.log_time == stamp_ns
        assert (world.version.version_major, world.version.version_minor, world.version.version_patch) == (3, 8, 0)
        assert world.host_vehicle_id.value in {each.id.value for each in world.moving_object}


def test_asams_reader_opens_it_and_finds_host_and_others(exported: Path) -> None:
    reader = create_reader(exported)
    assert isinstance(reader, MultiTraceReader)
    assert reader.open(exported)
    with reader:
        worlds: list[Any] = [result.message for result in reader]
    assert len(worlds) == 120  # 20 Hz, the last one before the 181st of 30.3 Hz
    world = worlds[60]  # at 3 s
    by_id = {each.id.value: each for each in world.moving_object}
    other = by_id[8]
    (host,) = (each for number, each in by_id.items() if number != 8)
    assert world.host_vehicle_id.value == host.id.value
    assert [each.reference for each in host.source_reference] == ["ego"]
    np.testing.assert_allclose((host.base.dimension.length, host.base.dimension.width), (4.4, 1.9))
    np.testing.assert_allclose((other.base.dimension.length, other.base.dimension.width), (12.0, 2.5))
    for actor, base in ((HOST, host.base), (LEAD, other.base)):
        x_m, y_m, yaw_rad, speed_mps, accel_mps2 = actor.motion(3.0)
        np.testing.assert_allclose((base.position.x, base.position.y), (x_m, y_m), atol=0.01)
        np.testing.assert_allclose(base.orientation.yaw, yaw_rad, atol=1e-3)
        ahead = np.array([np.cos(yaw_rad), np.sin(yaw_rad)])
        np.testing.assert_allclose((base.velocity.x, base.velocity.y), speed_mps * ahead, atol=0.02)
        np.testing.assert_allclose((base.acceleration.x, base.acceleration.y), accel_mps2 * ahead, atol=0.05)


def test_the_time_to_contact_survives_the_way_there_and_back(annotated: Path, exported: Path, tmp_path: Path) -> None:
    again = run_trace(exported, tmp_path / "again.mcap")
    found = []
    for path in (annotated, again):
        with Log.open(path) as log:
            fields: Mapping[str, Any] = log.columns("/cwcli/measures").fields
        found.append(dict(zip(fields["stamp_ns"].tolist(), fields["ttc_s"].tolist(), strict=True)))
    common = [stamp for stamp in found[0] if stamp in found[1] and found[0][stamp] < 10.0]
    assert len(common) > 50
    errors_s = [abs(found[0][stamp] - found[1][stamp]) for stamp in common]
    assert max(errors_s) < ATOL_TTC_S


def braking_at_once(t_s: float) -> tuple[float, float, float, float, float]:
    """18 m/s, 6 m/s^2 of braking between 2 and 3 s without any build-up, then 12 m/s: 40 m ahead at first."""
    braked_s = min(max(t_s - 2.0, 0.0), 1.0)
    way_m = 18.0 * t_s - 3.0 * braked_s**2 - 6.0 * max(t_s - 3.0, 0.0)
    return 40.0 + way_m, 0.0, 0.0, 18.0 - 6.0 * braked_s, -6.0 if 2.0 < t_s < 3.0 else 0.0


def test_times_to_contact_survive_where_a_simulators_car_brakes_without_delay(tmp_path: Path) -> None:
    """With the jerk of a driver the states would go round these corners."""
    host, lead = Actor(3, along(0.0, 0.0, 0.0, 20.0)), Actor(8, braking_at_once)
    annotated = run_trace(write_trace(tmp_path / "trace.mcap", (host, lead), host=3), tmp_path / "out.mcap")
    exported = tmp_path / "exported.mcap"
    assert run_command_line(["export", str(annotated), "--format", "osi", "-o", str(exported), "--quiet"]) == 0
    again = run_trace(exported, tmp_path / "again.mcap")
    for path in (annotated, again):
        with Log.open(path) as log:
            fields: Mapping[str, Any] = log.columns("/cwcli/measures").fields
        exact_s = np.array([time_to_contact_s(host, lead, stamp / 1e9) for stamp in fields["stamp_ns"].tolist()])
        judged = exact_s < 10.0
        assert judged.sum() > 50
        np.testing.assert_allclose(fields["ttc_s"][judged], exact_s[judged], atol=ATOL_TTC_S)


def test_ids_are_kept_where_they_are_numbers_and_free_ones_else() -> None:
    one = np.zeros(1)
    names = ["ego", "1", "2a3c", "0", "007", "1", str(2**64)]
    tracks = [Track(name, np.array([5]), one, one, one, one, one, one) for name in names]
    ids = _unique_numeric_ids(tracks)
    assert (ids[1], ids[3]) == (1, 0)
    assert len(set(ids)) == len(names)


def test_others_are_there_only_while_they_were_heard_and_unix_time_is_said() -> None:
    at_ns = 1_700_000_000_000_000_000 + np.arange(5, dtype=np.int64) * 100_000_000
    line = np.arange(5.0)
    ego = Track("ego", at_ns, line, line, 0 * line, line, line, line, "ego")
    late = Track("b", at_ns[2:4], line[:2], line[:2], 0 * line[:2], line[:2], line[:2], line[:2], "targets")
    reader = make_reader(io.BytesIO(encode_osi_mcap_trace([ego, late])))
    worlds = [GroundTruth.FromString(message.data) for *_, message in reader.iter_messages()]
    assert [len(world.moving_object) for world in worlds] == [1, 1, 2, 2, 1]
    (record,) = reader.iter_metadata()
    assert record.metadata["zero_time"] == "1970-01-01T00:00:00.000000000Z"
    assert worlds[2].moving_object[1].base.dimension.length == 4.5


@pytest.mark.parametrize("what", ["ego,warnings", "ego,nothing"])
def test_what_is_no_track_is_refused(annotated: Path, what: str, tmp_path: Path) -> None:
    target = tmp_path / "a.mcap"
    assert (
        run_command_line(["export", str(annotated), "--what", what, "--format", "osi", "-o", str(target)]) == EXIT_USAGE
    )
    assert not target.exists()
