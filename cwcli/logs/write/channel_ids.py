"""Assigns ids to new schemas and channels that don't clash with the source's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from cwcli.errors import OutputError
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.encoders.output_schema import find_output_schema
from cwcli.logs.format.index import LogIndex
from cwcli.logs.format.records import Channel, Schema
from cwcli.signals.columns import OutputChannel

MAX_RECORD_ID = 0xFFFF
"""The greatest id of a schema or a channel: the format has 16 bits for it (MCAP specification)."""


@dataclass(frozen=True)
class NewChannel:
    """A channel that is added, as columns and with its schema and channel records."""

    columns: OutputChannel
    schema: Schema
    channel: Channel


def assign_channel_ids(
    index: LogIndex, channels: Sequence[OutputChannel], replaced: Mapping[int, Channel]
) -> list[NewChannel]:
    """Return schema and channel records for the new channels.

    An equal schema of the source is used again. A new id is larger than all of the source's, even those of channels
    that are left out, because their definitions may be repeated inside chunks that are copied. Only a channel that is
    equal to the one that it replaces keeps its id.

    Raises:
        KeyError: A schema is unknown.
        OutputError: There are no ids left.
    """
    schema_ids = {(each.name, each.encoding, each.data): each.id for each in index.schemas.values()}
    next_schema_id = max(index.schemas, default=0) + 1
    next_channel_id = max(index.channels, default=0) + 1
    new: list[NewChannel] = []
    for columns in channels:
        message = find_output_schema(columns.schema_name)
        key = (message.name, message.encoding, message.data)
        if key not in schema_ids:
            schema_ids[key] = next_schema_id
            next_schema_id += 1
        schema = Schema(schema_ids[key], *key)
        channel = Channel(next_channel_id, schema.id, columns.topic, message.message_encoding, {})
        equal = [old for old in replaced.values() if channel._replace(id=old.id) == old]
        if equal:
            channel = equal[0]
        else:
            next_channel_id += 1
        new.append(NewChannel(columns, schema, channel))
    if max(next_schema_id, next_channel_id) > MAX_RECORD_ID + 1:
        raise OutputError("the log has no room for more channels: their ids end at 65,535")
    return new
