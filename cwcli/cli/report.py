"""Prints a stage's summary: its tables, the counts of its input messages, and its notes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from cwcli.cli.console import Console
from cwcli.cli.tables import format_table
from cwcli.cli.text import escape_control_characters, wrap_paragraph

if TYPE_CHECKING:
    from cwcli.pipeline.result import InputMessageCount, StageSummary


def print_stage_summary(console: Console, summary: StageSummary) -> None:
    """Print a summary as tables; notes go to stderr."""
    console.print_heading(summary.title)
    for section in summary.sections:
        console.print_summary("")
        console.print_summary(wrap_paragraph(escape_control_characters(section.title)))
        console.print_summary(format_table(section.columns, section.rows) if section.rows else "  none")
    if summary.inputs:
        console.print_summary("")
        console.print_summary("Input messages")
        console.print_summary(format_input_table(summary.inputs))
    if summary.verdict:
        console.print_summary("")
        text = f"verdict on {summary.verdict_subject}: {escape_control_characters(summary.verdict)}"
        console.print_summary(wrap_paragraph(text, rest="  "))
    console.print_summary("")
    for note in summary.notes:
        console.print_note(note)


def format_input_table(inputs: Sequence[InputMessageCount]) -> str:
    """Format a table of the read, used, rejected and repaired messages of each input, with the reasons below."""
    rows = [
        (entry.topic, entry.role, entry.read, entry.used, sum(entry.rejected.values()), sum(entry.repaired.values()))
        for entry in inputs
    ]
    lines = [format_table(("topic", "used as", "read", "used", "rejected", "repaired"), rows)]
    for entry in inputs:
        for kind, counts in (
            ("rejected", entry.rejected),
            ("repaired", entry.repaired),
            ("set aside", entry.set_aside),
        ):
            if any(counts.values()):
                text = f"{escape_control_characters(entry.topic)} {kind}: {format_reason_counts(counts)}"
                lines.append(wrap_paragraph(text, first="  ", rest="    "))
    return "\n".join(lines)


def format_reason_counts(counts: Mapping[str, int]) -> str:
    """Format counts of reasons, the most frequent first: `3 outside the gate, 1 without a fix`."""
    ordered = sorted(counts.items(), key=lambda item: -item[1])
    return ", ".join(f"{count} {escape_control_characters(reason)}" for reason, count in ordered if count)


def print_written_files(console: Console, paths: Sequence[str]) -> None:
    """Print the names and sizes of written files."""
    from pathlib import Path

    from cwcli.cli.text import format_byte_size

    for path in paths:
        console.print_summary(
            f"wrote {escape_control_characters(path)} ({format_byte_size(Path(path).stat().st_size)})"
        )
