"""The page of a run over many logs: made from the run's digest, the worst log first, and small."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from cwcli.logs.read.reader import Log
from cwcli.report import build, overview
from cwcli.report.build import build_report
from tests.cli.browser import Elements, visit

N_LOGS = 300


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run of 300 logs: two failed for one reason, one for another; one is doubtful, two have warnings."""
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
    entries[200]["tables"], entries[250]["tables"] = {"events": 3}, {"events": 5}
    entries[1]["digest"]["happened"] = ["At 4.7 s " + "word " * 40]
    (tmp_path / "manifest.json").write_text(json.dumps({"format": 2, "cwcli": "0.1.0", "logs": entries}))
    return tmp_path


def test_the_worst_logs_come_first_and_failures_are_grouped(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build, "MAX_LONG_PAGE_BYTES", 0)  # no log gets figures, so none has to be read
    monkeypatch.setattr(Log, "open", lambda *arguments, **options: pytest.fail("a log was opened"))
    report = build_report(str(run))
    page = report.html.decode()
    names = re.findall(r'<td class="name">(drive_\d+)</td>', page)
    assert (len(names), report.n_failed) == (N_LOGS, 3)
    assert names[:6] == ["drive_0007", "drive_0008", "drive_0009", "drive_0100", "drive_0250", "drive_0200"]
    assert "2 logs failed: no position (drive_0007, drive_0008)." in page
    assert "1 log failed: a damaged chunk (drive_0009)." in page
    assert f"<td>At 4.7 s {'word ' * 14}word...</td>" in page  # 86 characters; another word makes 91, of 90
    assert "1 doubt" in page and "The speed is in km/h &lt;b&gt;." in page


@pytest.mark.parametrize(("n_failed", "is_said"), [(3, False), (4, True)])
def test_one_reason_is_said_where_more_logs_failed_than_are_named(
    run: Path, monkeypatch: pytest.MonkeyPatch, n_failed: int, is_said: bool
) -> None:
    monkeypatch.setattr(build, "MAX_LONG_PAGE_BYTES", 0)
    manifest = json.loads((run / "manifest.json").read_text())
    for k in range(7, 7 + max(n_failed, 3)):
        manifest["logs"][k] |= {"status": "failed", "error": {"what": "no position"}}
    (run / "manifest.json").write_text(json.dumps(manifest))
    sentence = f"{n_failed} logs failed: no position (drive_0007, drive_0008, drive_0009, ...)."
    assert (sentence in build_report(str(run)).html.decode()) == is_said


def test_a_row_of_many_is_small(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build, "MAX_LONG_PAGE_BYTES", 0)
    table = build_report(str(run)).html.decode().partition('class="wide logs"')[2].partition("</table>")[0]
    assert len(table.encode()) < build.OVERVIEW_ROW_BYTES_OF_LONG_PAGE * N_LOGS


SHOWN = """
<script>
(async () => {
  while (document.documentElement.dataset.plots !== "drawn") { await new Promise((done) => setTimeout(done, 50)); }
  const table = document.querySelector("table.logs");
  const shown = () => [...table.rows].slice(1).filter((row) => row.getBoundingClientRect().height > 0).length;
  const told = [], tell = () => told.push(`${shown()} ${document.querySelector(".filters output").textContent}`);
  const find = (words) => {
    document.querySelector("input.find").value = words;
    document.querySelector("input.find").dispatchEvent(new Event("input", { bubbles: true }));
    tell();
  };
  tell();
  find("drive_0299");
  find("drive_02");
  find("");
  document.querySelector(".filters button").click();
  tell();
  document.body.dataset.told = told.join(";");
})();
</script>
"""


def test_the_browser_lays_out_the_first_rows_and_others_when_they_are_found_or_asked_for(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(build, "MAX_LONG_PAGE_BYTES", 0)
    monkeypatch.setattr(overview, "MAX_ROWS_SHOWN_AT_ONCE", 20)
    page = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", build_report(str(run)).html.decode())
    (tmp_path / "page.html").write_text(page.replace("</body>", f"{SHOWN}</body>"), encoding="utf-8")
    (body,) = Elements(visit(tmp_path / "page.html", tmp_path).dom).of("body")
    first = "20 the first 20 of 300 logs"
    assert body["data-told"].split(";") == [
        first, "1 1 of 300 logs", "20 the first 20 of 100 logs", first, "300 "
    ]  # fmt: skip
