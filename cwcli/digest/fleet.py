"""The digest of a run over many logs: the worst log first, and a last line on all of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from cwcli.digest.digest import Digest
from cwcli.digest.lines import CUT_SENTENCE_MARK, MAX_DIGEST_LINES, MAX_LINE_WIDTH_CELLS
from cwcli.lazy_dataclass import dataclass
from cwcli.text import format_count, shorten_and_escape, terminal_cells_of_text

MAX_LOG_NAME_WIDTH_CELLS = 28
"""Widest name of a log in its line, in cells; chosen: most of the line is left for what happened."""
MAX_LOG_TEXT_CHARACTERS = 200
"""Longest text of a log that is laid out, in characters; chosen: more than a line."""
N_LINES_BESIDE_LOGS = 4
"""Lines beside those of the logs: the heading, how many more logs there are, all of them, and what to do next."""
TEXT_START_COLUMN_CELLS = 6
"""Column at which the last two lines begin behind their labels, in cells: `next` and two spaces."""
DIGEST_ENTRY_KEY = "digest"
"""Key of a log's entry in the manifest that holds its digest."""


def digest_to_entry(digest: Digest) -> dict[str, Any]:
    """Convert a digest to its form in the manifest."""
    return {"happened": list(digest.happened), "doubts": [asdict(doubt) for doubt in digest.doubts]}


@dataclass(frozen=True)
class LogLine:
    """One log of the run.

    Attributes:
        status: `done`, `unchanged` or `failed`.
        error: Why it failed, "" otherwise.
        happened: What happened, "" where an earlier version did the log.
        doubts: The sentences of the doubts, the worst first.
    """

    id: str
    status: str
    error: str
    happened: str
    doubts: tuple[str, ...]
    n_warnings: int

    @classmethod
    def from_entry(cls, entry: Mapping[str, Any], status: str) -> LogLine:
        """Read the entry of a log; what does not fit in its digest is ignored, for others may have written it."""
        found = entry.get(DIGEST_ENTRY_KEY)
        digest = found if isinstance(found, dict) else {}
        happened, doubts = (each if isinstance(each, list) else [] for each in map(digest.get, ("happened", "doubts")))
        sentences = [doubt.get("sentence") for doubt in doubts if isinstance(doubt, dict)]
        error = entry["error"] if isinstance(entry["error"], dict) else {}
        n_events = entry["tables"].get("events", 0) if isinstance(entry["tables"], dict) else 0
        return cls(
            id=str(entry["id"]),
            status=status,
            error=str(error.get("what", "")),
            happened=next((text for text in happened if isinstance(text, str)), ""),
            doubts=tuple(text for text in sentences if isinstance(text, str)),
            n_warnings=n_events if isinstance(n_events, int) else 0,
        )

    @property
    def sort_key(self) -> tuple[bool, int, int, str]:
        """Sorts the failed logs first, then those of most doubts, then those of most warnings."""
        return not self.error, -len(self.doubts), -self.n_warnings, self.id

    @property
    def text(self) -> str:
        """What is said of the log."""
        if self.error:
            return f"failed: {self.error}"
        return f"doubt: {self.doubts[0]}" if self.doubts else self.happened or self.status


def format_fleet_lines(logs: Sequence[LogLine], *, next_step: str, width: int = MAX_LINE_WIDTH_CELLS) -> list[str]:
    """Format at most eleven lines, which go below a heading.

    Args:
        logs: In any order.
        next_step: A command line.
        width: Width of the terminal in cells.
    """
    width = min(width, MAX_LINE_WIDTH_CELLS)
    ordered = sorted(logs, key=lambda log: log.sort_key)
    n_shown = MAX_DIGEST_LINES - N_LINES_BESIDE_LOGS
    shown = ordered if len(ordered) <= n_shown + 1 else ordered[:n_shown]
    names = [_cut_to_cell_width(log.id, MAX_LOG_NAME_WIDTH_CELLS) for log in shown]
    column = max(map(terminal_cells_of_text, (*names, "next")), default=0) + 2
    rows = [(name, log.text, column) for name, log in zip(names, shown, strict=True)]
    if len(shown) < len(ordered):
        rows.append(("", f"and {format_count(len(ordered) - len(shown), 'more log')}", column))
    # long names of logs leave too little room for these two
    rows += [
        ("all", _fleet_totals_sentence(logs), TEXT_START_COLUMN_CELLS),
        ("next", next_step, TEXT_START_COLUMN_CELLS),
    ]
    return [
        f"{name}{' ' * (at - terminal_cells_of_text(name))}{_cut_to_cell_width(text, width - at)}"
        for name, text, at in rows
    ]


def _fleet_totals_sentence(logs: Sequence[LogLine]) -> str:
    """Count the logs by status, their warnings, and those that are doubtful."""
    statuses = [log.status for log in logs]
    facts = [f"{statuses.count(name)} {name}" for name in ("done", "unchanged", "failed") if name in statuses]
    n_doubtful = sum(bool(log.doubts) for log in logs)
    facts.append(format_count(sum(log.n_warnings for log in logs), "warning"))
    facts.append(f"{format_count(n_doubtful, 'log')} to doubt")
    return ", ".join(facts)


def _cut_to_cell_width(text: str, width: int) -> str:
    shown = shorten_and_escape(text, MAX_LOG_TEXT_CHARACTERS)
    if terminal_cells_of_text(shown) <= width:
        return shown
    while terminal_cells_of_text(shown) > max(width - len(CUT_SENTENCE_MARK), 0) and shown:
        shown = shown[:-1]
    return f"{shown.rstrip()}{CUT_SENTENCE_MARK}"
