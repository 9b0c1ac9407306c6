"""Prints a stage's summary: its tables, the counts of its input messages, and its notes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from cwcli.cli.console import Console
from cwcli.cli.tables import table
from cwcli.cli.text import paragraph, printable

if TYPE_CHECKING:
    from cwcli.pipeline.result import InputCount, Summary


def print_result(console: Console, summary: Summary) -> None:
    """Print a summary as tables; notes go to stderr."""
    console.heading(summary.title)
    for section in summary.sections:
        console.summary("")
        console.summary(printable(section.title))
        console.summary(table(section.columns, section.rows) if section.rows else "  none")
    if summary.inputs:
        console.summary("")
        console.summary("Input messages")
        console.summary(input_table(summary.inputs))
    if summary.verdict:
        console.summary("")
        console.summary(paragraph(printable(summary.verdict), first="verdict: ", rest="  "))
    console.summary("")
    for note in summary.notes:
        console.note(note)


def input_table(inputs: Sequence[InputCount]) -> str:
    """Format a table of the read, used, rejected and repaired messages of each input, with the reasons below."""
    rows = [
        (entry.topic, entry.role, entry.read, entry.used, sum(entry.rejected.values()), sum(entry.repaired.values()))
        for entry in inputs
    ]
    lines = [table(("topic", "role", "read", "used", "rejected", "repaired"), rows)]
    for entry in inputs:
        for kind, counts in (
            ("rejected", entry.rejected),
            ("repaired", entry.repaired),
            ("set aside", entry.set_aside),
        ):
            if any(counts.values()):
                text = f"{printable(entry.topic)} {kind}: {reasons(counts)}"
                lines.append(paragraph(text, first="  ", rest="    "))
    return "\n".join(lines)


def reasons(counts: Mapping[str, int]) -> str:
    """Format counts of reasons, the most frequent first: `3 outside the gate, 1 without a fix`."""
    ordered = sorted(counts.items(), key=lambda item: -item[1])
    return ", ".join(f"{count} {printable(reason)}" for reason, count in ordered if count)


def print_written(console: Console, paths: Sequence[str]) -> None:
    """Print the names and sizes of written files."""
    from pathlib import Path

    from cwcli.cli.text import size

    for path in paths:
        console.summary(f"wrote {printable(path)} ({size(Path(path).stat().st_size)})")
