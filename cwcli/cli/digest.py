"""Prints the digest of a run: at most twelve lines; the tables and notes are behind `--details`."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from cwcli.cli.console import Console
from cwcli.cli.text import DEFAULT_WIDTH, format_byte_size, format_count, terminal_width

if TYPE_CHECKING:
    from cwcli.digest.digest import Digest
    from cwcli.pipeline.execute import RunOutcome

MAX_COMMAND_CHARACTERS = 73
"""Longest command that is suggested, in characters; a line without its label."""
MAX_NAMED_FILES = 3
"""Greatest number of written files that are named; chosen by hand."""
MAX_NAME_WIDTH = 40
"""Widest name of a log in the first line, in cells; chosen: the names of the stages go beside it."""
NEXT_STAGE = {"estimate": "predict", "predict": "warn", "lanes": "observe", "observe": "predict-lane"}
"""Stage -> the stage that is suggested after it."""


def print_digest(console: Console, command: str, digest: Digest, run: RunOutcome, next_step: str) -> None:
    """Print the digest of a command.

    Args:
        console: Where to.
        command: Its name.
        digest: What it came to.
        run: What ran and was written.
        next_step: A command line, "" for none.
    """
    from cwcli.digest.lines import MAX_LINES, Block, doubt_block, format_blocks

    n_notes = len(run.left_out) + len(run.faults) + sum(len(result.summary.notes) for result in run.results)
    notes = f" and {format_count(n_notes, 'note')}" if n_notes else ""
    blocks = (
        Block("what", digest.happened, 4),
        doubt_block(digest.doubts, digest.confidence),
        Block("made", (_written_files_sentence(run.written),), 2),
        Block("next", (*filter(None, (next_step,)), f"(--details: tables{notes})")),
    )
    console.print_heading(_title(command, run))
    for line in format_blocks(blocks, width=terminal_width() or DEFAULT_WIDTH, max_lines=MAX_LINES - 1):
        console.print_summary(line)


def _title(command: str, run: RunOutcome) -> str:
    """Format `run drive.mcap: estimate, predict`."""
    from cwcli.digest.lines import shorten_path

    title = f"{command} {shorten_path(run.name, MAX_NAME_WIDTH)}"
    stages = [result.stage for result in run.results]
    return title if stages == [command] else f"{title}: {', '.join(stages)}"


def _written_files_sentence(written: Sequence[str]) -> str:
    """Name the written files with their sizes; of many, the first ones and how many more."""
    if not written:
        return "nothing (-o FILE writes the annotated log)"
    from cwcli.digest.lines import shorten_path

    names = [f"{shorten_path(path, 40)} ({format_byte_size(Path(path).stat().st_size)})" for path in written]
    if len(names) > MAX_NAMED_FILES:
        names = [*names[: MAX_NAMED_FILES - 1], f"{len(names) - MAX_NAMED_FILES + 1} more files"]
    return ", ".join(names)


def suggest_next_step(command: str, log: str, output: str | None) -> str:
    """Suggest the next command: the next stage, the report, or the same command with an output."""
    if output == "-":
        return ""
    if output is None:
        return _command_line("cwcli", command, log, "-o", "annotated.mcap")
    following = NEXT_STAGE.get(command)
    if following is not None:
        return _command_line("cwcli", following, output, "-o", f"{following}.mcap")
    return _command_line("cwcli", "report", output, "-o", "report.html")


def _command_line(*words: str) -> str:
    """Join the words of a command so that it can be pasted; "" where it is too long or holds odd characters."""
    line = shlex.join(words)
    return line if len(line) <= MAX_COMMAND_CHARACTERS and line.isprintable() else ""
