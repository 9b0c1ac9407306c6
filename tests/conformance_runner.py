"""For the MCAP conformance suite's runner: `python -m tests.conformance_runner streamed|indexed|write FILE`.

Prints what foxglove/mcap's tests/conformance wants of a `StreamedReadTestRunner` (every record in file order, those in
chunks among them) and of an `IndexedReadTestRunner` (definitions, messages in log-time order, statistics). `write`
takes the JSON of a file and prints its bytes, as a `WriteTestRunner` has to; it ends with 2 where `supports` is false.
"""

from __future__ import annotations

import argparse
import json
import struct
import sys
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.records import Attachment

from cwcli.input import InputFile
from cwcli.logs.format import record_bytes, records
from cwcli.logs.format.chunks import decompress_chunk
from cwcli.logs.format.faults import Faults
from cwcli.logs.format.open_index import open_index
from cwcli.logs.format.records import MCAP_MAGIC, ByteSource, ChunkIndex
from cwcli.logs.format.summary import find_footer_and_its_offset, read_summary_if_present
from cwcli.logs.read.message_reader import MessageReader
from cwcli.logs.write.message_merge import INDEX_ENTRY_DTYPE, ChunkPayload
from cwcli.logs.write.record_writer import RecordWriter

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
    return {"records": list(_records(file, file, len(MCAP_MAGIC), len(file) - len(MCAP_MAGIC)))}


def _records(file: InputFile, data: ByteSource, at: int, end: int) -> Iterator[Document]:
    while at < end:
        opcode, start, stop = records.read_opcode_and_content_range(data, at, end)
        if opcode == records.Opcode.CHUNK:
            chunk = records.read_chunk(data, start, stop)
            sizes = chunk.data_length, chunk.uncompressed_size
            place = ChunkIndex(chunk.start_ns, chunk.end_ns, at, stop - at, {}, 0, chunk.compression, *sizes)
            payload = decompress_chunk(file, place, verify=True)
            yield from _records(file, payload, 0, len(payload))
        elif opcode != records.Opcode.MESSAGE_INDEX:
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


def _header(data: ByteSource, start: int, stop: int) -> Document:
    profile, library = records.read_profile_and_library(data, start, stop)
    return record("Header", profile=profile, library=library)


def _message(data: ByteSource, start: int, stop: int) -> Document:
    head = start + records.MESSAGE_HEADER_BYTES
    channel_id, sequence, log_time, publish_time = struct.unpack("<HIQQ", data[start:head])
    return message(channel_id, sequence, log_time, publish_time, data[head:stop])


def _attachment(data: ByteSource, start: int, stop: int) -> Document:
    found = records.read_attachment(data, start, stop)
    at = records.attachment_crc_offset(found)
    content = {"data": data[at - found.size : at], "name": found.name, "media_type": found.media_type}
    return record("Attachment", log_time=found.log_time_ns, create_time=found.create_time_ns, **content)


def _metadata(data: ByteSource, start: int, stop: int) -> Document:
    name, values = records.read_metadata_name_and_entries(data, start, stop)
    return record("Metadata", name=name, metadata=values)


def _attachment_index(data: ByteSource, start: int, stop: int) -> Document:
    found = records.read_record(records.AttachmentIndex, data, start, stop)
    return record("AttachmentIndex", **dict(zip(ATTACHMENT_INDEX_NAMES, found, strict=True)))


def _summary_offset(data: ByteSource, start: int, stop: int) -> Document:
    opcode, first, length = struct.unpack("<BQQ", data[start : start + 17])
    return record("SummaryOffset", group_opcode=opcode, group_start=first, group_length=length)


KINDS: dict[int, Callable[[ByteSource, int, int], Document]] = {
    records.Opcode.HEADER: _header,
    records.Opcode.SCHEMA: lambda *place: schema(records.read_record(records.Schema, *place)),
    records.Opcode.CHANNEL: lambda *place: channel(records.read_record(records.Channel, *place)),
    records.Opcode.MESSAGE: _message,
    records.Opcode.ATTACHMENT: _attachment,
    records.Opcode.METADATA: _metadata,
    records.Opcode.DATA_END: lambda data, start, stop: record(
        "DataEnd", data_section_crc=int.from_bytes(data[start : start + 4], "little")
    ),
    records.Opcode.STATISTICS: lambda *place: statistics(records.read_record(records.Statistics, *place)),
    records.Opcode.CHUNK_INDEX: lambda *place: _chunk_index(records.read_record(records.ChunkIndex, *place)),
    records.Opcode.ATTACHMENT_INDEX: _attachment_index,
    records.Opcode.METADATA_INDEX: lambda *place: record(
        "MetadataIndex", **records.read_record(records.MetadataIndex, *place)._asdict()
    ),
    records.Opcode.SUMMARY_OFFSET: _summary_offset,
    records.Opcode.FOOTER: lambda *place: record("Footer", **records.read_record(records.Footer, *place)._asdict()),
}


def indexed(file: InputFile) -> Document:
    """What the reader of logs finds: by the summary, or without where there is none that is whole."""
    faults = Faults()
    index = open_index(file, faults, recover=False)
    reader = MessageReader(file, index, faults, recover=False)
    rows = [
        (int(channel_id), int(sequence), log_ns, int(publish_ns), bytes(payload))
        for batch in reader.iter_batches(list(index.channels))
        for channel_id, sequence, publish_ns, (log_ns, payload) in zip(
            batch.channel_id,
            batch.sequence,
            batch.publish_time_ns.view(np.uint64),
            batch.iter_log_times_and_payloads(),
            strict=True,
        )
    ]
    footer = find_footer_and_its_offset(file)
    summary = read_summary_if_present(file, *footer, index.header_length, verify=True) if footer else None
    counted = summary.statistics if summary else None
    return {
        "schemas": [schema(each) for _, each in sorted(index.schemas.items())],
        "channels": [channel(each) for _, each in sorted(index.channels.items())],
        "messages": [message(*each) for each in sorted(rows, key=lambda row: row[2])],
        "statistics": [statistics(counted)] if counted else [],
    }


class Output:
    """What is written, in memory."""

    def __init__(self) -> None:
        self.data = bytearray()

    @property
    def position(self) -> int:
        return len(self.data)

    def write(self, data: bytes) -> None:
        self.data += data


class SuiteWriter(RecordWriter):
    """cwcli's writer, which puts all messages into chunks, with messages outside of them."""

    def message(self, channel_id: int, log_ns: int, record: bytes) -> None:
        self.write_raw_record(record)
        self._counts[channel_id] += 1
        self._first_ns = log_ns if self._first_ns is None else min(self._first_ns, log_ns)
        self._last_ns = max(self._last_ns, log_ns)

    def write_attachment(self, log_ns: int, create_ns: int, name: str, media_type: str, data: bytes) -> None:
        """A new attachment, encoded by the official library: cwcli only copies them."""
        builder = RecordBuilder()
        Attachment(create_time=create_ns, log_time=log_ns, name=name, media_type=media_type, data=data).write(builder)
        encoded = builder.end()
        place = self._output.position, len(encoded)
        self._attachments.append(records.AttachmentIndex(*place, log_ns, create_ns, len(data), name, media_type))
        self.write_raw_record(encoded)


def supports(features: Collection[str]) -> bool:
    """Whether `written` makes a file with these features: cwcli puts no bytes behind the fields of a record."""
    return "pad" not in features


def written(wanted: Document) -> bytes:
    """The file of which these are the records and features: the writer finds counts, places, indexes and CRCs itself.

    Raises:
        NotImplementedError: A feature is not supported.
    """
    features = frozenset(wanted["meta"]["variant"]["features"])
    if not supports(features):
        raise NotImplementedError(f"not supported: {', '.join(sorted(features))}")
    output = Output()
    writer = SuiteWriter(cast("Any", output))
    in_chunk = bytearray()
    places: list[tuple[int, int, int]] = []
    for each in wanted["records"]:
        kind, given = each["type"], dict(each["fields"])
        if kind in ("Attachment", "Metadata", "DataEnd") and in_chunk:
            entries = {
                channel_id: np.array([place[1:] for place in places if place[0] == channel_id], INDEX_ENTRY_DTYPE)
                for channel_id in dict.fromkeys(place[0] for place in places)
            }
            times = [log_ns for _, log_ns, _ in places]
            payload = ChunkPayload(np.frombuffer(bytes(in_chunk), np.uint8), min(times), max(times), entries)
            writer.write_stored_chunk(payload, "", bytes(in_chunk), is_indexed="mx" in features)
            in_chunk.clear()
        if kind == "Header":
            writer.write_header(given["profile"], given["library"])
        elif kind == "Schema":
            defined = records.Schema(int(given["id"]), given["name"], given["encoding"], octets(given["data"]))
            writer.write_schema(defined, listed_only="ch" in features)
            in_chunk += record_bytes.encode_record(defined) if "ch" in features else b""
        elif kind == "Channel":
            ids = int(given["id"]), int(given["schema_id"])
            named = records.Channel(*ids, given["topic"], given["message_encoding"], given["metadata"])
            writer.write_channel(named, listed_only="ch" in features)
            in_chunk += record_bytes.encode_record(named) if "ch" in features else b""
        elif kind == "Message":
            numbers = [int(given[name]) for name in ("channel_id", "sequence", "log_time", "publish_time")]
            content = struct.pack("<HIQQ", *numbers) + octets(given["data"])
            packed = records.RECORD_PREFIX.pack(records.Opcode.MESSAGE, len(content)) + content
            if "ch" in features:
                places.append((numbers[0], numbers[2], len(in_chunk)))
                in_chunk += packed
            else:
                writer.message(numbers[0], numbers[2], packed)
        elif kind == "Attachment":
            named_as = given["name"], given["media_type"], octets(given["data"])
            writer.write_attachment(int(given["log_time"]), int(given["create_time"]), *named_as)
        elif kind == "Metadata":
            writer.write_metadata(given["name"], given["metadata"])
        elif kind == "DataEnd":
            kinds = {opcode for feature, opcode in SUMMARY.items() if feature in features}
            writer.write_summary_and_footer(kinds, has_offsets="sum" in features, data_crc=zlib.crc32(output.data))
            break
    return bytes(output.data)


SUMMARY = {
    "rsh": records.Opcode.SCHEMA,
    "rch": records.Opcode.CHANNEL,
    "st": records.Opcode.STATISTICS,
    "chx": records.Opcode.CHUNK_INDEX,
    "ax": records.Opcode.ATTACHMENT_INDEX,
    "mdx": records.Opcode.METADATA_INDEX,
}


def octets(numbers: Sequence[str]) -> bytes:
    return bytes(map(int, numbers))


READERS = {"streamed": streamed, "indexed": indexed}


def main() -> int:
    """Parse the arguments and print."""
    parser = argparse.ArgumentParser(prog="python -m tests.conformance_runner", description=__doc__)
    parser.add_argument("kind", choices=(*READERS, "write"))
    parser.add_argument("file")
    given = parser.parse_args()
    if given.kind == "write":
        try:
            sys.stdout.buffer.write(written(json.loads(Path(given.file).read_text())))
        except NotImplementedError as error:
            print(error, file=sys.stderr)
            return 2
        return 0
    with InputFile.open(given.file) as file:
        print(json.dumps(READERS[given.kind](file)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
