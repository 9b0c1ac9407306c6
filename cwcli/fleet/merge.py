"""Merges the output folders of a run's shards into the folder that one run over all logs would have written."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from cwcli.errors import InputError, OutputError, UsageError
from cwcli.evaluation.setting_changes import iter_changed_values
from cwcli.fleet.folder import (
    ENDED_LOG_STATUSES,
    HINT_ON_MANIFEST_OF_OTHER_FORMAT,
    MANIFEST_NAME,
    RUN_TIMES_NAME,
    SHARD_KEY,
    TABLES_KEY,
    Document,
    JsonText,
    LogOutputs,
    format_mismatch_text_or_empty,
    read_json_object,
    write_json_object,
)
from cwcli.fleet.index import FOLDERS_WITH_RESULTS
from cwcli.fleet.input_states import INPUT_STATES_KEY
from cwcli.fleet.remote_folder import StoreFolder, copy_remote_folder
from cwcli.fleet.run import lock_folder
from cwcli.fleet.shard import MAX_SHARDS
from cwcli.fleet.tables import MergedRows, are_tables_whole, iter_table_names, write_tables
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.remote import is_remote_url
from cwcli.output import make_folder
from cwcli.temporary import TemporaryFile
from cwcli.text import join_names, shorten_and_escape

RUN_AGAIN_HINT = "run the shard again with the same command: it continues"
"""Advice on a shard that was killed."""
SHARD_COPIES_FOLDER = ".merge"
"""Subfolder of the output folder with copies of shards from a store while they are merged; a run never uses it."""
MANIFEST_KEYS_OF_ALL_SHARDS = ("format", "cwcli", "run_id", "pipeline")
"""Keys of the manifest that all shards share."""
MAX_SHOWN_CHARS_OF_DIFFERING_SETTING = 40
"""Greatest number of characters that are shown of a setting that differs: a whole stage would be a page of JSON. Chosen
by hand."""


class _ShardFolder(NamedTuple):
    """The output folder of one shard, its manifest without the logs, and the entry of each log."""

    path: Path
    manifest: Document
    entries: list[JsonText]


class _EntryOfShard(NamedTuple):
    """The entry of one log, and the folder of the shard that has it."""

    path: Path
    source: object
    status: str
    text: JsonText


@dataclass(frozen=True)
class MergeResult:
    """What was merged.

    Attributes:
        n_logs, n_failed: Number of logs, and of those that failed.
        n_copied: Number of logs that were not in the folder yet.
        n_shards: Number of folders that were merged.
    """

    n_logs: int
    n_failed: int
    n_copied: int
    n_shards: int


def merge_shards(
    folders: Sequence[str], out: str | Path, report: Callable[[int, int], None] = lambda done, total: None
) -> MergeResult:
    """Merge the output folders of all shards of one run.

    Each log's entry is written last, so a merge that was killed goes on where it was. Equal files of the shards are
    linked where the file system can, else copied.

    Args:
        folders: The output folders of the shards, on this machine or as URLs of a store, which are copied first.
        out: The folder of the whole run, on this machine or as a URL of a store: new, or of a merge that was killed.
        report: Called with the number of merged logs and of all.

    Raises:
        InputError: A folder holds no run, a log is not done, or a shard is missing.
        UsageError: The shards are of different pipelines or versions, a log is in two of them with different results,
            or the output is one of them.
        OutputError: The folder holds something else, is in use, or can't be written.
    """
    if is_remote_url(str(out)):
        with StoreFolder(str(out)) as store:
            result = _merge_into(folders, store.path, report)
            store.send_all()
            return result
    return _merge_into(folders, Path(os.path.abspath(out)), report)  # noqa: PTH100 - links stay as they are


def _merge_into(folders: Sequence[str], target: Path, report: Callable[[int, int], None]) -> MergeResult:
    """Merge folders on this machine and in stores into one on this machine."""
    if not any(map(is_remote_url, folders)):
        return _merge_folders([Path(each) for each in folders], target, report)
    is_new, scratch = not target.exists(), target / SHARD_COPIES_FOLDER
    with lock_folder(scratch):
        try:
            return _merge_folders([_local_folder(each, scratch) for each in folders], target, report)
        finally:
            shutil.rmtree(scratch, ignore_errors=True)
            if is_new:
                with suppress(OSError):  # it is empty where nothing was merged
                    target.rmdir()


def _local_folder(folder: str, scratch: Path) -> Path:
    """Return the folder, or that of a copy below `scratch` if it is a URL."""
    if not is_remote_url(folder):
        return Path(folder)
    scheme, _, path = folder.partition("://")
    copy = scratch.joinpath(scheme, *(part for part in path.split("/") if part not in {"", ".", ".."}))
    copy_remote_folder(folder, copy)
    return copy


def _merge_folders(folders: Sequence[Path], target: Path, report: Callable[[int, int], None]) -> MergeResult:
    """Merge folders on this machine."""
    shards = [_read_shard(each) for each in folders]
    if any(target.resolve() == each.path.resolve() for each in shards):
        raise UsageError(
            "the output folder is one of the shards", where=str(target), hint="name another folder with -d"
        )
    _require_equal_runs(shards)
    _require_all_shards(shards)
    entries = _collect_entries(shards)
    manifest = {key: shards[0].manifest[key] for key in MANIFEST_KEYS_OF_ALL_SHARDS}
    with lock_folder(target):
        _refuse_other_content(target, manifest, set(entries))
        _write_manifest_with_all_logs_pending(manifest, entries, target)
        n_copied = 0
        for k, (name, each) in enumerate(entries.items()):
            own, merged = LogOutputs(each.path, name), LogOutputs(target, name)
            n_copied += _merge_log_and_tell_if_new(own, merged, json.loads(each.text))
            report(k + 1, len(entries))
        rows = {each.path: MergedRows(each.path) for each in shards}
        rows_of_done_logs = {name: rows[each.path] for name, each in entries.items() if each.status == "done"}
        tables = write_tables(target, rows_of_done_logs, manifest["run_id"])
        write_json_object(_merge_run_times(shards), target / RUN_TIMES_NAME)
        whole = [each.text for each in entries.values()]
        write_json_object({**manifest, TABLES_KEY: tables, "logs": whole}, target / MANIFEST_NAME, durable=True)
    n_failed = sum(each.status == "failed" for each in entries.values())
    return MergeResult(len(whole), n_failed, n_copied, len(shards))


def _write_manifest_with_all_logs_pending(manifest: Document, entries: dict[str, _EntryOfShard], target: Path) -> None:
    """Write the manifest of a merge that has begun."""
    pending = [
        {"id": name, "source": each.source, "status": "pending", "error": None} for name, each in entries.items()
    ]
    write_json_object({**manifest, TABLES_KEY: [], "logs": pending}, target / MANIFEST_NAME)


def _read_shard(path: Path) -> _ShardFolder:
    """Read the manifest of a shard; raise `InputError` if it holds none that this version can read."""
    manifest = read_json_object(path / MANIFEST_NAME)
    if manifest is None:
        raise InputError(f"the folder holds no run (no {MANIFEST_NAME} that can be read)", where=str(path))
    lacking = [key for key in MANIFEST_KEYS_OF_ALL_SHARDS if key not in manifest]
    if lacking or not isinstance(manifest.get("logs"), list):
        what = f"the manifest lacks {join_names([repr(key) for key in lacking] or ['the list of logs'])}"
        raise InputError(what, where=str(path / MANIFEST_NAME), hint="run `cwcli run` with this --shard again")
    if what := format_mismatch_text_or_empty(manifest):
        raise InputError(what, where=str(path / MANIFEST_NAME), hint=HINT_ON_MANIFEST_OF_OTHER_FORMAT)
    try:
        return _ShardFolder(path, manifest, [JsonText.encode_value(each) for each in manifest.pop("logs")])
    except ValueError as error:  # NaN is no number in JSON, though Python reads it
        raise InputError(f"the manifest can't be read: {error}", where=str(path / MANIFEST_NAME)) from error


def _require_equal_runs(shards: Sequence[_ShardFolder]) -> None:
    """Raise `UsageError` if the shards differ in pipeline or version."""
    first = shards[0]
    for each in shards[1:]:
        for key, what in (
            ("cwcli", "version of cwcli"),
            ("pipeline", "pipeline"),
            ("run_id", "set of options or version of the tables"),
        ):
            if each.manifest[key] != first.manifest[key]:
                changes = iter_changed_values({key: first.manifest[key]}, {key: each.manifest[key]})
                name, was, now = next(changes)
                was, now = (
                    shorten_and_escape(value, MAX_SHOWN_CHARS_OF_DIFFERING_SETTING) or "not set" for value in (was, now)
                )
                setting = (
                    f": {was} and {now}" if name == key else f": {name.removeprefix(f'{key}.')} is {was} and {now}"
                )
                raise UsageError(
                    f"{first.path} and {each.path} were made by another {what}{setting}",
                    hint="run the shards again with one command and one version",
                )


def _require_all_shards(shards: Sequence[_ShardFolder]) -> None:
    """Raise an error if the shards are not all those of one run, each once; whole runs may be merged, too."""
    numbers: dict[int, Path] = {}
    counts: set[int] = set()
    for each in shards:
        shard = each.manifest.get(SHARD_KEY)
        if not isinstance(shard, dict):
            continue
        index, count = shard.get("index"), shard.get("count")
        if type(index) is not int or type(count) is not int or not 1 <= index <= count <= MAX_SHARDS:
            raise InputError("the manifest does not say which shard it is", where=str(each.path / MANIFEST_NAME))
        if index in numbers:
            raise UsageError(f"{numbers[index]} and {each.path} are both shard {index}/{count}")
        numbers[index] = each.path
        counts.add(count)
    if len(counts) > 1:
        raise UsageError(f"the shards are of runs in {' and '.join(map(str, sorted(counts)))} parts")
    wholes = [each.path for each in shards if not isinstance(each.manifest.get(SHARD_KEY), dict)]
    missing = [str(index) for count in counts for index in range(1, count + 1) if index not in numbers]
    if missing and wholes:
        raise UsageError(
            f"{wholes[0]} holds all logs of its run, and {next(iter(numbers.values()))} a part of one",
            hint="merge all shards of a run, or whole runs",
        )
    if missing:
        raise InputError(
            f"{len(missing)} of {max(counts)} shards are missing: {', '.join(missing[:10])}", where=str(shards[0].path)
        )


def _collect_entries(shards: Sequence[_ShardFolder]) -> dict[str, _EntryOfShard]:
    """Return id -> entry of each log, in order of id.

    Raises:
        InputError: A log is not done, its id is no file name, or files or tables are not those that were written.
        UsageError: A log is in two shards with different results.
    """
    found: dict[str, _EntryOfShard] = {}
    for path, manifest, texts in shards:
        if not are_tables_whole(path, manifest.get(TABLES_KEY)):
            raise InputError("tables of the run are missing or changed", where=str(path), hint=RUN_AGAIN_HINT)
        for text in texts:
            listed = json.loads(text)
            name = listed.get("id") if isinstance(listed, dict) else None
            if not isinstance(name, str) or name in {"", ".", ".."} or set(name) & {"/", "\\", "\0"}:
                raise InputError(f"the log id {name!r} is not the name of a file", where=str(path / MANIFEST_NAME))
            folder = LogOutputs(path, name)
            entry = listed
            if entry.get("status") not in ENDED_LOG_STATUSES:
                raise InputError(f"the log {name} is not done", where=str(path), hint=RUN_AGAIN_HINT)
            if entry["status"] == "done" and not folder.is_log_done_with_key(
                entry, str(entry.get("key")), has_tables=True
            ):
                raise InputError(
                    f"files of the log {name} are missing or changed", where=str(path), hint=RUN_AGAIN_HINT
                )
            _refuse_files_elsewhere(entry.get("outputs", []), folder)
            if name in found and found[name].text != text:
                raise UsageError(f"the log {name} is in {found[name].path} and in {path}, with different results")
            found.setdefault(name, _EntryOfShard(path, entry.get("source"), entry["status"], text))
    return dict(sorted(found.items()))


def _refuse_files_elsewhere(names: object, folder: LogOutputs) -> None:
    """Raise `InputError` if files of a log are not right in its folder; a manifest of others may name any file."""
    own = folder.entry_path.parent.relative_to(folder.out).as_posix()
    for name in names if isinstance(names, list) else [None]:
        parent, _, file = name.rpartition("/") if isinstance(name, str) else ("", "", "")
        if parent != own or file in {"", ".", ".."} or set(file) & {"\\", "\0"}:
            what = f"the log {folder.id} has a file {name!r}, which is not in its folder"
            raise InputError(what, where=str(folder.out / MANIFEST_NAME))


def _refuse_other_content(target: Path, manifest: Document, names: set[str]) -> None:
    """Raise `OutputError` if the output folder holds anything but a part of this merge."""
    ours = [*(each for each in FOLDERS_WITH_RESULTS if (target / each).exists()), *iter_table_names(target)]
    known = read_json_object(target / MANIFEST_NAME)
    if known is None and not ours:
        return
    hint = "name a new folder with -d"
    if known is None or any(known.get(key) != manifest[key] for key in MANIFEST_KEYS_OF_ALL_SHARDS):
        raise OutputError("the folder holds something else than this run", where=str(target), hint=hint)
    others = {each.get("id") for each in known.get("logs", []) if isinstance(each, dict)} - names
    if others:
        raise OutputError(f"the folder holds {len(others)} logs that no shard has", where=str(target), hint=hint)


def _merge_log_and_tell_if_new(source: LogOutputs, target: LogOutputs, entry: Document) -> bool:
    """Bring one log's files into the merged folder, its entry last; return whether it was not there yet.

    Raises:
        InputError: A file of the shard has changed since the shards were checked.
    """
    is_done = entry["status"] == "failed" or target.is_log_done_with_key(entry, str(entry.get("key")), has_tables=True)
    if target.read_entry() == entry and is_done:
        return False
    target.remove_all_outputs()
    for name in entry.get("outputs", []):
        _link_or_copy(source.out / name, target.out / name)
    if entry["status"] == "done" and not target.is_log_done_with_key(entry, str(entry.get("key")), has_tables=True):
        target.remove_all_outputs()
        what = f"files of the log {source.id} changed while they were merged"
        raise InputError(what, where=str(source.out), hint=RUN_AGAIN_HINT)
    if source.read_entry() == entry:
        _link_or_copy(source.entry_path, target.entry_path)
    else:
        make_folder(target.annotated_log_path.parent, parents=True)
        write_json_object(entry, target.entry_path)
    return True


def _link_or_copy(source: Path, target: Path) -> None:
    """Make a file appear whole under another name.

    Raises:
        OutputError: It can't be written.
    """
    make_folder(target.parent, parents=True)
    try:
        with suppress(FileNotFoundError):
            target.unlink()
        try:
            os.link(source, target)
        except OSError:  # another file system, or one without links
            _copy_atomically(source, target)
    except OSError as error:
        raise OutputError(f"it can't be written: {error.strerror}", where=str(target)) from error


def _copy_atomically(source: Path, target: Path) -> None:
    """Copy a file, which appears when it is whole; a copy that fails leaves nothing.

    Raises:
        OSError: It can't be read or written.
    """
    temporary = TemporaryFile(target)
    try:
        with source.open("rb") as original, os.fdopen(temporary.descriptor, "wb", closefd=False) as copy:
            shutil.copyfileobj(original, copy)
        temporary.publish()
    except BaseException:
        temporary.discard()
        raise


def _merge_run_times(shards: Sequence[_ShardFolder]) -> Document:
    """Return the run times of all shards as one document."""
    times: dict[str, Any] = {}
    states: dict[str, Any] = {}
    began: list[str] = []
    wall_s = 0.0
    for path, *_ in shards:
        document = read_json_object(path / RUN_TIMES_NAME) or {}
        times |= document["logs"] if isinstance(document.get("logs"), dict) else {}
        states |= document[INPUT_STATES_KEY] if isinstance(document.get(INPUT_STATES_KEY), dict) else {}
        began += [document["began"]] if isinstance(document.get("began"), str) else []
        wall_s = max(wall_s, document["wall_s"] if isinstance(document.get("wall_s"), int | float) else 0.0)
    return {
        "began": min(began, default=""),
        "wall_s": wall_s,
        "logs": dict(sorted(times.items())),
        INPUT_STATES_KEY: dict(sorted(states.items())),
    }
