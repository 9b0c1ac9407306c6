"""Finds events in many logs: those of a run's output folder, of a folder or a pattern, or single ones."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from cwcli.errors import CwcliError, InputError, UsageError
from cwcli.evaluation.system_topics import OtherSystemTopics
from cwcli.events.search import FoundEvent, Query, find_events_in_log
from cwcli.fleet.folder import MANIFEST_NAME
from cwcli.fleet.inputs import expand_sources
from cwcli.fleet.run_source import read_run_or_none
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log
from cwcli.text import format_first_names

STDIN_ARGUMENT = "-"
"""Name of standard input."""
MAX_SEARCH_FAILURE_REASONS_SHOWN = 3
"""Number of reasons that are named where no log could be searched: one that names its file would fill a line a log.
Chosen by hand."""


class SearchedLog(NamedTuple):
    """A log that is searched.

    Attributes:
        name: Name to show, of this log alone: the id of a run's log, else the name as given.
        path: Absolute path or URL; "" for a log of a run that left no annotated log.
    """

    name: str
    path: str


@dataclass(frozen=True)
class FleetSearch:
    """What was found in many logs.

    Attributes:
        paths: Name of each searched log -> its path.
        missing: Event -> number of logs that can't tell.
        failed: The logs that could not be searched, with the error of each.
    """

    found: tuple[FoundEvent, ...]
    paths: dict[str, str]
    missing: dict[str, int]
    failed: tuple[tuple[str, CwcliError], ...]


def logs_to_search(arguments: Sequence[str]) -> list[SearchedLog]:
    """Return the logs that some arguments name, under names of their own; of a run's folder its annotated logs.

    A name that several logs share gets its argument before it, or gives way to the path.

    Raises:
        UsageError: A name is empty, or matches nothing.
        InputError: A run holds no annotated log, or a folder can't be read.
    """
    found: dict[str, tuple[str, SearchedLog]] = {}
    for argument in arguments:
        for each in _logs_of_argument(argument):
            found.setdefault(each.path or f"{argument}\0{each.name}", (argument, each))
    uses = Counter(each.name for _, each in found.values())
    named = [
        each if uses[each.name] == 1 else SearchedLog(f"{argument.rstrip('/')}/{each.name}", each.path)
        for argument, each in found.values()
    ]
    uses = Counter(each.name for each in named)
    return [each if uses[each.name] == 1 else SearchedLog(each.path, each.path) for each in named]


def _logs_of_argument(argument: str) -> Iterator[SearchedLog]:
    """Yield the logs of one argument."""
    if argument == STDIN_ARGUMENT:
        yield SearchedLog("<stdin>", STDIN_ARGUMENT)
        return
    run = read_run_or_none(argument)
    if run is None:
        for name, path in expand_sources([argument]):
            yield SearchedLog(name, path)
        return
    logs = [SearchedLog(log.id, log.find_annotated_log() or "") for log in run.logs]
    if not any(each.path for each in logs):
        raise InputError("the run holds no annotated log", where=run.path_or_url_of_file(run.path / MANIFEST_NAME))
    yield from logs


def _combine_errors_of_all_logs(failed: Sequence[tuple[str, CwcliError]]) -> CwcliError:
    """Return the error of the logs, if it is that of each; else one with the reasons and the most frequent one's hint.

    Reasons are in order of their number of logs, equal ones in order of the logs.
    """
    failures_by_reason: dict[str, list[tuple[str, CwcliError]]] = {}
    for name, error in failed:
        failures_by_reason.setdefault(error.what, []).append((name, error))
    reasons = sorted(failures_by_reason, key=lambda reason: -len(failures_by_reason[reason]))
    _, usual = failures_by_reason[reasons[0]][0]
    if len(reasons) == 1:
        return usual
    lines = [
        f"{reason}: {format_first_names([name for name, _ in failures_by_reason[reason]])}"
        for reason in reasons[:MAX_SEARCH_FAILURE_REASONS_SHOWN]
    ]
    if len(reasons) > MAX_SEARCH_FAILURE_REASONS_SHOWN:
        lines.append(f"and {len(reasons) - MAX_SEARCH_FAILURE_REASONS_SHOWN} more reasons")
    return type(usual)(f"none of the {len(failed)} logs could be searched", found=tuple(lines), hint=usual.hint)


def find_in_logs(
    logs: Sequence[SearchedLog],
    query: Query,
    open_log: Callable[[str], Log],
    *,
    other_system: OtherSystemTopics | None = None,
    step: Callable[[int, str], None] = lambda done, name: None,
) -> FleetSearch:
    """Find what is looked for in each of some logs.

    A log that can't be searched is counted and does not stop the others; a single one raises its error.

    Args:
        open_log: Opens a log by its path.
        other_system: Topics of another system in the logs.
        step: Called with the number of the log and its name before it is searched.

    Raises:
        CwcliError: No log can be searched.
    """
    found: list[FoundEvent] = []
    missing: dict[str, int] = {}
    failed: list[tuple[str, CwcliError]] = []
    for k, each in enumerate(logs):
        step(k, each.name)
        try:
            if not each.path:
                raise InputError("its run left no annotated log of it")
            with open_log(each.path) as log:
                searched = find_events_in_log(log, query, other_system, each.name)
        except UsageError:
            raise
        except CwcliError as error:
            failed.append((each.name, error))
            continue
        found += searched.found
        for event in searched.missing:
            missing[event] = missing.get(event, 0) + 1
    if logs and len(failed) == len(logs):
        raise _combine_errors_of_all_logs(failed)
    found.sort(key=lambda event: event.rank)
    return FleetSearch(tuple(found), {each.name: each.path for each in logs}, missing, tuple(failed))
