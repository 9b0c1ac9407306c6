"""The text of `cwcli --help`, written without Typer; tests/cli/test_root_help.py compares it with Typer's own."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence

from cwcli.cli.commands import HELP_LINE_BY_COMMAND
from cwcli.errors import EXIT_CODES

ROOT_HELP_PARAGRAPH = "From a recorded drive to states, predicted paths and collision warnings, on MCAP logs."
"""The paragraph of `cwcli --help` below the usage line: what cwcli does."""
EXIT_CODES_TEXT = ", ".join(f"{code} {meaning}" for code, (meaning, _) in EXIT_CODES.items())
"""All exit codes with their meanings."""
ROOT_HELP_EPILOG = f"""
Exit codes: {EXIT_CODES_TEXT}.

\b
Example:
  cwcli run drive.mcap -o annotated.mcap --metrics-dir metrics/
"""
"""Text at the end, as Typer takes it; the paragraph behind `\\b` is not wrapped."""
NO_PLUGINS_HELP = "Leave out what installed packages of others add."
"""Help of the option that leaves out plug-ins."""
HELP_BY_ROOT_OPTION = {
    "--version": "Print the version.",
    "--no-plugins": NO_PLUGINS_HELP,
    "--install-completion": "Install completion for the current shell.",
    "--show-completion": "Show completion for the current shell, to copy it or customize the installation.",
    "-h, --help": "Show this message and exit.",
}
"""The options of the whole command line, most of them Typer's."""
MAX_HELP_WIDTH_COLUMNS = 78
"""Width of help in columns where the terminal is not narrower: Typer's 80 less a margin of 2."""


def format_root_help() -> str | None:
    """The help, with a line feed at its end; None where a narrow terminal needs Typer's own."""
    if _terminal_columns() < MAX_HELP_WIDTH_COLUMNS + 2:
        return None
    lines = ["Usage: cwcli [OPTIONS] COMMAND [ARGS]...", "", *_wrap_with_indent(ROOT_HELP_PARAGRAPH, "  "), ""]
    for heading, rows in {"Options": HELP_BY_ROOT_OPTION, "Commands": HELP_LINE_BY_COMMAND}.items():
        lines += [f"{heading}:", *_format_name_and_help_lines(rows), ""]
    wrapped, _, verbatim = ROOT_HELP_EPILOG.partition("\b\n")
    lines += [*_wrap_with_indent(wrapped.strip(), "  "), "", *(f"  {line}" for line in verbatim.rstrip().splitlines())]
    return "\n".join(lines) + "\n"


def _terminal_columns() -> int:
    """Columns of the terminal as `shutil.get_terminal_size` finds them."""
    try:
        return int(os.environ["COLUMNS"]) or MAX_HELP_WIDTH_COLUMNS + 2
    except (KeyError, ValueError):
        pass
    try:
        return os.get_terminal_size(1).columns or MAX_HELP_WIDTH_COLUMNS + 2
    except (OSError, ValueError):
        return MAX_HELP_WIDTH_COLUMNS + 2


def _format_name_and_help_lines(rows: Mapping[str, str]) -> Sequence[str]:
    first = max(map(len, rows)) + 4
    lines = []
    for name, text in rows.items():
        wrapped = _wrap_with_indent(text, " " * first)
        lines += [f"  {name}".ljust(first) + wrapped[0][first:], *wrapped[1:]]
    return lines


def _wrap_with_indent(text: str, indent: str) -> list[str]:
    """Wrap a text at its spaces."""
    lines = [""]
    for word in text.split():
        line = f"{lines[-1]} {word}".lstrip()
        if len(indent) + len(line) <= MAX_HELP_WIDTH_COLUMNS:
            lines[-1] = line
        else:
            lines.append(word)
    return [indent + line for line in lines]
