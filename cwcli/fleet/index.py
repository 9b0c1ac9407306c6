"""What the output folder of a run says of its logs in one file, the manifest, so that a rerun reads no other."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from cwcli.errors import OutputError
from cwcli.fleet.folder import (
    ENDED_LOG_STATUSES,
    HINT_ON_MANIFEST_OF_OTHER_FORMAT,
    LOGS_FOLDER,
    MANIFEST_FORMAT_VERSION,
    MANIFEST_NAME,
    RUN_TIMES_NAME,
    SHARD_KEY,
    Document,
    LogOutputs,
    format_mismatch_text_or_empty,
    gates_of_manifest,
    read_json_object,
)
from cwcli.fleet.input_states import FileState, file_states_from_run_times, read_file_state
from cwcli.fleet.plan import FleetPlan, LogTask, make_cache_key
from cwcli.fleet.tables import DETAILS_FOLDER, TABLES_FOLDER, iter_table_names
from cwcli.version import __version__

FOLDERS_WITH_RESULTS = (LOGS_FOLDER, DETAILS_FOLDER, TABLES_FOLDER)
"""Subfolders of the output folder with results."""
MAX_NAMES_LISTED_IN_ERROR = 10
"""Largest number of names in an error; chosen by hand."""


def manifest_without_logs(plan: FleetPlan) -> Document:
    """Make the part of the manifest that does not depend on the logs."""
    shard = {} if plan.shard is None else {SHARD_KEY: {"index": plan.shard.index, "count": plan.shard.count}}
    run = {"run_id": plan.run_id, "pipeline": dict(plan.pipeline)}
    return {"format": MANIFEST_FORMAT_VERSION, "cwcli": __version__, **shard, **run}


class IndexOfEndedLogs(NamedTuple):
    """What an output folder says of the logs that have ended.

    Attributes:
        manifest: The manifest; {} if there is none.
        entries: Id -> entry of each log; without those of a run that was killed, whose logs have entries of their own.
        gates: Gates that the earlier run has stored; also for a run that begins afresh.
    """

    manifest: Document
    entries: dict[str, Document]
    gates: tuple[str, ...] = ()


def read_index_of_ended_logs(out: Path, *, force: bool) -> IndexOfEndedLogs:
    """Read the index of earlier results, which is empty for a run that begins afresh.

    Raises:
        OutputError: The folder holds the results of another version, or something else.
    """
    manifest = read_json_object(out / MANIFEST_NAME)
    if what := format_mismatch_text_or_empty(manifest or {}):
        raise OutputError(what, where=str(out / MANIFEST_NAME), hint=HINT_ON_MANIFEST_OF_OTHER_FORMAT)
    ours = [*(name for name in FOLDERS_WITH_RESULTS if (out / name).exists()), *iter_table_names(out)]
    if ours and (manifest is None or manifest.get("format") != MANIFEST_FORMAT_VERSION):
        raise OutputError(
            f"the folder holds no run of cwcli, but {', '.join(ours[:MAX_NAMES_LISTED_IN_ERROR])}",
            where=str(out),
            hint="name a new folder with -d",
        )
    gates = gates_of_manifest(manifest or {})
    if manifest is None or force:
        return IndexOfEndedLogs({}, {}, gates)
    listed = manifest.get("logs")
    entries = {
        each["id"]: each
        for each in (listed if isinstance(listed, list) else [])
        if isinstance(each, dict) and isinstance(each.get("id"), str) and each.get("status") in ENDED_LOG_STATUSES
    }
    return IndexOfEndedLogs(manifest, entries, gates)


def split_in_unchanged_and_to_read(
    tasks: Sequence[LogTask], plan: FleetPlan, index: IndexOfEndedLogs
) -> tuple[list[tuple[LogTask, FileState]], list[LogTask]]:
    """Split the logs in those that need no reading, with the state of their files, and the others."""
    if plan.rehash or not tasks:
        return [], list(tasks)
    out = Path(tasks[0].out)
    known = file_states_from_run_times(read_json_object(out / RUN_TIMES_NAME))
    settings_hash = plan.settings_hash()
    current, to_read = [], []
    for task in tasks:
        state = known.get(task.id)
        entry = None
        if state is not None and state == read_file_state(task.path):
            entry = index.entries.get(task.id) or LogOutputs(out, task.id).read_entry()
        if state is not None and entry is not None and _is_up_to_date(task, entry, settings_hash):
            current.append((task, state))
        else:
            to_read.append(task)
    return current, to_read


def _is_up_to_date(task: LogTask, entry: Document, settings_hash: str) -> bool:
    """Whether the folder holds the results of a log whose bytes are those of its entry."""
    if entry.get("source") != task.source or not isinstance(entry.get("sha256"), str):
        return False
    key = make_cache_key(settings_hash, entry["sha256"])
    return LogOutputs(Path(task.out), task.id).is_log_done_with_key(entry, key, has_tables=task.has_tables)


def is_run_done_and_tables_written(manifest: Document, plan: FleetPlan, ids: Sequence[str], out: Path) -> bool:
    """Whether a manifest is that of a whole run over these logs with this plan, whose tables are written."""
    listed = manifest.get("logs")
    if not isinstance(listed, list) or [each["id"] for each in listed if each.get("status") == "done"] != list(ids):
        return False
    head = json.loads(json.dumps(manifest_without_logs(plan)))
    if len(listed) != len(ids) or any(manifest.get(key) != value for key, value in head.items()):
        return False
    return not any(os.path.exists(LogOutputs(out, id).staged_tables_path) for id in ids)  # noqa: PTH110
