"""Where words go: stdout is data, stderr is talk.

No colour but bold headings, and those only on a terminal and when `NO_COLOR` is not set.
"""

from __future__ import annotations

import contextlib
import os
import stat
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TextIO

from cwcli import __version__
from cwcli.cli.text import paragraph, printable, shown
from cwcli.errors import CwcliError, names_hint

MAX_FOUND_WIDTH = 100  # paths and topics are long; a terminal wraps them
MAX_FOUND = 200
"""Entries behind `found:`."""
MAX_ENTRY = 300
"""Characters of one."""


@dataclass(frozen=True)
class Console:
    """Prints a command's words.

    Attributes:
        quiet: Only errors and what was asked for by name (`--json`, `-o -`) are printed.
        summary_to_stderr: stdout carries the log (`-o -`) or JSON, so tables are talk.
    """

    quiet: bool = False
    summary_to_stderr: bool = False

    def data(self, text: str) -> None:
        """A line of data, whatever the options say."""
        write(sys.stdout, text)

    def document(self, command: str, values: Mapping[str, Any]) -> None:
        """What `--json` prints, as `schemas/output.schema.json` says."""
        import json

        said = {"cwcli": __version__, "command": command, **values}
        self.data(json.dumps(said, indent=2, allow_nan=False))

    def summary(self, text: str) -> None:
        """A table or a line that tells the result."""
        if not self.quiet:
            write(sys.stderr if self.summary_to_stderr else sys.stdout, text)

    def heading(self, text: str) -> None:
        """A heading of the summary."""
        stream = sys.stderr if self.summary_to_stderr else sys.stdout
        self.summary(bold(printable(text), stream))

    def failure(self, text: str) -> None:
        """Why the exit code is not 0, where that is no error of cwcli or of the input; told even when quiet."""
        write(sys.stderr, paragraph(printable(text), rest="  "))

    def note(self, text: str) -> None:
        """Something the user should know, which is not the result."""
        if not self.quiet:
            write(sys.stderr, paragraph(shown(text), first="note: ", rest="      "))


def write(stream: TextIO | None, text: str) -> None:
    """Write a line. A stream that was closed when the process started swallows it."""
    if stream is not None:
        stream.write(text + "\n")


def stdout_or_file(target: str | None) -> str | None:
    """`-` for any name of standard output (`-`, `/dev/stdout`, `/dev/fd/1`), else the name as it is."""
    if target is None or target == "-":
        return target
    try:
        there, here = os.stat(target), os.fstat(1)  # noqa: PTH116 - compared with an open file
    except (OSError, ValueError):  # a zero byte in the name is told by whoever opens it
        return target
    is_same = not stat.S_ISREG(there.st_mode) and os.path.samestat(there, here)
    return "-" if is_same else target


def is_terminal(stream: TextIO | None) -> bool:
    """Whether somebody reads it as it comes."""
    return stream is not None and stream.isatty()


def uses_style(stream: TextIO | None) -> bool:
    """Whether escape sequences may be written: a terminal that is not dumb, and no `NO_COLOR`."""
    return is_terminal(stream) and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


def bold(text: str, stream: TextIO | None) -> str:
    """`text`, bold where the stream can show it."""
    return f"\x1b[1m{text}\x1b[0m" if uses_style(stream) else text


def format_error(error: CwcliError) -> str:
    """The error as `error:`, `found:` and `hint:` lines.

    ```
    error: drive.mcap: no channel holds the ego state (needed by `cwcli predict`)
      found: /gps/fix (sensor_msgs/msg/NavSatFix), /camera/front (foxglove.CompressedImage)
      hint:  run `cwcli estimate drive.mcap -o estimated.mcap` first
    ```
    """
    where = f"{shown(error.where)}: " if error.where else ""
    lines = [f"error: {where}{shown(error.what)}"]
    if error.found:
        more = len(error.found) - MAX_FOUND
        entries = [shown(entry, MAX_ENTRY) for entry in error.found[:MAX_FOUND]]
        lines.extend(_found_lines([*entries, f"and {more:,} more"] if more > 0 else entries))
    if error.hint:
        lines.append(f"  hint:  {shown(error.hint)}")
    return "\n".join(lines)


def _found_lines(entries: list[str]) -> list[str]:
    """The entries behind `found:`, as many on a line as fit."""
    lines = ["  found: " + entries[0]]
    for entry in entries[1:]:
        if len(lines[-1]) + len(entry) + 3 <= MAX_FOUND_WIDTH:
            lines[-1] += f", {entry}"
        else:
            lines[-1] += ","
            lines.append(" " * 9 + entry)
    return lines


def report_error(error: CwcliError) -> None:
    """Print a known error on stderr. A closed stderr is no reason to fail again."""
    with contextlib.suppress(OSError):
        write(sys.stderr, format_error(error))


def closest(name: str, known: list[str]) -> str:
    """A hint for a misspelt name: the closest known ones, else all of them."""
    return names_hint(name, known, "known")
