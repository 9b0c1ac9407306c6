"""What each stage needs and what it adds, by role name.

`cwcli info` tells from this what a log is good for, and `cwcli run` which stages it leaves out. A stage that can run in
several ways has an entry for each.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Need:
    """Roles of one way to run a stage.

    Attributes:
        required: Without these it can't run.
        one_of: Groups of roles: of each group one must be there.
        used: It uses these when they are there.
        added: Role that the stage adds -> role of the input that it takes.
    """

    required: tuple[str, ...]
    one_of: tuple[tuple[str, ...], ...] = ()
    used: tuple[str, ...] = ()
    added: Mapping[str, str] = field(default_factory=dict)

    @property
    def groups(self) -> tuple[tuple[str, ...], ...]:
        """Of each of these groups one role must be there."""
        return (*((role,) for role in self.required), *self.one_of)

    def met_by(self, roles: Collection[str]) -> bool:
        """Whether these roles are enough."""
        return all(any(role in roles for role in group) for group in self.groups)


WARN_OF_TARGETS = "warn --source targets"
WARN_OF_LANE_DEPARTURE = "warn --rules lane-departure"
PREDICT_FROM_OBSERVER = "predict --from observer"
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
    "lanes": Need(
        required=("camera",),
        used=("camera_info", "ego_state", "ego_speed", "imu"),
        added={"lanes": "camera"},
    ),
    "observe": Need(
        required=("lanes",),
        one_of=(("ego_speed", "ego_state", "ego_velocity"),),
        used=("imu", "ego_steer", "lateral_truth"),
        added={"observer": "lanes"},
    ),
    "predict": Need(
        required=("ego_state",),
        used=("remote_state",),
        added={"ego_path": "ego_state", "remote_path": "remote_state"},
    ),
    PREDICT_FROM_OBSERVER: Need(
        required=("observer",),
        used=("ego_state", "camera", "truth", "lateral_truth"),
        added={"observer_path": "observer"},
    ),
    "warn": Need(required=("ego_state", "ego_path", "remote_state", "remote_path")),
    WARN_OF_TARGETS: Need(required=("ego_state", "ego_path", "targets")),
    WARN_OF_LANE_DEPARTURE: Need(required=("observer_path", "lanes")),
    "control": Need(required=("ego_state", "remote_state")),
}
"""Command line -> what it needs, in the order in which the stages run. A bare name is the stage with its defaults."""
STAGES = tuple(dict.fromkeys(command.split(maxsplit=1)[0] for command in NEEDS))


@dataclass(frozen=True)
class Readiness:
    """Whether a stage can run on a log.

    Attributes:
        command: Its key in `NEEDS`.
        is_ready: It can run now.
        after: Commands that must run first, if they can; else ().
        missing: Roles of input channels for lack of which it can't run, now or later.
        unused: Roles that it would use, and that the log does not have.
    """

    command: str
    is_ready: bool
    after: tuple[str, ...]
    missing: tuple[str, ...]
    unused: tuple[str, ...]


def readiness(bound: Collection[str]) -> list[Readiness]:
    """What can be run on a log.

    Args:
        bound: Names of the roles for which the log has a channel.

    Returns:
        One entry per command line of `NEEDS`.
    """
    entries = []
    earlier: list[str] = []
    available = set(bound)
    for command, need in NEEDS.items():
        lacking = [group for group in need.groups if not available.intersection(group)]
        missing = tuple(dict.fromkeys(_root(group[0]) for group in lacking))
        unused = tuple(dict.fromkeys(_root(role) for role in need.used if role not in available))
        after = () if missing else _before(need, earlier, bound)
        entries.append(Readiness(command, need.met_by(bound), after, missing, unused))
        if not missing:
            earlier.append(command)
            available.update(role for role, source in need.added.items() if source in available)
    return entries


def _before(need: Need, earlier: Sequence[str], bound: Collection[str]) -> tuple[str, ...]:
    """Those of the earlier commands that make what `need` requires and the log does not hold."""
    wanted = _lacking(need, bound)
    commands: list[str] = []
    for command in reversed(earlier):
        if any(group & set(NEEDS[command].added) for group in wanted):
            commands.insert(0, command)
            wanted += _lacking(NEEDS[command], bound)
    return tuple(commands)


def _lacking(need: Need, bound: Collection[str]) -> list[set[str]]:
    """The groups of `need` of which nothing is bound."""
    return [set(group) for group in need.groups if not set(group) & set(bound)]


def _root(role: str) -> str:
    """The role of an input channel from which stages make `role`."""
    sources = {added: source for need in NEEDS.values() for added, source in need.added.items()}
    while role in sources:
        role = sources[role]
    return role
