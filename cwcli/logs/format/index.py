"""What a file holds and where, before any message is decoded: from its summary, or from a walk over its records."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field
from operator import itemgetter
from typing import NamedTuple, TypeVar

from cwcli.logs.format.joined_file import Renumbering
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
        data_sections: Of a log of parts: start and `data_end` of each part that has one.
        renumberings: Of a log of parts: start of each part, and what gives its messages the ids of the log; None where
            they have them.
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
    data_sections: list[tuple[int, int]] = field(default_factory=list)
    renumberings: list[tuple[int, Renumbering | None]] = field(default_factory=list)

    def items_of(self, kind: type[Kind]) -> list[Kind]:
        """The items of a kind, in file order."""
        return [item for item in self.items if isinstance(item, kind)]

    def with_own_ids(self, at: int, records: memoryview) -> memoryview:
        """The records that stand at an offset, with this log's ids in the messages, if the file there has others."""
        renumbering = self.renumbering(at)
        return records if renumbering is None else renumbering.records(records)

    def renumbering(self, at: int) -> Renumbering | None:
        """What gives the messages at an offset the ids of the log; None where they have them."""
        k = bisect_right(self.renumberings, at, key=itemgetter(0)) - 1
        return self.renumberings[k][1] if k >= 0 else None

    def section_at(self, at: int) -> tuple[int, int | None]:
        """Start and `data_end` of the data section around an offset, from the magic bytes on."""
        within = [each for each in self.data_sections if each[0] <= at < each[1]]
        return within[0] if within else (0, None if self.data_sections else self.data_end)

    def lacks_schema(self, channel_id: int) -> bool:
        """Whether a channel is unknown, or its schema."""
        channel = self.channels.get(channel_id)
        return channel is None or (channel.schema_id != 0 and channel.schema_id not in self.schemas)
