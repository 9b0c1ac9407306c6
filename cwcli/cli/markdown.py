"""Writes GitHub-flavoured Markdown in which foreign text can't become markup, links, mentions or table cells."""

from __future__ import annotations

import re
from collections.abc import Sequence

from cwcli.cli.text import number, printable

Cell = str | float | int | None

_STRUCTURAL = re.compile(r"[`|\\]")
"""Characters that can end a code span or a table cell."""


def code(text: str) -> str:
    """Format text as code, so that nothing in it is interpreted."""
    shown = printable(text)
    if shown and shown == shown.strip() and not _STRUCTURAL.search(shown):
        return f"`{shown}`"
    inner = "".join(char if char.isalnum() or char in " ,%" else f"&#{ord(char)};" for char in shown)
    return f"<code>{inner}</code>"


def table(columns: Sequence[str], rows: Sequence[Sequence[Cell]]) -> str:
    """Format a table. Text cells must be safe Markdown already; columns of numbers are right-aligned."""
    is_number = [all(not isinstance(row[k], str) for row in rows) and bool(rows) for k in range(len(columns))]
    lines = [_row(columns), _row(["---:" if right else "---" for right in is_number])]
    lines += [_row([_cell(cell) for cell in row]) for row in rows]
    return "\n".join(lines)


def _cell(cell: Cell) -> str:
    if cell is None:
        return ""
    return number(cell) if isinstance(cell, float) else str(cell)


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def filled(text: str, mark: str, block: str) -> str:
    """Replace the block of a page between `<!-- mark -->` and `<!-- end -->`."""
    begin = text.index(f"<!-- {mark} -->\n") + len(f"<!-- {mark} -->\n")
    return f"{text[:begin]}{block}\n{text[text.index('<!-- end -->', begin) :]}"
