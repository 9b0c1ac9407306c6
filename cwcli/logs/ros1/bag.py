"""Reads ROS 1 bags of the versions 2.0 and 1.2, record by record: an index is compared, and not needed.

A bag whose recorder was killed has no index. It is read to its end with `--recover` alone, like a log without a footer:
the connections stand in the chunks, in front of their messages.

Format: http://wiki.ros.org/Bags/Format/2.0, http://wiki.ros.org/Bags/Format/1.2
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Generator, Iterator
from typing import NamedTuple

from cwcli.errors import InputError
from cwcli.input import InputFile
from cwcli.logs.codecs.ros2msg import SchemaError
from cwcli.logs.format.records import Channel, Schema
from cwcli.logs.read.read_bounds import ReadBounds
from cwcli.logs.read.source_format import SourceFormat
from cwcli.logs.ros1.cdr_conversion import ConversionError, Ros1Converter
from cwcli.logs.ros1.definitions import (
    MAX_DEFINITION_BYTES,
    definition_checksum,
    parse_ros1_definition,
    ros2_definition_text,
)
from cwcli.logs.ros1.records import (
    BAG_CHUNK_COMPRESSIONS,
    LENGTH_STRUCT,
    BagError,
    EndOfRecordsError,
    Header,
    PieceSource,
    RecordHead,
    find_next_chunk_offset,
    header_number,
    header_text,
    iter_file_pieces,
    iter_unpacked_pieces,
    parse_header,
    ros_time_to_ns,
    take_record_head,
)
from cwcli.signals.units import NS_PER_S

Content = Schema | Channel | tuple[int, int, bytes]
"""A schema, a channel, or the channel's number, log time in ns and payload of a message."""

BAG_VERSION_BY_FIRST_LINE = {b"#ROSBAG V2.0\n": "2.0", b"#ROSBAG V1.2\n": "1.2"}
"""First line of a bag -> its version (http://wiki.ros.org/Bags/Format)."""
BAG_VERSION_LINE_BYTES = 13
"""The size in bytes of the first line of a bag, which names its version."""
OP_DEFINITION, OP_MESSAGE, OP_FILE_HEADER, OP_INDEX, OP_CHUNK, OP_CHUNK_INFO, OP_CONNECTION = range(1, 8)
"""The kinds of records; a definition occurs in version 1.2 alone."""
MAX_CHANNELS = 0xFFFF
"""The greatest number of channels: MCAP has 16 bits for their ids, from 1 on (MCAP specification)."""
INDEX_ENTRY_STRUCT = struct.Struct("<III")
"""An entry of a chunk's index: seconds, nanoseconds, and the offset of a message (rosbag format 2.0)."""
INDEX_ENTRY_BYTES = INDEX_ENTRY_STRUCT.size
"""The size in bytes of such an entry."""
INDEX_ENTRIES_READ_AT_ONCE = 65_536
"""Entries that are read at a time. Chosen by hand."""
CHECKSUM_OF_ANY_TYPE = "*"
"""The checksum of a connection that takes every type."""
MAX_TYPE_NAME_CHARS = 512
"""The greatest length of a type's name. Chosen by hand."""
MAX_KINDS_OF_FAULTS, MAX_FAULT_CHARS = 300, 300
"""The greatest number of different notes on a bag, and the length at which one is cut. Chosen by hand."""
FURTHER_FAULTS_NOTE = "faults of further kinds"
"""The note on what would be one note more than that."""
DAMAGED_CHUNKS_NOTE = "damaged chunks"
"""The note on chunks that were read in part or not at all."""
UNFINISHED_BAG_NOTE = "a bag without an index, or cut: messages may be missing at its end"
"""The note on a bag that its recorder did not finish."""


class Connection(NamedTuple):
    """A connection: a topic as one publisher sent it.

    Attributes:
        channel: Number of its channel.
        topic: Topic.
        identity: Type, checksum and definition.
        converter: Converts its messages; None where the definition can't be used.
    """

    channel: int
    topic: str
    identity: tuple[str, str, str]
    converter: Ros1Converter | None


class _Type(NamedTuple):
    """A message type: the number of its schema, 0 for none, and what converts its messages."""

    schema: int
    converter: Ros1Converter | None


class BagReader:
    """Reads one bag.

    Args:
        file: The bag.
        source: Gets the number of chunks, the compressions, and what could not be read.
        bounds: What it may cost.
    """

    def __init__(self, file: InputFile, source: SourceFormat, bounds: ReadBounds) -> None:
        self._file = file
        self._source = source
        self._bounds = bounds
        self._connections: dict[object, Connection] = {}
        self._types: dict[tuple[str, str], _Type] = {}
        self._n_left = bounds.max_unpacked_bytes(file.n_stored_bytes)
        self._indexed_counts: Counter[object] = Counter()
        self._read_counts: Counter[object] = Counter()
        self._is_in_chunk = False
        # sums over connection and time of each message, which do not depend on the order
        self._read_sum = self._index_sum = self._n_index_entries = 0

    def iter_content(self) -> Generator[Content, None, None]:
        """Yield schemas, channels and messages, in the order of the file.

        Raises:
            InputError: It is damaged or cut, and the bounds do not say to recover; or it can't be read at all.
        """
        version = BAG_VERSION_BY_FIRST_LINE.get(bytes(self._file[:BAG_VERSION_LINE_BYTES]))
        if version is None:
            first = bytes(self._file[:BAG_VERSION_LINE_BYTES]).partition(b"\n")[0].decode("ascii", "replace")
            raise InputError(
                f"bags that begin with {first!r} are not read, those of the versions 2.0 and 1.2 are",
                where=self._file.name,
                hint="ROS 1 converts it: `rosbag fix` or `rosbag migrate`",
            )
        yield from self._iter_records(BAG_VERSION_LINE_BYTES)
        self._count_differences_from_index()

    def _iter_records(self, at: int) -> Iterator[Content]:
        """Yield the content of the file from a place on; behind damage, from the next chunk on."""
        while at < len(self._file):
            begin = at
            try:
                head, at = self._record_head_and_data_offset(at)
                if head.op == OP_CHUNK:
                    yield from self._iter_chunk(head, at)
                elif head.op == OP_FILE_HEADER:
                    if not self._has_index_or_raise_if_encrypted(head.header):
                        self._count_missing_end_once()
                elif head.op == OP_INDEX:
                    self._add_index(head, at)
                else:
                    yield from self._iter_record(head, PieceSource(iter_file_pieces(self._file, at, at + head.n_bytes)))
                at += head.n_bytes
                if at > len(self._file):
                    raise EndOfRecordsError("the file ends inside of a record")
            except BagError as error:
                found = find_next_chunk_offset(self._file, begin + 1) if self._bounds.recover else None
                if found is None and isinstance(error, EndOfRecordsError):
                    self._count_missing_end_once()
                else:
                    self._count_damage_or_raise("damaged records", f"{error} (at byte {begin})")
                if found is None:
                    return
                at = found

    def _record_head_and_data_offset(self, offset: int) -> tuple[RecordHead, int]:
        """Return the head of the record at a place of the file, and the place of its data."""
        (n,) = LENGTH_STRUCT.unpack(self._read_bytes_at(offset, LENGTH_STRUCT.size))
        source = PieceSource(
            iter([self._read_bytes_at(offset, min(n + 2 * LENGTH_STRUCT.size, len(self._file) - offset))])
        )
        return take_record_head(source), offset + n + 2 * LENGTH_STRUCT.size

    def _read_bytes_at(self, at: int, n: int) -> bytes:
        if at + n > len(self._file):
            raise EndOfRecordsError("the file ends inside of a record")
        return bytes(self._file[at : at + n])

    def _has_index_or_raise_if_encrypted(self, header: Header) -> bool:
        """Tell whether the file has an index, as a recorder writes at its end.

        Raises:
            InputError: It is encrypted.
        """
        encryptor = header.get(b"encryptor", b"").decode("utf-8", "replace")
        if encryptor:
            raise InputError(
                f"the bag is encrypted ({encryptor[:80]!r}), which is not read",
                where=self._file.name,
                hint="decrypt it with ROS first",
            )
        return 0 < header_number(header, b"index_pos", 8) <= len(self._file)

    def _iter_chunk(self, head: RecordHead, at: int) -> Iterator[Content]:
        """Yield the content of a chunk whose data are at a place of the file."""
        self._source.n_chunks += 1
        compression = header_text(head.header, b"compression")
        size = header_number(head.header, b"size")
        if compression not in BAG_CHUNK_COMPRESSIONS:
            self._count_damage_or_raise(f"chunks with the compression {compression[:40]!r}, which is not read")
            return
        self._source.add_compression("" if compression == "none" else compression)
        if max(size, head.n_bytes) > self._bounds.max_chunk_bytes:
            what = f"chunks of more than {self._bounds.max_chunk_bytes / 1e6:g} MB"
            self._count_damage_or_raise(what, hint="--max-chunk reads larger ones")
            return
        self._n_left -= size
        if self._n_left < 0:
            what = "chunks beyond what the whole file may unpack to"
            self._count_damage_or_raise(what, hint="--max-ratio and --max-input allow more")
            return
        source = PieceSource(iter_unpacked_pieces(self._file, at, head.n_bytes, compression, size))
        try:
            self._is_in_chunk = True
            while not source.is_at_end():
                yield from self._iter_messages_in_recorder_form(source)
                if not source.is_at_end():
                    yield from self._iter_record(take_record_head(source), source)
        except BagError as error:
            if at + head.n_bytes <= len(self._file):  # else the file was cut, which is noted once
                self._count_damage_or_raise(DAMAGED_CHUNKS_NOTE, f"{error} (at byte {at})")
        finally:
            self._is_in_chunk = False

    def _iter_record(self, head: RecordHead, source: PieceSource) -> Iterator[Content]:
        """Yield the content of one record, and take its data from the source."""
        if head.op == OP_MESSAGE:
            yield from self._iter_message(head, source.take(self._message_size(head)))
        elif head.op == OP_CONNECTION:
            if head.n_bytes > 2 * MAX_DEFINITION_BYTES:
                source.skip(head.n_bytes)
                header = {b"topic": head.header.get(b"topic", b"?"), b"message_definition": b""}
                self._count_fault("topics with a definition that is too long")
            else:
                header = parse_header(source.take(head.n_bytes))
            topic = head.header.get(b"topic") or header.get(b"topic", b"")
            definition = header.get(b"message_definition", b"")
            key = header_number(head.header, b"conn")
            yield from self._iter_new_schema_and_channel(
                key, topic, header.get(b"type", b""), header.get(b"md5sum", b""), definition
            )
        elif head.op == OP_DEFINITION:
            source.skip(head.n_bytes)
            topic = header_text(head.header, b"topic").encode()
            fields = (head.header.get(name, b"") for name in (b"type", b"md5", b"def"))
            yield from self._iter_new_schema_and_channel(topic, topic, *fields)
        elif head.op == OP_CHUNK_INFO:
            self._add_indexed_counts(source.take(min(head.n_bytes, len(self._file))))
        else:
            source.skip(head.n_bytes)

    def _message_size(self, head: RecordHead) -> int:
        if head.n_bytes > self._bounds.max_chunk_bytes:
            raise BagError(f"a message has {head.n_bytes:,} bytes")
        return head.n_bytes

    def _iter_new_schema_and_channel(
        self, key: object, topic: bytes, kind: bytes, checksum: bytes, definition: bytes
    ) -> Iterator[Content]:
        """Yield the channel of a connection, and its schema, where they are new."""
        name, text = kind.decode("utf-8", "replace"), definition.decode("utf-8", "replace")
        identity = name, checksum.decode("ascii", "replace"), text
        known = self._connections.get(key)
        shown = topic.decode("utf-8", "replace")
        if known is not None:
            if (known.topic, known.identity) != (shown, identity):
                self._count_fault(f"connections that come twice and differ ({known.topic})")
            return
        if len(self._connections) == MAX_CHANNELS:
            raise InputError(f"it has more topics than the {MAX_CHANNELS} of a log", where=self._file.name)
        if self._source.n_chunks and not self._is_in_chunk:
            self._count_fault(f"connections that the index describes and no chunk ({shown})")
        if (name, text) not in self._types:
            yield from self._register_type_and_yield_schema(name, text, identity[1])
        found = self._types[name, text]
        connection = Connection(len(self._connections) + 1, shown, identity, found.converter)
        self._connections[key] = connection
        yield Channel(connection.channel, found.schema, shown, "cdr", {})

    def _register_type_and_yield_schema(self, name: str, text: str, checksum: str) -> Iterator[Schema]:
        """Yield the schema of a type; one that can't be used has none, and is counted."""
        shown = _ros2_type_name(name)
        try:
            if len(name) > MAX_TYPE_NAME_CHARS or "/" not in name:
                raise SchemaError("it has no name")
            definition = parse_ros1_definition(name, text)
            if checksum != CHECKSUM_OF_ANY_TYPE and definition_checksum(definition) != checksum:
                self._count_fault(f"message types whose definition differs from its checksum ({shown})")
            self._types[name, text] = _Type(len(self._types) + 1, Ros1Converter(definition))
            yield Schema(len(self._types), shown, "ros2msg", ros2_definition_text(definition).encode())
        except SchemaError as error:
            self._types[name, text] = _Type(0, None)
            self._count_fault(f"message types whose definition can't be used ({shown[:80]}: {error})")

    def _iter_messages_in_recorder_form(self, source: PieceSource) -> Iterator[Content]:
        """Yield the messages that come next, as long as they are as recorders write them."""
        for key, log_time_ns, data in source.take_messages(self._bounds.max_chunk_bytes):
            message = self._converted_message_or_none(key, log_time_ns, data)
            if message is not None:
                yield message

    def _iter_message(self, head: RecordHead, data: bytes) -> Iterator[Content]:
        key: object = head.header[b"topic"] if b"conn" not in head.header and b"topic" in head.header else None
        if key is None:
            key = header_number(head.header, b"conn")
            log_time_ns = ros_time_to_ns(head.header.get(b"time", b""))
        else:
            log_time_ns = ros_time_to_ns(head.header.get(b"sec", b"") + head.header.get(b"nsec", b""))
        message = self._converted_message_or_none(key, log_time_ns, data)
        if message is not None:
            yield message

    def _converted_message_or_none(self, key: object, log_time_ns: int, data: bytes) -> tuple[int, int, bytes] | None:
        """Return a message as it is in the log; None, and it is counted, where it can't be converted."""
        self._read_counts[key] += 1
        self._read_sum += hash((key, log_time_ns))
        connection = self._connections.get(key)
        if connection is None:
            self._count_fault("messages of connections that are not described")
            return None
        try:
            if connection.converter is None:
                raise ConversionError("its type can't be used")
            return connection.channel, log_time_ns, connection.converter.convert(data)
        except ConversionError:
            self._count_fault(f"messages that can't be converted on {connection.topic}")
            return None

    def _add_indexed_counts(self, data: bytes) -> None:
        """Add the counts of one chunk's messages by connection."""
        for at in range(0, len(data) - 7, 8):
            self._indexed_counts[int.from_bytes(data[at : at + 4], "little")] += int.from_bytes(
                data[at + 4 : at + 8], "little"
            )

    def _add_index(self, head: RecordHead, at: int) -> None:
        """Add the index of one connection's messages in a chunk, whose data are at a place of the file."""
        key = head.header.get(b"conn", b"")
        if len(key) == LENGTH_STRUCT.size:  # version 1.2 has another one
            number = int.from_bytes(key, "little")
            source = PieceSource(iter_file_pieces(self._file, at, at + head.n_bytes))
            n_left = head.n_bytes // INDEX_ENTRY_BYTES
            while n_left:
                n = min(n_left, INDEX_ENTRIES_READ_AT_ONCE)
                for seconds, nanoseconds, _ in INDEX_ENTRY_STRUCT.iter_unpack(source.take(n * INDEX_ENTRY_BYTES)):
                    self._index_sum += hash((number, seconds * NS_PER_S + nanoseconds))
                self._n_index_entries += n
                n_left -= n

    def _count_differences_from_index(self) -> None:
        """Count the messages by which the index and what was read differ."""
        n_read = self._read_counts.total()
        if self._n_index_entries and (self._n_index_entries != n_read or self._index_sum != self._read_sum):
            self._count_fault(f"indexes of chunks that differ from the {n_read:,} messages")
        if self._indexed_counts:
            n_missing = (self._indexed_counts - self._read_counts).total()
            n_more = (self._read_counts - self._indexed_counts).total()
            if n_missing:
                self._count_fault("messages that the index counts and the file does not hold", n_missing)
            if n_more:
                self._count_fault("messages that the index does not count", n_more)

    def _count_fault(self, what: str, n: int = 1) -> None:
        notes, note = self._source.notes, what[:MAX_FAULT_CHARS]
        if note not in notes and len(notes) >= MAX_KINDS_OF_FAULTS:
            note = FURTHER_FAULTS_NOTE
        notes[note] = notes.get(note, 0) + n

    def _count_missing_end_once(self) -> None:
        """Note, once, that the end of the bag is missing; raise as `_count_damage_or_raise` does."""
        if UNFINISHED_BAG_NOTE not in self._source.notes:
            self._count_damage_or_raise(
                UNFINISHED_BAG_NOTE, "it has no index or is cut, as a recorder leaves it that was killed"
            )

    def _count_damage_or_raise(self, what: str, detail: str = "", *, hint: str = "") -> None:
        """Count damage.

        Raises:
            InputError: The bounds do not say to recover.
        """
        if not self._bounds.recover:
            raise InputError(
                f"the bag is damaged: {detail or what}",
                where=self._file.name,
                hint=hint or "--recover reads the intact parts and reports what is lost",
            )
        self._count_fault(what)


def _ros2_type_name(name: str) -> str:
    """Return a type's name in ROS 2: `sensor_msgs/Imu` -> `sensor_msgs/msg/Imu`."""
    parts = name.split("/")
    return f"{'/'.join(parts[:-1])}/msg/{parts[-1]}" if len(parts) == 2 else name
