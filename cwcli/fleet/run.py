"""Runs a pipeline over many logs and records the results in an output folder."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from cwcli.errors import EXIT_BUG, OutputError, UsageError
from cwcli.fleet.folder import (
    DETAILS_FOLDER,
    LOGS_FOLDER,
    MANIFEST_FORMAT,
    MANIFEST_NAME,
    METRICS_FOLDER,
    OTHER_FORMAT_HINT,
    RUN_TIMES_NAME,
    SCRATCH_FOLDER,
    SHARD_KEY,
    TABLES_FOLDER,
    Document,
    LogOutputs,
    format_mismatch_text,
    iter_recorded_ids,
    new_log_entry,
    read_json_object,
    write_json_object,
)
from cwcli.fleet.input_states import (
    INPUTS_KEY,
    FileState,
    read_file_state,
    states_from_document,
    states_to_document,
)
from cwcli.fleet.inputs import expand_sources
from cwcli.fleet.local import MAX_ATTEMPTS, WorkerDied, run_on_local_processes
from cwcli.fleet.names import unique_log_ids
from cwcli.fleet.plan import FleetPlan, LogTask, TaskResult
from cwcli.input import names_of_inputs_in_folder, remember_input_file, remember_inputs
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.remote import is_remote_url
from cwcli.output import check_targets, make_folder
from cwcli.pipeline.selection import check_selection_options
from cwcli.url import display_name_of_url
from cwcli.version import __version__

Report = Callable[[LogTask, str, int, int], None]
RUN_FOLDERS = (LOGS_FOLDER, METRICS_FOLDER, DETAILS_FOLDER, TABLES_FOLDER, SCRATCH_FOLDER)
"""Subfolders of the output folder that a run writes and may empty."""


@dataclass(frozen=True)
class FleetResult:
    """The result of a run over many logs.

    Attributes:
        out: The output folder.
        manifest: Content of `manifest.json`.
        statuses: Log id -> `done`, `failed` or `unchanged`.
    """

    out: Path
    manifest: Document
    statuses: dict[str, str]

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
    report: Report = lambda task, status, done, total: None,
) -> FleetResult:
    """Run a pipeline on every log, and record the result of each.

    Args:
        sources: Files, folders, patterns and URLs.
        plan: What is done with each log.
        out: The output folder.
        jobs: Worker processes; None: as many as there are processors.
        ray: Address of a Ray cluster, `auto` for the one of this machine, `local` for one of its own; None: no Ray.
        force: Remove all results of earlier runs in the folder first.
        report: Called when a log ends, with the task, its status, the number of ended logs and of all logs.

    Raises:
        UsageError: A pattern matches nothing, a folder holds no log, a log lies in the output folder, or that holds
            logs that this run does not name.
        InputError: A folder can't be listed, or a remote store does not answer.
        OutputError: The folder is something else, is in use, or can't be written.
    """
    begin = time.monotonic()
    began = datetime.now(UTC).isoformat(timespec="seconds")
    if is_remote_url(str(out)):
        raise UsageError("the output folder must lie on this machine", where=str(out), hint="copy it there afterwards")
    if str(out) in {"", "-"}:
        raise UsageError(f"the output folder can't be '{out}'", hint="name it with -d")
    folder = Path(os.path.abspath(out))  # noqa: PTH100 - links stay as they are
    check_selection_options(plan.topic, plan.start, plan.end)
    found = expand_sources(sources, [str(folder / part) for part in RUN_FOLDERS])
    ids = unique_log_ids([source for source, _ in found])
    tasks = [LogTask(i, source, path, str(folder)) for i, (source, path) in zip(ids, found, strict=True)]
    tasks.sort(key=lambda task: task.id)
    if plan.shard is not None:  # the ids are those that the whole run gives
        tasks = plan.shard.select_own(tasks)
    with remember_inputs(), lock_folder(folder):
        _refuse_inputs_in_output_folder(folder, tasks)
        _prepare_output_folder(folder, tasks, force=force)
        write_json_object(_make_manifest(folder, plan, tasks), folder / MANIFEST_NAME)
        known = {} if plan.rehash else states_from_document(read_json_object(folder / RUN_TIMES_NAME))
        statuses: dict[str, str] = {}
        states: dict[str, FileState] = {}
        times: dict[str, Any] = {}
        try:
            with closing(_run_tasks(tasks, plan, known, jobs, ray)) as ended:
                for task, answer in ended:
                    done = _record_dead_worker(task, plan) if isinstance(answer, WorkerDied) else answer
                    statuses[task.id] = done.status
                    if done.input_state is not None:
                        states[task.id] = done.input_state
                    times[task.id] = {
                        "status": done.status,
                        "wall_s": round(done.wall_s, 4),
                        "cpu_s": round(done.cpu_s, 4),
                        "peak_mb": round(done.peak_mb, 1),
                        "attempts": done.attempts,
                    }
                    report(task, done.status, len(statuses), len(tasks))
        finally:
            shutil.rmtree(folder / SCRATCH_FOLDER, ignore_errors=True)
            manifest = _make_manifest(folder, plan, tasks, statuses)
            write_json_object(manifest, folder / MANIFEST_NAME, durable=True)
        took = {"began": began, "wall_s": round(time.monotonic() - begin, 3), "logs": dict(sorted(times.items()))}
        write_json_object({**took, INPUTS_KEY: states_to_document(states)}, folder / RUN_TIMES_NAME)
    return FleetResult(folder, manifest, statuses)


def _run_tasks(
    tasks: list[LogTask], plan: FleetPlan, known: Mapping[str, FileState], jobs: int | None, ray: str | None
) -> Generator[tuple[LogTask, TaskResult | WorkerDied]]:
    """Yield each task with its result: first the logs that need no reading, then the others as workers end them."""
    to_read = []
    for task in tasks:
        state = known.get(task.id)
        if state is not None and state == read_file_state(task.path) and _is_up_to_date(task, plan):
            yield task, TaskResult(task.id, "unchanged", 0.0, 0.0, attempts=0, input_state=state)
        else:
            to_read.append(task)
    if not to_read:
        return
    if ray is not None:
        from cwcli.fleet.ray_backend import run_on_ray_cluster

        running = run_on_ray_cluster(to_read, plan, ray, jobs)
    else:
        running = run_on_local_processes(to_read, plan, min(jobs or count_available_processors(), len(to_read)))
    yield from running


def _is_up_to_date(task: LogTask, plan: FleetPlan) -> bool:
    """Whether the folder holds the results of a log whose bytes are those of its entry."""
    folder = LogOutputs(Path(task.out), task.id)
    entry = folder.read_entry()
    if entry is None or entry.get("source") != task.source or not isinstance(entry.get("sha256"), str):
        return False
    return folder.is_done(entry, plan.cache_key(entry["sha256"]))


def count_available_processors() -> int:
    """The number of processors that this process may use."""
    with suppress(AttributeError):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _refuse_inputs_in_output_folder(out: Path, tasks: Iterable[LogTask]) -> None:
    """Refuse an output folder in which an input would be overwritten or removed."""
    for task in tasks:
        if not is_remote_url(task.path):
            remember_input_file(task.path)
    check_targets([out / MANIFEST_NAME, out / RUN_TIMES_NAME], force=True)
    for part in RUN_FOLDERS:
        for name in names_of_inputs_in_folder(out / part):
            raise OutputError("an input lies where the results go", where=name, hint="name another folder with -d")


def _prepare_output_folder(out: Path, tasks: Iterable[LogTask], *, force: bool) -> None:
    """Prepare the output folder: refuse one with other content, and remove what cancelled or forced runs left."""
    by_id = {task.id: task for task in tasks}
    ours = [name for name in (LOGS_FOLDER, METRICS_FOLDER, DETAILS_FOLDER, TABLES_FOLDER) if (out / name).exists()]
    manifest = read_json_object(out / MANIFEST_NAME)
    if what := format_mismatch_text(manifest or {}):
        raise OutputError(what, where=str(out / MANIFEST_NAME), hint=OTHER_FORMAT_HINT)
    if ours and (manifest is None or manifest.get("format") != MANIFEST_FORMAT):
        raise OutputError(
            f"the folder holds no run of cwcli, but {', '.join(ours)}", where=str(out), hint="name a new folder with -d"
        )
    shutil.rmtree(out / SCRATCH_FOLDER, ignore_errors=True)
    if force:
        for name in ours:
            shutil.rmtree(out / name)
    sources = {task.source for task in by_id.values()}
    others = []
    for known in iter_recorded_ids(out):
        if known in by_id:
            continue
        entry = LogOutputs(out, known).read_entry()
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
            found=tuple(others[:10]),
            hint="name them too, use another folder, or begin afresh with --force",
        )


def _make_manifest(
    out: Path, plan: FleetPlan, tasks: list[LogTask], statuses: dict[str, str] | None = None
) -> Document:
    """Make the manifest: the entries of the logs that have ended; all others are pending."""
    entries = []
    for task in tasks:
        known = LogOutputs(out, task.id).read_entry() if statuses and task.id in statuses else None
        entries.append(known or {"id": task.id, "source": task.source, "status": "pending", "error": None})
    shard = {} if plan.shard is None else {SHARD_KEY: {"index": plan.shard.index, "count": plan.shard.count}}
    return {"format": MANIFEST_FORMAT, "cwcli": __version__, **shard, "pipeline": dict(plan.pipeline), "logs": entries}


def _record_dead_worker(task: LogTask, plan: FleetPlan) -> TaskResult:
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
    return TaskResult(task.id, "failed", 0.0, 0.0, attempts=MAX_ATTEMPTS)


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
