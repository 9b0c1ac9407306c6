"""The output folder of a run: paths of its files, and whether a log's part of it is finished.

manifest.json                                the pipeline, the logs that are done, and why others failed
run_times.json                               the only file that differs from run to run
logs/<id>/annotated.mcap                     the log with its new channels
logs/<id>/entry.json                         what became of the log; written last
metrics/log=<id>/metrics.parquet             headline metrics; all logs together are one table
details/<table>/log=<id>/<table>.parquet     each table of each stage
tables/<channel>/log=<id>/<channel>.parquet  the channels' columns (`--tables`)
"""

from __future__ import annotations

import json
import math
import shutil
import sys
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cwcli.errors import InputError, OutputError
from cwcli.input import remember_input_file
from cwcli.lazy_dataclass import dataclass
from cwcli.output import make_folder, open_output
from cwcli.version import __version__

if TYPE_CHECKING:
    from cwcli.metrics.table import Table

MANIFEST_FORMAT = 1
"""Version of the manifest's format."""
MANIFEST_NAME, RUN_TIMES_NAME, ENTRY_NAME, ANNOTATED_LOG_NAME = (
    "manifest.json",
    "run_times.json",
    "entry.json",
    "annotated.mcap",
)
"""Names of the files in the output folder."""
SHARD_KEY = "shard"
"""Key of the manifest with the number of the shard and of all shards; a whole run has none."""
NOT_DONE_TEXT = "it was not processed"
"""Error text of a log that has no entry."""
OTHER_FORMAT_HINT = "use the version of cwcli that wrote it, or do the run again into a new folder"
"""Hint of the error about a manifest in another format."""
LOGS_FOLDER, METRICS_FOLDER, DETAILS_FOLDER, TABLES_FOLDER, SCRATCH_FOLDER = (
    "logs",
    "metrics",
    "details",
    "tables",
    ".scratch",
)
"""Names of the subfolders of the output folder."""

Document = dict[str, Any]


@dataclass(frozen=True)
class LogOutputs:
    """One log's part of the output folder.

    Attributes:
        out: The output folder.
        id: The log's safe, unique name.
    """

    out: Path
    id: str

    @property
    def annotated_log_path(self) -> Path:
        """Path of the annotated log."""
        return self.out / LOGS_FOLDER / self.id / ANNOTATED_LOG_NAME

    @property
    def metrics_path(self) -> Path:
        """Path of the table of headline metrics."""
        return self._partition_path(METRICS_FOLDER) / f"{METRICS_FOLDER}.parquet"

    def table_path(self, kind: str, name: str) -> Path:
        """Path of one table; `kind` is the folder of details or of channel tables."""
        return self._partition_path(kind, name) / f"{name}.parquet"

    def read_entry(self) -> Document | None:
        """Read the log's entry; None if there is none or it can't be read."""
        return read_json_object(self.entry_path)

    @property
    def entry_path(self) -> Path:
        """Path of the log's entry."""
        return self.out / LOGS_FOLDER / self.id / ENTRY_NAME

    def note_entry_as_input(self) -> None:
        """Register the entry as an input of this run, so that no output overwrites it."""
        remember_input_file(self.entry_path)

    def is_done(self, entry: Document | None, key: str) -> bool:
        """Whether the log was done with this key and all its files still have their sizes."""
        if entry is None or entry.get("status") != "done" or entry.get("key") != key or not _has_all_fields(entry):
            return False
        return bool(self._file_sizes(entry["outputs"]) == entry["bytes"])

    def write_entry(self, entry: Mapping[str, Any], outputs: list[Path]) -> Document:
        """Write the log's entry with the names and sizes of its files; returns the whole entry."""
        paths = sorted(path.relative_to(self.out).as_posix() for path in outputs)
        whole = {**entry, "outputs": paths, "bytes": self._file_sizes(paths)}
        write_json_object(whole, self.entry_path)
        return whole

    def remove_all_outputs(self) -> None:
        """Remove all files of the log.

        Raises:
            OutputError: Something can't be removed.
        """
        with suppress(FileNotFoundError):  # first, so that a half-removed log does not look done
            self.entry_path.unlink()
        parts = [self.out / LOGS_FOLDER / self.id, self._partition_path(METRICS_FOLDER)]
        for kind in (DETAILS_FOLDER, TABLES_FOLDER):
            if (self.out / kind).is_dir():
                parts += [table / f"log={self.id}" for table in (self.out / kind).iterdir()]
        for part in parts:
            try:
                if part.exists():
                    shutil.rmtree(part)
            except OSError as error:
                raise OutputError(f"it can't be removed: {error.strerror}", where=str(part)) from error
        for part in parts[2:]:
            with suppress(OSError):  # it is empty only after the last log that had this table
                part.parent.rmdir()

    def _partition_path(self, *names: str) -> Path:
        return self.out.joinpath(*names, f"log={self.id}")

    def _file_sizes(self, paths: list[str]) -> list[int]:
        return [path.stat().st_size if path.is_file() else -1 for path in (self.out / name for name in paths)]


def log_id_of_annotated_file(path: Path) -> str | None:
    """The id of the drive whose annotated log in an output folder this is; None for any other file."""
    try:
        resolved = path.resolve()
        is_of_run = resolved.name == ANNOTATED_LOG_NAME and (resolved.parent / ENTRY_NAME).is_file()
    except (OSError, ValueError):  # reading the file gives the error
        return None
    return resolved.parent.name if is_of_run else None


@dataclass(frozen=True)
class RecordedLog:
    """One log of an earlier run, as its output folder records it.

    Attributes:
        id: The recorded id.
        folder: Its part of the output folder; None where the id is no plain file name and could lead elsewhere.
        entry: The log's own entry, else the manifest's, or {}.
    """

    id: str
    folder: LogOutputs | None
    entry: Document


@dataclass(frozen=True)
class RecordedRun:
    """An earlier run, as its output folder records it.

    Attributes:
        logs: In order of id.
        gates: Gate expressions of its pipeline.
    """

    logs: tuple[RecordedLog, ...]
    gates: tuple[str, ...]


def read_output_folder(out: Path) -> RecordedRun | None:
    """Read the run in an output folder: the logs in the manifest, else those that have a folder.

    The manifest of a killed run calls every log pending, so a log's own entry takes precedence. All types are checked,
    because the files may come from elsewhere.

    Returns:
        The run, or None if the folder holds none.

    Raises:
        InputError: The manifest is of another format.
    """
    remember_input_file(out / MANIFEST_NAME)
    manifest = read_json_object(out / MANIFEST_NAME) or {}
    if what := format_mismatch_text(manifest):
        raise InputError(what, where=str(out / MANIFEST_NAME), hint=OTHER_FORMAT_HINT)
    listed = manifest.get("logs")
    if not isinstance(listed, list):
        listed = [{"id": name} for name in iter_recorded_ids(out)]
        if not listed:
            return None
    given = {each["id"]: each for each in listed if isinstance(each, dict) and isinstance(each.get("id"), str)}
    logs = []
    for name, entry in sorted(given.items()):
        is_plain = name not in {"", ".", ".."} and not set(name) & {"/", "\\", "\0"}
        folder = LogOutputs(out, name) if is_plain else None
        if folder is not None:
            folder.note_entry_as_input()
        logs.append(RecordedLog(name, folder, (folder and folder.read_entry()) or entry))
    pipeline = manifest.get("pipeline")
    gates = pipeline.get("gates") if isinstance(pipeline, dict) else None
    kept = tuple(gate for gate in gates if isinstance(gate, str)) if isinstance(gates, list) else ()
    return RecordedRun(tuple(logs), kept)


def read_run_times(out: Path) -> dict[str, float]:
    """Read the seconds that the last run into a folder took for each log: id -> seconds; {} where no file says it."""
    logs = (read_json_object(out / RUN_TIMES_NAME) or {}).get("logs")
    entries = logs.items() if isinstance(logs, dict) else ()
    found = {name: entry.get("wall_s") for name, entry in entries if isinstance(entry, dict)}
    return {
        name: float(wall_s)
        for name, wall_s in found.items()
        if isinstance(wall_s, int | float) and not isinstance(wall_s, bool) and 0.0 <= wall_s < math.inf
    }


def format_mismatch_text(manifest: Mapping[str, Any]) -> str:
    """An error text for a manifest of cwcli in another format than this version's; "" for any other file.

    A folder of logs may hold a manifest.json of another tool, which is ignored.
    """
    found = manifest.get("format", MANIFEST_FORMAT)
    if found == MANIFEST_FORMAT or not ("cwcli" in manifest or isinstance(manifest.get("logs"), list)):
        return ""
    return f"a manifest of format {found!r}, and cwcli {__version__} reads format {MANIFEST_FORMAT}"


def new_log_entry(id: str, source: str) -> Document:
    """Make the entry of a log that has not been processed yet."""
    return {
        "id": id,
        "source": source,
        "sha256": None,
        "status": "failed",
        "stages": [],
        "left_out": {},
        "error": None,
        "faults": {},
        "inputs": [],
        "tables": {},
        "key": None,
    }


def _has_all_fields(entry: Document) -> bool:
    """Whether the entry of a log that is done has all fields that are read from it, in their types."""
    return (
        entry.get("error") is None
        and all(isinstance(entry.get(key), str) for key in ("id", "source", "sha256"))
        and all(isinstance(entry.get(key), list) for key in ("stages", "outputs", "bytes", "inputs"))
        and all(isinstance(entry.get(key), dict) for key in ("left_out", "faults", "tables"))
        and all(isinstance(each, str) for each in (*entry["stages"], *entry["outputs"], *entry["left_out"].values()))
        and all(isinstance(each, int) for each in entry["tables"].values())
        and all(isinstance(each, dict) and _is_message_count(each) for each in entry["inputs"])
    )


def _is_message_count(count: Document) -> bool:
    rejected = count.get("rejected")
    return (
        isinstance(count.get("read"), int)
        and isinstance(rejected, dict)
        and all(isinstance(each, int) for each in rejected.values())
    )


def write_table_with_folders(table: Table, path: Path) -> Path:
    """Write one table and create its folders; returns the path."""
    from cwcli.metrics.table import write_table

    make_folder(path.parent, parents=True)
    write_table(table, path, force=True, durable=False)
    return path


def read_json_object(path: Path) -> Document | None:
    """Read a JSON file that holds an object; None if it is missing or holds something else."""
    try:
        document = json.loads(path.read_bytes(), object_pairs_hook=_intern_strings)
    except (OSError, ValueError, RecursionError):
        return None
    return document if isinstance(document, dict) else None


def _intern_strings(pairs: list[tuple[str, Any]]) -> Document:
    """Make an object whose strings are interned, because many logs repeat them."""
    return {sys.intern(key): sys.intern(value) if type(value) is str else value for key, value in pairs}


def write_json_object(document: Mapping[str, Any], path: Path, *, durable: bool = False) -> None:
    """Write a JSON file atomically, with a line for each key and for each item below it."""
    with open_output(path, force=True, durable=durable) as output:
        before = "{\n "
        for key, value in document.items():
            output.write(f"{before}{_to_json(key)}: ".encode())
            for piece in _iter_json_lines(value):
                output.write(piece.encode())
            before = ",\n "
        output.write(b"\n}\n")


def _iter_json_lines(value: Any) -> Iterator[str]:
    # Python's own indentation takes ten times as long, of a manifest of a thousand logs several seconds
    if isinstance(value, Mapping) and value:
        for k, (key, each) in enumerate(value.items()):
            yield f"{',' if k else '{'}\n  {_to_json(str(key))}: {_to_json(each)}"
        yield "\n }"
    elif isinstance(value, list) and value:
        for k, each in enumerate(value):
            yield f"{',' if k else '['}\n  {_to_json(each)}"
        yield "\n ]"
    else:
        yield _to_json(value)


def _to_json(value: Any) -> str:
    return json.dumps(value, allow_nan=False)


def iter_recorded_ids(out: Path) -> Iterator[str]:
    """Yield the ids of the logs that have a folder, sorted."""
    logs = out / LOGS_FOLDER
    if logs.is_dir():
        yield from sorted(path.name for path in logs.iterdir() if path.is_dir())
