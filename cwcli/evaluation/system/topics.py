"""`--topic ROLE=/name` of another system: which roles there are, and what is named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from cwcli.channels.binding import parse_overrides
from cwcli.errors import UsageError, names_hint
from cwcli.logs.read.reader import Log
from cwcli.signals.field_condition import EXAMPLES, Condition, parse_condition

WORDS = {
    "warning": "its warnings: a topic, a colon and a condition on a field, warning=/adas/fcw:data==true",
    "ego_path": "its planned or predicted path of the ego: a Trajectory or a Path",
    "ego_state": "its state of the ego: an Odometry or another pose",
}
"""Role -> what can be named for it."""
ROLES = ", ".join(WORDS)


@dataclass(frozen=True)
class System:
    """What of a log is another system's; "" and None for what it does not have.

    Attributes:
        warning, condition: The topic of its warnings, and what a message says when it warns.
        ego_path, ego_state: Topics.
    """

    warning: str = ""
    condition: Condition | None = None
    ego_path: str = ""
    ego_state: str = ""

    @property
    def topics(self) -> tuple[str, ...]:
        """All that are named."""
        return tuple(topic for topic in (self.warning, self.ego_path, self.ego_state) if topic)

    def require_topics(self, log: Log) -> None:
        """Check that the log has what is named.

        Raises:
            UsageError: It has not.
        """
        there = tuple(dict.fromkeys(f"{channel.topic} ({channel.schema_name})" for channel in log.channels))
        known = {channel.topic for channel in log.channels}
        for topic in self.topics:
            if topic not in known:
                raise UsageError(f"--topic {topic}: the log has no such topic", where=log.name, found=there)


def parse_system(options: Sequence[str]) -> System:
    """Read `ROLE=/name` options.

    Raises:
        UsageError: One is none, is there twice, names no role, or has no condition where it needs one.
    """
    named = parse_overrides(options)
    for role, topic in named.items():
        if role not in WORDS:
            raise UsageError(
                f"--topic {role}={topic}: there is no role {role} of another system",
                hint=names_hint(role, WORDS, "roles"),
            )
    topic, colon, text = named.get("warning", "").partition(":")
    condition = None
    if topic or colon:
        if not topic or not text:
            raise UsageError(f"--topic warning={named['warning']}: expected warning=/topic:field==value", hint=EXAMPLES)
        condition = parse_condition(text)
    return System(topic, condition, named.get("ego_path", ""), named.get("ego_state", ""))
