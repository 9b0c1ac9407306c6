"""Which stages can run on a log, now or after others, told from the roles that its channels fill."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from cwcli.pipeline.stage import Stage

Table = Mapping[str, Stage]
"""Name -> stage, in the order in which they run."""


@dataclass(frozen=True)
class Readiness:
    """Whether a stage can run on a log.

    Attributes:
        stage: The stage.
        is_ready: It can run now.
        after: Names of stages that must run first, if they can; else ().
        missing: Roles of input channels for lack of which it can't run, now or later.
        unused: Roles that it would use, and that the log does not have.
    """

    stage: Stage
    is_ready: bool
    after: tuple[str, ...]
    missing: tuple[str, ...]
    unused: tuple[str, ...]


def readiness(bound: Collection[str], stages: Table) -> list[Readiness]:
    """What can be run on a log.

    Args:
        bound: Names of the roles for which the log has a channel.
        stages: Those that are asked about.

    Returns:
        One entry a stage.
    """
    entries = []
    earlier: list[Stage] = []
    available = set(bound)
    sources = {added: source for stage in stages.values() for added, source in stage.added.items()}
    for stage in stages.values():
        lacking = [group for group in stage.groups if not available.intersection(group)]
        missing = tuple(dict.fromkeys(_root(group[0], sources) for group in lacking))
        unused = tuple(dict.fromkeys(_root(role, sources) for role in stage.used if role not in available))
        after = () if missing else _before(stage, earlier, bound)
        entries.append(Readiness(stage, stage.met_by(bound), after, missing, unused))
        if not missing:
            earlier.append(stage)
            available.update(role for role, source in stage.added.items() if source in available)
    return entries


def _before(stage: Stage, earlier: Sequence[Stage], bound: Collection[str]) -> tuple[str, ...]:
    """Those of the earlier stages that make what `stage` requires and the log does not hold."""
    wanted = _lacking(stage, bound)
    names: list[str] = []
    for maker in reversed(earlier):
        if any(group & set(maker.added) for group in wanted):
            names.insert(0, maker.name)
            wanted += _lacking(maker, bound)
    return tuple(names)


def _lacking(stage: Stage, bound: Collection[str]) -> list[set[str]]:
    """The groups of the stage of which nothing is bound."""
    return [set(group) for group in stage.groups if not set(group) & set(bound)]


def _root(role: str, sources: Mapping[str, str]) -> str:
    """The role of an input channel from which stages make `role`."""
    while role in sources:
        role = sources[role]
    return role
