"""What each stage needs and what it adds, by role name: `cwcli info` tells from this what a log is good for."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Need:
    """Roles of one stage.

    Attributes:
        required: Without these it can't run.
        used: It uses these when they are there.
        added: Role that the stage adds -> role of the input that it takes.
    """

    required: tuple[str, ...]
    used: tuple[str, ...] = ()
    added: Mapping[str, str] = field(default_factory=dict)


NEEDS: dict[str, Need] = {
    "estimate": Need(
        required=("ego_position",),
        used=("ego_velocity", "ego_speed", "ego_heading", "imu", "remote", "truth"),
        added={"ego_state": "ego_position", "remote_state": "remote"},
    ),
    "track": Need(
        required=("detections",),
        used=("ego_state", "target_truth"),
        added={"targets": "detections"},
    ),
    "predict": Need(
        required=("ego_state",),
        used=("remote_state",),
        added={"ego_path": "ego_state", "remote_path": "remote_state"},
    ),
    "warn": Need(required=("ego_state", "ego_path", "remote_state", "remote_path")),
    "control": Need(required=("ego_state", "remote_state")),
    "lanes": Need(required=("camera",), used=("camera_info",), added={"lanes": "camera"}),
    "observe": Need(required=("lanes", "ego_speed"), used=("imu", "ego_steer", "lateral_truth")),
}
"""In the order in which the stages run."""


@dataclass(frozen=True)
class Readiness:
    """Whether a stage can run on a log.

    Attributes:
        stage: Its name.
        is_ready: It can run now.
        after: Stages that must run first, if they can; else ().
        missing: Roles of input channels for lack of which it can't run, now or later.
        unused: Roles that it would use, and that the log does not have.
    """

    stage: str
    is_ready: bool
    after: tuple[str, ...]
    missing: tuple[str, ...]
    unused: tuple[str, ...]


def readiness(bound: Collection[str]) -> list[Readiness]:
    """What can be run on a log.

    Args:
        bound: Names of the roles for which the log has a channel.

    Returns:
        One entry per stage of `NEEDS`.
    """
    entries = []
    earlier: list[str] = []
    available = set(bound)
    for stage, need in NEEDS.items():
        is_ready = all(role in bound for role in need.required)
        missing = tuple(dict.fromkeys(_root(role) for role in need.required if role not in available))
        unused = tuple(dict.fromkeys(_root(role) for role in need.used if role not in available))
        after = () if missing else _before(need, earlier, bound)
        entries.append(Readiness(stage, is_ready, after, missing, unused))
        if not missing:
            earlier.append(stage)
            available.update(role for role, source in need.added.items() if source in available)
    return entries


def _before(need: Need, earlier: Sequence[str], bound: Collection[str]) -> tuple[str, ...]:
    """Those of the earlier stages that make what `need` requires and the log does not hold."""
    wanted = set(need.required) - set(bound)
    stages: list[str] = []
    for stage in reversed(earlier):
        if wanted & set(NEEDS[stage].added):
            stages.insert(0, stage)
            wanted |= set(NEEDS[stage].required) - set(bound)
    return tuple(stages)


def _root(role: str) -> str:
    """The role of an input channel from which stages make `role`."""
    sources = {added: source for need in NEEDS.values() for added, source in need.added.items()}
    while role in sources:
        role = sources[role]
    return role
