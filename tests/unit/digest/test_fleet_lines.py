"""The digest of many logs: the worst first, the last line on all, twelve lines with the heading."""

from __future__ import annotations

from typing import Any

import pytest

from cwcli.digest.digest import Digest
from cwcli.digest.fleet import LogLine, digest_to_entry, format_fleet_lines
from cwcli.evaluation.doubts.base import Doubt
from cwcli.text import terminal_cells_of_text

NEXT = "cwcli report out -o report.html"


def line(id: str, *doubts: str, status: str = "done", error: str = "", n_warnings: int = 0) -> LogLine:
    return LogLine(id, status, error, f"What happened in {id}.", doubts, n_warnings)


def test_failed_then_doubtful_then_warned_logs_come_first() -> None:
    logs = [
        line("a"),
        line("b", n_warnings=2),
        line("c", "It jumps."),
        line("d", "It jumps.", "It lies."),
        line("e", status="failed", error="no log"),
    ]
    assert format_fleet_lines(logs, next_step=NEXT) == [
        "e     failed: no log",
        "d     doubt: It jumps.",
        "c     doubt: It jumps.",
        "b     What happened in b.",
        "a     What happened in a.",
        "all   4 done, 1 failed, 2 warnings, 2 logs to doubt",
        "next  cwcli report out -o report.html",
    ]


@pytest.mark.parametrize("n_logs", [1, 8, 9, 10, 1000])
def test_many_logs_are_counted(n_logs: int) -> None:
    lines = format_fleet_lines([line(f"log-{k:04d}") for k in range(n_logs)], next_step=NEXT)
    assert len(lines) <= 11
    shown = sum(text.startswith("log-") for text in lines)
    more = [text for text in lines if "more log" in text]
    assert more == ([] if shown == n_logs else [f"{'':10}and {n_logs - shown} more logs"])
    assert lines[-2].startswith("all")
    assert f"{n_logs} done" in lines[-2]


def test_long_names_of_logs_leave_the_last_lines_whole() -> None:
    counts = [line("x" * 28, "It jumps.", status=status) for status in ("done", "unchanged", "failed")]
    step = "cwcli report a-folder-with-a-rather-long-name/out -o report.html"
    *_, on_all, following = format_fleet_lines(counts, next_step=step)
    assert on_all == "all   1 done, 1 unchanged, 1 failed, 0 warnings, 3 logs to doubt"
    assert following == f"next  {step}"


@pytest.mark.parametrize("text", ["x" * 999, "日本" * 200, "\x1b[2J"])
def test_names_and_texts_of_others_fit_the_line(text: str) -> None:
    for shown in format_fleet_lines([line(text, text)], next_step=NEXT):
        assert terminal_cells_of_text(shown) <= 80
        assert shown.isprintable()


def test_entry_keeps_the_digest() -> None:
    doubt = Doubt("late", "It is late.", "Check.", 2.0, 1.0, "s")
    entry: dict[str, Any] = {"id": "a", "error": None, "tables": {"events": 3}}
    entry["digest"] = digest_to_entry(Digest(("It rained.",), ("More.",), (doubt,), ()))
    assert LogLine.from_entry(entry, "unchanged") == LogLine("a", "unchanged", "", "It rained.", ("It is late.",), 3)


@pytest.mark.parametrize(
    "digest", [None, 3, [], {}, {"happened": 3, "doubts": {}}, {"happened": [3], "doubts": [3, {}]}]
)
def test_entry_of_anybody_is_read(digest: Any) -> None:
    entry = {"id": "a", "error": None, "tables": {}, "digest": digest}
    assert LogLine.from_entry(entry, "done") == LogLine("a", "done", "", "", (), 0)
    assert LogLine.from_entry(entry, "done").text == "done"
