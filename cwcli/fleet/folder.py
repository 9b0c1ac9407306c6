"""The output folder of a run: paths of its files, and whether a log's part of it is finished.

manifest.json                                the pipeline, the logs that are done, and why others failed
run_times.json                               the only file that differs from run to run
logs/<id>/annotated.mcap                     the log with its new channels
logs/<id>/entry.json                         what became of the log; written last
logs/<id>/tables.arrows                      its tables, until those of the run hold them (`cwcli.fleet.tables`)
metrics.parquet, details/, tables/           the tables of the run
"""

from __future__ import annotations

import json
import math
import os
import shutil
import stat
from collections.abc import Iterator, Mapping
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any

from cwcli.errors import InputError, OutputError
from cwcli.input import remember_input_file
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.recording import names_of_entries
from cwcli.output import open_output
from cwcli.version import __version__

MANIFEST_FORMAT_VERSION = 2
"""Version of the manifest's format."""
MANIFEST_NAME, RUN_TIMES_NAME, LOG_ENTRY_FILE_NAME, ANNOTATED_LOG_NAME, STAGED_TABLES_FILE_NAME = (
    "manifest.json",
    "run_times.json",
    "entry.json",
    "annotated.mcap",
    "tables.arrows",
)
"""Names of the files in the output folder."""
ENDED_LOG_STATUSES = ("done", "failed")
"""Statuses of a log that has ended; a manifest with one is that of a run that has ended, too."""
SHARD_KEY = "shard"
"""Key of the manifest with the number of the shard and of all shards; a whole run has none."""
NOT_DONE_TEXT = "it was not processed"
"""Error text of a log that has no entry."""
HINT_ON_MANIFEST_OF_OTHER_FORMAT = "use the version of cwcli that wrote it, or do the run again into a new folder"
"""Hint of the error about a manifest in another format."""
TABLES_KEY = "tables"
"""Key of the manifest with the names of the run's tables."""
HEADLINE_METRIC_REFERENCES_KEY = "scores"
"""Key of a log's entry with what its headline metrics were held against, and notes on them."""
LOGS_FOLDER, SCRATCH_FOLDER = "logs", ".scratch"
"""Names of the subfolders of the output folder."""

MAX_JSON_BYTES = 1_000_000_000
"""The greatest size of a manifest. Chosen by hand: 10^5 logs take 0.2 GB."""
LINES_WRITTEN_AT_ONCE = 100
"""Number of lines of JSON that are written at a time. Chosen by hand: each has some kB at most."""

Document = dict[str, Any]


@dataclass(frozen=True)
class LogOutputs:
    """One log's part of the output folder."""

    out: Path
    id: str

    @property
    def annotated_log_path(self) -> Path:
        """Path of the annotated log."""
        return self.out / LOGS_FOLDER / self.id / ANNOTATED_LOG_NAME

    @property
    def staged_tables_path(self) -> Path:
        """Path of the log's tables, which is there until the tables of the run hold them."""
        return self.out / LOGS_FOLDER / self.id / STAGED_TABLES_FILE_NAME

    def read_entry(self) -> Document | None:
        """Read the log's entry; None if there is none or it can't be read."""
        with suppress(InputError):  # too large
            return read_json_object(self.entry_path)
        return None

    @property
    def entry_path(self) -> Path:
        """Path of the log's entry."""
        return self.out / LOGS_FOLDER / self.id / LOG_ENTRY_FILE_NAME

    def note_entry_as_input(self) -> None:
        """Register the entry as an input of this run, so that no output overwrites it."""
        remember_input_file(self.entry_path)

    def is_log_done_with_key(self, entry: Document | None, key: str, *, has_tables: bool) -> bool:
        """Whether the log was done with this key, its files have their sizes, and its rows are there.

        Args:
            has_tables: Whether the tables of the run are whole; else the log's own tables must be there.
        """
        if entry is None or entry.get("status") != "done" or entry.get("key") != key or not _has_all_fields(entry):
            return False
        if self._file_sizes(entry["outputs"]) != entry["bytes"]:
            return False
        return has_tables or self.staged_tables_path.is_file()

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
        path = self.out / LOGS_FOLDER / self.id
        try:
            if path.exists():
                shutil.rmtree(path)
        except OSError as error:
            raise OutputError(f"it can't be removed: {error.strerror}", where=str(path)) from error

    def _file_sizes(self, paths: list[str]) -> list[int]:
        return [_file_size(f"{self.out}/{name}") for name in paths]


def _file_size(path: str) -> int:
    """Return the size of a regular file in bytes; -1 if there is none."""
    try:
        found = os.stat(path)  # noqa: PTH116 - asked for every log of a run, and a `Path` takes longer
    except (OSError, ValueError):
        return -1
    return found.st_size if stat.S_ISREG(found.st_mode) else -1


def log_id_of_annotated_file(path: Path) -> str | None:
    """The id of the drive whose annotated log in an output folder this is; None for any other file."""
    try:
        resolved = path.resolve()
        is_of_run = resolved.name == ANNOTATED_LOG_NAME and (resolved.parent / LOG_ENTRY_FILE_NAME).is_file()
    except (OSError, ValueError):  # reading the file gives the error
        return None
    return resolved.parent.name if is_of_run else None


@dataclass(frozen=True)
class RecordedLog:
    """One log of an earlier run, as its output folder records it.

    Attributes:
        folder: Its part of the output folder; None where the id is no plain file name and could lead elsewhere.
        entry: The log's own entry, else the manifest's, or {}.
        run_url: URL of the run, if the folder is a copy of it without the annotated logs.
    """

    id: str
    folder: LogOutputs | None
    entry: Document
    run_url: str = ""

    def find_annotated_log(self) -> str | None:
        """Return the path or the URL of the annotated log; None if there is none."""
        if self.folder is None:
            return None
        path = self.folder.annotated_log_path
        if not self.run_url:
            return str(path) if path.is_file() else None
        name, outputs = path.relative_to(self.folder.out).as_posix(), self.entry.get("outputs")
        return f"{self.run_url}/{name}" if isinstance(outputs, list) and name in outputs else None


@dataclass(frozen=True)
class RecordedRun:
    """An earlier run, as its output folder records it.

    Attributes:
        path: The folder with its tables.
        url: URL of the run, if the folder is a copy of it.
    """

    path: Path
    logs: tuple[RecordedLog, ...]
    gates: tuple[str, ...]
    url: str = ""

    def path_or_url_of_file(self, path: Path) -> str:
        """Return what a file of the folder is called for the user."""
        return f"{self.url}/{path.relative_to(self.path).as_posix()}" if self.url else str(path)


def read_output_folder(out: Path, url: str = "") -> RecordedRun | None:
    """Read the run in an output folder: the logs in the manifest, else those that have a folder.

    The manifest of a killed run calls every log pending; then its own entry is read. All types are checked, because the
    files may come from elsewhere.

    Args:
        url: URL of the run, if the folder is a copy of it.

    Returns:
        The run, or None if the folder holds none.

    Raises:
        InputError: The manifest is of another format.
    """
    remember_input_file(out / MANIFEST_NAME)
    manifest = read_json_object(out / MANIFEST_NAME) or {}
    if what := format_mismatch_text_or_empty(manifest):
        raise InputError(what, where=f"{url or out}/{MANIFEST_NAME}", hint=HINT_ON_MANIFEST_OF_OTHER_FORMAT)
    listed = manifest.get("logs")
    if not isinstance(listed, list):
        listed = [{"id": name} for name in iter_recorded_log_ids(out)]
        if not listed:
            return None
    entry_by_id = {each["id"]: each for each in listed if isinstance(each, dict) and isinstance(each.get("id"), str)}
    logs = []
    for name, entry in sorted(entry_by_id.items()):
        is_plain = name not in {"", ".", ".."} and not set(name) & {"/", "\\", "\0"}
        folder = LogOutputs(out, name) if is_plain else None
        if folder is not None:
            folder.note_entry_as_input()
        # the manifest of a run that was killed knows of no log that has ended
        own = folder.read_entry() if folder is not None and entry.get("status") not in ENDED_LOG_STATUSES else None
        logs.append(RecordedLog(name, folder, own or entry, url))
    return RecordedRun(out, tuple(logs), gates_of_manifest(manifest), url)


def gates_of_manifest(manifest: Document) -> tuple[str, ...]:
    """Return the gates in a manifest; () where it holds none, for it may come from elsewhere."""
    pipeline = manifest.get("pipeline")
    gates = pipeline.get("gates") if isinstance(pipeline, dict) else None
    return tuple(gate for gate in gates if isinstance(gate, str)) if isinstance(gates, list) else ()


def read_run_time_s_by_log(out: Path) -> dict[str, float]:
    """Read the seconds that the last run into a folder took for each log: id -> seconds; {} where no file says it."""
    logs = (read_json_object(out / RUN_TIMES_NAME) or {}).get("logs")
    entries = logs.items() if isinstance(logs, dict) else ()
    found = {name: entry.get("wall_s") for name, entry in entries if isinstance(entry, dict)}
    return {
        name: float(wall_s)
        for name, wall_s in found.items()
        if isinstance(wall_s, int | float) and not isinstance(wall_s, bool) and 0.0 <= wall_s < math.inf
    }


def format_mismatch_text_or_empty(manifest: Mapping[str, Any]) -> str:
    """An error text for a manifest of cwcli in another format than this version's; "" for any other file.

    A folder of logs may hold a manifest.json of another tool, which is ignored.
    """
    found = manifest.get("format", MANIFEST_FORMAT_VERSION)
    if found == MANIFEST_FORMAT_VERSION or not ("cwcli" in manifest or isinstance(manifest.get("logs"), list)):
        return ""
    return f"a manifest of format {found!r}, and cwcli {__version__} reads format {MANIFEST_FORMAT_VERSION}"


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
        HEADLINE_METRIC_REFERENCES_KEY: {},
        "key": None,
    }


def _has_all_fields(entry: Document) -> bool:
    """Whether the entry of a log that is done has all fields that are read from it, in their types."""
    return (
        entry.get("error") is None
        and all(isinstance(entry.get(key), str) for key in ("id", "source", "sha256"))
        and all(isinstance(entry.get(key), list) for key in ("stages", "outputs", "bytes", "inputs"))
        and all(
            isinstance(entry.get(key), dict) for key in ("left_out", "faults", "tables", HEADLINE_METRIC_REFERENCES_KEY)
        )
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


def read_json_object(path: Path) -> Document | None:
    """Read a JSON file that holds an object; None if it is missing, no regular file, or holds something else.

    Raises:
        InputError: It has more than `MAX_JSON_BYTES`.
    """
    try:
        if not path.is_file():
            return None
        if path.stat().st_size > MAX_JSON_BYTES:
            raise InputError(f"it has more than {MAX_JSON_BYTES / 1e9:g} GB, the most that is read", where=str(path))
        document = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
    return document if isinstance(document, dict) else None


def write_json_object(document: Mapping[str, Any], path: Path, *, durable: bool = False) -> None:
    """Write a JSON file atomically, with a line for each key and for each item below it."""
    with open_output(path, force=True, durable=durable) as output:
        before = "{\n "
        for key, value in document.items():
            output.write(f"{before}{_to_json(key)}: ".encode())
            lines = _iter_json_lines(value)
            while some := [*islice(lines, LINES_WRITTEN_AT_ONCE)]:
                output.write("".join(some).encode())
            before = ",\n "
        output.write(b"\n}\n")


class JsonText(str):
    """A value as JSON, as `write_json_object` writes it; it takes a quarter of the memory of what it says."""

    __slots__ = ()

    @classmethod
    def encode_value(cls, value: Any) -> JsonText:
        """Return a value as JSON."""
        return cls(_to_json(value))


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


_encode_as_json = json.JSONEncoder(allow_nan=False).encode  # `json.dumps` makes an encoder at each call


def _to_json(value: Any) -> str:
    return value if isinstance(value, JsonText) else _encode_as_json(value)


def iter_recorded_log_ids(out: Path) -> Iterator[str]:
    """Yield the ids of the logs that have a folder, sorted."""
    logs = out / LOGS_FOLDER
    if logs.is_dir():
        yield from sorted(names_of_entries(logs, os.DirEntry.is_dir))
