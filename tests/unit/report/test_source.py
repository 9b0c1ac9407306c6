"""What a report is made of: folders, single logs, and manifests that lie."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cwcli.errors import InputError
from cwcli.report.source import read_reported_run


def folder(path: Path, *logs: dict[str, object], manifest: bool = True) -> Path:
    for log in logs:
        (path / "logs" / str(log["id"])).mkdir(parents=True)
        (path / "logs" / str(log["id"]) / "annotated.mcap").write_bytes(b"x")
        (path / "logs" / str(log["id"]) / "entry.json").write_text(json.dumps(log))
    if manifest:
        (path / "manifest.json").write_text(json.dumps({"format": 2, "pipeline": {"gates": ["a < 1"]}, "logs": logs}))
    return path


def test_folder_is_read_from_its_manifest(tmp_path: Path) -> None:
    out = folder(tmp_path, {"id": "b", "status": "done"}, {"id": "a", "status": "failed", "error": {"what": "gone"}})
    run = read_reported_run(str(out))
    assert [entry.id for entry in run.entries] == ["a", "b"]
    assert run.entries[0].has_failed
    assert run.entries[0].error == {"what": "gone"}
    assert run.gates == ("a < 1",)


def test_folder_of_a_killed_run_tells_what_is_done(tmp_path: Path) -> None:
    out = folder(tmp_path, {"id": "a", "status": "done"}, manifest=False)
    assert [entry.id for entry in read_reported_run(str(out)).entries] == ["a"]


def test_a_logs_own_entry_counts_more_than_the_manifest_of_a_killed_run(tmp_path: Path) -> None:
    out = folder(tmp_path, {"id": "a", "status": "done"}, {"id": "b", "status": "failed"})
    pending = [{"id": name, "status": "pending", "error": None} for name in ("a", "b", "c")]
    (out / "manifest.json").write_text(json.dumps({"format": 2, "pipeline": {}, "logs": pending}))
    assert [(entry.id, entry.has_failed) for entry in read_reported_run(str(out)).entries] == [
        ("a", False),
        ("b", True),
        ("c", True),
    ]
    assert read_reported_run(str(out)).entries[2].error == {"what": "it was not processed"}


@pytest.mark.parametrize("name", ["../other", "..", "", "a/b", "a\\b", "a\0b", "/etc"])
def test_id_cannot_lead_out_of_the_folder(tmp_path: Path, name: str) -> None:
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "annotated.mcap").write_bytes(b"secret")
    out = tmp_path / "out"
    (out / "logs").mkdir(parents=True)
    (out / "manifest.json").write_text(json.dumps({"logs": [{"id": name, "status": "done"}]}))
    (entry,) = read_reported_run(str(out)).entries
    assert entry.log is None
    assert entry.metrics == {}


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"logs": 3}', "\xff"])
def test_broken_manifest_is_one_line(tmp_path: Path, text: str) -> None:
    (tmp_path / "manifest.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError):
        read_reported_run(str(tmp_path))


def test_other_folder_is_refused_with_a_hint(tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        read_reported_run(str(tmp_path))
    assert "cwcli run -d" in error.value.what


def test_manifest_of_odd_types_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    entry = {"id": "7", "source": None, "status": None, "error": "text", "left_out": [1], "metrics": 4}
    (tmp_path / "manifest.json").write_text(json.dumps({"pipeline": {"gates": 5}, "logs": [entry, 3, {"id": 8}]}))
    run = read_reported_run(str(tmp_path))
    assert [each.id for each in run.entries] == ["7"]
    assert run.gates == ()
