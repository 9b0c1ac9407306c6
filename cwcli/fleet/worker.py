"""Processes one log of a run into its part of the output folder; failures are recorded, not raised."""

from __future__ import annotations

import sys
import time
import traceback
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from cwcli.array_memory import bound_array_memory_and_get_old_handler
from cwcli.digest.digest import build_digest
from cwcli.digest.fleet import DIGEST_ENTRY_KEY, digest_to_entry
from cwcli.errors import EXIT_BUG, CwcliError
from cwcli.evaluation.evaluate_log import evaluate_log
from cwcli.fleet.folder import (
    HEADLINE_METRIC_REFERENCES_KEY,
    SCRATCH_FOLDER,
    Document,
    LogOutputs,
    new_log_entry,
)
from cwcli.fleet.input_states import FileState, read_file_state
from cwcli.fleet.inputs import temporary_local_copy
from cwcli.fleet.plan import FleetPlan, LogTask, TaskResult
from cwcli.fleet.staged_tables import write_staged_tables_file_of_log
from cwcli.fleet.tables import DETAILS_FOLDER, METRICS_TABLE, TABLES_FOLDER
from cwcli.input import InputFile, remember_inputs
from cwcli.logs.read.read_bounds import ReadBounds
from cwcli.logs.read.reader import Log
from cwcli.logs.read.remote import is_remote_url
from cwcli.logs.read.source import open_source
from cwcli.logs.write.annotate import CopyOptions, annotate_log
from cwcli.metrics.table import Table
from cwcli.output import make_folder
from cwcli.pipeline.channel_choice import ChannelChoice
from cwcli.pipeline.execute import RunOutcome, SkipRules, run_stages
from cwcli.pipeline.missing import SignalCheck
from cwcli.pipeline.selection import resolve_selection
from cwcli.stages import STAGES
from cwcli.url import redact_urls
from cwcli.version import __version__


def process_log(task: LogTask, plan: FleetPlan) -> TaskResult:
    """Process one log, unless an earlier run has done it.

    Raises:
        OutputError: The output folder can't be written: no other log would fare better.
    """
    bound_array_memory_and_get_old_handler()
    wall_s, cpu_s = time.perf_counter(), time.process_time()
    with remember_inputs():
        status, state = _process_log_and_write_entry(task, plan)
    return TaskResult(
        task.id,
        status,
        time.perf_counter() - wall_s,
        time.process_time() - cpu_s,
        _peak_memory_mb(),
        input_state=state,
    )


def _peak_memory_mb() -> float:
    try:
        import resource
    except ImportError:  # Windows
        return 0.0
    unit = 1 << 20 if sys.platform == "darwin" else 1 << 10
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6


def _process_log_and_write_entry(task: LogTask, plan: FleetPlan) -> tuple[str, FileState | None]:
    """Process one log and write its entry; returns its status, and the state in which its file was read."""
    folder = LogOutputs(Path(task.out), task.id)
    before = folder.read_entry()
    entry = new_log_entry(task.id, task.source)
    if plan.tables:
        entry["without_table"] = {}
    try:
        with _open_log_file(task, plan) as file:
            # a converted or joined log depends on more than one file, and a remote one has none here
            is_plain = type(file) is InputFile and not is_remote_url(task.path)
            state = read_file_state(file.descriptor) if is_plain else None
            entry["sha256"] = file.begin_sha256().result()
            entry["key"] = plan.cache_key(entry["sha256"])
            if before is not None and folder.is_log_done_with_key(before, entry["key"], has_tables=task.has_tables):
                if before["source"] != task.source:
                    folder.write_entry(
                        {**before, "source": task.source}, [folder.out / name for name in before["outputs"]]
                    )
                return "unchanged", state
            folder.remove_all_outputs()
            make_folder(folder.annotated_log_path.parent, parents=True)
            with Log.open(
                file, recover=plan.recover, max_chunk_bytes=plan.max_chunk_bytes, max_ratio=plan.max_ratio
            ) as log:
                outputs = _run_stages_and_write(log, plan, folder, entry)
            entry["status"] = "done"
    except CwcliError as error:
        outputs = []
        entry["error"] = error_to_entry(error)
    except Exception as error:
        outputs = []
        entry["error"] = bug_to_entry(error, task.path)
    write_log_entry(folder, entry, outputs)
    return str(entry["status"]), state if entry["status"] == "done" else None


def write_log_entry(folder: LogOutputs, entry: Document, outputs: list[Path]) -> None:
    """Write the entry of a log, and remove all other files of a log that failed.

    Raises:
        OutputError: It can't be written.
    """
    if entry["status"] == "failed":
        folder.remove_all_outputs()
        make_folder(folder.annotated_log_path.parent, parents=True)
    folder.write_entry(entry, outputs)


def _run_stages_and_write(log: Log, plan: FleetPlan, folder: LogOutputs, entry: Document) -> list[Path]:
    """Run the stages and write all files but the entry; returns their paths."""
    calls, choice = plan.stage_calls(), ChannelChoice(plan.channels)
    outcome, annotated = run_stages(
        log,
        calls,
        resolve_selection(log, plan.topic, plan.start, plan.end),
        skip=SkipRules(SignalCheck(STAGES, plan.ego_station), True),
        strict=plan.strict,
        choice=choice,
    )
    outputs = []
    if plan.annotate:
        annotate_log(
            annotated,
            (),
            {},
            folder.annotated_log_path,
            replace=plan.replace,
            force=True,
            options=CopyOptions(chosen_topics=choice, durable=False),
        )
        outputs.append(folder.annotated_log_path)
    tables = outcome.tables_by_name()
    scores = evaluate_log(annotated, tables=tables)
    entry[HEADLINE_METRIC_REFERENCES_KEY] = dict(scores.metadata)
    write_staged_tables_file_of_log(_iter_all_tables(annotated, scores, tables, plan, entry), folder.staged_tables_path)
    _add_stages_inputs_and_tables_to_entry(outcome, entry)
    stages = [result.stage for result in outcome.results]
    entry[DIGEST_ENTRY_KEY] = digest_to_entry(build_digest(annotated, stages, outcome.left_out, tables, is_run=True))
    return outputs


def _iter_all_tables(
    log: Log, scores: Table, details: Mapping[str, Table], plan: FleetPlan, entry: Document
) -> Iterator[tuple[str, Table]]:
    """Yield name and content of each table of the log; the entry gets the topics that have none."""
    yield METRICS_TABLE, Table(scores.name, scores.columns, scores.docs)
    for name, table in details.items():
        yield f"{DETAILS_FOLDER}/{name}", table
    if plan.tables:
        from cwcli.fleet.channel_tables import iter_channel_tables_by_safe_name

        for name, table in iter_channel_tables_by_safe_name(log, entry["without_table"]):
            yield f"{TABLES_FOLDER}/{name}", table


def _add_stages_inputs_and_tables_to_entry(outcome: RunOutcome, entry: Document) -> None:
    entry["stages"] = [result.stage for result in outcome.results]
    entry["left_out"] = dict(outcome.left_out)
    entry["faults"] = dict(outcome.faults)
    entry["inputs"] = [
        {"stage": result.stage, **count} for result in outcome.results for count in result.summary.to_json()["inputs"]
    ]
    entry["tables"] = {name: len(table) for name, table in outcome.tables_by_name().items()}


def error_to_entry(error: CwcliError) -> dict[str, Any]:
    """Convert a known error to its form in the manifest."""
    return {
        "exit_code": error.exit_code,
        "what": error.what,
        "where": error.where,
        "found": list(error.found),
        "hint": error.hint,
    }


def bug_to_entry(error: Exception, path: str = "") -> dict[str, Any]:
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
def _open_log_file(task: LogTask, plan: FleetPlan) -> Iterator[InputFile]:
    """Open a log, or a local copy of a remote one."""
    bounds = ReadBounds(plan.max_chunk_bytes, plan.max_pipe_bytes, plan.max_ratio, plan.recover, plan.timeout_s)
    with ExitStack() as stack:
        path = task.path
        if is_remote_url(path) and not path.endswith("/"):  # of a folder, each part is copied where it is opened
            copy = temporary_local_copy(path, Path(task.out) / SCRATCH_FOLDER, bounds)
            path = str(stack.enter_context(copy))
        yield stack.enter_context(open_source(path, task.source, pipes=False, bounds=bounds))
