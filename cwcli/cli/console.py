"""Prints to the terminal: data and summaries on stdout, notes and errors on stderr.

No colour but bold headings, and those only on a terminal and when `NO_COLOR` is not set.
"""

from __future__ import annotations

import contextlib
import os
import stat
import sys
from collections.abc import Mapping, Sequence
from typing import Any, TextIO

from cwcli.cli.text import escape_control_characters, shorten_and_escape, terminal_width, wrap_paragraph
from cwcli.errors import CwcliError, hint_at_closest_or_all_known_names
from cwcli.lazy_dataclass import dataclass
from cwcli.version import __version__

ERROR_FOUND_ITEMS_LINE_WIDTH_CHARS = 100
"""Width of the lines behind `found:`, in characters; chosen wide, because paths and topics are long."""
MAX_FOUND_ITEMS_LISTED_IN_ERROR = 200
"""Largest number of entries behind `found:`; chosen by hand."""
MAX_FOUND_ITEM_OF_ERROR_CHARS = 300
"""Longest entry behind `found:`, in characters; chosen by hand."""


@dataclass(frozen=True)
class Console:
    """Prints the output of a command.

    Attributes:
        quiet: Print only errors and requested output (`--json`, `-o -`).
        summary_to_stderr: Print summaries on stderr, because stdout carries the log (`-o -`).
    """

    quiet: bool = False
    summary_to_stderr: bool = False

    def print_data(self, text: str) -> None:
        """Print a line of data on stdout, also when quiet."""
        write_line(sys.stdout, text)

    def print_document(self, command: str, values: Mapping[str, Any]) -> None:
        """Print the content of `--json`, as `schemas/output.schema.json` describes it."""
        import json

        said = {"cwcli": __version__, "command": command, **values}
        self.print_data(json.dumps(said, indent=2, allow_nan=False))

    def print_summary(self, text: str) -> None:
        """Print a table or a line of the result, unless quiet."""
        if not self.quiet:
            write_line(sys.stderr if self.summary_to_stderr else sys.stdout, text)

    def print_heading(self, text: str) -> None:
        """Print a heading of the summary, in bold on a terminal."""
        stream = sys.stderr if self.summary_to_stderr else sys.stdout
        self.print_summary(format_bold(escape_control_characters(text), stream))

    def print_failure(self, text: str) -> None:
        """Print on stderr why the exit code is not 0 without an error, such as a failed gate; also when quiet."""
        write_line(sys.stderr, wrap_paragraph(escape_control_characters(text), rest="  "))

    def print_annotations(self, commands: Sequence[str]) -> None:
        """Print commands for the CI on stderr, each on a line of its own; also when quiet. They are escaped already."""
        for command in commands:
            write_line(sys.stderr, command)

    def print_note(self, text: str) -> None:
        """Print a note on stderr, unless quiet."""
        if not self.quiet:
            write_line(sys.stderr, wrap_paragraph(shorten_and_escape(text), first="note: ", rest="      "))


def write_line(stream: TextIO | None, text: str) -> None:
    """Write a line; nothing happens if the stream was closed when the process started."""
    if stream is not None:
        stream.write(text + "\n")


def replace_stdout_path_by_dash(target: str | None) -> str | None:
    """Replace any name of standard output (`/dev/stdout`, `/dev/fd/1`) by `-`; other names are returned unchanged."""
    if target is None or target == "-":
        return target
    try:
        target_status, stdout_status = os.stat(target), os.fstat(1)  # noqa: PTH116 - compared with an open file
    except (OSError, ValueError):  # opening the file reports a zero byte in its name
        return target
    is_same = not stat.S_ISREG(target_status.st_mode) and os.path.samestat(target_status, stdout_status)
    return "-" if is_same else target


def is_terminal(stream: TextIO | None) -> bool:
    """Whether a stream is a terminal."""
    return stream is not None and stream.isatty()


def supports_style(stream: TextIO | None) -> bool:
    """Whether escape sequences may be written: a terminal that is not dumb, and no `NO_COLOR`."""
    return is_terminal(stream) and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


def format_bold(text: str, stream: TextIO | None) -> str:
    """Format text in bold if the stream can show it."""
    return f"\x1b[1m{text}\x1b[0m" if supports_style(stream) else text


def format_error(error: CwcliError, width: int | None = None) -> str:
    """Format an error as `error:`, `found:` and `hint:` lines.

    A width wraps them; without one, each stays a line that can be searched for.

    ```
    error: drive.mcap: no channel holds the ego state (needed by `cwcli predict`)
      found: /gps/fix (sensor_msgs/msg/NavSatFix), /camera/front (foxglove.CompressedImage)
      hint:  run `cwcli estimate drive.mcap -o estimated.mcap` first
    ```
    """
    where = f"{shorten_and_escape(error.where)}: " if error.where else ""
    lines = [f"error: {where}{shorten_and_escape(error.what)}"]
    if error.found:
        more = len(error.found) - MAX_FOUND_ITEMS_LISTED_IN_ERROR
        entries = [
            shorten_and_escape(entry, MAX_FOUND_ITEM_OF_ERROR_CHARS)
            for entry in error.found[:MAX_FOUND_ITEMS_LISTED_IN_ERROR]
        ]
        lines.extend(_format_found_lines([*entries, f"and {more:,} more"] if more > 0 else entries))
    if error.hint:
        lines.append(f"  hint:  {shorten_and_escape(error.hint)}")
    if width is not None:
        lines = [wrap_paragraph(line, rest=" " * 9, width=width) for line in lines]
    return "\n".join(lines)


def _format_found_lines(entries: list[str]) -> list[str]:
    """Format the entries behind `found:`, as many on a line as fit."""
    lines = ["  found: " + entries[0]]
    for entry in entries[1:]:
        if len(lines[-1]) + len(entry) + 3 <= ERROR_FOUND_ITEMS_LINE_WIDTH_CHARS:
            lines[-1] += f", {entry}"
        else:
            lines[-1] += ","
            lines.append(" " * 9 + entry)
    return lines


def print_error(error: CwcliError) -> None:
    """Print a known error on stderr; errors of a closed stderr are ignored."""
    with contextlib.suppress(OSError):
        write_line(sys.stderr, format_error(error, terminal_width(sys.stderr)))


def closest_names_hint(name: str, known: list[str]) -> str:
    """Make a hint for a misspelt name: the closest known names, else all of them."""
    return hint_at_closest_or_all_known_names(name, known, "known")
