"""The page of a run over many logs: made from the run's digest, the worst log first, and small."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from cwcli.logs.read.reader import Log
from cwcli.report import build
from cwcli.report.build import build_report

N_LOGS = 300


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run of 300 logs: two failed for one reason, one for another; one is doubtful, one has warnings."""
    entries = []
    for k in range(N_LOGS):
        name = f"drive_{k:04}"
        entry: dict[str, Any] = {
            "id": name,
            "source": f"{name}.mcap",
            "status": "done",
            "error": None,
            "tables": {"events": 0},
        }
        entry["digest"] = {"happened": [f"The log is {k} s long; the car drove 100 m, at most 50 km/h."], "doubts": []}
        (tmp_path / "logs" / name).mkdir(parents=True)
        (tmp_path / "logs" / name / "annotated.mcap").write_bytes(b"")
        entries.append(entry)
    for k, what in ((7, "no position"), (8, "no position"), (9, "a damaged chunk")):
        entries[k] |= {"status": "failed", "error": {"what": what}, "digest": {}}
    entries[100]["digest"]["doubts"] = [{"sentence": "The speed is in km/h <b>."}]
    entries[200]["tables"] = {"events": 3}
    (tmp_path / "manifest.json").write_text(json.dumps({"format": 2, "cwcli": "0.1.0", "logs": entries}))
    return tmp_path


def test_the_worst_logs_come_first_and_failures_are_grouped(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build, "MAX_LONG_PAGE_BYTES", 0)  # no log gets figures, so none has to be read
    monkeypatch.setattr(Log, "open", lambda *arguments, **options: pytest.fail("a log was opened"))
    report = build_report(str(run))
    page = report.html.decode()
    names = re.findall(r'<td class="name">(drive_\d+)</td>', page)
    assert (len(names), report.n_failed) == (N_LOGS, 3)
    assert names[:6] == ["drive_0007", "drive_0008", "drive_0009", "drive_0100", "drive_0200", "drive_0000"]
    assert "2 logs failed: no position (drive_0007, drive_0008)." in page
    assert "1 log failed: a damaged chunk (drive_0009)." in page
    assert "1 doubt" in page and "The speed is in km/h &lt;b&gt;." in page


def test_a_row_of_many_is_small(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build, "MAX_LONG_PAGE_BYTES", 0)
    table = build_report(str(run)).html.decode().partition('class="wide logs"')[2].partition("</table>")[0]
    assert len(table.encode()) < build.OVERVIEW_ROW_BYTES_OF_LONG_PAGE * N_LOGS
