"""Ids for new schemas and channels that don't clash with the source's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mcap.records import Channel, Schema

from cwcli.errors import OutputError
from cwcli.logs.format.layout import Layout
from cwcli.logs.write.feeds import MESSAGE_ENCODING, SCHEMA_ENCODING
from cwcli.logs.write.schemas import message_schema
from cwcli.signals.columns import OutputChannel

MAX_ID = 0xFFFF


@dataclass(frozen=True)
class NewChannel:
    """A channel that is added, with its records."""

    columns: OutputChannel
    schema: Schema
    channel: Channel


def assign_ids(layout: Layout, channels: Sequence[OutputChannel], replaced: Mapping[int, Channel]) -> list[NewChannel]:
    """Records for the new channels.

    An equal schema of the source is used again. A new id is larger than all of the source's, even those of channels
    that are left out, because their definitions may be repeated inside chunks that are copied. Only a channel that is
    equal to the one that it replaces keeps its id.

    Raises:
        KeyError: A schema is unknown.
        OutputError: There are no ids left.
    """
    schema_ids = {(each.name, each.encoding, each.data): each.id for each in layout.schemas.values()}
    next_schema_id = max(layout.schemas, default=0) + 1
    next_channel_id = max(layout.channels, default=0) + 1
    new: list[NewChannel] = []
    for columns in channels:
        message = message_schema(columns.schema_name)
        key = (message.name, SCHEMA_ENCODING, message.data)
        if key not in schema_ids:
            schema_ids[key] = next_schema_id
            next_schema_id += 1
        schema = Schema(id=schema_ids[key], name=message.name, encoding=SCHEMA_ENCODING, data=message.data)
        channel = Channel(
            id=next_channel_id,
            topic=columns.topic,
            message_encoding=MESSAGE_ENCODING,
            metadata={},
            schema_id=schema.id,
        )
        equal = [old.id for old in replaced.values() if _with_id(channel, old.id) == old]
        if equal:
            channel = _with_id(channel, equal[0])
        else:
            next_channel_id += 1
        new.append(NewChannel(columns, schema, channel))
    if max(next_schema_id, next_channel_id) > MAX_ID + 1:
        raise OutputError("the log has no room for more channels: their ids end at 65,535")
    return new


def _with_id(channel: Channel, channel_id: int) -> Channel:
    return Channel(
        id=channel_id,
        topic=channel.topic,
        message_encoding=channel.message_encoding,
        metadata=channel.metadata,
        schema_id=channel.schema_id,
    )
