"""Processes one log of a run into its part of the output folder; failures are recorded, not raised."""

from __future__ import annotations

import sys
import time
import traceback
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cwcli import __version__
from cwcli.array_memory import bound_array_memory
from cwcli.errors import EXIT_BUG, CwcliError
from cwcli.evaluation.evaluate_log import evaluate_log
from cwcli.fleet.folder import DETAILS, SCRATCH, TABLES, Document, LogFolder, new_entry, put_table
from cwcli.fleet.inputs import local_copy
from cwcli.fleet.plan import Plan, Task
from cwcli.input import InputFile, remembering_inputs
from cwcli.logs.read.reader import Log
from cwcli.logs.read.remote import is_remote
from cwcli.logs.read.source import open_source
from cwcli.logs.write.annotate import annotate
from cwcli.output import make_folder
from cwcli.pipeline.channel_choice import ChannelChoice
from cwcli.pipeline.execute import Outcome, run_stages
from cwcli.pipeline.missing import SignalsFor
from cwcli.pipeline.selection import select
from cwcli.stages import STAGES
from cwcli.url import redact_urls


@dataclass(frozen=True)
class Done:
    """The result of one log.

    Attributes:
        id: Id of the log.
        status: `done`, `failed`, or `unchanged` if an earlier run had written the same.
        wall_s, cpu_s: Run times.
        peak_mb: Largest memory of the worker up to now.
        attempts: Number of attempts; more than one if a worker died.
    """

    id: str
    status: str
    wall_s: float
    cpu_s: float
    peak_mb: float = 0.0
    attempts: int = 1


def work(task: Task, plan: Plan) -> Done:
    """Process one log, unless an earlier run has done it.

    Raises:
        OutputError: The output folder can't be written: no other log would fare better.
    """
    bound_array_memory()
    wall_s, cpu_s = time.perf_counter(), time.process_time()
    with remembering_inputs():
        status = _work(task, plan)
    return Done(task.id, status, time.perf_counter() - wall_s, time.process_time() - cpu_s, _peak_mb())


def _peak_mb() -> float:
    try:
        import resource
    except ImportError:  # Windows
        return 0.0
    unit = 1 << 20 if sys.platform == "darwin" else 1 << 10
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6


def _work(task: Task, plan: Plan) -> str:
    folder = LogFolder(Path(task.out), task.id)
    before = folder.entry()
    entry = new_entry(task.id, task.source)
    if plan.tables:
        entry["without_table"] = {}
    try:
        with _opened(task, plan.max_pipe_bytes) as file:
            entry["sha256"] = file.begin_sha256().result()
            entry["key"] = plan.key(entry["sha256"])
            if before is not None and folder.is_done(before, entry["key"]):
                if before["source"] != task.source:
                    folder.finish({**before, "source": task.source}, [folder.out / name for name in before["outputs"]])
                return "unchanged"
            folder.clear()
            make_folder(folder.annotated.parent, parents=True)
            with Log.open(
                file, recover=plan.recover, max_chunk_bytes=plan.max_chunk_bytes, max_ratio=plan.max_ratio
            ) as log:
                outputs = _run(log, plan, folder, entry)
            entry["status"] = "done"
    except CwcliError as error:
        outputs = []
        entry["error"] = error_entry(error)
    except Exception as error:
        outputs = []
        entry["error"] = bug_entry(error, task.path)
    record(folder, entry, outputs)
    return str(entry["status"])


def record(folder: LogFolder, entry: Document, outputs: list[Path]) -> None:
    """Write the entry of a log, and remove all other files of a log that failed.

    Raises:
        OutputError: It can't be written.
    """
    if entry["status"] == "failed":
        folder.clear()
        make_folder(folder.annotated.parent, parents=True)
    folder.finish(entry, outputs)


def _run(log: Log, plan: Plan, folder: LogFolder, entry: Document) -> list[Path]:
    """Run the stages and write all files but the entry; returns their paths."""
    calls, choice = plan.calls(), ChannelChoice(plan.channels)
    outcome, annotated = run_stages(
        log,
        calls,
        select(log, plan.topic, plan.start, plan.end),
        missing=SignalsFor(STAGES, plan.ego_station),
        lenient=True,
        strict=plan.strict,
        choice=choice,
    )
    annotate(annotated, (), {}, folder.annotated, replace=plan.replace, force=True, chosen=choice, durable=False)
    outputs = [folder.annotated]
    tables = outcome.tables()
    for name, table in tables.items():
        outputs.append(put_table(table, folder.table(DETAILS, name)))
    outputs.append(put_table(evaluate_log(annotated, tables=tables), folder.metrics))
    if plan.tables:
        from cwcli.fleet.channel_tables import channel_tables

        for name, table in channel_tables(annotated, entry["without_table"]):
            outputs.append(put_table(table, folder.table(TABLES, name)))
    _describe(outcome, entry)
    return outputs


def _describe(outcome: Outcome, entry: Document) -> None:
    entry["stages"] = [result.stage for result in outcome.results]
    entry["left_out"] = dict(outcome.left_out)
    entry["faults"] = dict(outcome.faults)
    entry["inputs"] = [
        {"stage": result.stage, **count} for result in outcome.results for count in result.summary.to_json()["inputs"]
    ]
    entry["tables"] = {name: len(table) for name, table in outcome.tables().items()}


def error_entry(error: CwcliError) -> dict[str, Any]:
    """Convert a known error to its form in the manifest."""
    return {
        "exit_code": error.exit_code,
        "what": error.what,
        "where": error.where,
        "found": list(error.found),
        "hint": error.hint,
    }


def bug_entry(error: Exception, path: str = "") -> dict[str, Any]:
    """Convert an unknown error to its form in the manifest, with its location; secrets in `path` are redacted."""
    frames = traceback.extract_tb(error.__traceback__)
    found = [f"{Path(frame.filename).name}:{frame.lineno} in {frame.name}" for frame in frames[-5:]]
    return {
        "exit_code": EXIT_BUG,
        "what": f"a bug in cwcli {__version__}: {type(error).__name__}: {redact_urls(str(error), path)[:200]}",
        "where": "",
        "found": found,
        "hint": "run `cwcli run` on this log alone for the whole traceback, and please report it",
    }


@contextmanager
def _opened(task: Task, max_pipe_bytes: int) -> Iterator[InputFile]:
    """Open a log, or a local copy of a remote one."""
    with ExitStack() as stack:
        path = task.path
        if is_remote(path) and not path.endswith("/"):  # of a folder, each part is copied where it is opened
            path = str(stack.enter_context(local_copy(path, Path(task.out) / SCRATCH, max_pipe_bytes)))
        yield stack.enter_context(open_source(path, task.source, pipes=False, max_pipe_bytes=max_pipe_bytes))
