"""Writes GitHub-flavoured Markdown in which foreign text can't become markup, links, mentions or table cells."""

from __future__ import annotations

import re
from collections.abc import Sequence

from cwcli.cli.text import escape_control_characters, format_number

Cell = str | float | int | None

_STRUCTURAL_CHARACTERS = re.compile(r"[`|\\]")
"""Characters that can end a code span or a table cell."""


def format_code(text: str) -> str:
    """Format text as code, so that nothing in it is interpreted."""
    shown = escape_control_characters(text)
    if shown and shown == shown.strip() and not _STRUCTURAL_CHARACTERS.search(shown):
        return f"`{shown}`"
    inner = "".join(char if char.isalnum() or char in " ,%" else f"&#{ord(char)};" for char in shown)
    return f"<code>{inner}</code>"


def format_markdown_table(columns: Sequence[str], rows: Sequence[Sequence[Cell]]) -> str:
    """Format a table. Text cells must be safe Markdown already; columns of numbers are right-aligned."""
    is_number = [all(not isinstance(row[k], str) for row in rows) and bool(rows) for k in range(len(columns))]
    lines = [_markdown_row_line(columns), _markdown_row_line(["---:" if right else "---" for right in is_number])]
    lines += [_markdown_row_line([_cell_text(cell) for cell in row]) for row in rows]
    return "\n".join(lines)


def _cell_text(cell: Cell) -> str:
    if cell is None:
        return ""
    return format_number(cell) if isinstance(cell, float) else str(cell)


def _markdown_row_line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def replace_marked_block(text: str, mark: str, block: str) -> str:
    """Replace the block of a page between `<!-- mark -->` and `<!-- end -->`."""
    begin = text.index(f"<!-- {mark} -->\n") + len(f"<!-- {mark} -->\n")
    return f"{text[:begin]}{block}\n{text[text.index('<!-- end -->', begin) :]}"
