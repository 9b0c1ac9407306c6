"""What a report is made of: the output folder of `cwcli run`, or one annotated log."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from pathlib import Path

from cwcli.digest.fleet import LogLine
from cwcli.errors import InputError
from cwcli.fleet.folder import MANIFEST_NAME, NOT_DONE_TEXT, RecordedLog
from cwcli.fleet.results import MetricsOfRun
from cwcli.fleet.run_source import is_folder_of_logs, read_run_or_none
from cwcli.lazy_dataclass import dataclass
from cwcli.metrics.gate_syntax import metric_names_in_gate
from cwcli.metrics.gates import matches_pattern
from cwcli.metrics.pooling import MetricRow
from cwcli.url import display_name_of_url

MAX_LOGS_WITH_ALL_METRICS = 200
"""Greatest number of logs of which all metrics are held in memory. Chosen by hand: some 20 MB."""


@dataclass(frozen=True)
class LogEntry:
    """One log of a run.

    Attributes:
        log: Path or URL of the annotated log, None where there is none.
        has_failed: The run could not finish it.
        error: What, where and hint of the failure.
        skip_reason_by_stage: Stage -> why it did not run.
        line: What the run's digest says of the log; None for a single log.
    """

    id: str
    name: str
    source: str
    log: str | None
    has_failed: bool = False
    error: Mapping[str, str] = field(default_factory=dict)
    skip_reason_by_stage: Mapping[str, str] = field(default_factory=dict)
    metrics: Mapping[str, MetricRow] = field(default_factory=dict)
    line: LogLine | None = None


@dataclass(frozen=True)
class ReportedRun:
    """The run that the report is about.

    Attributes:
        is_folder: It is the output of `cwcli run -d`.
    """

    name: str
    entries: tuple[LogEntry, ...]
    gates: tuple[str, ...]
    is_folder: bool


def read_reported_run(source: str, is_metric_needed: Callable[[str], bool] | None = None) -> ReportedRun:
    """Read the run to report on.

    Args:
        source: An output folder of `cwcli run -d`, an annotated log, or `-` for one on standard input.
        is_metric_needed: Tells by its name whether a metric is needed; of many logs the others are not read, but for
            those of the run's gates. None: all are read.

    Raises:
        InputError: It is neither, or the folder's manifest can't be read.
    """
    if not source:
        raise InputError("the name of the run is empty", hint="is a variable of the shell not set?")
    run = read_run_or_none(source)
    if run is None and not is_folder_of_logs(source):
        shown = Path(display_name_of_url(source))
        return ReportedRun(shown.name, (LogEntry(shown.stem, shown.name, str(shown), source),), (), is_folder=False)
    if run is None:
        raise InputError(
            f"the folder has no readable {MANIFEST_NAME}: it is not the output of `cwcli run -d`",
            where=source,
            hint="name such a folder, or one annotated log",
        )
    if not run.logs:
        raise InputError("the folder holds no log", where=source, hint="fill it with `cwcli run logs/*.mcap -d out/`")
    is_needed = None
    if is_metric_needed is not None and len(run.logs) > MAX_LOGS_WITH_ALL_METRICS:
        is_needed = _gate_metric_filter(run.gates, is_metric_needed)
    metrics = MetricsOfRun(run, is_needed)
    entries = tuple(_build_log_entry(log, metrics) for log in run.logs)
    name = display_name_of_url(run.url).rpartition("/")[2] or run.path.resolve().name
    return ReportedRun(name, entries, run.gates, is_folder=True)


def _gate_metric_filter(gates: Sequence[str], others: Callable[[str], bool]) -> Callable[[str], bool]:
    """Return a function that tells whether a metric is one of some gates, or of others."""
    patterns = [name for gate in gates for name in metric_names_in_gate(gate)]
    return lambda metric: others(metric) or any(matches_pattern(pattern, metric) for pattern in patterns)


def _build_log_entry(log: RecordedLog, metrics_of_run: MetricsOfRun) -> LogEntry:
    """Build the entry of one log of the folder; damaged metrics count as its failure."""
    has_failed = log.entry.get("status") != "done"
    error, left_out = log.entry.get("error"), log.entry.get("left_out")
    if has_failed and not isinstance(error, dict):
        error = {"what": NOT_DONE_TEXT}
    metrics: Mapping[str, MetricRow] = {}
    try:
        has_metrics = log.folder is not None and not has_failed and metrics_of_run.may_hold_rows_of_log(log.folder)
        metrics = {} if log.folder is None or not has_metrics else metrics_of_run.rows_of_log(log.folder)
    except InputError as damage:
        if not has_failed:
            has_failed, error = True, {"what": damage.what, "where": damage.where, "hint": "do the run again"}
    return LogEntry(
        id=log.id,
        name=log.id,
        source=str(log.entry.get("source") or ""),
        log=log.find_annotated_log(),
        has_failed=has_failed,
        error={key: str(error[key]) for key in ("what", "where", "hint") if error.get(key)}
        if isinstance(error, dict)
        else {},
        skip_reason_by_stage={str(stage): str(reason) for stage, reason in left_out.items()}
        if isinstance(left_out, dict)
        else {},
        metrics=metrics,
        line=LogLine.from_entry({"id": log.id, "error": None, "tables": {}, **log.entry}, str(log.entry.get("status"))),
    )
