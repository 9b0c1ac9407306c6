"""The run that an argument names, where its folder lies in a store."""

from __future__ import annotations

import gc
import json
import tempfile
from pathlib import Path

import fsspec
import pytest

from cwcli.cli.main import run_command_line
from cwcli.errors import InputError
from cwcli.fleet.results import read_run_metrics
from cwcli.fleet.run_source import read_run_or_none
from cwcli.fleet.search import logs_to_search
from cwcli.report.source import read_reported_run
from tests.cli.conftest import SAMPLES
from tests.cli.fleet_logs import cut

URL = "memory://runs/out"


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run over one log, in a folder; `send` copies it to the store."""
    log = cut(SAMPLES / "straight.mcap", tmp_path / "a.mcap", seconds=2.0)
    run_command_line(["run", str(log), "-d", str(tmp_path / "out"), "--stage", "estimate", "--jobs", "1", "-q"])
    return tmp_path / "out"


def send(run: Path) -> None:
    store = fsspec.filesystem("memory")
    if store.exists("/runs"):
        store.rm("/runs", recursive=True)
    store.put(f"{run}/", "/runs/out/", recursive=True)


def spoil_manifest(run: Path, **changes: object) -> None:
    path = run / "manifest.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))


def test_copies_of_a_run_are_gone_with_it(run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    send(run)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    found = read_run_or_none(URL)
    assert found is not None
    assert sorted(path.name for path in found.path.iterdir()) == ["manifest.json", "metrics.parquet", "run_times.json"]
    path = found.path
    del found
    gc.collect()
    assert not path.exists()
    assert [each.path for each in logs_to_search([URL])] == [f"{URL}/logs/a/annotated.mcap"]


def test_a_run_that_was_killed_has_the_entries_of_its_logs(run: Path) -> None:
    expected = repr(read_run_metrics(str(run)).logs)  # NaN differs from itself
    [entry] = json.loads((run / "manifest.json").read_text())["logs"]
    spoil_manifest(run, logs=[{"id": "a", "source": entry["source"], "status": "pending", "error": None}])
    send(run)
    assert repr(read_run_metrics(URL).logs) == expected


def test_what_is_wrong_in_the_store_is_named_by_its_url(run: Path) -> None:
    (run / "metrics.parquet").write_bytes(b"half")
    send(run)
    assert read_reported_run(URL).entries[0].error["where"] == f"{URL}/metrics.parquet"
    spoil_manifest(run, format=99)
    send(run)
    with pytest.raises(InputError, match=f"{URL}/manifest.json: a manifest of format 99"):
        read_run_or_none(URL)
    (run / "manifest.json").write_text("[]")  # of another tool
    send(run)
    assert read_run_or_none(URL) is None
    assert read_run_or_none("https://host/out") is None  # a web server has no folders
