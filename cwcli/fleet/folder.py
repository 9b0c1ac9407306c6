"""The output folder: what lies where, and whether a log's part of it is finished.

manifest.json                                what was to be done, what was done, what failed and why
run_times.json                               the only file that differs from run to run
logs/<id>/annotated.mcap                     the log with its new channels
logs/<id>/entry.json                         written last: the log is done
metrics/log=<id>/metrics.parquet             headline metrics; all logs together are one table
details/<table>/log=<id>/<table>.parquet     each table of each stage, likewise
tables/<channel>/log=<id>/<channel>.parquet  the channels' columns (`--tables`)
"""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cwcli import __version__
from cwcli.errors import InputError, OutputError
from cwcli.input import note_input
from cwcli.output import make_folder, open_output

if TYPE_CHECKING:
    from cwcli.metrics.table import Table

FORMAT = 1
MANIFEST, RUN_TIMES, ENTRY, ANNOTATED = "manifest.json", "run_times.json", "entry.json", "annotated.mcap"
NOT_DONE = "it was not done"
OTHER_FORMAT_HINT = "use the version of cwcli that wrote it, or do the run again into a new folder"
LOGS, METRICS, DETAILS, TABLES, SCRATCH = "logs", "metrics", "details", "tables", ".scratch"

Document = dict[str, Any]


@dataclass(frozen=True)
class LogFolder:
    """One log's part of the output folder.

    Attributes:
        out: The output folder.
        id: The log's safe, unique name.
    """

    out: Path
    id: str

    @property
    def annotated(self) -> Path:
        """The log with its new channels."""
        return self.out / LOGS / self.id / ANNOTATED

    @property
    def metrics(self) -> Path:
        """The file of headline metrics."""
        return self._part(METRICS) / f"{METRICS}.parquet"

    def table(self, kind: str, name: str) -> Path:
        """The file of one table, of `kind` details or tables."""
        return self._part(kind, name) / f"{name}.parquet"

    def entry(self) -> Document | None:
        """What was recorded of the log; None if nothing was, or it can't be read."""
        return read_document(self._entry)

    @property
    def _entry(self) -> Path:
        return self.out / LOGS / self.id / ENTRY

    def note(self) -> None:
        """Remember the entry as an input: this run only reads it."""
        note_input(self._entry)

    def is_done(self, entry: Document | None, key: str) -> bool:
        """Whether the log was done with this key, and every file of it is still there in full."""
        if entry is None or entry.get("status") != "done" or entry.get("key") != key or not _is_whole(entry):
            return False
        return bool(self._sizes(entry["outputs"]) == entry["bytes"])

    def finish(self, entry: Mapping[str, Any], outputs: list[Path]) -> Document:
        """Record what became of the log; returns the whole entry."""
        paths = sorted(path.relative_to(self.out).as_posix() for path in outputs)
        whole = {**entry, "outputs": paths, "bytes": self._sizes(paths)}
        write_document(whole, self._entry)
        return whole

    def clear(self) -> None:
        """Remove everything of the log.

        Raises:
            OutputError: Something can't be removed.
        """
        with suppress(FileNotFoundError):  # first, so that a half-removed log does not look done
            self._entry.unlink()
        parts = [self.out / LOGS / self.id, self._part(METRICS)]
        for kind in (DETAILS, TABLES):
            if (self.out / kind).is_dir():
                parts += [table / f"log={self.id}" for table in (self.out / kind).iterdir()]
        for part in parts:
            try:
                if part.exists():
                    shutil.rmtree(part)
            except OSError as error:
                raise OutputError(f"it can't be removed: {error.strerror}", where=str(part)) from error
        for part in parts[2:]:
            with suppress(OSError):  # the last log that had this table
                part.parent.rmdir()

    def _part(self, *names: str) -> Path:
        return self.out.joinpath(*names, f"log={self.id}")

    def _sizes(self, paths: list[str]) -> list[int]:
        return [path.stat().st_size if path.is_file() else -1 for path in (self.out / name for name in paths)]


def id_of_annotated(path: Path) -> str | None:
    """The id of the drive whose annotated log in an output folder this is; None for any other file."""
    try:
        resolved = path.resolve()
        is_of_run = resolved.name == ANNOTATED and (resolved.parent / ENTRY).is_file()
    except (OSError, ValueError):  # whoever reads it tells what is wrong
        return None
    return resolved.parent.name if is_of_run else None


@dataclass(frozen=True)
class RecordedLog:
    """What is known of one log of a run.

    Attributes:
        id: As it is recorded.
        folder: Its part of the output folder; None where the id is no name of a file: it could lead elsewhere.
        entry: Its own, else the manifest's, or {}.
    """

    id: str
    folder: LogFolder | None
    entry: Document


@dataclass(frozen=True)
class RecordedRun:
    """What is known of a run.

    Attributes:
        logs: In order of id.
        gates: Gate expressions of its pipeline.
    """

    logs: tuple[RecordedLog, ...]
    gates: tuple[str, ...]


def read_output(out: Path) -> RecordedRun | None:
    """The run whose output folder this is: the logs that the manifest names; without one, those that have a folder.

    A killed run's manifest calls every log pending, so a log's own entry counts more. None of it is believed further
    than its types go: the files may be anybody's.

    Returns:
        The run, or None if the folder holds none.

    Raises:
        InputError: The manifest is of another format.
    """
    note_input(out / MANIFEST)
    manifest = read_document(out / MANIFEST) or {}
    if what := other_format(manifest):
        raise InputError(what, where=str(out / MANIFEST), hint=OTHER_FORMAT_HINT)
    listed = manifest.get("logs")
    if not isinstance(listed, list):
        listed = [{"id": name} for name in recorded_ids(out)]
        if not listed:
            return None
    given = {each["id"]: each for each in listed if isinstance(each, dict) and isinstance(each.get("id"), str)}
    logs = []
    for name, entry in sorted(given.items()):
        is_plain = name not in {"", ".", ".."} and not set(name) & {"/", "\\", "\0"}
        folder = LogFolder(out, name) if is_plain else None
        if folder is not None:
            folder.note()
        logs.append(RecordedLog(name, folder, (folder and folder.entry()) or entry))
    pipeline = manifest.get("pipeline")
    gates = pipeline.get("gates") if isinstance(pipeline, dict) else None
    kept = tuple(gate for gate in gates if isinstance(gate, str)) if isinstance(gates, list) else ()
    return RecordedRun(tuple(logs), kept)


def other_format(manifest: Mapping[str, Any]) -> str:
    """What to say of a manifest that cwcli wrote in another format than this version's; "" if there is nothing to say.

    A folder of logs may hold a manifest.json of another tool: that is nobody's run.
    """
    found = manifest.get("format", FORMAT)
    if found == FORMAT or not ("cwcli" in manifest or isinstance(manifest.get("logs"), list)):
        return ""
    return f"a manifest of format {found!r}, and cwcli {__version__} reads format {FORMAT}"


def new_entry(id: str, source: str) -> Document:
    """The entry of a log of which nothing is known yet but that it is there."""
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


def _is_whole(entry: Document) -> bool:
    """Whether an entry of a log that is done has what is read of it: nobody may have changed it since."""
    return (
        entry.get("error") is None
        and all(isinstance(entry.get(key), str) for key in ("id", "source", "sha256"))
        and all(isinstance(entry.get(key), list) for key in ("stages", "outputs", "bytes", "inputs"))
        and all(isinstance(entry.get(key), dict) for key in ("left_out", "faults", "tables"))
        and all(isinstance(each, str) for each in (*entry["stages"], *entry["outputs"], *entry["left_out"].values()))
        and all(isinstance(each, int) for each in entry["tables"].values())
        and all(isinstance(each, dict) and _is_count(each) for each in entry["inputs"])
    )


def _is_count(count: Document) -> bool:
    rejected = count.get("rejected")
    return (
        isinstance(count.get("read"), int)
        and isinstance(rejected, dict)
        and all(isinstance(each, int) for each in rejected.values())
    )


def put_table(table: Table, path: Path) -> Path:
    """Write one table, with its folders."""
    from cwcli.metrics.table import write_table

    make_folder(path.parent, parents=True)
    write_table(table, path, force=True, durable=False)
    return path


def read_document(path: Path) -> Document | None:
    """A JSON file of ours; None if it is not there or is no JSON object."""
    try:
        document = json.loads(path.read_bytes(), object_pairs_hook=_shared)
    except (OSError, ValueError, RecursionError):
        return None
    return document if isinstance(document, dict) else None


def _shared(pairs: list[tuple[str, Any]]) -> Document:
    """An object whose words are kept once, however many logs have them."""
    return {sys.intern(key): sys.intern(value) if type(value) is str else value for key, value in pairs}


def write_document(document: Mapping[str, Any], path: Path, *, durable: bool = False) -> None:
    """Write a JSON file that appears whole or not at all: a line for each key, and for each thing right below one."""
    with open_output(path, force=True, durable=durable) as output:
        before = "{\n "
        for key, value in document.items():
            output.write(f"{before}{_json(key)}: ".encode())
            for piece in _json_lines(value):
                output.write(piece.encode())
            before = ",\n "
        output.write(b"\n}\n")


def _json_lines(value: Any) -> Iterator[str]:
    # Python's own indentation takes ten times as long, of a manifest of a thousand logs several seconds
    if isinstance(value, Mapping) and value:
        for k, (key, each) in enumerate(value.items()):
            yield f"{',' if k else '{'}\n  {_json(str(key))}: {_json(each)}"
        yield "\n }"
    elif isinstance(value, list) and value:
        for k, each in enumerate(value):
            yield f"{',' if k else '['}\n  {_json(each)}"
        yield "\n ]"
    else:
        yield _json(value)


def _json(value: Any) -> str:
    return json.dumps(value, allow_nan=False)


def recorded_ids(out: Path) -> Iterator[str]:
    """Names of the logs that have a folder, in order."""
    logs = out / LOGS
    if logs.is_dir():
        yield from sorted(path.name for path in logs.iterdir() if path.is_dir())
