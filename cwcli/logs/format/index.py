"""The index of a file: its channels, chunks and other records and their places, from the summary or from a scan."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import field
from operator import itemgetter
from typing import NamedTuple, TypeVar

from cwcli.errors import InputError
from cwcli.input import BYTES_PER_MEGABYTE, InputFile
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.format.joined_file import ChannelRenumbering
from cwcli.logs.format.metadata_table import MetadataRun, MetadataTable
from cwcli.logs.format.records import AttachmentIndex, Channel, ChunkIndex, Schema, Statistics

MAX_DEFINITION_SHARE_OF_CHUNK_BOUND = 1 / 4
"""The greatest size of all schemas and channels of a log, as a share of that of a chunk. Chosen by hand: 64 MB of the
default; recorders write 10 MB at most."""
BYTES_AS_COSTLY_AS_ONE_METADATA_ENTRY = 128
"""Bytes of definitions that take about as much memory as one entry of a channel's metadata. Chosen by hand."""


class UnchunkedRange(NamedTuple):
    """A byte range of the data section outside chunks: messages found by a scan, or bytes that no index covers."""

    start: int
    end: int


class UnchunkedRecord(NamedTuple):
    """A schema or channel outside chunks, or a record with an opcode that the format does not define (`id` -1)."""

    start: int
    length: int
    opcode: int
    id: int


Item = ChunkIndex | UnchunkedRange | AttachmentIndex | MetadataRun | UnchunkedRecord
Kind = TypeVar("Kind")


@dataclass
class LogIndex:
    """The schemas, channels, chunks and other records of a file, and their places.

    Attributes:
        profile, library: From the header.
        header_length: Bytes of magic and header; 0 if the header is damaged.
        schemas, channels: By id.
        items: The data section in file order. `UnchunkedRecord`s are listed after a scan only.
        metadata: The metadata records; a `Run` among the items names its rows.
        statistics: The counts of the summary or of the scan; None if there are none yet.
        data_end: Offset of the data end record, which holds a CRC of everything before; None if there is none.
        has_end: There is a data end record, or a footer.
        cut_chunks: Start offsets of chunks that are cut off, or whose record has a wrong length.
        has_complete_summary: A complete summary lists everything.
        data_sections: For a log of parts: start and `data_end` of each part that has one.
        renumberings: For a log of parts: start of each part, and the mapping of its channel ids to those of the log;
            None if the ids are the same.
        n_definition_bytes: About how much memory the schemas and channels take.
        has_message_counts: The summary counts the messages of each channel, which shows an index that leaves some out.
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
    has_complete_summary: bool = False
    has_message_counts: bool = False
    n_definition_bytes: int = 0
    data_sections: list[tuple[int, int]] = field(default_factory=list)
    renumberings: list[tuple[int, ChannelRenumbering | None]] = field(default_factory=list)

    def count_definition(self, definition: Schema | Channel, file: InputFile) -> None:
        """Count the memory of a schema or a channel that is new.

        Raises:
            InputError: All together take too much.
        """
        if isinstance(definition, Schema):
            n_bytes = len(definition.name) + len(definition.data)
        else:
            entries = definition.metadata.items()
            n_bytes = len(definition.topic) + sum(
                BYTES_AS_COSTLY_AS_ONE_METADATA_ENTRY + len(key) + len(value) for key, value in entries
            )
        self.n_definition_bytes += n_bytes
        n_most = file.max_chunk_bytes * MAX_DEFINITION_SHARE_OF_CHUNK_BOUND
        if self.n_definition_bytes > n_most:
            what = (
                f"its schemas and channels take more than {n_most / BYTES_PER_MEGABYTE:g} MB, a quarter of --max-chunk"
            )
            raise InputError(what, where=file.name, hint="if you trust the log, a larger --max-chunk reads it")

    def items_of_type(self, kind: type[Kind]) -> list[Kind]:
        """Return the items of one type, in file order."""
        return [item for item in self.items if isinstance(item, kind)]

    def records_with_log_ids(self, at: int, records: memoryview) -> memoryview:
        """Return the records read at an offset, with this log's channel ids in the messages."""
        renumbering = self.channel_renumbering_at_offset(at)
        return records if renumbering is None else renumbering.renumber_channels_of_messages(records)

    def channel_renumbering_at_offset(self, at: int) -> ChannelRenumbering | None:
        """Return the mapping of the channel ids at an offset to those of the log; None if they are the same."""
        k = bisect_right(self.renumberings, at, key=itemgetter(0)) - 1
        return self.renumberings[k][1] if k >= 0 else None

    def start_and_data_end_of_section_at(self, offset: int) -> tuple[int, int | None]:
        """Return start (at the magic bytes) and `data_end` of the data section around an offset."""
        within = [each for each in self.data_sections if each[0] <= offset < each[1]]
        return within[0] if within else (0, None if self.data_sections else self.data_end)

    def lacks_channel_or_schema(self, channel_id: int) -> bool:
        channel = self.channels.get(channel_id)
        return channel is None or (channel.schema_id != 0 and channel.schema_id not in self.schemas)
