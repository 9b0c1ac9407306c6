"""Wraps and pads text for a terminal; re-exports `cwcli.text`."""

from __future__ import annotations

import os
import sys
from typing import TextIO

from cwcli.text import (
    escape_control_characters,
    finite_or_none,
    format_byte_size,
    format_count,
    format_duration,
    format_interval,
    format_number,
    join_names,
    shorten_and_escape,
    terminal_cells_of_text,
    wrap_text,
)

__all__ = [
    "DEFAULT_OUTPUT_WIDTH_COLUMNS",
    "escape_control_characters",
    "finite_or_none",
    "format_byte_size",
    "format_count",
    "format_duration",
    "format_interval",
    "format_number",
    "join_names",
    "pad_to_width",
    "shorten_and_escape",
    "terminal_cells_of_text",
    "terminal_width",
    "wrap_paragraph",
    "wrap_text",
]

DEFAULT_OUTPUT_WIDTH_COLUMNS = 80
"""Width of the output in columns when it is no terminal."""
MIN_OUTPUT_WIDTH_COLUMNS = 20
"""Least width in columns that is used; chosen by hand."""


def terminal_width(stream: TextIO | None = None) -> int | None:
    """Width of the terminal on a stream (None: standard output) in columns, at least 20; None for a file or a pipe."""
    stream = sys.stdout if stream is None else stream
    if stream is None or not stream.isatty():
        return None
    try:
        columns = os.get_terminal_size(stream.fileno()).columns
    except (OSError, ValueError):
        return DEFAULT_OUTPUT_WIDTH_COLUMNS
    return max(columns or DEFAULT_OUTPUT_WIDTH_COLUMNS, MIN_OUTPUT_WIDTH_COLUMNS)  # some terminals report 0


def wrap_paragraph(text: str, *, first: str = "", rest: str = "", width: int | None = None) -> str:
    """Wrap a text to `width` or the terminal, with `first` before its first line and `rest` before the others."""
    width = width or terminal_width() or DEFAULT_OUTPUT_WIDTH_COLUMNS
    lines = wrap_text(text, width - max(len(first), len(rest)))
    return "\n".join((first if i == 0 else rest) + line for i, line in enumerate(lines))


def pad_to_width(text: str, width: int, *, right: bool) -> str:
    """Pad a text with spaces to `width` cells, on the left if `right`-aligned."""
    fill = " " * (width - terminal_cells_of_text(text))
    return fill + text if right else text + fill
