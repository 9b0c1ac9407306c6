"""Which stages can run on a log, now or after others, told from the roles that its channels fill."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from cwcli.lazy_dataclass import dataclass
from cwcli.pipeline.stage import Stage

StageByName = Mapping[str, Stage]
"""The type of a table of stages: name -> stage, in the order in which they run."""


@dataclass(frozen=True)
class StageReadiness:
    """Whether a stage can run on a log.

    Attributes:
        is_ready: It can run now.
        after: Names of the stages that must run first, if they can; else ().
        missing: Required roles of input channels that the log lacks, so that the stage can't run now or later.
        unused: Optional roles that the log does not have.
    """

    stage: Stage
    is_ready: bool
    after: tuple[str, ...]
    missing: tuple[str, ...]
    unused: tuple[str, ...]


def readiness_of_each_stage(bound: Collection[str], stages: StageByName) -> list[StageReadiness]:
    """Return for each stage whether it can run on a log.

    Args:
        bound: Names of the roles for which the log has a channel.

    Returns:
        One entry for each stage.
    """
    entries = []
    earlier: list[Stage] = []
    available = set(bound)
    sources = {added: source for stage in stages.values() for added, source in stage.input_role_by_added_role.items()}
    for stage in stages.values():
        lacking = [group for group in stage.required_role_groups if not available.intersection(group)]
        missing = tuple(dict.fromkeys(_input_role_that_yields(group[0], sources) for group in lacking))
        unused = tuple(
            dict.fromkeys(_input_role_that_yields(role, sources) for role in stage.used if role not in available)
        )
        after = () if missing else _names_of_stages_needed_first(stage, earlier, bound)
        entries.append(StageReadiness(stage, stage.is_satisfied_by(bound), after, missing, unused))
        if not missing:
            earlier.append(stage)
            available.update(role for role, source in stage.input_role_by_added_role.items() if source in available)
    return entries


def _names_of_stages_needed_first(stage: Stage, earlier: Sequence[Stage], bound: Collection[str]) -> tuple[str, ...]:
    """Return the earlier stages that publish what `stage` requires and the log does not hold."""
    unbound_roles = _unbound_role_groups(stage, bound)
    names: list[str] = []
    for maker in reversed(earlier):
        if any(group & set(maker.input_role_by_added_role) for group in unbound_roles):
            names.insert(0, maker.name)
            unbound_roles += _unbound_role_groups(maker, bound)
    return tuple(names)


def _unbound_role_groups(stage: Stage, bound: Collection[str]) -> list[set[str]]:
    """Return the stage's groups of alternative roles of which none is bound."""
    return [set(group) for group in stage.required_role_groups if not set(group) & set(bound)]


def _input_role_that_yields(role: str, sources: Mapping[str, str]) -> str:
    """Return the role of the input channel from which stages compute the channel of `role`."""
    while role in sources:
        role = sources[role]
    return role
