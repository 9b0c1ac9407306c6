"""Headline metrics of another system, beside cwcli's own."""

from __future__ import annotations

from cwcli.errors import MissingSignalError
from cwcli.evaluation.happened import what_happened
from cwcli.evaluation.subject import Subject
from cwcli.evaluation.system.flag import read_flag
from cwcli.evaluation.system.warnings import judge_flag
from cwcli.evaluation.warn import add_scores

PREFIX = "system"


def add_system(subject: Subject) -> None:
    """Add the metrics of what is named of another system.

    Raises:
        UsageError: A field is not there, or holds nothing that can be compared.
        MissingSignalError: There is nothing to hold it against, or its channel is empty.
        DataError: Nothing of its channel can be used.
    """
    if subject.system.condition is not None:
        _add_warnings(subject)


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
    add_scores(subject.headline, f"{PREFIX}.warnings", judge_flag(flag.spans(), real).scores)
