"""Formats tables that fit the terminal, or 80 columns in a pipe, where topics are never broken."""

from __future__ import annotations

import re
from collections.abc import Sequence

from cwcli.cli.text import (
    DEFAULT_OUTPUT_WIDTH_COLUMNS,
    escape_control_characters,
    format_number,
    pad_to_width,
    shorten_and_escape,
    terminal_cells_of_text,
    terminal_width,
    wrap_text,
)

Cell = str | float | int | None

COLUMN_GAP = "  "
"""Space between two columns."""
MIN_TEXT_COLUMN_WIDTH_CELLS = 12
"""Least width of a column of text before the table is split, in cells; chosen by hand."""

MAX_CELL_CHARS = 300
"""Longest text of a cell, in characters; chosen by hand."""
_NUMBER_PATTERN = re.compile(r"[+-]?[\d.]+(e[+-]?\d+)?( ?%)?|-")
"""Pattern of cells that are right-aligned: numbers, percentages and the dash of a missing value."""


def format_table(columns: Sequence[str], rows: Sequence[Sequence[Cell]], *, width: int | None = None) -> str:
    """Format a table: headings, a rule and one line a row, each at most as wide as `width` or the terminal.

    Numbers are right-aligned. A table that is too wide first wraps its headings, then its text cells between words, and
    only then within a word, as a name is one; if that is not enough, it is cut into several tables, which repeat the
    leading columns that tell the rows apart. In a pipe, where `grep` reads, a topic is never broken, even if its line
    becomes too long.
    """
    keeps_topics = width is None and terminal_width() is None
    width = width or terminal_width() or DEFAULT_OUTPUT_WIDTH_COLUMNS
    heads = [escape_control_characters(column) for column in columns]
    cells = [[_cell_text(value) for value in row] for row in rows]
    right = [bool(cells) and all(_NUMBER_PATTERN.fullmatch(row[i]) for row in cells) for i in range(len(heads))]
    least = [keeps_topics * max((_topic_width_or_zero(row[i]) for row in cells), default=0) for i in range(len(heads))]
    narrowest = [
        max(least[i], _narrowest_column_width(head, [row[i] for row in cells], right[i]))
        for i, head in enumerate(heads)
    ]
    n_repeated = _count_identifying_columns(cells, right, narrowest, width)
    blocks = [
        _format_block(heads, cells, right, part, narrowest, least, width)
        for part in _split_columns_into_blocks(narrowest, n_repeated, width)
    ]
    return "\n\n".join(blocks)


def _cell_text(value: Cell) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return format_number(value)
    return shorten_and_escape(str(value), MAX_CELL_CHARS)


def _topic_width_or_zero(cell: str) -> int:
    return terminal_cells_of_text(cell) if cell.startswith("/") and " " not in cell else 0


def _narrowest_column_width(head: str, column: Sequence[str], right: bool) -> int:
    """The least width of a column, in cells of the terminal."""
    widest_cell = max((terminal_cells_of_text(cell) for cell in column), default=0)
    longest_word = max((terminal_cells_of_text(word) for word in head.split()), default=0)
    return max(longest_word, widest_cell if right else min(widest_cell, MIN_TEXT_COLUMN_WIDTH_CELLS))


def _natural_column_width(head: str, column: Sequence[str]) -> int:
    return max(terminal_cells_of_text(head), max((terminal_cells_of_text(cell) for cell in column), default=0))


def _count_identifying_columns(
    cells: Sequence[Sequence[str]], right: Sequence[bool], narrowest: Sequence[int], width: int
) -> int:
    """Return how many leading columns tell the rows apart, at least 1, as far as they take at most half of `width`.

    Where no number of columns tells all rows apart, it is the number of the leading columns of text.
    """
    used, n_fitting = -len(COLUMN_GAP), 0
    for needed in narrowest:
        used += len(COLUMN_GAP) + needed
        if used > width // 2:
            break
        n_fitting += 1
        if len({tuple(row[:n_fitting]) for row in cells}) == len(cells):
            return n_fitting
    n_text = next((i for i, is_right in enumerate(right) if is_right), len(right))
    return max(min(n_text, n_fitting), 1)


def _split_columns_into_blocks(narrowest: Sequence[int], n_repeated: int, width: int) -> list[list[int]]:
    """Split columns into blocks that fit `width` at their least widths; each begins with the first `n_repeated`."""
    parts: list[list[int]] = []
    part: list[int] = []
    used = 0
    for i, needed in enumerate(narrowest):
        if len(part) > n_repeated and used + len(COLUMN_GAP) + needed > width:
            parts.append(part)
            part = list(range(n_repeated))
            used = sum(narrowest[:n_repeated]) + len(COLUMN_GAP) * (n_repeated - 1)
        used += needed + (len(COLUMN_GAP) if part else 0)
        part.append(i)
    parts.append(part)
    return parts


def _format_block(
    heads: Sequence[str],
    cells: Sequence[Sequence[str]],
    right: Sequence[bool],
    part: Sequence[int],
    narrowest: Sequence[int],
    least: Sequence[int],
    width: int,
) -> str:
    widths = _fit_column_widths(
        [_natural_column_width(heads[i], [row[i] for row in cells]) for i in part],
        [
            [_longest_word_width([heads[i]], _natural_column_width("", [row[i] for row in cells])) for i in part],
            [_longest_word_width([heads[i], *(row[i] for row in cells)], narrowest[i]) for i in part],
            [_longest_word_width([heads[i], *(row[i] for row in cells)], 0) for i in part],
            [narrowest[i] for i in part],
            [max(least[i], 1) for i in part],  # a word wider than the terminal is cut
        ],
        width - len(COLUMN_GAP) * (len(part) - 1),
    )
    lines = _format_row_lines([heads[i] for i in part], widths, [right[i] for i in part], bottom=True)
    lines.append(COLUMN_GAP.join("-" * column_width for column_width in widths))
    for row in cells:
        lines.extend(_format_row_lines([row[i] for i in part], widths, [right[i] for i in part]))
    return "\n".join(lines)


def _longest_word_width(texts: Sequence[str], at_least: int) -> int:
    return max(at_least, *(terminal_cells_of_text(word) for text in texts for word in text.split()), 0)


def _fit_column_widths(natural: list[int], limits: Sequence[list[int]], available: int) -> list[int]:
    """Shrink the widest columns until the sum of widths fits: all down to the first limits, then to the next ones."""
    widths = list(natural)
    for limit in limits:
        while sum(widths) > available:
            wide = [i for i, own in enumerate(limit) if widths[i] > own]
            if not wide:
                break
            widths[max(wide, key=lambda i: widths[i])] -= 1
    return widths


def _format_row_lines(
    cells: Sequence[str], widths: Sequence[int], right: Sequence[bool], *, bottom: bool = False
) -> list[str]:
    wrapped = [wrap_text(cell, width) for cell, width in zip(cells, widths, strict=True)]
    height = max(len(lines) for lines in wrapped)
    for lines in wrapped:
        missing = [""] * (height - len(lines))
        lines[:] = missing + lines if bottom else lines + missing
    return [
        COLUMN_GAP.join(
            pad_to_width(lines[i], width, right=is_right)
            for lines, width, is_right in zip(wrapped, widths, right, strict=True)
        ).rstrip()
        for i in range(height)
    ]
