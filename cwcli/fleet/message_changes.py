"""Compares the annotated logs of two runs, message by message."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import PurePosixPath

from cwcli.errors import CwcliError, UsageError, hint_at_closest_or_all_known_names
from cwcli.evaluation.message_changes import LogDifference, compare_messages, field_names
from cwcli.fleet.search import SearchedLog, logs_to_search
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log


@dataclass(frozen=True)
class RunDifference:
    """What differs between the messages of two runs.

    Attributes:
        differing: Id of a log -> what differs, for the logs that differ.
        unread: Ids of the logs that could not be read, with the reason.
        paths: Id of a log that differs -> its annotated logs in the earlier and in the later run.
    """

    differing: Mapping[str, LogDifference]
    n_logs: int
    unread: Mapping[str, str]
    paths: Mapping[str, tuple[str, str]]


def compare_logs_of_runs(
    baseline: str, candidate: str, tolerance_by_field: Mapping[str, float], step: Callable[[str], None]
) -> RunDifference:
    """Compare the logs of two runs; logs are paired by their id, two single logs always.

    Args:
        baseline, candidate: Annotated logs, folders of them, or the output folders of runs.
        tolerance_by_field: Field name -> difference up to which its values count as equal.
        step: Called with a text for each log.

    Raises:
        UsageError: A run is a table or standard input, no log is in both runs, or no channel has a field.
        InputError: A folder can't be read.
    """
    runs = []
    for source in (baseline, candidate):
        if source == "-" or source.lower().endswith(".parquet"):
            raise UsageError("--messages compares annotated logs", where=source, hint="name a log or a run's folder")
        runs.append([each for each in logs_to_search([source]) if each.path])
    pairs = _names_and_paths_of_common_logs(*runs)
    if not pairs:
        raise UsageError(f"{baseline} and {candidate} have no log in common, so nothing can be compared")
    differing: dict[str, LogDifference] = {}
    unread: dict[str, str] = {}
    paths: dict[str, tuple[str, str]] = {}
    known_fields: set[str] = set()
    for name, early, late in pairs:
        step(f"comparing the messages of {name}")
        try:
            with Log.open(early) as before, Log.open(late) as after:
                found = compare_messages(before, after, tolerance_by_field)
                if not tolerance_by_field.keys() <= known_fields:
                    known_fields |= field_names(before) | field_names(after)
        except CwcliError as error:
            unread[name] = str(error)
            continue
        if not found.has_no_difference:
            differing[name] = found
            paths[name] = early, late
    for name in tolerance_by_field.keys() - known_fields if known_fields else ():
        hint = hint_at_closest_or_all_known_names(name, sorted(known_fields))
        raise UsageError(f"--fields: no compared channel has the field {name}", hint=hint)
    return RunDifference(differing, len(pairs) - len(unread), unread, paths)


def _names_and_paths_of_common_logs(early: list[SearchedLog], late: list[SearchedLog]) -> list[tuple[str, str, str]]:
    """Return name and both paths of each log that is in both runs."""
    if len(early) == len(late) == 1:
        return [(PurePosixPath(late[0].name).name, early[0].path, late[0].path)]
    known = {PurePosixPath(each.name).name: each.path for each in early}
    names = [(PurePosixPath(each.name).name, each.path) for each in late]
    return [(name, known[name], path) for name, path in names if name in known]
