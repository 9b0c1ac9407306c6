"""Checks the topic that the user names for rendered frames."""

from __future__ import annotations

import re

from cwcli.errors import UsageError
from cwcli.logs.read.reader import Log

RENDERED_SCHEMA = "foxglove.CompressedImage"
"""Schema of rendered frames."""
TOPIC_NAME_PATTERN = re.compile(r"(/[^/\s\x00-\x1f\x7f]+)+")
"""Pattern of a topic name: parts that begin with a slash, without spaces and control characters."""


def check_topic_name_if_given(topic: str | None) -> None:
    """Refuse a topic for rendered frames that is not a valid topic name.

    Raises:
        UsageError: It is not valid.
    """
    if topic is not None and not TOPIC_NAME_PATTERN.fullmatch(topic):
        raise UsageError(f"--render {topic!r} is not the name of a topic", hint="for example --render /cwcli/camera")


def check_render_topic_is_free(log: Log, topic: str | None, camera_topic: str) -> None:
    """Refuse a topic for rendered frames that is invalid or that another channel has.

    A channel of compressed images may have it: an earlier run may have written that, and `--replace` removes it.

    Raises:
        UsageError: It is invalid, the camera's own, or of a channel of another schema.
    """
    if topic is None:
        return
    from cwcli.channels.published import schema_name_by_published_topic

    check_topic_name_if_given(topic)
    if topic == camera_topic:
        raise UsageError(f"--render {topic} is the camera's own topic", hint="name another one")
    schema_of_topic = next((each.schema_name for each in log.channels if each.topic == topic), "")
    schema_of_topic = schema_name_by_published_topic().get(topic, schema_of_topic)
    if schema_of_topic not in ("", RENDERED_SCHEMA):
        raise UsageError(f"--render {topic} is the topic of {schema_of_topic}", hint="name another one")
