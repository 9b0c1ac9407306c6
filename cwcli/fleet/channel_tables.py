"""The channels of a log as tables: one row per message (`--tables`)."""

from __future__ import annotations

from collections.abc import Iterator

from cwcli.channels.published import EGO_PATH, PATH_SCENE, REMOTE_PATH
from cwcli.errors import CwcliError
from cwcli.fleet.names import safe_topic_name
from cwcli.fleet.table_schemas import COMMON_COLUMNS
from cwcli.logs.read.reader import Log
from cwcli.metrics.table import ColumnDoc, Table, TableColumn
from cwcli.signals.columns import Columns, StreamedChannel

STREAMED_PATH_TOPICS = {each.topic for each in (EGO_PATH, REMOTE_PATH, PATH_SCENE)}
"""Topics of streamed channels that hold no images and so get a table."""
LOG_TIME_DOC, PUBLISH_TIME_DOC = ColumnDoc("ns", doc="when it was logged"), ColumnDoc("ns", doc="when it was published")
"""Descriptions of the two columns of times."""


def iter_channel_tables_by_safe_name(log: Log, reason_by_left_out_topic: dict[str, str]) -> Iterator[tuple[str, Table]]:
    """Yield (safe name, table) of each channel that has columns, one at a time because a log may be large.

    Args:
        log: The log with the channels of the stages that ran.
        reason_by_left_out_topic: Filled with topic -> why it has no table. Bytes such as images are in no column.
    """
    streamed = {
        channel.topic
        for channel in log.added_channels
        if isinstance(channel, StreamedChannel) and channel.topic not in STREAMED_PATH_TOPICS
    }
    for topic in sorted({channel.topic for channel in log.channels}):
        if topic in streamed:
            reason_by_left_out_topic[topic] = "its images are rendered only while the log is written"
            continue
        try:
            columns = log.columns(topic)
        except CwcliError as error:
            reason_by_left_out_topic[topic] = error.what
            continue
        name = safe_topic_name(topic)
        yield name, make_channel_table(name, columns)


def make_channel_table(name: str, columns: Columns) -> Table:
    """Make the table of a channel: log time, publish time and sequence number, then its leaf fields."""
    header: dict[str, TableColumn] = {
        "log_time_ns": columns.log_time_ns,
        "publish_time_ns": columns.publish_time_ns,
        "sequence": columns.sequence,
    }
    used_columns = COMMON_COLUMNS | header.keys()
    fields = {f"message.{leaf}" if leaf in used_columns else leaf: values for leaf, values in columns.fields.items()}
    about = {"topic": columns.topic, "schema": columns.schema_name, "encoding": columns.message_encoding}
    return Table(name, {**header, **fields}, {"log_time_ns": LOG_TIME_DOC, "publish_time_ns": PUBLISH_TIME_DOC}, about)
