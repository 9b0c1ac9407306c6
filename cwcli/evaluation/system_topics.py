"""Topics of another system, from options `--topic ROLE=/name`, and their roles."""

from __future__ import annotations

from collections.abc import Sequence

from cwcli.channels.binding import parse_role_overrides
from cwcli.errors import UsageError, hint_at_closest_or_all_known_names
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log
from cwcli.signals.field_condition import CONDITION_EXAMPLES_HINT, Condition, parse_condition

ROLE_DESCRIPTIONS = {
    "warning": "its warnings: a topic, a colon and a condition on a field, warning=/adas/fcw:data==true",
    "ego_path": "its planned or predicted path of the ego: a Trajectory or a Path",
    "ego_state": "its state of the ego: an Odometry or another pose",
}
"""Role -> description of the topics that fit it."""


@dataclass(frozen=True)
class OtherSystemTopics:
    """Topics of another system in a log; "" and None for those that it does not have.

    Attributes:
        warning, condition: Topic of its warnings, and the condition that holds while it warns.
        ego_path, ego_state: Topics of its path and its state of the ego.
    """

    warning: str = ""
    condition: Condition | None = None
    ego_path: str = ""
    ego_state: str = ""

    @property
    def topics_named_by_user(self) -> tuple[str, ...]:
        """All topics that are named."""
        return tuple(topic for topic in (self.warning, self.ego_path, self.ego_state) if topic)

    def require_topics_in_log(self, log: Log) -> None:
        """Check that the log has the named topics.

        Raises:
            UsageError: A topic is missing.
        """
        topics_of_log = tuple(dict.fromkeys(f"{channel.topic} ({channel.schema_name})" for channel in log.channels))
        known = {channel.topic for channel in log.channels}
        for topic in self.topics_named_by_user:
            if topic not in known:
                raise UsageError(f"--topic {topic}: the log has no such topic", where=log.name, found=topics_of_log)


def parse_other_system_options(options: Sequence[str]) -> OtherSystemTopics:
    """Read `ROLE=/name` options.

    Raises:
        UsageError: An option is malformed, given twice, names no role, or lacks a condition.
    """
    named = parse_role_overrides(options)
    for role, topic in named.items():
        if role not in ROLE_DESCRIPTIONS:
            raise UsageError(
                f"--topic {role}={topic}: there is no role {role} of another system",
                hint=hint_at_closest_or_all_known_names(role, ROLE_DESCRIPTIONS, "roles"),
            )
    topic, colon, text = named.get("warning", "").partition(":")
    condition = None
    if topic or colon:
        if not topic or not text:
            raise UsageError(
                f"--topic warning={named['warning']}: expected warning=/topic:field==value",
                hint=CONDITION_EXAMPLES_HINT,
            )
        condition = parse_condition(text)
    return OtherSystemTopics(topic, condition, named.get("ego_path", ""), named.get("ego_state", ""))
