"""The description of a channel of a log."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field

from cwcli.lazy_dataclass import dataclass
from cwcli.logs.format.index import LogIndex


@dataclass(frozen=True)
class ChannelInfo:
    """A channel as the file declares it.

    Attributes:
        id: Id in the file; negative for a channel in memory.
        schema_name, schema_encoding, schema_data: "" and b"" if it has no schema.
        message_encoding: `cdr`, `protobuf`, `json`, or another name from the file.
        message_count: Number of messages; None if the file does not say.
    """

    id: int
    topic: str
    schema_name: str
    schema_encoding: str
    message_encoding: str
    message_count: int | None
    metadata: Mapping[str, str] = field(default_factory=dict)
    schema_data: bytes = field(default=b"", repr=False)


def channel_infos_from_index(index: LogIndex) -> tuple[ChannelInfo, ...]:
    """Return the channels of a file, sorted by id."""
    statistics = index.statistics
    counted = statistics.channel_counts if statistics else None
    if statistics and statistics.n_messages and not counted:
        counted = None  # the format's way to say that the messages are not counted
    found = []
    for channel in sorted(index.channels.values()):
        schema = index.schemas.get(channel.schema_id)
        found.append(
            ChannelInfo(
                id=channel.id,
                topic=channel.topic,
                schema_name=schema.name if schema else "",
                schema_encoding=schema.encoding if schema else "",
                message_encoding=channel.message_encoding,
                message_count=None if counted is None else counted.get(channel.id, 0),
                metadata=channel.metadata,
                schema_data=schema.data if schema else b"",
            )
        )
    return tuple(found)
