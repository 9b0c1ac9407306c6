"""A log in parts on the command line: every command takes it, and finds what it finds in the whole."""

from __future__ import annotations

import http.server
import json
import re
import threading
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pyarrow as pa
import pytest
import zstandard
from mcap.reader import make_reader
from mcap.writer import Writer
from pyarrow import parquet

from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_BAD_DATA, EXIT_BAD_INPUT, EXIT_NOT_WRITTEN, EXIT_USAGE
from cwcli.logs.read.reader import Log
from tests.unit.logs_read.part_builders import official, write_metadata

SAMPLE = Path(__file__).parents[2] / "sample_logs" / "intersection.mcap"
N_PARTS = 10


def in_parts(source: Path, folder: Path, n_parts: int = N_PARTS) -> Path:
    """A log cut between any two messages, each part with ids and chunks of its own; and its metadata.yaml."""
    folder.mkdir()
    with source.open("rb") as stream:
        reader = make_reader(stream)
        header = reader.get_header()
        content = list(reader.iter_messages(log_time_order=False))
    size = -(-len(content) // n_parts)
    counts, paths = [], []
    for k in range(n_parts):
        part = content[k * size : (k + 1) * size]
        paths.append(folder / f"drive_{k}.mcap")
        counts.append(len(part))
        with paths[-1].open("wb") as target:
            writer = Writer(target, chunk_size=20_000)
            writer.start(header.profile, header.library)
            ids: dict[int, int] = {}
            for schema, channel, message in part:
                if channel.id not in ids:
                    schema_id = writer.register_schema(schema.name, schema.encoding, schema.data) if schema else 0
                    ids[channel.id] = writer.register_channel(
                        channel.topic, channel.message_encoding, schema_id, channel.metadata
                    )
                writer.add_message(
                    ids[channel.id], message.log_time, message.data, message.publish_time, message.sequence
                )
            writer.finish()
    write_metadata(folder, paths, counts)
    return folder


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sample log in ten parts."""
    return in_parts(SAMPLE, tmp_path_factory.mktemp("recorded") / "drive")


def tables(folder: Path) -> dict[str, bytes]:
    """Name -> every byte of the values and of the schema; the bytes of a Parquet file hold more than these."""
    found = {path.name: parquet.read_table(path) for path in sorted(folder.iterdir())}
    return {name: ipc_bytes(table) for name, table in found.items()}


def ipc_bytes(table: pa.Table) -> bytes:
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema) as stream:
        stream.write_table(table.combine_chunks())
    return bytes(sink.getvalue())


def test_ten_parts_give_the_tables_and_the_channels_of_the_whole(drive: Path, tmp_path: Path) -> None:
    parts = sorted(map(str, drive.glob("*.mcap")))
    hold_to_the_whole(SAMPLE, {"folder": [str(drive)], "named": [*parts[::-1], "--as-one"]}, tmp_path)


@pytest.mark.parametrize("chunk_bytes", [1, 1_000_000], ids=["between chunks", "inside chunks"])
@pytest.mark.parametrize("name", ["curve", "rear-end"])
def test_parts_of_any_log_give_what_the_whole_gives(name: str, chunk_bytes: int, tmp_path: Path) -> None:
    """Frames of a camera, ROS 2, protobuf and JSON; of a whole with a chunk for each message, or one for all."""
    source, whole = SAMPLE.with_name(f"{name}.mcap"), tmp_path / "copy.mcap"
    with source.open("rb") as stream, whole.open("wb") as target:
        reader = make_reader(stream)
        writer = Writer(target, chunk_size=chunk_bytes)
        writer.start(reader.get_header().profile, reader.get_header().library)
        ids: dict[int, int] = {}
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            if channel.id not in ids:
                schema_id = writer.register_schema(schema.name, schema.encoding, schema.data) if schema else 0
                ids[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, schema_id, {})
            writer.add_message(ids[channel.id], message.log_time, message.data, message.publish_time, message.sequence)
        writer.finish()
    hold_to_the_whole(whole, {"folder": [str(in_parts(whole, tmp_path / "drive"))]}, tmp_path)


def hold_to_the_whole(whole: Path, ways: dict[str, list[str]], folder: Path) -> None:
    """Every byte of the tables, and every message of the annotated log."""
    for name, source in {"whole": [str(whole)], **ways}.items():
        out, made = folder / f"{name}.mcap", folder / name
        assert run_command_line(["run", *source, "-o", str(out), "--metrics-dir", str(made), "--quiet"]) == 0
    expected = sorted(official(folder / "whole.mcap"))
    for name in ways:
        assert tables(folder / name) == tables(folder / "whole")
        assert sorted(official(folder / f"{name}.mcap")) == expected


@pytest.mark.parametrize(
    "command",
    [
        ["info", "PARTS"],
        ["estimate", "PARTS", "--metrics", "OUT.csv"],
        ["run", "PARTS", "-d", "OUT"],
        ["export", "ANNOTATED", "--what", "ego", "-o", "OUT.csv"],
        ["evaluate", "ANNOTATED", "--metrics", "OUT.csv"],
        ["report", "ANNOTATED", "-o", "OUT.html"],
        ["layout", "PARTS", "-o", "OUT.json"],
        ["calibrate", "PARTS", "-o", "OUT.toml"],
        ["compare", "ANNOTATED", "ANNOTATED"],
    ],
    ids=lambda command: command[0],
)
def test_a_folder_is_a_log_for_every_command(
    drive: Path, tmp_path: Path, command: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    annotated = tmp_path / "annotated"
    if "ANNOTATED" in command:
        annotated.mkdir()
        assert run_command_line(["run", str(drive), "-o", str(annotated / "one.mcap"), "--quiet"]) == 0
    names = {"PARTS": str(drive), "ANNOTATED": str(annotated)}
    if command[0] in ("evaluate", "report", "compare"):  # there a folder without metadata.yaml means its logs
        write_metadata(annotated, [annotated / "one.mcap"], [3489])
    told = run_command_line([names.get(each, each.replace("OUT", str(tmp_path / "made"))) for each in command])
    assert told == 0, capsys.readouterr().err


def test_a_missing_part_is_told_and_strict_refuses_it(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    parts = [str(path) for path in sorted(drive.glob("*.mcap")) if path.name != "drive_4.mcap"]
    assert run_command_line(["info", *parts, "--as-one", "--json"]) == 0
    faults = json.loads(capsys.readouterr().out)["faults"]
    assert faults.pop("parts missing by the numbers in the names (4)") == 1
    assert run_command_line(["run", *parts, "--as-one", "--details"]) == 0
    assert "parts missing by the numbers in the names (4): 1" in " ".join(capsys.readouterr().err.split())
    assert run_command_line(["run", *parts, "--as-one", "--strict", "-o", str(tmp_path / "out.mcap")]) == EXIT_BAD_DATA
    assert not (tmp_path / "out.mcap").exists()


def test_several_logs_need_a_word_on_what_they_are(drive: Path, capsys: pytest.CaptureFixture[str]) -> None:
    parts = sorted(map(str, drive.glob("*.mcap")))[:2]
    for command in ("info", "estimate", "run", "export"):
        assert run_command_line([command, *parts]) == EXIT_USAGE
        assert "--as-one" in capsys.readouterr().err
    assert run_command_line(["run", *parts, "--as-one", "-d", "out"]) == EXIT_USAGE
    assert "exclude each other" in capsys.readouterr().err


def test_a_part_is_no_output(drive: Path, capsys: pytest.CaptureFixture[str]) -> None:
    part = drive / "drive_3.mcap"
    before = part.read_bytes()
    assert run_command_line(["estimate", str(drive), "-o", str(part), "--force"]) != 0
    assert "the input itself" in capsys.readouterr().err
    assert part.read_bytes() == before


@pytest.fixture
def server(drive: Path) -> Iterator[str]:
    handler = partial(http.server.SimpleHTTPRequestHandler, directory=str(drive))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as served:
        thread = threading.Thread(target=served.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{served.server_port}"
        served.shutdown()
        thread.join()


def test_a_url_is_a_log_for_every_command(server: str, drive: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["info", f"{server}/drive_0.mcap", "--json"]) == 0
    of_url = json.loads(capsys.readouterr().out)
    assert run_command_line(["info", str(drive / "drive_0.mcap"), "--json"]) == 0
    of_file = json.loads(capsys.readouterr().out)
    assert of_url.pop("name") == f"{server}/drive_0.mcap"
    of_file.pop("name")
    assert of_url == of_file
    assert run_command_line(["info", f"{server}/drive_0.mcap", f"{server}/drive_1.mcap", "--as-one", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["messages"] == 2 * of_file["messages"]
    assert run_command_line(["info", f"{server}/nothing.mcap"]) == EXIT_BAD_INPUT
    assert "there is no such file" in capsys.readouterr().err


def test_a_url_and_compressed_parts_have_a_bound(
    server: str, drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    parts = []
    for k in range(2):
        parts.append(tmp_path / f"drive_{k}.mcap.zstd")
        parts[k].write_bytes(zstandard.compress((drive / f"drive_{k}.mcap").read_bytes()))
    largest = max((drive / f"drive_{k}.mcap").stat().st_size for k in range(2))
    much, little = f"{1.01 * largest / 1e9:.9f}", f"{0.5 * largest / 1e9:.9f}"
    for logs in ([f"{server}/drive_0.mcap"], [str(tmp_path), "--as-one"], [*map(str, parts), "--as-one"]):
        assert run_command_line(["info", *logs, "--max-input", much]) == 0
        capsys.readouterr()
        assert run_command_line(["info", *logs, "--max-input", little]) == EXIT_BAD_INPUT
        assert re.search("--max-input reads? more", capsys.readouterr().err)
    for command in (
        ["run", f"{server}/drive_0.mcap", "-d", str(tmp_path / "many"), "--jobs", "1"],
        ["run", str(parts[0]), "-d", str(tmp_path / "more"), "--jobs", "1"],
        ["join", f"{server}/drive_0.mcap", str(drive / "drive_1.mcap"), "-o", str(tmp_path / "joined.mcap")],
        ["join", str(drive / "drive_1.mcap"), str(parts[0]), "-o", str(tmp_path / "joined.mcap")],
        ["calibrate", str(parts[0]), "-o", str(tmp_path / "calibration.toml")],
    ):
        assert run_command_line([*command, "--max-input", little]) == EXIT_BAD_INPUT, command
        assert re.search("--max-input reads? more", capsys.readouterr().err), command


def test_the_annotated_log_in_the_parts_of_the_input(drive: Path, tmp_path: Path) -> None:
    whole, parts = tmp_path / "whole.mcap", tmp_path / "parts"
    assert run_command_line(["run", str(drive), "-o", str(whole), "--quiet"]) == 0
    assert run_command_line(["run", str(drive), "-o", str(parts), "--split", "like-input", "--quiet"]) == 0
    written = sorted(parts.iterdir())
    assert [path.name for path in written] == [f"drive_{k}.mcap" for k in range(N_PARTS)]
    assert sorted(each for path in written for each in official(path)) == sorted(official(whole))
    for one, path in zip(sorted(drive.glob("*.mcap")), written, strict=True):
        first_ns = min(log_time_ns for _, _, log_time_ns, _ in official(one))
        of_cwcli = [log_time_ns for topic, _, log_time_ns, _ in official(path) if topic.startswith("/cwcli/")]
        assert path == written[0] or min(of_cwcli) >= first_ns
    with Log.open([str(path) for path in written]) as log, Log.open(whole) as expected:
        assert log.faults.counts_by_reason() == {}
        assert {each.topic: each.message_count for each in log.channels} == {
            each.topic: each.message_count for each in expected.channels
        }
        assert dict(log.metadata) == dict(expected.metadata)


def test_parts_are_written_to_a_folder_of_their_own(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    split = ["--split", "like-input"]
    assert run_command_line(["estimate", str(SAMPLE), "-o", str(tmp_path / "out"), *split]) == EXIT_USAGE
    assert "the log is one file" in capsys.readouterr().err
    before = {path: path.read_bytes() for path in drive.iterdir()}
    assert run_command_line(["estimate", str(drive), "-o", str(drive), "--force", *split]) == EXIT_NOT_WRITTEN
    assert "the input itself" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in drive.iterdir()} == before
    assert run_command_line(["estimate", str(drive), "-o", "-", *split]) == EXIT_USAGE
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "drive_9.mcap").write_bytes(b"mine")
    assert run_command_line(["estimate", str(drive), "-o", str(tmp_path / "there"), *split]) == EXIT_NOT_WRITTEN
    assert [path.name for path in (tmp_path / "there").iterdir()] == ["drive_9.mcap"]
