"""Which topic rendered frames may have."""

from __future__ import annotations

import re

from cwcli.errors import UsageError
from cwcli.logs.read.reader import Log

RENDERED_SCHEMA = "foxglove.CompressedImage"
NAME = re.compile(r"(/[^/\s\x00-\x1f\x7f]+)+")


def check_topic_name(topic: str | None) -> None:
    """Refuse a topic for rendered frames that is no name, whatever the log holds.

    Raises:
        UsageError: As it says.
    """
    if topic is not None and not NAME.fullmatch(topic):
        raise UsageError(f"--render {topic!r} is no topic's name", hint="for example --render /cwcli/camera")


def check_render_topic(log: Log, topic: str | None, camera_topic: str) -> None:
    """Refuse a topic for rendered frames that is no name, or that something else has.

    A channel of the log with frames of the same kind is left to `--replace`: an earlier run may have written it.

    Raises:
        UsageError: As it says.
    """
    if topic is None:
        return
    from cwcli.channels.published import topics

    check_topic_name(topic)
    if topic == camera_topic:
        raise UsageError(f"--render {topic} is the camera's own topic", hint="name another one")
    held = next((each.schema_name for each in log.channels if each.topic == topic), "")
    held = topics().get(topic, held)
    if held not in ("", RENDERED_SCHEMA):
        raise UsageError(f"--render {topic} is the topic of {held}", hint="name another one")
