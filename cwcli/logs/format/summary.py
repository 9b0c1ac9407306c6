"""The summary at the end of a file: everything that `cwcli info` shows, in one short read."""

from __future__ import annotations

import zlib

from cwcli.logs.format.index import Structure
from cwcli.logs.format.records import (
    ATTACHMENT_INDEX,
    CHANNEL,
    CHUNK_INDEX,
    DATA_END,
    FOOTER,
    FOOTER_BYTES,
    MAGIC,
    METADATA_INDEX,
    PREFIX,
    SCHEMA,
    STATISTICS,
    SUMMARY_OFFSET,
    Data,
    Footer,
    RecordError,
    read_attachment_index,
    read_channel,
    read_chunk_index,
    read_footer,
    read_metadata_index,
    read_prefix,
    read_schema,
    read_statistics,
)

DATA_END_BYTES = PREFIX.size + 4


def find_footer(data: Data) -> tuple[Footer, int] | None:
    """The footer and its offset, or None when the file does not end with one: it was cut."""
    at = len(data) - len(MAGIC) - FOOTER_BYTES
    if at < len(MAGIC) or data[-len(MAGIC) :] != MAGIC:
        return None
    try:
        opcode, start, end = read_prefix(data, at, len(data) - len(MAGIC))
        return (read_footer(data, start, end), at) if opcode == FOOTER and end == len(data) - len(MAGIC) else None
    except RecordError:
        return None


def read_summary(data: Data, footer: Footer, footer_at: int, data_start: int, *, verify: bool) -> Structure | None:
    """The file's structure from its summary.

    Args:
        data: The file.
        footer, footer_at: From `find_footer`.
        data_start: Where the data section begins.
        verify: Check the summary's CRC.

    Returns:
        None when there is no summary. It need not be complete (`is_complete`): the format allows that.

    Raises:
        RecordError: The summary is damaged.
    """
    start = footer.summary_start
    if start == 0:
        return None
    if not data_start <= start <= footer_at:
        raise RecordError("the footer points to no summary")
    summary = data[start : footer_at + FOOTER_BYTES - 4]
    if verify and footer.summary_crc and footer.summary_crc != zlib.crc32(summary):
        raise RecordError("the summary's CRC does not fit")
    structure = Structure()
    at = 0
    while at < footer_at - start:
        opcode, begin, end = read_prefix(summary, at, footer_at - start)
        _take(structure, opcode, summary, begin, end)
        at = end
    data_end = start - DATA_END_BYTES
    if data_end < data_start or data[data_end : data_end + 1] != bytes([DATA_END]):
        data_end = start  # a longer end record: the walk will come upon it
    else:
        structure.data_end = data_end
    structure.chunks.sort(key=lambda chunk: chunk.chunk_start)
    structure.loose = _gaps(structure, data_start, data_end)
    return structure


def _take(structure: Structure, opcode: int, data: Data, start: int, end: int) -> None:
    """Note one record of the summary."""
    if opcode == SCHEMA:
        schema = read_schema(data, start, end)
        structure.schemas[schema.id] = schema
    elif opcode == CHANNEL:
        channel = read_channel(data, start, end)
        structure.channels[channel.id] = channel
    elif opcode == CHUNK_INDEX:
        structure.chunks.append(read_chunk_index(data, start, end))
    elif opcode == STATISTICS:
        structure.statistics = read_statistics(data, start, end)
    elif opcode == ATTACHMENT_INDEX:
        structure.attachments.append(read_attachment_index(data, start, end))
    elif opcode == METADATA_INDEX:
        structure.metadata.append(read_metadata_index(data, start, end))
    elif opcode < SUMMARY_OFFSET or opcode == DATA_END:
        raise RecordError("the summary holds a record of the data section")


def is_complete(structure: Structure) -> bool:
    """Whether the summary repeats all that reading needs."""
    counted = structure.statistics
    if counted is None or structure.lacks_definitions():
        return False
    return (
        counted.n_chunks == len(structure.chunks)
        and counted.n_channels == len(structure.channels)
        and counted.n_attachments == len(structure.attachments)
        and counted.n_metadata == len(structure.metadata)
    )


def _gaps(structure: Structure, start: int, end: int) -> list[tuple[int, int]]:
    """The parts of the data section that no index covers.

    Raises:
        RecordError: Indexed records overlap, or lie outside the data section.
    """
    covered = [
        *((chunk.chunk_start, chunk.chunk_length + chunk.index_length) for chunk in structure.chunks),
        *((each.offset, each.length) for each in structure.attachments),
        *((each.offset, each.length) for each in structure.metadata),
    ]
    covered.sort()
    gaps = []
    at = start
    for offset, length in covered:
        if offset < at or length > end - offset:
            raise RecordError("the summary's indexes overlap, or point outside the file")
        if offset > at:
            gaps.append((at, offset))
        at = offset + length
    if at < end:
        gaps.append((at, end))
    return gaps
