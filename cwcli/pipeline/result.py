"""What a stage returns: channels for the log, tables for the metrics files, a summary for people and for `--json`."""

from __future__ import annotations

import json
import math
from collections import ChainMap
from collections.abc import Mapping
from dataclasses import field
from typing import Any

from cwcli.lazy_dataclass import dataclass, replace
from cwcli.metrics.table import Table
from cwcli.pipeline.json_names import table_row_to_json
from cwcli.signals.columns import OutputChannel

Cell = str | float | int | None
MAX_RECORDED_TABLE_ROWS = 200
"""Greatest number of rows of a table that the metadata record keeps; a thousand vehicles have a row each."""


@dataclass(frozen=True)
class SummaryTable:
    """One table of the summary.

    Attributes:
        key: Name in the JSON output.
        title: Heading on the terminal.
        columns: Column headings, units included.
        rows: One tuple a row, as long as `columns`.
        names: Of the columns in the JSON output, where the headings don't make good ones (`cwcli.pipeline.json_names`).
        is_timed: The table holds processing times, which differ from run to run; it is in no record.
    """

    key: str
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    names: tuple[str, ...] = ()
    is_timed: bool = False

    def to_markdown(self) -> str:
        """Format columns and rows as a table in Markdown."""
        lines = [f"| {' | '.join(self.columns)} |", f"| {' | '.join('---' for _ in self.columns)} |"]
        for row in self.rows:
            texts = [f"{cell:.4g}" if isinstance(cell, float) else "" if cell is None else str(cell) for cell in row]
            cells = (text.replace("|", "\\|").replace("<", "&lt;") for text in texts)
            lines.append(f"| {' | '.join(cells)} |")
        return "\n".join(lines)


@dataclass(frozen=True)
class InputMessageCount:
    """Counts of the messages of one input channel: read, used, rejected, repaired and set aside.

    Attributes:
        role: The role in which it was used.
        read, used: Numbers of messages.
        rejected, repaired: Reason -> number of messages.
        set_aside: Reason -> number of messages that are not used and are no fault.
        first_fault_ns: Reason -> log time of the first message rejected or repaired for it, where it is known.
    """

    topic: str
    role: str
    read: int
    used: int
    rejected: Mapping[str, int] = field(default_factory=dict)
    repaired: Mapping[str, int] = field(default_factory=dict)
    set_aside: Mapping[str, int] = field(default_factory=dict)
    first_fault_ns: Mapping[str, int] = field(default_factory=dict)

    @classmethod
    def from_transforms(cls, topic: str, read: int, used: int, unreadable: int) -> InputMessageCount:
        """Count the messages of a channel of transforms; a message is used if it defines a new frame of reference."""
        rejected = {"not a transform": unreadable} if unreadable else {}
        aside = read - used - unreadable
        known = {"transform of a known frame": aside} if aside else {}
        return cls(topic, "transform", read, used, rejected, {}, known)


@dataclass(frozen=True)
class StageSummary:
    """The summary of a stage for the user.

    Attributes:
        sections, inputs, notes: Its tables, the counts of input messages, and notes.
        verdict: One sentence on the result, "" where the stage has none.
        contradictions: One sentence for each pair of sources that contradict each other; an error with `--strict`.
        verdict_subject: What the verdict is about.
        corrections: One sentence for each source whose values were wrong in a known way and were corrected; an error
            with `--strict`.
    """

    title: str
    sections: tuple[SummaryTable, ...] = ()
    inputs: tuple[InputMessageCount, ...] = ()
    notes: tuple[str, ...] = ()
    verdict: str = ""
    contradictions: tuple[str, ...] = ()
    verdict_subject: str = "the result"
    corrections: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return the summary for JSON, with names in snake_case; NaN, infinity and empty cells become None."""
        return {
            "title": self.title,
            "sections": {
                section.key: [table_row_to_json(section.names or section.columns, row) for row in section.rows]
                for section in self.sections
            },
            "inputs": [
                {
                    "topic": count.topic,
                    "role": count.role,
                    "read": count.read,
                    "used": count.used,
                    "rejected": dict(count.rejected),
                    "repaired": dict(count.repaired),
                    "set_aside": dict(count.set_aside),
                }
                for count in self.inputs
            ],
            "notes": list(self.notes),
            **({"verdict": self.verdict} if self.verdict else {}),
            **({"corrections": list(self.corrections)} if self.corrections else {}),
            **({"contradictions": list(self.contradictions)} if self.contradictions else {}),
        }

    def to_record_entry(self) -> dict[str, str]:
        """Return what later readers of the log need, as an entry of the record: tables, notes, verdict, doubts."""
        summary = {
            "verdict": self.verdict,
            "notes": list(self.notes),
            **({"corrections": list(self.corrections)} if self.corrections else {}),
            **({"contradictions": list(self.contradictions)} if self.contradictions else {}),
            "sections": [
                {
                    "key": section.key,
                    "title": section.title,
                    "columns": list(section.columns),
                    "rows": [
                        [_cell_or_none_if_not_finite(cell) for cell in row]
                        for row in section.rows[:MAX_RECORDED_TABLE_ROWS]
                    ],
                }
                for section in self.sections
                if not section.is_timed
            ],
        }
        return {"summary": json.dumps(summary)}


@dataclass(frozen=True)
class StageResult:
    """The outcome of one stage.

    Attributes:
        stage: Its name, e.g. `estimate`.
        channels: New channels for the log.
        tables: Metrics by name; the first is the stage's main table (what `--metrics` writes).
        summary: For people and `--json`.
        metadata: The record `cwcli.run.<stage>`: version, resolved configuration, input hash, counts.
        evaluation_inputs: Values that only its evaluation (`cwcli.evaluation`) needs in addition to the channels.
    """

    stage: str
    channels: tuple[OutputChannel, ...]
    tables: Mapping[str, Table]
    summary: StageSummary
    metadata: Mapping[str, str] = field(default_factory=dict)
    evaluation_inputs: Any = None

    def with_evaluation(
        self,
        *,
        sections: tuple[SummaryTable, ...] = (),
        tables: Mapping[str, Table] | None = None,
        notes: tuple[str, ...] = (),
        note_index: int | None = None,
        verdict: str | None = None,
        entries: Mapping[str, str] | None = None,
    ) -> StageResult:
        """Return the result with the output of its evaluation, and without `evaluation_inputs`.

        Args:
            sections, notes: Appended to those of the stage; the notes at `note_index` of those, if given.
            tables: Added to those of the stage; one with the same name replaces it.
            verdict: Replaces that of the stage, if given.
            entries: Further entries of the record.
        """
        own = self.summary.notes
        note_index = len(own) if note_index is None else note_index
        summary = replace(
            self.summary,
            sections=(*self.summary.sections, *sections),
            notes=(*own[:note_index], *(note for note in notes if note not in own), *own[note_index:]),
            verdict=self.summary.verdict if verdict is None else verdict,
        )
        return replace(
            self,
            tables={**self.tables, **(tables or {})},
            summary=summary,
            metadata=ChainMap({**(entries or {}), **summary.to_record_entry()}, self.metadata),  # type: ignore[arg-type]
            evaluation_inputs=None,
        )


def _cell_or_none_if_not_finite(cell: Cell) -> Cell:
    """Return the cell for JSON: None for NaN and infinity."""
    return None if isinstance(cell, float) and not math.isfinite(cell) else cell
