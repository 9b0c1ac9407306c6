"""Reads the summary at the end of a file: everything that `cwcli info` shows, in one short read."""

from __future__ import annotations

import zlib
from operator import itemgetter

from cwcli.input import InputFile
from cwcli.logs.format.faults import check_non_message_record_count
from cwcli.logs.format.index import Item, LogIndex, UnchunkedRange
from cwcli.logs.format.metadata_table import MIN_RECORDS_FOR_KERNEL
from cwcli.logs.format.records import (
    FOOTER_BYTES,
    MCAP_MAGIC,
    RECORD_PREFIX,
    AttachmentIndex,
    ByteSource,
    ChunkIndex,
    Footer,
    MetadataIndex,
    Opcode,
    RecordError,
    Schema,
    Statistics,
    read_channel,
    read_opcode_and_content_range,
    read_record,
)

DATA_END_BYTES = RECORD_PREFIX.size + 4
"""Size in bytes of a data end record with its prefix (MCAP specification)."""


def find_footer_and_its_offset(data: ByteSource) -> tuple[Footer, int] | None:
    """Return the footer and its offset, or None if the file does not end with one because it was cut."""
    at = len(data) - len(MCAP_MAGIC) - FOOTER_BYTES
    if at < len(MCAP_MAGIC) or data[-len(MCAP_MAGIC) :] != MCAP_MAGIC:
        return None
    try:
        opcode, start, end = read_opcode_and_content_range(data, at, len(data) - len(MCAP_MAGIC))
        return (
            (read_record(Footer, data, start, end), at)
            if opcode == Opcode.FOOTER and end == len(data) - len(MCAP_MAGIC)
            else None
        )
    except RecordError:
        return None


def read_summary_if_present(
    file: InputFile, footer: Footer, footer_at: int, data_start: int, *, verify: bool
) -> LogIndex | None:
    """Return the index of a file from its summary.

    Args:
        footer, footer_at: From `find_footer_and_its_offset`.
        data_start: Offset of the data section.
        verify: Check the summary's CRC.

    Returns:
        None if there is no summary. It may be incomplete (`has_complete_summary`), as the format allows.

    Raises:
        RecordError: The summary is damaged.
        InputError: It holds too many records.
    """
    start = footer.summary_start
    if start == 0:
        return None
    if not data_start <= start <= footer_at:
        raise RecordError("the footer points to no summary")
    summary = file[start : footer_at + FOOTER_BYTES - 4]
    if verify and footer.summary_crc and footer.summary_crc != zlib.crc32(summary):
        raise RecordError("the summary's CRC is wrong")
    index = LogIndex(has_end=True)
    at = n = n_alike = 0
    while at < footer_at - start:
        opcode, begin, at = read_opcode_and_content_range(summary, at, footer_at - start)
        n += opcode not in (Opcode.CHUNK_INDEX, Opcode.SUMMARY_OFFSET, Opcode.METADATA_INDEX)
        check_non_message_record_count(file.name, n)
        _add_record_to_index(index, opcode, summary, begin, at, file)
        n_alike = n_alike + 1 if opcode == Opcode.METADATA_INDEX else 0
        if n_alike > MIN_RECORDS_FOR_KERNEL:
            at = index.metadata.append_consecutive_records_and_get_end(
                summary, at, footer_at - start, opcode, file.name
            )
    data_end = start - DATA_END_BYTES
    if data_end < data_start or file[data_end : data_end + 1] != bytes([Opcode.DATA_END]):
        data_end = start  # a longer end record: the walk will come upon it
    else:
        index.data_end = data_end
    _sort_items_and_insert_unindexed_ranges(index, data_start, data_end)
    return index


def _add_record_to_index(index: LogIndex, opcode: int, data: ByteSource, start: int, end: int, file: InputFile) -> None:
    """Add one record of the summary to the index.

    Raises:
        InputError: The schemas and channels take too much memory.
        RecordError: It is damaged, or belongs in the data section.
    """
    if opcode == Opcode.SCHEMA:
        schema = read_record(Schema, data, start, end)
        if index.schemas.get(schema.id) != schema:
            index.count_definition(schema, file)
        index.schemas[schema.id] = schema
    elif opcode == Opcode.CHANNEL:
        channel = read_channel(data, start, end)
        if index.channels.get(channel.id) != channel:
            index.count_definition(channel, file)
        index.channels[channel.id] = channel
    elif opcode == Opcode.CHUNK_INDEX:
        index.items.append(read_record(ChunkIndex, data, start, end))
    elif opcode == Opcode.STATISTICS:
        index.statistics = read_record(Statistics, data, start, end)
    elif opcode == Opcode.ATTACHMENT_INDEX:
        index.items.append(read_record(AttachmentIndex, data, start, end))
    elif opcode == Opcode.METADATA_INDEX:
        index.metadata.append(*read_record(MetadataIndex, data, start, end))
    elif opcode < Opcode.SUMMARY_OFFSET or opcode == Opcode.DATA_END:
        raise RecordError("the summary holds a record of the data section")


def is_complete_summary(index: LogIndex) -> bool:
    """Tell whether the summary lists all that reading needs."""
    counted = index.statistics
    used = {channel_id for chunk in index.items_of_type(ChunkIndex) for channel_id in chunk.index_offsets}
    return (
        counted is not None
        and not any(map(index.lacks_channel_or_schema, {*used, *index.channels}))
        and counted.n_channels == len(index.channels)
        and counted.n_chunks == len(index.items_of_type(ChunkIndex))
        and counted.n_attachments == len(index.items_of_type(AttachmentIndex))
        and counted.n_metadata == len(index.metadata)
    )


def _sort_items_and_insert_unindexed_ranges(index: LogIndex, start: int, end: int) -> None:
    """Sort the items by offset, and insert the ranges of the data section between them that no index covers.

    Raises:
        RecordError: Indexed records overlap, or lie outside the data section.
    """
    index.metadata.sort_by_offset()
    places: list[tuple[int, int, Item]] = [(run.start, run.end, run) for run in index.metadata.contiguous_runs()]
    for each in index.items:
        if isinstance(each, ChunkIndex):
            places.append((each.chunk_start, each.end_offset, each))
        elif isinstance(each, AttachmentIndex):
            places.append((each.offset, each.offset + each.length, each))
    index.items = []
    at = start
    for first, last, item in sorted(places, key=itemgetter(0, 1)):
        if first < at or last > end:
            raise RecordError("the summary's indexes overlap, or point outside the file")
        if first > at:
            index.items.append(UnchunkedRange(at, first))
        index.items.append(item)
        at = last
    if at < end:
        index.items.append(UnchunkedRange(at, end))
