"""Reads the headline metrics of a run from an output folder, from annotated logs, or from a metrics table."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cwcli.errors import CwcliError, InputError, UsageError
from cwcli.fleet.folder import (
    HEADLINE_METRIC_REFERENCES_KEY,
    MANIFEST_NAME,
    NOT_DONE_TEXT,
    LogOutputs,
    RecordedLog,
    RecordedRun,
    read_run_time_s_by_log,
)
from cwcli.fleet.run_source import is_folder_of_logs, read_run_or_none
from cwcli.fleet.staged_tables import iter_staged_tables, list_staged_tables
from cwcli.fleet.table_schemas import LOG_COLUMN
from cwcli.fleet.tables import METRICS_TABLE, TABLE_FILE_SUFFIX
from cwcli.input import MAX_NET_OR_TABLE_FILE_BYTES, read_file
from cwcli.lazy_dataclass import dataclass
from cwcli.metrics.headline import COLUMNS_MISSING_IN_EARLIER_VERSIONS, METRICS_TABLE_COLUMNS
from cwcli.metrics.pooling import (
    LOG_ID_OF_ALL_LOGS_POOLED,
    LogMetrics,
    MetricRow,
    metric_rows_by_name,
    notes_from_metadata,
)
from cwcli.metrics.table import Table, TableColumn
from cwcli.url import display_name_of_url

if TYPE_CHECKING:
    import pyarrow as pa

    from cwcli.evaluation.system_topics import OtherSystemTopics
    from cwcli.logs.read.reader import Log

STDIN_NAME = "-"
"""Name of standard input."""
METRIC_ROWS_PER_BATCH = 65_536
"""Number of rows of a table of metrics that are read at a time. Chosen by hand: some ten MB."""
TEXT_COLUMNS_OF_METRICS_TABLE = ("stage", "metric", "unit", "pool", "states")
"""The text columns of the table of metrics; the others hold numbers."""
NO_METRICS_TABLE_ERROR_TEXT = "the log has no readable table of metrics, and no annotated log to make it from"
"""Error text of a log that is done but has neither metrics nor an annotated log."""
NO_ANNOTATED_LOG_ERROR_TEXT = "the run wrote no annotated log, from which other scores could be computed"
"""Error text of a log of a run with `--no-annotate`, for another truth or another system."""


@dataclass(frozen=True)
class RunMetrics:
    """The headline metrics of each log of a run.

    Attributes:
        source: The run, as the user named it.
        logs: Metrics of each log in order of id, failed logs included.
    """

    source: str
    logs: tuple[LogMetrics, ...]
    gates: tuple[str, ...] = ()
    is_one_log: bool = False


class _ScoringOptions(NamedTuple):
    """Options of scoring a log: the truth, and another system or None."""

    truth: str
    system: OtherSystemTopics | None


def read_run_metrics(
    source: str,
    *,
    truth: str = "auto",
    system: OtherSystemTopics | None = None,
    step: Callable[[str], None] = lambda text: None,
) -> RunMetrics:
    """Read or compute the headline metrics of a run.

    Args:
        source: Output folder of `cwcli run -d`; folder of annotated logs (`*.mcap`); one annotated log, also a folder
            with a recorder's metadata.yaml or a URL, `-` for standard input; or a table (`.parquet`) that `cwcli
            evaluate --metrics` has written.
        truth: As in `cwcli.evaluation.evaluate_log`. Metrics that an output folder holds for another truth are computed
            again from its annotated logs.
        system: Another system in the logs to score too; then all metrics are computed again.
        step: Called with a text for each log that is computed.

    Raises:
        InputError: There is no such file or folder, or it holds none of these.
        UsageError: A truth topic can't be one, or another system's; or a table is to be computed again.
        CwcliError: The only log can't be read.
    """
    how = _ScoringOptions(truth, system)
    if not source:
        raise InputError("the name of the run is empty", hint="is a variable of the shell not set?")
    path, name = Path(source), display_name_of_url(source)
    run = read_run_or_none(source)
    if run is not None:
        return RunMetrics(name, tuple(_iter_metrics_of_run(run, how, step)), run.gates)
    if is_folder_of_logs(source):
        return _metrics_of_logs_in_folder(source, how, step)
    if path.suffix.lower() == ".parquet":
        if system is not None:
            raise UsageError("--topic needs the annotated logs, not their table of metrics", where=source)
        return RunMetrics(source, tuple(_metrics_of_table(path)))
    step(f"evaluating {name}")
    log = _score_log(source, Path(name).name if source != STDIN_NAME else "<stdin>", how)
    return RunMetrics(name, (replace(log, source=source),), is_one_log=True)


def _metrics_of_logs_in_folder(source: str, scoring: _ScoringOptions, step: Callable[[str], None]) -> RunMetrics:
    found = sorted(each for each in Path(source).iterdir() if each.suffix.lower() == ".mcap" and each.is_file())
    if not found:
        raise InputError(
            f"the folder holds neither a {MANIFEST_NAME} nor logs (*.mcap)",
            where=source,
            hint="fill it with `cwcli run logs/*.mcap -d DIR`",
        )
    logs = []
    for file in found:
        step(f"evaluating {file}")
        try:
            logs.append(replace(_score_log(str(file), file.name, scoring), source=str(file)))
        except UsageError:
            raise
        except CwcliError as error:
            logs.append(LogMetrics(file.name, error=str(error)))
    return RunMetrics(source, tuple(logs))


def _iter_metrics_of_run(
    run: RecordedRun, scoring: _ScoringOptions, step: Callable[[str], None]
) -> Iterator[LogMetrics]:
    """Yield the metrics of each log of a run."""
    times = read_run_time_s_by_log(run.path)
    metrics = MetricsOfRun(run)
    for log in run.logs:
        if log.folder is None:
            where = run.path_or_url_of_file(run.path / MANIFEST_NAME)
            raise InputError(f"the log id {log.id!r} is not the name of a file", where=where)
        if log.entry.get("status") != "done":
            found = LogMetrics(log.id, error=_error_or_not_done_text(log.entry))
        else:
            found = replace(
                _metrics_of_log(log, log.folder, metrics, scoring, step), sha256=str(log.entry.get("sha256") or "")
            )
        yield replace(found, source=str(log.entry.get("source") or ""), run_s=times.get(log.id, 0.0))


def _metrics_of_log(
    log: RecordedLog, folder: LogOutputs, metrics: MetricsOfRun, scoring: _ScoringOptions, step: Callable[[str], None]
) -> LogMetrics:
    scores = log.entry.get(HEADLINE_METRIC_REFERENCES_KEY)
    scores = scores if isinstance(scores, dict) else {}
    try:
        rows = metrics.rows_of_log(folder)
        if scores.get("truth", "auto") == scoring.truth and scoring.system is None:
            return LogMetrics(folder.id, rows, notes=tuple(str(scores.get("notes", "")).splitlines()))
    except InputError:
        if log.find_annotated_log() is None:
            return LogMetrics(folder.id, error=NO_METRICS_TABLE_ERROR_TEXT)
    annotated = log.find_annotated_log()
    if annotated is None:
        return LogMetrics(folder.id, error=NO_ANNOTATED_LOG_ERROR_TEXT)
    step(f"evaluating {folder.id}")
    try:
        return _score_log(annotated, folder.id, scoring)
    except UsageError:
        raise
    except CwcliError as error:
        return LogMetrics(folder.id, error=str(error))


class MetricsOfRun:
    """The headline metrics of a run's logs, whose table is read once.

    Args:
        is_needed: Tells by its name whether a metric is needed; others are not held in memory. None: all are.
    """

    def __init__(self, run: RecordedRun, is_needed: Callable[[str], bool] | None = None) -> None:
        self._run = run
        self._path = run.path / f"{METRICS_TABLE}{TABLE_FILE_SUFFIX}"
        self._is_needed = is_needed
        self._error: InputError | None = None
        self._rows: Mapping[str, Mapping[str, MetricRow]] | None = None

    def may_hold_rows_of_log(self, folder: LogOutputs) -> bool:
        """Whether there is a file that can hold rows of a log."""
        return self._path.is_file() or folder.staged_tables_path.is_file()

    def rows_of_log(self, folder: LogOutputs) -> Mapping[str, MetricRow]:
        """Return metric -> row of a log.

        Raises:
            InputError: The table is missing or damaged.
        """
        staged = folder.staged_tables_path
        is_staged = staged.is_file()
        try:
            return self._rows_in_staged_tables(staged) if is_staged else self._rows_in_table_of_run(folder.id)
        except InputError as error:
            where = self._run.path_or_url_of_file(staged if is_staged else self._path)
            raise InputError(error.what, where=where, hint=error.hint) from error

    @staticmethod
    def _rows_in_staged_tables(path: Path) -> Mapping[str, MetricRow]:
        tables = [each for each in list_staged_tables(path) if each.name == METRICS_TABLE]
        for _, table in iter_staged_tables(path, tables):
            return _checked_metric_rows_by_name(_table_from_arrow(table, path), path)
        return {}

    def _rows_in_table_of_run(self, id: str) -> Mapping[str, MetricRow]:
        if self._rows is None and self._error is None:
            try:
                self._rows = _metric_rows_by_log(self._path, self._is_needed)
            except InputError as error:
                self._error = error
        if self._error is not None:
            raise self._error
        return (self._rows or {}).get(id, {})


def _checked_metric_rows_by_name(table: Table, path: Path) -> dict[str, MetricRow]:
    """Return the rows of a table by metric; raise `InputError` if it does not hold what it should."""
    try:
        return metric_rows_by_name(table)
    except (ValueError, TypeError) as error:
        raise InputError(f"can't be read: {error}", where=str(path)) from error


def _metric_rows_by_log(path: Path, is_needed: Callable[[str], bool] | None) -> dict[str, dict[str, MetricRow]]:
    """Return log -> metric -> row of a table that may have millions of rows; few of them are in memory at a time.

    Raises:
        InputError: The table can't be read, a column is missing or holds something else.
    """
    import pyarrow as pa
    import pyarrow.compute as pc
    from pyarrow import parquet

    rows: dict[str, dict[str, MetricRow]] = {}
    try:
        source = pa.BufferReader(read_file(path, limit=MAX_NET_OR_TABLE_FILE_BYTES))
        with parquet.ParquetFile(source) as file:
            if file.metadata.num_rows == 0:
                _table_from_arrow(file.schema_arrow.empty_table(), path)
            for batch in file.iter_batches(METRIC_ROWS_PER_BATCH, use_threads=False):
                found = pa.Table.from_batches([batch])
                if is_needed is not None and "metric" in found.column_names:
                    names = [each for each in pc.unique(found.column("metric")).to_pylist() if is_needed(str(each))]
                    found = found.filter(pc.is_in(found.column("metric"), pa.array(names, pa.string())))
                _add_metric_rows(rows, _table_from_arrow(found, path), path)
    except (OSError, ValueError, pa.ArrowException) as error:
        what = getattr(error, "strerror", None) or str(error).splitlines()[0]
        raise InputError(f"the metrics can't be read: {what}", where=str(path)) from error
    return rows


def _add_metric_rows(rows: dict[str, dict[str, MetricRow]], table: Table, path: Path) -> None:
    """Add the rows of a table whose types are checked to log -> metric -> row.

    Raises:
        InputError: The table has no column `log`.
    """
    ids = table.columns.get(LOG_COLUMN)
    if not isinstance(ids, list):
        raise InputError("the table has no column log", where=str(path))
    names = [field.name for field in fields(MetricRow) if field.name in table.columns]
    columns = [_column_values_as_list(table.columns[name]) for name in names]
    for id, *values in zip(ids, *columns, strict=True):
        row = MetricRow(*values)
        rows.setdefault(id, {})[row.metric] = row


def _column_values_as_list(column: TableColumn) -> list[Any]:
    """Return the values of a column of numbers or texts as a list."""
    if isinstance(column, np.ndarray):
        return list(column.tolist())
    return column if isinstance(column, list) else []


def _iter_log_ids_and_tables(path: Path) -> Iterator[tuple[str, Table]]:
    """Yield each id in the column `log` of a table of metrics, with its rows.

    Raises:
        InputError: It can't be read, or lacks a column.
    """
    table = read_metrics_table(path)
    ids = table.columns.get(LOG_COLUMN)
    if not isinstance(ids, list):
        raise InputError("the table has no column log", where=str(path), hint="make one: cwcli evaluate --metrics")
    rows: dict[str, list[int]] = {}
    for k, name in enumerate(ids):
        rows.setdefault(str(name), []).append(k)
    for name, selected in rows.items():
        yield name, _select_table_rows(table, selected)


def _error_or_not_done_text(entry: dict[str, Any]) -> str:
    error = entry.get("error")
    if not isinstance(error, dict):
        return NOT_DONE_TEXT
    where, what = error.get("where"), error.get("what")
    return f"{where}: {what}" if where else str(what)


def _score_log(source: str, name: str, scoring: _ScoringOptions) -> LogMetrics:
    from cwcli.array_memory import bound_array_memory_and_get_old_handler
    from cwcli.evaluation.evaluate_log import evaluate_log
    from cwcli.logs.read.reader import Log

    bound_array_memory_and_get_old_handler()
    with Log.open(source) as log:
        table = evaluate_log(log, truth=scoring.truth, system=scoring.system)
        return LogMetrics(name, metric_rows_by_name(table), sha256=_input_sha256(log), notes=notes_from_metadata(table))


def _input_sha256(log: Log) -> str:
    """Hash of the log before it was annotated, from the first metadata record that holds it, else ""."""
    from cwcli.pipeline.records import read_run_records

    hashes = [record["input_sha256"] for record in read_run_records(log).values() if "input_sha256" in record]
    return hashes[0] if hashes else ""


def _metrics_of_table(path: Path) -> list[LogMetrics]:
    """Read the metrics of each log from a table with a column `log`."""
    return [
        LogMetrics(name, metric_rows_by_name(table))
        for name, table in _iter_log_ids_and_tables(path)
        if name != LOG_ID_OF_ALL_LOGS_POOLED
    ]


def _select_table_rows(table: Table, rows: list[int]) -> Table:
    columns = {
        name: column[np.array(rows)] if isinstance(column, np.ndarray) else [column[k] for k in rows]
        for name, column in table.columns.items()
        if name in METRICS_TABLE_COLUMNS and isinstance(column, np.ndarray | list)
    }
    return Table(table.name, columns)


def read_metrics_table(path: Path) -> Table:
    """Read a table of headline metrics, as a run and `cwcli evaluate --metrics` write it.

    Raises:
        InputError: It can't be read, or lacks a column.
    """
    import pyarrow as pa
    from pyarrow import parquet

    try:
        found = parquet.read_table(
            pa.BufferReader(read_file(path, limit=MAX_NET_OR_TABLE_FILE_BYTES)), use_threads=False
        )
    except (OSError, ValueError, pa.ArrowException) as error:
        what = getattr(error, "strerror", None) or str(error).splitlines()[0]
        raise InputError(f"the metrics can't be read: {what}", where=str(path)) from error
    return _table_from_arrow(found, path)


def _texts_of_column(column: pa.ChunkedArray) -> list[str]:
    """Return the values of a column as texts; equal ones are one object, as a million rows repeat a few names."""
    known: dict[str, str] = {}
    return [known.setdefault(text, text) for text in map(str, column.to_pylist())]


def _table_from_arrow(arrow_table: pa.Table, path: Path) -> Table:
    """Return a table of metrics; raise `InputError` if it lacks a column or one holds something else."""
    import pyarrow as pa

    missing = [
        name
        for name in METRICS_TABLE_COLUMNS
        if name not in arrow_table.column_names and name not in COLUMNS_MISSING_IN_EARLIER_VERSIONS
    ]
    if missing:
        raise InputError(f"the table has no column {missing[0]}", where=str(path))
    columns: dict[str, Any] = {}
    for name in arrow_table.column_names:
        column = arrow_table.column(name)
        is_integer = pa.types.is_integer(column.type)
        is_number = pa.types.is_floating(column.type) or is_integer
        is_count = is_integer and not column.null_count
        if name in METRICS_TABLE_COLUMNS and (
            is_number == (name in TEXT_COLUMNS_OF_METRICS_TABLE) or (name == "n" and not is_count)
        ):
            raise InputError(f"its column {name} does not hold valid values: {column.type}", where=str(path))
        columns[name] = column.to_numpy() if is_number else _texts_of_column(column)
    metadata = {
        key.decode(errors="replace"): value.decode(errors="replace")
        for key, value in (arrow_table.schema.metadata or {}).items()
    }
    return Table(metadata.pop("name", "metrics"), columns, metadata=metadata)
