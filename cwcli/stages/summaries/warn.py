"""What each of several warning rules says of one log: numbered through, and joined as tables and one channel."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cwcli.channels.published import WARNINGS
from cwcli.channels.warning import make_warning_and_log_channels, read_warnings
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.logs.read.reader import Log
from cwcli.metrics.table import Table
from cwcli.pipeline.result import InputMessageCount, StageResult, StageSummary, SummaryTable
from cwcli.pipeline.run_record import build_run_record
from cwcli.warning.rows import WarningRows

WARNING_NUMBER_HEADING = "warning no."
"""Heading of the warnings' numbers, the first column of a table of warnings."""
EVENT_ID_COLUMN = "event_id"
"""Name of the column that holds the id of an event; 0 stands for none."""


@dataclass(frozen=True)
class RuleOutcome:
    """The warnings of one rule.

    Attributes:
        rule: Name of the rule.
        rows: The warnings over time.
        tables: Tables of the rule, its events first.
        sections: Tables for the summary.
    """

    rule: str
    rows: WarningRows
    tables: tuple[Table, ...]
    sections: tuple[SummaryTable, ...]


def continue_event_numbers(outcomes: Sequence[RuleOutcome], earlier: Sequence[WarningRows] = ()) -> list[RuleOutcome]:
    """Number the events over all rules, which makes each id unique in the channel.

    Args:
        earlier: Warnings that are in the channel already.
    """
    result: list[RuleOutcome] = []
    n_before = max(map(_greatest_event_id_or_zero, earlier), default=0)
    for outcome in outcomes:
        n = _greatest_event_id_or_zero(outcome.rows)
        result.append(_shift_event_ids(outcome, n_before) if n_before else outcome)
        n_before += n
    return result


def _greatest_event_id_or_zero(rows: WarningRows) -> int:
    """Return the greatest event id; 0 without events."""
    return int(np.max(rows.event_id, initial=0))


def _shift_event_ids(outcome: RuleOutcome, n_before: int) -> RuleOutcome:
    """Return the outcome with event ids that are greater by `n_before`, in rows, tables and sections."""
    warnings = replace(outcome.rows, event_id=outcome.rows.event_id + n_before)
    tables = []
    for table in outcome.tables:
        if EVENT_ID_COLUMN in table.columns:
            ids = np.asarray(table.columns[EVENT_ID_COLUMN])  # 0: no event, in the table of conflicts
            shifted_ids = np.where(ids > 0, ids + n_before, ids)
            tables.append(replace(table, columns={**table.columns, EVENT_ID_COLUMN: shifted_ids}))
        else:
            tables.append(table)
    sections = tuple(_shift_event_ids_of_table(section, n_before) for section in outcome.sections)
    return replace(outcome, rows=warnings, tables=tuple(tables), sections=sections)


def _shift_event_ids_of_table(section: SummaryTable, n_before: int) -> SummaryTable:
    """Return the table with event ids greater by `n_before` where its first column holds them."""
    if section.columns[0] != WARNING_NUMBER_HEADING:
        return section
    rows = tuple((row[0] + n_before if isinstance(row[0], int) else row[0], *row[1:]) for row in section.rows)
    return replace(section, rows=rows)


def tables_by_unique_name(outcomes: Sequence[RuleOutcome]) -> dict[str, Table]:
    """Return all tables by name; the rule's name is appended to a table's name that is taken."""
    tables: dict[str, Table] = {}
    for outcome in outcomes:
        for table in outcome.tables:
            name = table.name if table.name not in tables else f"{table.name}_{outcome.rule.replace('-', '_')}"
            tables[name] = replace(table, name=name)
    return tables


def build_warnings_result(
    stage: str,
    log: Log,
    config: object,
    outcomes: Sequence[RuleOutcome],
    inputs: tuple[InputMessageCount, ...],
    notes: tuple[str, ...],
    **record: str,
) -> tuple[StageResult, tuple[WarningRows, ...]]:
    """Build the result of a warning stage. The warnings of an earlier stage of the same run stay in the channel.

    Returns:
        The result, and those earlier warnings.
    """
    is_there = any(channel.topic == WARNINGS.topic for channel in log.added_channels)
    earlier = (read_warnings(log.columns(WARNINGS.topic)),) if is_there else ()
    outcomes = continue_event_numbers(outcomes, earlier=earlier)
    channels = make_warning_and_log_channels([*earlier, *(outcome.rows for outcome in outcomes)])
    sections = tuple(section for outcome in outcomes for section in outcome.sections)
    summary = StageSummary(stage, sections, inputs, notes)
    result = StageResult(
        stage,
        channels,
        tables_by_unique_name(outcomes),
        summary,
        build_run_record(stage, log, config, summary, **record),
    )
    return result, earlier
