"""Headline metrics of another system in the same log."""

from __future__ import annotations

from cwcli.errors import MissingSignalError
from cwcli.evaluation.happened import what_happened
from cwcli.evaluation.knowledge import SYSTEM, against, estimated
from cwcli.evaluation.subject import Subject
from cwcli.evaluation.system.flag import read_flag
from cwcli.evaluation.system.path import add_path
from cwcli.evaluation.system.state import add_state
from cwcli.evaluation.system.warnings import judge_flag
from cwcli.evaluation.warn import add_scores
from cwcli.pipeline.records import run_records


def add_system(subject: Subject) -> None:
    """Add the metrics of another system: of those of its warnings, state and path whose topics are named.

    Raises:
        UsageError: A field does not exist, or holds nothing that can be compared.
        MissingSignalError: There is nothing to compare it with, or its channel is empty.
        DataError: No message of its channel can be used.
    """
    system = subject.system
    if system.condition is not None:
        _add_warnings(subject)
    placed = add_state(subject, system.ego_state) if system.ego_state else None
    if system.ego_path:
        add_path(subject, system.ego_path, placed)


def _add_warnings(subject: Subject) -> None:
    log, system = subject.log, subject.system
    assert system.condition is not None
    real = what_happened(log)
    if real is None:
        raise MissingSignalError(
            f"the warnings of {system.warning} can't be judged: the log holds no states of the ego and the others",
            where=log.name,
            hint="annotate it first: `cwcli run LOG -o annotated.mcap`",
        )
    flag = read_flag(log, system.warning, system.condition)
    subject.notes.extend(flag.notes)
    with subject.headline.of(against(SYSTEM, estimated(run_records(log)))):
        add_scores(subject.headline, "system.warnings", judge_flag(flag.spans(), real).scores)
