"""What a report is made of: the output folder of `cwcli run`, or one annotated log."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cwcli.errors import InputError
from cwcli.metrics.headline import COLUMNS
from cwcli.metrics.pooling import MetricRow, rows_of
from cwcli.metrics.table import Table

MANIFEST = "manifest.json"
ANNOTATED = "annotated.mcap"
ENTRY = "entry.json"


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
    """What the report is about.

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
    """Find out what to report on.

    Args:
        source: An output folder of `cwcli run -d`, an annotated log, or `-` for one on standard input.

    Raises:
        InputError: It is neither, or the folder's manifest can't be read.
    """
    path = Path(source)
    try:
        is_folder = source != "-" and path.is_dir()
    except ValueError as error:  # a zero byte in the name
        raise InputError(str(error), where=source) from error
    if not is_folder:
        return Run(Path(source).name, (Entry(path.stem, path.name, source, path),), (), is_folder=False)
    manifest = _manifest(path)
    entries = [_entry(path, each) for each in manifest["logs"] if isinstance(each, dict)]
    if not entries:
        raise InputError("the folder holds no log", where=source, hint="fill it with `cwcli run logs/*.mcap -d out/`")
    pipeline = manifest.get("pipeline")
    gates = pipeline.get("gates", []) if isinstance(pipeline, dict) else []
    gates = [gate for gate in gates if isinstance(gate, str)] if isinstance(gates, list) else []
    return Run(path.resolve().name, tuple(sorted(entries, key=lambda each: each.id)), tuple(gates), is_folder=True)


def _manifest(folder: Path) -> dict[str, Any]:
    """The manifest; of a run that was killed, what its finished logs tell."""
    file = folder / MANIFEST
    if file.is_file():
        found = _read_json(file)
        if isinstance(found, dict) and isinstance(found.get("logs"), list):
            return found
        raise InputError("the manifest is not one of `cwcli run`", where=str(file))
    logs = [_read_json(each) for each in sorted(folder.glob(f"logs/*/{ENTRY}"))]
    if not logs:
        raise InputError(
            f"the folder has no {MANIFEST}: it is no output of `cwcli run -d`",
            where=str(folder),
            hint="name such a folder, or one annotated log",
        )
    return {"logs": logs}


def _read_json(file: Path) -> Any:
    try:
        return json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"can't be read: {error}", where=str(file)) from error


def _entry(folder: Path, given: Mapping[str, Any]) -> Entry:
    """One entry. What it says of paths is not believed: a log's files are in the folder of its id."""
    number = str(given.get("id", ""))
    is_plain = number not in {"", ".", ".."} and not set(number) & {"/", "\\", "\0"}
    log = folder / "logs" / number / ANNOTATED if is_plain else None
    error = given.get("error")
    left_out = given.get("left_out")
    return Entry(
        id=number,
        name=number,
        source=str(given.get("source") or ""),
        log=log if log is not None and log.is_file() else None,
        has_failed=given.get("status") != "done",
        error={key: str(error[key]) for key in ("what", "where", "hint") if error.get(key)}
        if isinstance(error, dict)
        else {},
        left_out={str(stage): str(reason) for stage, reason in left_out.items()} if isinstance(left_out, dict) else {},
        metrics=_metrics(folder / "metrics" / f"log={number}" / "metrics.parquet") if is_plain else {},
    )


def _metrics(file: Path) -> dict[str, MetricRow]:
    """The log's rows of the metrics dataset.

    Raises:
        InputError: The file is damaged.
    """
    if not file.is_file():
        return {}
    from pyarrow import ArrowException, parquet

    try:
        columns = parquet.ParquetFile(file).read().to_pydict()
        table = Table("metrics", {name: column for name, column in columns.items() if name in COLUMNS})
        return rows_of(table)
    except (ArrowException, OSError, ValueError, TypeError) as error:
        raise InputError(f"can't be read: {error}", where=str(file)) from error
