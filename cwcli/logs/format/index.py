"""What a file holds and where, before any message is decoded: from its summary, or from a walk over its records."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple, TypeVar

from cwcli.logs.format.metadata_table import MetadataTable, Run
from cwcli.logs.format.records import AttachmentIndex, Channel, ChunkIndex, Schema, Statistics


class Span(NamedTuple):
    """A part of the data section outside chunks: messages that a walk found, or what no index of a summary covers."""

    start: int
    end: int


class LooseRecord(NamedTuple):
    """A schema or channel outside chunks, or a record of a kind that the format leaves to its users (`id` -1)."""

    start: int
    length: int
    opcode: int
    id: int


Item = ChunkIndex | Span | AttachmentIndex | Run | LooseRecord
Kind = TypeVar("Kind")


@dataclass
class Index:
    """What a file holds.

    Attributes:
        profile, library: From the header.
        header_length: Bytes of magic and header; 0 where it is damaged.
        schemas, channels: By id.
        items: The data section in file order. `LooseRecord`s are there after a walk only.
        metadata: The metadata records; a `Run` among the items names its rows.
        statistics: As the summary or the walk counted; None until something counts.
        data_end: Where the data section ends: its end record, which holds a CRC of everything before; None if there is
            none.
        has_end: There is an end record, or a footer.
        cut_chunks: Starts of chunks that are cut off, or whose record has a wrong length.
        is_listed: A whole summary lists it.
        is_counted: The summary counts the messages of each channel: an index that leaves some out is found by that.
    """

    profile: str = ""
    library: str = ""
    header_length: int = 0
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    items: list[Item] = field(default_factory=list)
    metadata: MetadataTable = field(default_factory=MetadataTable)
    statistics: Statistics | None = None
    data_end: int | None = None
    has_end: bool = False
    cut_chunks: set[int] = field(default_factory=set)
    is_listed: bool = False
    is_counted: bool = False

    def items_of(self, kind: type[Kind]) -> list[Kind]:
        """The items of a kind, in file order."""
        return [item for item in self.items if isinstance(item, kind)]

    def lacks_schema(self, channel_id: int) -> bool:
        """Whether a channel is unknown, or its schema."""
        channel = self.channels.get(channel_id)
        return channel is None or (channel.schema_id != 0 and channel.schema_id not in self.schemas)
