"""Converts an annotated log to a log of ROS 2 messages."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from cwcli.channels.published import OWN_TOPIC_PREFIX
from cwcli.errors import DataError, MissingSignalError
from cwcli.export.ros.messages import ROS_CONVERSIONS, names_of_fields_left_out_of_ros
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.encoders.cdr_fit import unrepresentable_row_masks
from cwcli.logs.read.reader import Log
from cwcli.logs.write.annotate import CopyOptions, annotate_log
from cwcli.logs.write.profile import matches_ros_profile
from cwcli.pipeline.records import (
    MAP_ORIGIN_ENTRY_NAMES,
    RUN_RECORD_PREFIX,
    local_map_from_estimate_record,
    read_run_records,
)
from cwcli.signals.columns import OutputChannel, select_column_rows
from cwcli.signals.geodesy import LocalMap
from cwcli.version import __version__

MCAP_PROFILE_OF_ROS_LOG = "ros2"
"""Profile of an MCAP file that holds ROS 2 messages only."""
ROS_TOPIC_PREFIX = f"{OWN_TOPIC_PREFIX}ros/"
"""Beginning of converted topics; no command reads topics below it as measurements or as results of a stage."""
MAP_ORIGIN_RECORD_NAME = "cwcli.export.ros2"
"""Name of the metadata record that holds the map's origin."""
FORBIDDEN_TOPIC_CHARACTERS = re.compile("[^A-Za-z0-9_/]")
"""Pattern of the characters that a ROS topic may not hold (design.ros2.org, topic and service names)."""

OWN_SCHEMA_PREFIX = "cwcli."
"""Beginning of the names of cwcli's own schemas."""


@dataclass(frozen=True)
class RosLogReport:
    """Counts of a conversion to a ROS 2 log.

    Attributes:
        n_messages_kept, n_messages_made: ROS messages copied from the source, and messages converted.
        left_out: Topic -> schema of each channel for which there is no ROS message.
        left_messages: Topic -> field -> number of messages whose value the ROS message can't hold (a time beyond int32
            seconds, elements that differ in number), where there are any. A message counts once.
        left_fields: Topic -> fields that the ROS message does not have, because another version wrote them.
        replaced: Topics of recorded ROS channels that a converted channel replaces.
    """

    n_messages_kept: int
    n_messages_made: int
    left_out: dict[str, str]
    left_messages: dict[str, dict[str, int]]
    left_fields: dict[str, list[str]]
    replaced: list[str]


def write_ros_log(log: Log, target: str | Path, *, force: bool = False) -> RosLogReport:
    """Write a log of ROS 2 messages: recorded ROS messages unchanged, and cwcli's channels converted.

    A metadata record with the map's origin replaces the records of the stages.

    Raises:
        MissingSignalError: There is no channel that could be written.
        DataError: Another version wrote a channel, or a field holds what no message of cwcli's does.
        InputError: The log is damaged.
        OutputError: The target can't be written.
    """
    foreign = [
        each
        for each in log.channels
        if not matches_ros_profile(MCAP_PROFILE_OF_ROS_LOG, each.message_encoding, each.schema_encoding)
    ]
    if len(foreign) == len(log.channels) and not any(each.schema_name in ROS_CONVERSIONS for each in foreign):
        raise MissingSignalError(
            "no channel can be written as ROS messages", where=log.name, hint="run `cwcli run` on it first"
        )
    estimated = read_run_records(log).get("estimate", {})
    local_map = local_map_from_estimate_record(estimated)
    known = {each.topic: each.schema_name for each in foreign if each.schema_name in ROS_CONVERSIONS}
    converted, left_messages, left_fields, unreadable = [], {}, {}, {}
    for topic, name in ros_topic_names(known).items():
        try:
            channel, left_messages[topic], left_fields[topic] = _convert_channel_and_get_left_out_fields(
                log, topic, name, local_map
            )
        except DataError as error:
            if known[topic].startswith(OWN_SCHEMA_PREFIX):
                raise
            unreadable[topic] = f"{known[topic]}: {error.what}"
        else:
            converted.append(channel)
    made_topics = {each.topic for each in converted}
    foreign_ids = {each.id for each in foreign}
    replaced = [each.topic for each in log.channels if each.id not in foreign_ids and each.topic in made_topics]
    report = annotate_log(
        log,
        converted,
        {
            MAP_ORIGIN_RECORD_NAME: {
                "cwcli": __version__,
                **{name: estimated[name] for name in MAP_ORIGIN_ENTRY_NAMES if name in estimated},
            }
        },
        target,
        replace=True,
        force=force,
        options=CopyOptions(
            excluded_channel_ids=frozenset(each.id for each in foreign),
            excluded_metadata_names=frozenset(
                name for name in log.metadata_names if name.startswith(RUN_RECORD_PREFIX)
            ),
            profile=MCAP_PROFILE_OF_ROS_LOG,
        ),
    )
    left_out = {each.topic: each.schema_name for each in foreign if each.topic not in known} | unreadable
    return RosLogReport(
        report.n_messages_copied,
        report.n_messages_added,
        left_out,
        {topic: counts for topic, counts in left_messages.items() if counts},
        {topic: names for topic, names in left_fields.items() if names},
        replaced,
    )


def ros_topic_names(topics: Iterable[str]) -> dict[str, str]:
    """The ROS topic of each topic, all different: `/a b` and `/a_b` become `a_b` and `a_b_2`."""
    names: dict[str, str] = {}
    for topic in topics:
        plain = ROS_TOPIC_PREFIX + (
            FORBIDDEN_TOPIC_CHARACTERS.sub("_", topic.removeprefix(OWN_TOPIC_PREFIX).strip("/")) or "_"
        )
        every = (plain, *(f"{plain}_{k}" for k in range(2, len(names) + 3)))
        names[topic] = next(name for name in every if name not in names.values())
    return names


def _convert_channel_and_get_left_out_fields(
    log: Log, topic: str, name: str, local_map: LocalMap | None
) -> tuple[OutputChannel, dict[str, int], list[str]]:
    """Convert a channel; returns it, the number of messages left out by field, and the names of fields left out."""
    columns = log.columns(topic)
    message = ROS_CONVERSIONS[columns.schema_name]
    fields = message.make_fields(columns, local_map)
    fit = np.ones(len(columns), np.bool_)
    left_out = {}
    for path, is_unfit in unrepresentable_row_masks(message.schema, fields, len(columns)).items():
        if n := int(np.count_nonzero(fit & is_unfit)):
            left_out[path] = n
        fit &= ~is_unfit
    if not fit.all():
        rows = np.flatnonzero(fit)
        selected = {path: select_column_rows(column, rows) for path, column in columns.fields.items()}
        columns = columns.with_fields_of_rows(rows, selected)
        fields = message.make_fields(columns, local_map)
    channel = OutputChannel(name, message.schema, columns.log_time_ns, fields)
    return channel, left_out, names_of_fields_left_out_of_ros(columns)
