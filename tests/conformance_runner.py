"""The readers of the MCAP conformance suite's runner: `python -m tests.conformance_runner streamed|indexed FILE`.

Prints what foxglove/mcap's tests/conformance wants of a `StreamedReadTestRunner` (every record in file order, those in
chunks among them) and of an `IndexedReadTestRunner` (definitions, messages in log-time order, statistics). A
`WriteTestRunner` is not possible: it has to write any combination of the format's features, and cwcli always writes
compressed and indexed chunks, without a CRC of the data section.
"""

from __future__ import annotations

import argparse
import json
import struct
import sys
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from cwcli.input import InputFile
from cwcli.logs.format import records
from cwcli.logs.format.chunks import chunk_payload
from cwcli.logs.format.faults import Faults
from cwcli.logs.format.open_index import open_index
from cwcli.logs.format.records import MAGIC, ChunkIndex, Data
from cwcli.logs.format.summary import find_footer, read_summary
from cwcli.logs.read.message_reader import MessageReader

Document = dict[str, Any]
ATTACHMENT_INDEX_NAMES = ("offset", "length", "log_time", "create_time", "data_size", "name", "media_type")
STATISTICS_NAMES = (
    *("message_count", "schema_count", "channel_count", "attachment_count", "metadata_count", "chunk_count"),
    *("message_start_time", "message_end_time", "channel_message_counts"),
)


def shown(value: Any) -> Any:
    """Numbers and bytes as the suite writes them."""
    if isinstance(value, Mapping):
        return {str(key): shown(each) for key, each in value.items()}
    if isinstance(value, bytes | memoryview):
        return [str(each) for each in value]
    return str(value)


def record(kind: str, **fields: Any) -> Document:
    """A record as the suite writes it: its fields by name."""
    return {"type": kind, "fields": [[name, shown(fields[name])] for name in sorted(fields)]}


def schema(found: records.Schema) -> Document:
    return record("Schema", **found._asdict())


def channel(found: records.Channel) -> Document:
    return record("Channel", **found._asdict())


def message(channel_id: int, sequence: int, log_time: int, publish_time: int, data: bytes | memoryview) -> Document:
    return record(
        "Message", channel_id=channel_id, sequence=sequence, log_time=log_time, publish_time=publish_time, data=data
    )


def statistics(found: records.Statistics) -> Document:
    return record("Statistics", **dict(zip(STATISTICS_NAMES, found, strict=True)))


def streamed(file: InputFile) -> Document:
    """Every record but chunks and message indexes, what is in chunks in their place."""
    return {"records": list(_records(file, file, len(MAGIC), len(file) - len(MAGIC)))}


def _records(file: InputFile, data: Data, at: int, end: int) -> Iterator[Document]:
    while at < end:
        opcode, start, stop = records.read_prefix(data, at, end)
        if opcode == records.CHUNK:
            chunk = records.read_chunk(data, start, stop)
            sizes = chunk.data_length, chunk.uncompressed_size
            place = ChunkIndex(chunk.start_ns, chunk.end_ns, at, stop - at, {}, 0, chunk.compression, *sizes)
            payload = chunk_payload(file, place, verify=True)
            yield from _records(file, payload, 0, len(payload))
        elif opcode != records.MESSAGE_INDEX:
            yield KINDS[opcode](data, start, stop)
        at = stop


def _chunk_index(found: ChunkIndex) -> Document:
    return record(
        "ChunkIndex",
        message_start_time=found.start_ns,
        message_end_time=found.end_ns,
        chunk_start_offset=found.chunk_start,
        chunk_length=found.chunk_length,
        message_index_offsets=found.index_offsets,
        message_index_length=found.index_length,
        compression=found.compression,
        compressed_size=found.compressed_size,
        uncompressed_size=found.uncompressed_size,
    )


def _header(data: Data, start: int, stop: int) -> Document:
    profile, library = records.read_header(data, start, stop)
    return record("Header", profile=profile, library=library)


def _message(data: Data, start: int, stop: int) -> Document:
    head = start + records.MESSAGE_HEADER_BYTES
    return message(*struct.unpack("<HIQQ", data[start:head]), data[head:stop])


def _attachment(data: Data, start: int, stop: int) -> Document:
    found = records.read_attachment(data, start, stop)
    at = records.attachment_crc_at(found)
    content = {"data": data[at - found.size : at], "name": found.name, "media_type": found.media_type}
    return record("Attachment", log_time=found.log_time_ns, create_time=found.create_time_ns, **content)


def _metadata(data: Data, start: int, stop: int) -> Document:
    name, values = records.read_metadata(data, start, stop)
    return record("Metadata", name=name, metadata=values)


def _attachment_index(data: Data, start: int, stop: int) -> Document:
    found = records.read_attachment_index(data, start, stop)
    return record("AttachmentIndex", **dict(zip(ATTACHMENT_INDEX_NAMES, found, strict=True)))


def _summary_offset(data: Data, start: int, stop: int) -> Document:
    opcode, first, length = struct.unpack("<BQQ", data[start : start + 17])
    return record("SummaryOffset", group_opcode=opcode, group_start=first, group_length=length)


KINDS: dict[int, Callable[[Data, int, int], Document]] = {
    records.HEADER: _header,
    records.SCHEMA: lambda *place: schema(records.read_schema(*place)),
    records.CHANNEL: lambda *place: channel(records.read_channel(*place)),
    records.MESSAGE: _message,
    records.ATTACHMENT: _attachment,
    records.METADATA: _metadata,
    records.DATA_END: lambda data, start, stop: record(
        "DataEnd", data_section_crc=int.from_bytes(data[start : start + 4], "little")
    ),
    records.STATISTICS: lambda *place: statistics(records.read_statistics(*place)),
    records.CHUNK_INDEX: lambda *place: _chunk_index(records.read_chunk_index(*place)),
    records.ATTACHMENT_INDEX: _attachment_index,
    records.METADATA_INDEX: lambda *place: record("MetadataIndex", **records.read_metadata_index(*place)._asdict()),
    records.SUMMARY_OFFSET: _summary_offset,
    records.FOOTER: lambda *place: record("Footer", **records.read_footer(*place)._asdict()),
}


def indexed(file: InputFile) -> Document:
    """What the reader of logs finds: by the summary, or without where there is none that is whole."""
    faults = Faults()
    index = open_index(file, faults, recover=False, verify=True)
    reader = MessageReader(file, index, faults, recover=False, verify=True)
    rows = [
        (int(channel_id), int(sequence), log_ns, int(publish_ns), bytes(payload))
        for batch in reader.batches(list(index.channels))
        for channel_id, sequence, publish_ns, (log_ns, payload) in zip(
            batch.channel_id, batch.sequence, batch.publish_time_ns.view(np.uint64), batch.messages(), strict=True
        )
    ]
    footer = find_footer(file)
    summary = read_summary(file, *footer, index.header_length, verify=True) if footer else None
    counted = summary.statistics if summary else None
    return {
        "schemas": [schema(each) for _, each in sorted(index.schemas.items())],
        "channels": [channel(each) for _, each in sorted(index.channels.items())],
        "messages": [message(*each) for each in sorted(rows, key=lambda row: row[2])],
        "statistics": [statistics(counted)] if counted else [],
    }


READERS = {"streamed": streamed, "indexed": indexed}


def main() -> int:
    """Parse the arguments and print."""
    parser = argparse.ArgumentParser(prog="python -m tests.conformance_runner", description=__doc__)
    parser.add_argument("kind", choices=READERS)
    parser.add_argument("file")
    given = parser.parse_args()
    with InputFile.open(given.file) as file:
        print(json.dumps(READERS[given.kind](file)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
