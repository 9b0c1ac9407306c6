"""What a report is made of: the output folder of `cwcli run`, or one annotated log."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from cwcli.errors import InputError
from cwcli.fleet.folder import MANIFEST, NOT_DONE, RecordedLog, read_output
from cwcli.fleet.results import read_metrics_table
from cwcli.logs.read.recording import is_recording
from cwcli.metrics.pooling import MetricRow, rows_of
from cwcli.url import name_url


@dataclass(frozen=True)
class Entry:
    """One log of a run.

    Attributes:
        id: Unique in the run.
        name: For people.
        source: Where the log came from.
        log: The annotated log, None where there is none.
        has_failed: The run could not finish it.
        error: What, where and hint of the failure.
        left_out: Stage -> why it did not run.
        metrics: Headline metrics by name.
    """

    id: str
    name: str
    source: str
    log: Path | None
    has_failed: bool = False
    error: Mapping[str, str] = field(default_factory=dict)
    left_out: Mapping[str, str] = field(default_factory=dict)
    metrics: Mapping[str, MetricRow] = field(default_factory=dict)


@dataclass(frozen=True)
class Run:
    """The run that the report is about.

    Attributes:
        name: Of the folder or the log.
        entries: Its logs, in order of id.
        gates: Gate expressions of the pipeline.
        is_folder: It is the output of `cwcli run -d`.
    """

    name: str
    entries: tuple[Entry, ...]
    gates: tuple[str, ...]
    is_folder: bool


def read_run(source: str) -> Run:
    """Read the run to report on.

    Args:
        source: An output folder of `cwcli run -d`, an annotated log, or `-` for one on standard input.

    Raises:
        InputError: It is neither, or the folder's manifest can't be read.
    """
    if not source:
        raise InputError("the name of the run is empty", hint="is a variable of the shell not set?")
    path = Path(source)
    try:
        is_folder = source != "-" and path.is_dir() and not is_recording(path)
    except ValueError as error:  # a zero byte in the name
        raise InputError(str(error), where=source) from error
    if not is_folder:
        shown = Path(name_url(source))
        return Run(shown.name, (Entry(shown.stem, shown.name, str(shown), path),), (), is_folder=False)
    run = read_output(path)
    if run is None:
        raise InputError(
            f"the folder has no readable {MANIFEST}: it is no output of `cwcli run -d`",
            where=source,
            hint="name such a folder, or one annotated log",
        )
    if not run.logs:
        raise InputError("the folder holds no log", where=source, hint="fill it with `cwcli run logs/*.mcap -d out/`")
    return Run(path.resolve().name, tuple(_entry(log) for log in run.logs), run.gates, is_folder=True)


def _entry(log: RecordedLog) -> Entry:
    """Build the entry of one log of the folder; damaged metrics count as its failure."""
    annotated = None if log.folder is None else log.folder.annotated
    has_failed = log.entry.get("status") != "done"
    error, left_out = log.entry.get("error"), log.entry.get("left_out")
    if has_failed and not isinstance(error, dict):
        error = {"what": NOT_DONE}
    metrics: dict[str, MetricRow] = {}
    try:
        metrics = {} if log.folder is None else _metrics(log.folder.metrics)
    except InputError as damage:
        if not has_failed:
            has_failed, error = True, {"what": damage.what, "where": damage.where, "hint": "do the run again"}
    return Entry(
        id=log.id,
        name=log.id,
        source=str(log.entry.get("source") or ""),
        log=annotated if annotated is not None and annotated.is_file() else None,
        has_failed=has_failed,
        error={key: str(error[key]) for key in ("what", "where", "hint") if error.get(key)}
        if isinstance(error, dict)
        else {},
        left_out={str(stage): str(reason) for stage, reason in left_out.items()} if isinstance(left_out, dict) else {},
        metrics=metrics,
    )


def _metrics(file: Path) -> dict[str, MetricRow]:
    """Read the log's rows of the metrics dataset; {} if there is no file.

    Raises:
        InputError: The file is damaged.
    """
    if not file.is_file():
        return {}
    try:
        return rows_of(read_metrics_table(file))
    except (ValueError, TypeError) as error:
        raise InputError(f"can't be read: {error}", where=str(file)) from error
