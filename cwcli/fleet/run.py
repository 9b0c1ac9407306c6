"""Runs a pipeline over many logs and records the results in an output folder."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

from cwcli.errors import EXIT_BUG, OutputError, UsageError
from cwcli.fleet.folder import (
    MANIFEST_NAME,
    RUN_TIMES_NAME,
    SCRATCH_FOLDER,
    TABLES_KEY,
    Document,
    LogOutputs,
    iter_recorded_log_ids,
    new_log_entry,
    write_json_object,
)
from cwcli.fleet.index import (
    FOLDERS_WITH_RESULTS,
    MAX_NAMES_LISTED_IN_ERROR,
    IndexOfEndedLogs,
    is_run_done_and_tables_written,
    manifest_without_logs,
    read_index_of_ended_logs,
    split_in_unchanged_and_to_read,
)
from cwcli.fleet.input_states import (
    INPUT_STATES_KEY,
    FileState,
    file_states_to_document,
)
from cwcli.fleet.inputs import expand_sources
from cwcli.fleet.local import MAX_ATTEMPTS_AT_LOG, WorkerDied, run_on_local_processes
from cwcli.fleet.names import unique_log_ids
from cwcli.fleet.plan import FleetPlan, LogTask, TaskResult
from cwcli.fleet.remote_folder import StoreFolder
from cwcli.fleet.tables import (
    MergedRows,
    StagedRows,
    are_tables_whole,
    remove_all_tables,
    write_tables,
)
from cwcli.input import names_of_inputs_in_folders, remember_input_file, remember_inputs
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.remote import is_remote_url
from cwcli.output import make_folder, refuse_unwritable_targets
from cwcli.pipeline.selection import check_selection_options
from cwcli.process_pool import count_available_processors
from cwcli.url import display_name_of_url

ReportTaskStatus = Callable[[LogTask | None, str, int, int], None]
"""Called with a task, its status, the number of ended logs and of all."""
TaskRunner = Callable[
    [list[tuple[LogTask, FileState]], list[LogTask]], Generator[tuple[LogTask, "TaskResult | WorkerDied"]]
]
"""Yields each task with its result; the arguments of `_iter_task_results` that are not settings."""
RUN_FOLDERS = (*FOLDERS_WITH_RESULTS, SCRATCH_FOLDER)
"""Subfolders of the output folder that a run writes and may empty."""


@dataclass(frozen=True)
class FleetResult:
    """The result of a run over many logs.

    Attributes:
        manifest: Content of `manifest.json`.
        statuses: Log id -> `done`, `failed` or `unchanged`.
        earlier_gates: Gates that the earlier run into the folder had stored.
    """

    out: Path
    manifest: Document
    statuses: dict[str, str]
    earlier_gates: tuple[str, ...]

    @property
    def exit_code(self) -> int:
        """0 if every log is done, else the highest exit code of those that failed."""
        return max((entry["error"]["exit_code"] for entry in self.manifest["logs"] if entry["error"]), default=0)


def run_fleet(
    sources: Sequence[str],
    plan: FleetPlan,
    out: str | Path,
    *,
    jobs: int | None = None,
    ray: str | None = None,
    force: bool = False,
    report: ReportTaskStatus = lambda task, status, done, total: None,
) -> FleetResult:
    """Run a pipeline on every log, and record the result of each.

    Args:
        out: The output folder, on this machine or as a URL of a store, to which each log's results are sent.
        jobs: Worker processes; None: as many as there are processors.
        ray: Address of a Ray cluster, `auto` for the one of this machine, `local` for one of its own; None: no Ray.
        force: Remove all results of earlier runs in the folder first.
        report: Called when a log ends, with the task, its status, the number of ended logs and of all logs; before the
            first, once the logs are found, with None, "found" and these numbers.

    Raises:
        UsageError: A pattern matches nothing, a folder holds no log, a log lies in the output folder, or that holds
            logs that this run does not name; or a Ray cluster is to write into a store.
        InputError: A folder can't be listed, or a remote store does not answer.
        OutputError: The folder is something else, is in use, or can't be written.
    """
    run_tasks = partial(_iter_task_results, plan=plan, jobs=jobs, ray=ray)
    if not is_remote_url(str(out)):
        return _run_into_folder(sources, plan, _absolute_output_folder(out), run_tasks, force, report)
    if ray is not None:
        hint = "name a folder that all machines see, or use --shard"
        raise UsageError("a Ray cluster does not write into a store", where=display_name_of_url(str(out)), hint=hint)
    with StoreFolder(str(out)) as store:

        def send_and_report(task: LogTask | None, status: str, done: int, total: int) -> None:
            if task is not None:
                store.send_log(task.id)
            report(task, status, done, total)

        result = _run_into_folder(sources, plan, store.path, run_tasks, force, send_and_report, store.send_manifest)
        store.send_all()
        return result


def _run_into_folder(
    sources: Sequence[str],
    plan: FleetPlan,
    folder: Path,
    run_tasks: TaskRunner,
    force: bool,
    report: ReportTaskStatus,
    after_begin: Callable[[], None] = lambda: None,
) -> FleetResult:
    """Run a pipeline on every log, as `run_fleet`, into a folder of this machine.

    Args:
        sources, plan, force, report: As in `run_fleet`.
        folder: The output folder.
        run_tasks: Yields the results of the tasks that are up to date, and of those that must be read.
        after_begin: Called when the manifest says what is going to be done.
    """
    begin = time.monotonic()
    statuses: dict[str, str] = {}
    began = datetime.now(UTC).isoformat(timespec="seconds")
    check_selection_options(plan.topic, plan.start, plan.end)
    found = expand_sources(sources, [str(folder / part) for part in RUN_FOLDERS])
    ids = unique_log_ids([source for source, _ in found])
    tasks = [LogTask(i, source, path, str(folder)) for i, (source, path) in zip(ids, found, strict=True)]
    tasks.sort(key=lambda task: task.id)
    if plan.shard is not None:  # the ids are those that the whole run gives
        tasks = plan.shard.select_shard_items(tasks)
    with remember_inputs(), lock_folder(folder):
        _refuse_inputs_in_output_folder(folder, tasks)
        index = read_index_of_ended_logs(folder, force=force)
        _prepare_output_folder(folder, tasks, index, force=force)
        has_tables = are_tables_whole(folder, index.manifest.get(TABLES_KEY))
        tasks = [replace(task, has_tables=has_tables) for task in tasks]
        current, to_read = split_in_unchanged_and_to_read(tasks, plan, index)
        if not to_read and is_run_done_and_tables_written(
            index.manifest, plan, [task.id for task, _ in current], folder
        ):
            for task, _ in current:
                statuses[task.id] = "unchanged"
                report(task, "unchanged", len(statuses), len(tasks))
            return FleetResult(folder, index.manifest, statuses, index.gates)
        report(None, "found", 0, len(tasks))
        tables = index.manifest.get(TABLES_KEY, [])
        write_json_object(_make_manifest(plan, tasks, {}, tables), folder / MANIFEST_NAME)
        after_begin()
        entries: dict[str, Document] = {}
        states: dict[str, FileState] = {}
        times: dict[str, Any] = {}
        try:
            with closing(run_tasks(current, to_read)) as ended:
                for task, answer in ended:
                    task_result = (
                        _record_failed_log_of_dead_worker(task, plan) if isinstance(answer, WorkerDied) else answer
                    )
                    statuses[task.id] = task_result.status
                    entry = index.entries.get(task.id) if not task_result.attempts else None
                    entry = entry or LogOutputs(folder, task.id).read_entry()
                    if entry is not None:
                        entries[task.id] = entry
                    if task_result.input_state is not None:
                        states[task.id] = task_result.input_state
                    times[task.id] = _run_time_document(task_result)
                    report(task, task_result.status, len(statuses), len(tasks))
            tables = _write_tables_of_run(folder, entries, plan)
        finally:
            shutil.rmtree(folder / SCRATCH_FOLDER, ignore_errors=True)
            manifest = _make_manifest(plan, tasks, entries, tables)
            write_json_object(manifest, folder / MANIFEST_NAME, durable=True)
        _remove_staged_tables(folder, entries)
        took = {"began": began, "wall_s": round(time.monotonic() - begin, 3), "logs": dict(sorted(times.items()))}
        write_json_object({**took, INPUT_STATES_KEY: file_states_to_document(states)}, folder / RUN_TIMES_NAME)
    return FleetResult(folder, manifest, statuses, index.gates)


def _absolute_output_folder(out: str | Path) -> Path:
    """Return the output folder with its whole path; refuse what is no name of a folder."""
    if str(out) in {"", "-"}:
        raise UsageError(f"the output folder can't be '{out}'", hint="name it with -d")
    return Path(os.path.abspath(out))  # noqa: PTH100 - links stay as they are


def _run_time_document(task_result: TaskResult) -> Document:
    """Make a log's part of `run_times.json`."""
    return {
        "status": task_result.status,
        "wall_s": round(task_result.wall_s, 4),
        "cpu_s": round(task_result.cpu_s, 4),
        "peak_mb": round(task_result.peak_mb, 1),
        "attempts": task_result.attempts,
    }


def _write_tables_of_run(out: Path, entries: Mapping[str, Document], plan: FleetPlan) -> list[str]:
    """Write the tables with the rows of all logs that are done; returns their names."""
    merged, staged = MergedRows(out), StagedRows(lambda id: LogOutputs(out, id).staged_tables_path)
    return write_tables(
        out,
        {
            id: staged if LogOutputs(out, id).staged_tables_path.is_file() else merged
            for id, entry in entries.items()
            if entry["status"] == "done"
        },
        plan.run_id,
    )


def _remove_staged_tables(out: Path, ids: Iterable[str]) -> None:
    """Remove the logs' own tables, whose rows are in those of the run."""
    for id in ids:
        with suppress(OSError):
            LogOutputs(out, id).staged_tables_path.unlink(missing_ok=True)


def _iter_task_results(
    current: Iterable[tuple[LogTask, FileState]],
    to_read: list[LogTask],
    plan: FleetPlan,
    jobs: int | None,
    ray: str | None,
) -> Generator[tuple[LogTask, TaskResult | WorkerDied]]:
    """Yield each task with its result: first the logs that need no reading, then the others as workers end them."""
    for task, state in current:
        yield task, TaskResult(task.id, "unchanged", 0.0, 0.0, attempts=0, input_state=state)
    if not to_read:
        return
    if ray is not None:
        from cwcli.fleet.ray_backend import run_on_ray_cluster

        running = run_on_ray_cluster(to_read, plan, ray, jobs)
    else:
        running = run_on_local_processes(to_read, plan, min(jobs or count_available_processors(), len(to_read)))
    yield from running


def _refuse_inputs_in_output_folder(out: Path, tasks: Iterable[LogTask]) -> None:
    """Refuse an output folder in which an input would be overwritten or removed."""
    for task in tasks:
        if not is_remote_url(task.path):
            remember_input_file(task.path)
    refuse_unwritable_targets([out / MANIFEST_NAME, out / RUN_TIMES_NAME], force=True)
    for name in names_of_inputs_in_folders(*(out / part for part in RUN_FOLDERS)):
        raise OutputError("an input is in the folder of the results", where=name, hint="name another folder with -d")


def _prepare_output_folder(out: Path, tasks: Iterable[LogTask], index: IndexOfEndedLogs, *, force: bool) -> None:
    """Remove what cancelled or forced runs left; refuse a folder with logs that this run does not name."""
    shutil.rmtree(out / SCRATCH_FOLDER, ignore_errors=True)
    if force:
        for name in FOLDERS_WITH_RESULTS:
            shutil.rmtree(out / name, ignore_errors=True)
        remove_all_tables(out)
    ids = {task.id for task in tasks}
    sources = {task.source for task in tasks}
    others = []
    for known in sorted(({*iter_recorded_log_ids(out)} | index.entries.keys()) - ids):
        entry = index.entries.get(known) or LogOutputs(out, known).read_entry()
        if (
            entry is None or display_name_of_url(str(entry.get("source"))) in sources
        ):  # it was interrupted, or has another id now
            LogOutputs(out, known).remove_all_outputs()
        else:
            others.append(known)
    if others:
        raise UsageError(
            f"the folder holds {len(others)} logs that this run does not name",
            where=str(out),
            found=tuple(others[:MAX_NAMES_LISTED_IN_ERROR]),
            hint="name them too, use another folder, or begin afresh with --force",
        )


def _make_manifest(
    plan: FleetPlan, tasks: Iterable[LogTask], entries: Mapping[str, Document], tables: Sequence[str]
) -> Document:
    """Make the manifest: the entries of the logs that have ended; all others are pending."""
    logs = [
        entries.get(task.id) or {"id": task.id, "source": task.source, "status": "pending", "error": None}
        for task in tasks
    ]
    return {**manifest_without_logs(plan), TABLES_KEY: list(tables), "logs": logs}


def _record_failed_log_of_dead_worker(task: LogTask, plan: FleetPlan) -> TaskResult:
    """Record a log whose worker died at every attempt as failed."""
    from cwcli.fleet.worker import write_log_entry

    entry = new_log_entry(task.id, task.source)
    entry["error"] = {
        "exit_code": EXIT_BUG,
        "what": "the worker process died twice: killed, out of memory, or a crash",
        "where": task.source,
        "found": [],
        "hint": "run `cwcli run` on this log alone, or with fewer --jobs",
    }
    write_log_entry(LogOutputs(Path(task.out), task.id), entry, [])
    return TaskResult(task.id, "failed", 0.0, 0.0, attempts=MAX_ATTEMPTS_AT_LOG)


@contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Create the output folder and lock it against other runs while the context lasts."""
    make_folder(folder, parents=True)
    try:
        import fcntl
    except ImportError:  # Windows
        yield
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise OutputError("another run is writing into the folder", where=str(folder)) from error
        except OSError:  # a file system without locks
            pass
        yield
    finally:
        os.close(descriptor)
