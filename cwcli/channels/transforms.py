"""Reads the mounting of the ego's sensors from the user's options, else from the log's transforms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from cwcli.errors import UsageError
from cwcli.estimation.config import LeverArms, is_lever_arm_on_car
from cwcli.logs.read.reader import Log
from cwcli.signals.columns import Strings
from cwcli.signals.transforms import (
    BODY_FRAME_NAMES,
    Transform,
    find_body_frame_and_transform,
    find_carrying_body_frame_and_transform,
)

FIELDS_NAMING_FRAME_OF_REFERENCE = ("header.frame_id", "frame_id")
"""Fields of a message that may name its frame of reference."""


class TransformCount(NamedTuple):
    """Counts of a topic's transform messages: read, used for a new frame, and unreadable."""

    topic: str
    read: int
    used: int
    unreadable: int


def read_lever_arms_transform_counts_and_notes(
    log: Log, topics: Sequence[str], lever_arms_of_user: LeverArms
) -> tuple[LeverArms, tuple[TransformCount, ...], tuple[str, ...]]:
    """Read the lever arms of the ego's sensors by topic, message counts of the transforms, and notes.

    Only transforms of frames that are fixed to the car are used: the first of each frame, static channels first. A log
    without transforms is not read.

    Args:
        topics: Topics of the ego's sensors.
        lever_arms_of_user: Lever arms of the user, which take precedence over transforms.

    Raises:
        UsageError: A given topic is none of the ego's sensors.
    """
    for name in lever_arms_of_user:
        if name not in topics:
            hint = f"these are {', '.join(topics)}"
            raise UsageError(f"--lever-arm {name}: no sensor of the ego", where=log.name, hint=hint)
    open_topics = [topic for topic in topics if topic not in lever_arms_of_user]
    channels = sorted({c.topic for c in log.transform_channels()}, key=lambda name: ("static" not in name, name))
    if not channels or not open_topics:
        return lever_arms_of_user, (), ()
    tree: dict[str, Transform] = {}
    counts = tuple(add_transforms_of_topic_to_tree(log, topic, tree) for topic in channels)
    found, notes = dict(lever_arms_of_user), []
    for topic, frame in _frame_id_of_first_message_by_topic(log, open_topics).items():
        carried = find_carrying_body_frame_and_transform(tree, frame)
        if carried is None:
            continue
        body, matrix = carried
        ahead_m, left_m = float(matrix[0, 3]), float(matrix[1, 3])
        place_text = f"{ahead_m:.2f} m ahead and {left_m:.2f} m to the left of {body} ({frame})"
        if is_lever_arm_on_car(ahead_m, left_m):
            found[topic] = ahead_m, left_m
            notes.append(f"{topic} is mounted {place_text}")
        else:
            notes.append(f"{topic}: {place_text} is not on the car; not used")
    return found, counts, tuple(notes)


def add_transforms_of_topic_to_tree(
    log: Log, topic: str, tree: dict[str, Transform], frame: str = ""
) -> TransformCount:
    """Add the transforms of one topic to the tree; with `frame`, only until the tree links it to the vehicle's base."""
    read, used, unreadable = 0, 0, 0
    for transforms in log.transforms(topic):
        read += 1
        if transforms is None:
            unreadable += 1
            continue
        new = [each for each in transforms if each.child not in tree]
        for each in new:
            tree.setdefault(each.child, each)
        used += bool(new)
        found = find_body_frame_and_transform(tree, frame) if new and frame else None
        if found is not None and found[0] == BODY_FRAME_NAMES[0]:
            break
    return TransformCount(topic, read, used, unreadable)


def _frame_id_of_first_message_by_topic(log: Log, topics: Sequence[str]) -> Mapping[str, str]:
    """The frame of reference that the first message of each topic names."""
    found = {}
    for topic, columns in log.load_topics(dict.fromkeys(topics, FIELDS_NAMING_FRAME_OF_REFERENCE)).items():
        for name in FIELDS_NAMING_FRAME_OF_REFERENCE:
            values = columns.fields.get(name)
            if isinstance(values, Strings) and len(values) and values.codes[0] >= 0:
                found[topic] = values.values[values.codes[0]].lstrip("/")
    return found
