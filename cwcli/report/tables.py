"""The tables of a log's part of the page."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from cwcli.digest.drive import Drive
from cwcli.digest.encounters import DriveEncounters, Encounter
from cwcli.digest.story import badge_of_warning_verdict, name_of_other
from cwcli.metrics.headline import find_metric
from cwcli.report.source import LogEntry
from cwcli.report.views import TableView
from cwcli.signals.units import NS_PER_S
from cwcli.text import format_interval, format_number

TIME_ORIGIN_PHRASE = "the log began"
"""The phrase that says what times in the tables count from."""
MAX_PAGE_TABLE_ROWS = 200
"""The greatest number of rows of a table. Chosen by hand; not fitted."""


def encounter_facts_table(drive: Drive, encounter: Encounter) -> TableView:
    """Build the table of what a warning predicted and what happened."""

    def seconds_text(stamp_ns: int) -> str:
        return f"{(stamp_ns - drive.start_ns) / NS_PER_S:.2f} s after {TIME_ORIGIN_PHRASE}"

    def metres_text(value: float) -> str:
        return f"{value:.2f} m" if math.isfinite(value) else "-"

    verdict = encounter.verdict
    rows = [
        ("warned of", name_of_other(encounter)),
        *([("where it was", encounter.direction)] if encounter.direction else []),
        ("rule", encounter.rule or "-"),
        ("warning given", seconds_text(encounter.raised_ns)),
        ("warning stood until", seconds_text(encounter.last_ns)),
    ]
    rows += _prediction_rows(drive, encounter)
    if verdict is not None:
        if verdict.closest_ns >= 0:
            rows.append(("really nearest", seconds_text(verdict.closest_ns)))
        rows.append(("really: centres apart by", metres_text(verdict.closest_m)))
        gap = encounter.least_gap_m
        overlap = f"none: they overlapped by {-gap:.2f} m" if gap < 0.0 else metres_text(gap)
        rows.append(("really: gap between outlines", overlap))
        if math.isfinite(verdict.lead_time_s):
            rows.append(("warned before the conflict by", f"{verdict.lead_time_s:.2f} s"))
    return TableView("In numbers", (("", False), ("", False)), tuple(rows))


def _prediction_rows(drive: Drive, encounter: Encounter) -> list[tuple[str, str]]:
    """Return the rows of what the warning predicted when it was given."""
    lane, rule = encounter.is_lane_departure, drive.warning_config
    within = "probability of the crossing" if lane else f"probability within {rule.horizon_s:g} s"
    compared = f"probability, which the rule compares with {rule.probability:g}"
    said = (
        ("the line is crossed in" if lane else "the collision comes in", encounter.time_to_event_s, ".2f", " s"),
        ("the tyre stays inside by" if lane else "centres apart by", encounter.predicted_distance_m, ".2f", " m"),
        (compared, encounter.alert_probability, ".2f", ""),
        (within, encounter.probability, ".2f", ""),
    )
    return [
        (f"predicted when it was given: {what}", f"{value:{form}}{unit}")
        for what, value, form, unit in said
        if math.isfinite(value)
    ]


def all_warnings_table(
    drive: Drive, drive_encounters: DriveEncounters, anchor_name_by_warning: Mapping[int, str]
) -> TableView:
    """Build the table of all warnings; `marks`: warning number -> anchor name, of those without figures."""
    rows = []
    for each in drive_encounters.encounters:
        verdict = each.verdict
        nearest = f"{verdict.closest_m:.2f}" if verdict is not None and math.isfinite(verdict.closest_m) else "-"
        lead = f"{verdict.lead_time_s:.2f}" if verdict is not None and math.isfinite(verdict.lead_time_s) else "-"
        at = f"{(each.raised_ns - drive.start_ns) / NS_PER_S:.2f}"
        rows.append((str(each.event_id), name_of_other(each), at, badge_of_warning_verdict(each).text, lead, nearest))
    columns = (
        ("warning", True),
        ("of", False),
        ("at [s]", True),
        ("verdict", False),
        ("lead [s]", True),
        ("nearest [m]", True),
    )
    listed = rows[:MAX_PAGE_TABLE_ROWS]
    hint = "the most critical ones have figures above"
    if len(rows) > len(listed):
        hint += f"; the first {MAX_PAGE_TABLE_ROWS} of {len(rows)} are listed"
    names = tuple(anchor_name_by_warning.get(each.event_id, "") for each in drive_encounters.encounters[: len(listed)])
    return TableView("All warnings", columns, tuple(listed), hint, row_marks=names)


def build_log_tables(drive: Drive, entry: LogEntry, *, has_all_metrics: bool) -> list[TableView]:
    """Build the tables of a log: its input messages and its metrics."""
    tables = []
    rows: list[tuple[str, ...]] = []
    for stage in drive.records:
        for input_record in drive.stage_input_records(stage):
            reasons = [
                f"{n} {reason} ({kind.replace('_', ' ')})"
                for kind in ("rejected", "repaired", "set_aside")
                for reason, n in _positive_counts_by_reason(input_record.get(kind)).items()
            ]
            totals = [
                str(sum(_positive_counts_by_reason(input_record.get(kind)).values()))
                for kind in ("rejected", "repaired")
            ]
            topic, role = str(input_record.get("topic", "")), str(input_record.get("role", "")).replace("_", " ")
            read, used = str(input_record.get("read", "")), str(input_record.get("used", ""))
            rows.append((stage, topic, role, read, used, *totals, "; ".join(reasons)))
    if rows:
        columns: tuple[tuple[str, bool], ...] = (
            ("stage", False),
            ("channel", False),
            ("used as", False),
            ("read", True),
            ("used", True),
            ("rejected", True),
            ("repaired", True),
            ("reasons", False),
        )
        if not any(row[-1] for row in rows):
            columns, rows = columns[:-1], [row[:-1] for row in rows]
        tables.append(
            TableView("Messages read, used, rejected and repaired", columns, tuple(rows[:MAX_PAGE_TABLE_ROWS]))
        )
    if entry.metrics:
        tables += _build_metrics_tables(entry, has_all_metrics)
    return tables


def _build_metrics_tables(entry: LogEntry, has_all_metrics: bool) -> list[TableView]:
    """Build the table of the metrics that runs are compared by, and a folded one of the rest."""
    main: list[tuple[str, ...]] = []
    rest: list[tuple[str, ...]] = []
    for metric in list(entry.metrics.values())[: 2 * MAX_PAGE_TABLE_ROWS]:
        known = find_metric(metric.metric)
        value, between = format_metric_value(metric.metric, metric.value), format_interval(metric.low, metric.high)
        if metric.stage == "system":  # beside cwcli's own, in a table of its own
            continue
        row = (metric.metric, value, metric.unit, metric.states, between, str(metric.n))
        (main if known is not None and known.is_compared else rest).append(row)
    texts = ("metric", "unit", "states", "95 % interval")
    names = ("metric", "value", "unit", "states", "95 % interval", "samples")
    columns = tuple((name, name not in texts) for name in names)
    tables = [drop_empty_columns(TableView("Headline metrics", columns, tuple(main)))] if main else []
    if rest and has_all_metrics:
        tables.append(drop_empty_columns(TableView("Further metrics", columns, tuple(rest), is_folded=True)))
    return tables


def drop_empty_columns(table: TableView) -> TableView:
    """Drop the columns in which every row is empty."""
    filled_columns = [k for k in range(len(table.columns)) if any(row[k] not in ("", "-") for row in table.rows)]
    rows = tuple(tuple(row[k] for k in filled_columns) for row in table.rows)
    return replace(table, columns=tuple(table.columns[k] for k in filled_columns), rows=rows)


def format_metric_value(name: str, value: float) -> str:
    """Format a metric's value; counts have no decimals."""
    is_count = name.endswith(("_count", ".count")) and math.isfinite(value)
    return f"{value:.0f}" if is_count else format_number(value)


def _positive_counts_by_reason(value: Any) -> dict[str, int]:
    """Return the positive counts by reason; {} if the value is no mapping."""
    if not isinstance(value, dict):
        return {}
    return {str(reason): n for reason, n in value.items() if isinstance(n, int) and n}
