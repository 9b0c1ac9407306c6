"""Prints the digest of a run: at most twelve lines; the tables and notes are behind `--details`."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from cwcli.cli.console import Console
from cwcli.cli.invocation import repeat_command_with
from cwcli.cli.text import DEFAULT_OUTPUT_WIDTH_COLUMNS, format_byte_size, format_count, terminal_width

if TYPE_CHECKING:
    from cwcli.digest.digest import Digest
    from cwcli.pipeline.execute import RunOutcome

MAX_SUGGESTED_COMMAND_CHARACTERS = 73
"""Longest command that is suggested, in characters; a line without its label. Chosen by hand; not fitted."""
MAX_NAMED_WRITTEN_FILES = 3
"""Greatest number of written files that are named; chosen by hand."""
MAX_LOG_NAME_WIDTH_CELLS = 40
"""Widest name of a log in the first line, in cells; chosen: the names of the stages go beside it."""
MAX_NAMES_TRIED_FOR_SUGGESTED_FILE = 100
"""Greatest number of names that are tried for a suggested file; chosen by hand."""
SUGGESTED_STAGE_AFTER_STAGE = {"estimate": "predict", "predict": "warn", "lanes": "observe", "observe": "predict-lane"}
"""Stage -> the stage that is suggested after it."""


def print_digest(
    console: Console,
    command: str,
    digest: Digest,
    run: RunOutcome,
    next_step: str,
    *,
    with_details: bool,
    n_lines_behind: int,
) -> None:
    """Print the digest of a command.

    Args:
        next_step: A command line, "" for none.
        with_details: The tables and notes follow.
        n_lines_behind: Number of lines that follow and count as its own.
    """
    from cwcli.digest.lines import MAX_DIGEST_LINES, Block, format_blocks, trust_or_doubt_block

    n_notes = len(run.left_out) + sum(len(result.summary.notes) for result in run.results)
    notes = f" and {format_count(n_notes, 'note')}" if n_notes else ""
    blocks = (
        Block("what", digest.happened, 4),
        trust_or_doubt_block(digest.doubts, digest.confidence),
        Block("also", digest.more, 0),
        Block("wrote", (_written_files_sentence(run.written),), 2),
        Block("next", tuple(filter(None, (next_step, "" if with_details else f"(--details: tables{notes})")))),
    )
    console.print_heading(_digest_title(command, run))
    width, max_lines = terminal_width() or DEFAULT_OUTPUT_WIDTH_COLUMNS, MAX_DIGEST_LINES - 1 - n_lines_behind
    for line in format_blocks(blocks, width=width, max_lines=max_lines):
        console.print_summary(line)


def _digest_title(command: str, run: RunOutcome) -> str:
    """Format `run drive.mcap: estimate, predict`."""
    from cwcli.digest.lines import shorten_path

    title = f"{command} {shorten_path(run.name, MAX_LOG_NAME_WIDTH_CELLS)}"
    stages = [result.stage for result in run.results]
    return title if stages == [command] else f"{title}: {', '.join(stages)}"


def _written_files_sentence(written: Sequence[str]) -> str:
    """Name the written files with their sizes; of many, the first ones and how many more."""
    if not written:
        return "nothing (-o FILE writes the annotated log)"
    from cwcli.digest.lines import shorten_path

    names = [f"{shorten_path(path, 40)} ({format_byte_size(Path(path).stat().st_size)})" for path in written]
    if len(names) > MAX_NAMED_WRITTEN_FILES:
        names = [*names[: MAX_NAMED_WRITTEN_FILES - 1], f"{len(names) - MAX_NAMED_WRITTEN_FILES + 1} more files"]
    return ", ".join(names)


def suggest_next_step(command: str, output: str | None, *, following: str = "") -> str:
    """Suggest what to do next: the following stage, the report, or the same command with an output.

    Args:
        output: The annotated log that it wrote, None for none.
        following: The stage that can run on the annotated log, "" for none.
    """
    if output == "-":
        return ""
    if output is None:
        target = append_number_if_file_exists("annotated.mcap")
        repeated = repeat_command_with("-o", target)
        return repeated if _can_be_pasted(repeated) else f"the same command with -o {target} added"
    words = (following, "-o", f"{following}.mcap") if following else ("report", "-o", "report.html")
    name, option, target = words[0], words[1], append_number_if_file_exists(words[2])
    line = shlex.join(("cwcli", name, output, option, target))
    return line if _can_be_pasted(line) else f"cwcli {name} FILE {option} {target}, where FILE is the file above"


def append_number_if_file_exists(name: str) -> str:
    """Return the name, or `NAME-2`, `NAME-3` and so on, if a file of that name exists in the working folder."""
    path = Path(name)
    for k in range(2, MAX_NAMES_TRIED_FOR_SUGGESTED_FILE):
        if not path.exists():
            break
        path = Path(f"{Path(name).stem}-{k}{Path(name).suffix}")
    return str(path)


def _can_be_pasted(line: str) -> bool:
    """Tell whether a suggested command fits one line and holds no odd characters."""
    return 0 < len(line) <= MAX_SUGGESTED_COMMAND_CHARACTERS and line.isprintable()
