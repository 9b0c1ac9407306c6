"""What a file holds and where, before any message is decoded."""

from __future__ import annotations

from dataclasses import dataclass, field

from cwcli.logs.format.records import AttachmentIndex, Channel, ChunkIndex, MetadataIndex, Schema, Statistics


@dataclass
class Structure:
    """What a file holds.

    Attributes:
        profile, library: From the header.
        schemas, channels: By id.
        chunks: In file order. No `index_offsets` means that the chunk must be opened to know its channels; an offset of
            0 means that the channel is in the chunk, but not in an index.
        loose: Start and end of the parts of the data section outside chunks that may hold messages.
        attachments, metadata: In file order.
        statistics: As the summary or the scan counted; None until something counts.
        data_end: Where the data section ends: its end record, which holds a CRC of everything before; None if there is
            none.
        partial_chunk: Start of the last chunk when it is cut, else None.
        is_scanned: The file was read record by record.
    """

    profile: str = ""
    library: str = ""
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[ChunkIndex] = field(default_factory=list)
    loose: list[tuple[int, int]] = field(default_factory=list)
    attachments: list[AttachmentIndex] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)
    statistics: Statistics | None = None
    data_end: int | None = None
    partial_chunk: int | None = None
    is_scanned: bool = False

    def lacks_definitions(self) -> bool:
        """Whether a channel or schema is used that is not known yet."""
        return any(not chunk.index_offsets.keys() <= self.channels.keys() for chunk in self.chunks) or any(
            channel.schema_id and channel.schema_id not in self.schemas for channel in self.channels.values()
        )
