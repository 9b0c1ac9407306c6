"""The official TypeScript reader, with which Foxglove opens logs: it finds what the official Python reader finds.

It comes from npm (`@mcap/core`), not from a Python index: `npm ci --prefix tests/peers/typescript`.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import shutil
import subprocess
from collections import defaultdict
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from cwcli.cli.main import run_command_line
from tests.cli.conftest import ROOT, SAMPLES, Run

FOLDER = ROOT / "tests" / "peers" / "typescript"
STATES = "/cwcli/ego/state"


@pytest.fixture(scope="module")
def node() -> str:
    """Where it is absent this file is not collected (tests/conftest.py)."""
    found = shutil.which("node")
    assert found is not None
    return found


@pytest.fixture(scope="module")
def annotated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("typescript") / "annotated.mcap"
    assert run_command_line(["run", str(SAMPLES / "intersection.mcap"), "-o", str(target), "--quiet"]) == 0
    return target


def by_typescript(node: str, path: Path) -> dict[str, Any]:
    done = subprocess.run([node, FOLDER / "read.mjs", path, STATES], capture_output=True, check=False, timeout=600)
    assert done.returncode == 0, done.stderr.decode()
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def by_python(path: Path) -> dict[str, dict[str, Any]]:
    """Topic -> schema, encoding, number of messages, and a digest of their times, lengths and payloads."""
    found: dict[str, dict[str, Any]] = {}
    digests: dict[str, Any] = defaultdict(hashlib.sha256)
    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            name = schema.name if schema else ""
            told = found.setdefault(
                channel.topic, {"schema": name, "encoding": channel.message_encoding, "messages": 0}
            )
            told["messages"] += 1
            digests[channel.topic].update(f"{message.log_time} {len(message.data)} ".encode() + message.data)
    return {topic: told | {"digest": digests[topic].hexdigest()} for topic, told in found.items()}


def test_it_finds_every_message_of_an_annotated_log(node: str, annotated: Path) -> None:
    found = by_typescript(node, annotated)
    assert found["topics"] == by_python(annotated)
    assert {"/v2x/bsm", STATES, "/cwcli/remote/path", "/cwcli/warnings"} <= found["topics"].keys()
    assert found["is_whole"]
    assert found["messages_in_stream"] == sum(each["messages"] for each in found["topics"].values())
    assert {"cwcli.run.estimate", "cwcli.run.predict", "cwcli.run.warn"} <= {*found["metadata"]}


def test_it_decodes_the_states_with_the_schema_in_the_log(node: str, annotated: Path, cwcli: Run) -> None:
    rows = by_typescript(node, annotated)["rows"]
    expected = [*csv.DictReader(io.StringIO(cwcli("export", annotated, "--what", "ego").stdout.decode()))]
    assert len(rows) == len(expected) == 201
    assert [row["stamp_ns"] for row in rows] == [row["stamp_ns"] for row in expected]
    for name in ("x_m", "speed_mps", "heading_rad"):
        assert [row.get(name, 0.0) for row in rows] == [float(row[name]) for row in expected]


@pytest.mark.parametrize("form", ["ros2", "osi"])
def test_it_reads_what_is_exported_to_other_tools(node: str, annotated: Path, tmp_path: Path, form: str) -> None:
    target = tmp_path / "exported.mcap"
    assert run_command_line(["export", str(annotated), "--format", form, "-o", str(target), "--quiet"]) == 0
    found = by_typescript(node, target)
    assert found["topics"] == by_python(target)
    assert found["is_whole"] and found["profile"] == {"ros2": "ros2", "osi": ""}[form]


@pytest.mark.parametrize("name", ["intersection", "straight"])
def test_it_reads_the_bundled_logs(node: str, name: str) -> None:
    found = by_typescript(node, SAMPLES / f"{name}.mcap")
    assert found["topics"] == by_python(SAMPLES / f"{name}.mcap")
    assert found["is_whole"]
