"""What a report is made of: the output folder of `cwcli run`, or one annotated log."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cwcli.errors import InputError

MANIFEST = "manifest.json"
ANNOTATED = "annotated.mcap"
ENTRY = "entry.json"


@dataclass(frozen=True)
class Metric:
    """One headline metric of a log, as `cwcli evaluate` writes it; NaN where there is no interval."""

    stage: str
    name: str
    value: float
    unit: str
    n: int
    low: float
    high: float


@dataclass(frozen=True)
class Entry:
    """One log of a run.

    Attributes:
        id: Unique in the run.
        name: For people: the source's name.
        log: The annotated log, None where there is none.
        has_failed: The run could not finish it.
        error: What, where and hint of the failure.
        left_out: Stage -> why it did not run.
        metrics: Headline metrics.
    """

    id: str
    name: str
    log: Path | None
    has_failed: bool = False
    error: Mapping[str, str] = field(default_factory=dict)
    left_out: Mapping[str, str] = field(default_factory=dict)
    metrics: tuple[Metric, ...] = ()


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
        return Run(Path(source).name, (Entry(Path(source).stem, Path(source).name, path),), (), is_folder=False)
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
        name=str(given.get("source") or number),
        log=log if log is not None and log.is_file() else None,
        has_failed=given.get("status") != "done",
        error={key: str(error[key]) for key in ("what", "where", "hint") if error.get(key)}
        if isinstance(error, dict)
        else {},
        left_out={str(stage): str(reason) for stage, reason in left_out.items()} if isinstance(left_out, dict) else {},
        metrics=_metrics(folder / "metrics" / f"log={number}" / "metrics.parquet") if is_plain else (),
    )


def _metrics(file: Path) -> tuple[Metric, ...]:
    """The log's rows of the metrics dataset.

    Raises:
        InputError: The file is damaged.
    """
    if not file.is_file():
        return ()
    from pyarrow import ArrowException, parquet

    try:
        rows = parquet.ParquetFile(file).read().to_pylist()
    except (ArrowException, OSError) as error:
        raise InputError(f"can't be read: {error}", where=str(file)) from error
    return tuple(metric_of(row) for row in rows)


def metric_of(row: Mapping[str, Any]) -> Metric:
    """A row of the metrics table."""

    def number(name: str) -> float:
        value = row.get(name)
        return float(value) if isinstance(value, int | float) else math.nan

    n = row.get("n")
    return Metric(
        stage=str(row.get("stage", "")),
        name=str(row.get("metric", "")),
        value=number("value"),
        unit=str(row.get("unit") or ""),
        n=int(n) if isinstance(n, int | float) and math.isfinite(n) else 0,
        low=number("low"),
        high=number("high"),
    )
