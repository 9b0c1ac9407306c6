"""Records of a ROS 1 bag, taken from a file or from the pieces of an unpacked chunk.

A record is the length of its header, the header, the length of its data, the data; a header is a list of fields, each
the length of `name=value` and that text (http://wiki.ros.org/Bags/Format/2.0, http://wiki.ros.org/Bags/Format/1.2).
"""

from __future__ import annotations

import bz2
import struct
from collections.abc import Iterator
from typing import Any, NamedTuple

from cwcli.input import InputFile
from cwcli.signals.units import NS_PER_S

MAX_HEADER_BYTES = 1 << 20
"""The greatest size of a record's header, 1 MiB; in version 1.2 it holds a definition. Chosen by hand."""
MAX_HEADER_FIELDS = 64
"""The greatest number of fields in a header. Chosen by hand: the format has eight at most."""
BAG_BYTES_READ_AT_ONCE = 1 << 20
"""Bytes of a file that are read at a time. Chosen by hand."""
LENGTH_STRUCT = struct.Struct("<I")
"""The length in front of a header, a field, or data."""
TIME_STRUCT = struct.Struct("<II")
"""A time: seconds and nanoseconds."""
CONNECTION_FIELD_HEAD, OP_FIELD_HEAD, TIME_FIELD_HEAD = b"\t\0\0\0conn=", b"\4\0\0\0op=\2", b"\r\0\0\0time="
"""The fields of a message's header as recorders write them, with their lengths, up to their values."""
MESSAGE_HEADER_BYTES, MESSAGE_HEADER_AND_BOTH_LENGTHS_BYTES = 38, 46
"""The size of such a header, and with its length and that of the data."""
_UNPACK_MESSAGE_HEADER_OF_RECORDER = struct.Struct("<I9sI8s9sIII").unpack_from
"""Reads such a header as the recorder of ROS writes it."""
_UNPACK_MESSAGE_HEADER_OF_PYTHON_LIBRARY = struct.Struct("<I8s9sI9sIII").unpack_from
"""Reads such a header as ROS's library for Python writes it."""
CHUNK_OP_FIELD = b"op=\x05"
"""The field of a header that says that its record is a chunk."""
Header = dict[bytes, bytes]
BYTES_UNPACKED_AT_ONCE = 1 << 20
"""Bytes that are unpacked at a time, 1 MiB. Chosen by hand."""
BAG_CHUNK_COMPRESSIONS = ("none", "bz2", "lz4")
"""The compressions of chunks (http://wiki.ros.org/Bags/Format/2.0)."""


class BagError(ValueError):
    """Bytes that are no record, or a record that can't be used."""


class EndOfRecordsError(BagError):
    """The bytes end inside of a record."""


class PieceSource:
    """Bytes that come in pieces.

    Args:
        pieces: The pieces; they may raise `BagError`.
    """

    def __init__(self, pieces: Iterator[bytes]) -> None:
        self._pieces = pieces
        self._held = b""
        self._at = 0

    def is_at_end(self) -> bool:
        """Tell whether no byte is left."""
        return self._at == len(self._held) and not self._fill_until_n_bytes(1)

    def take(self, n: int) -> bytes:
        """Return the next `n` bytes.

        Raises:
            EndOfRecordsError: There are fewer.
        """
        at = self._at
        if at + n > len(self._held):
            if not self._fill_until_n_bytes(n):
                raise EndOfRecordsError("the data end inside of a record")
            at = self._at
        self._at = at + n
        return self._held[at : at + n]

    def take_messages(self, most_bytes: int) -> Iterator[tuple[int, int, bytes]]:
        """Yield the connection, the time in ns and the data of the messages that come next and are held whole.

        It ends before a record of another kind, or with another header than recorders write, or with more data than
        `most_bytes`; `take_record_head` reads any.
        """
        held_bytes, at = self._held, self._at
        end = len(held_bytes)
        while at + MESSAGE_HEADER_AND_BOTH_LENGTHS_BYTES <= end:
            n_header, first, key, second, third, seconds, nanoseconds, n = _UNPACK_MESSAGE_HEADER_OF_RECORDER(
                held_bytes, at
            )
            if first != CONNECTION_FIELD_HEAD or second != OP_FIELD_HEAD:
                n_header, second, first, key, third, seconds, nanoseconds, n = _UNPACK_MESSAGE_HEADER_OF_PYTHON_LIBRARY(
                    held_bytes, at
                )
            start = at + MESSAGE_HEADER_AND_BOTH_LENGTHS_BYTES
            stop = start + n
            is_message = n_header == MESSAGE_HEADER_BYTES and first == CONNECTION_FIELD_HEAD and second == OP_FIELD_HEAD
            if not is_message or third != TIME_FIELD_HEAD or stop > end or n > most_bytes:
                return
            self._at = at = stop
            yield key, seconds * NS_PER_S + nanoseconds, held_bytes[start:stop]

    def skip(self, n: int) -> None:
        """Leave out the next `n` bytes; raise as `take` does."""
        while n > len(self._held) - self._at:
            n -= len(self._held) - self._at
            self._held, self._at = next(self._pieces, b""), 0
            if not self._held:
                raise EndOfRecordsError("the data end inside of a record")
        self._at += n

    def _fill_until_n_bytes(self, n: int) -> bool:
        """Hold at least `n` bytes; return whether there are so many."""
        pieces = [self._held[self._at :]]
        n_held = len(pieces[0])
        while n_held < n:
            piece = next(self._pieces, b"")
            if not piece:
                break
            pieces.append(piece)
            n_held += len(piece)
        self._held, self._at = b"".join(pieces), 0
        return n_held >= n


def iter_file_pieces(file: InputFile, start: int, stop: int) -> Iterator[bytes]:
    """Yield the bytes of a part of a file."""
    for at in range(start, stop, BAG_BYTES_READ_AT_ONCE):
        yield bytes(file[at : min(at + BAG_BYTES_READ_AT_ONCE, stop)])


class RecordHead(NamedTuple):
    """What stands in front of a record's data.

    Attributes:
        header: Fields of the header.
        op: What kind of record it is.
        n_bytes: Size of the data.
    """

    header: Header
    op: int
    n_bytes: int


def take_record_head(source: PieceSource) -> RecordHead:
    """Take a record up to its data.

    Raises:
        BagError: There is none.
    """
    header = parse_header(source.take(take_length(source, MAX_HEADER_BYTES)))
    op = header.get(b"op", b"")
    if len(op) != 1:
        raise BagError("a record does not say what it is")
    return RecordHead(header, op[0], take_length(source))


def take_length(source: PieceSource, limit: int | None = None) -> int:
    """Take a length.

    Raises:
        BagError: It exceeds the limit.
    """
    (n,) = LENGTH_STRUCT.unpack(source.take(LENGTH_STRUCT.size))
    if limit is not None and n > limit:
        raise BagError(f"a header has {n:,} bytes")
    return int(n)


def parse_header(data: bytes) -> Header:
    """Return the fields of a header.

    Raises:
        BagError: It is none.
    """
    header: Header = {}
    at = 0
    while at < len(data):
        if at + LENGTH_STRUCT.size > len(data):
            raise BagError("a header is no list of fields")
        (n,) = LENGTH_STRUCT.unpack_from(data, at)
        at += LENGTH_STRUCT.size
        name, equals, value = data[at : at + n].partition(b"=")
        if not equals or at + n > len(data) or len(header) == MAX_HEADER_FIELDS:
            raise BagError("a header is no list of fields")
        header[name] = value
        at += n
    return header


def header_number(header: Header, name: bytes, size: int = LENGTH_STRUCT.size) -> int:
    """Return a number of a header.

    Raises:
        BagError: It is missing, or has another size in bytes.
    """
    value = header.get(name, b"")
    if len(value) != size:
        raise BagError(f"a record has no {name.decode()}")
    return int.from_bytes(value, "little")


def header_text(header: Header, name: bytes) -> str:
    """Return a text of a header; raise as `header_number` does."""
    if name not in header:
        raise BagError(f"a record has no {name.decode()}")
    return header[name].decode("utf-8", "replace")


def ros_time_to_ns(value: bytes) -> int:
    """Return a time in ns.

    Raises:
        BagError: It is none.
    """
    if len(value) != TIME_STRUCT.size:
        raise BagError("a record has no time")
    seconds, nanoseconds = TIME_STRUCT.unpack(value)
    return int(seconds) * NS_PER_S + int(nanoseconds)


def find_next_chunk_offset(file: InputFile, start: int) -> int | None:
    """Return the place of the next record of a chunk at or behind `start`, by the look of its header; None if none."""
    at = start
    while at < len(file):
        block = bytes(file[at : at + BAG_BYTES_READ_AT_ONCE])
        mark = block.find(CHUNK_OP_FIELD)
        while mark >= 0:
            found = _chunk_offset_around_mark(file, at + mark, start)
            if found is not None:
                return found
            mark = block.find(CHUNK_OP_FIELD, mark + 1)
        at += max(len(block) - len(CHUNK_OP_FIELD) + 1, 1)
    return None


MAX_CHUNK_HEADER_BYTES = 128
"""The greatest size of a chunk's header that is recognised. Chosen by hand: written ones have 40 to 50."""


def _chunk_offset_around_mark(file: InputFile, mark: int, start: int) -> int | None:
    """Return the place of the chunk whose header has its mark at a place."""
    first = max(start, mark - MAX_CHUNK_HEADER_BYTES)
    window = bytes(file[first : mark + MAX_CHUNK_HEADER_BYTES])
    if b"compression=" not in window or b"size=" not in window:
        return None
    for at in range(mark - first - LENGTH_STRUCT.size, -1, -1):
        (n,) = LENGTH_STRUCT.unpack_from(window, at)
        end = at + LENGTH_STRUCT.size + n
        if n <= MAX_CHUNK_HEADER_BYTES and mark - first < end <= len(window):
            try:
                header = parse_header(window[at + LENGTH_STRUCT.size : end])
            except BagError:
                continue
            if header.keys() >= {b"op", b"compression", b"size"}:
                return first + at
    return None


def iter_unpacked_pieces(file: InputFile, start: int, n_bytes: int, compression: str, size: int) -> Iterator[bytes]:
    """Yield the content of a chunk.

    Args:
        file: The bag.
        start: Place of the chunk's data.
        n_bytes: Size of the chunk's data, which may end behind the end of the file.
        compression: One of `BAG_CHUNK_COMPRESSIONS`.
        size: Size of the content as the chunk declares it.

    Raises:
        BagError: It can't be unpacked, or has another size.
    """
    stop = min(start + n_bytes, len(file))
    stored = iter_file_pieces(file, start, stop)
    if compression == "none":
        if size != n_bytes:
            raise BagError(f"a chunk declares {size:,} bytes and has {n_bytes:,}")
        yield from stored
        return
    n_left = size
    for piece in _iter_decompressed(stored, compression):
        n_left -= len(piece)
        if n_left < 0:
            raise BagError(f"a chunk unpacks to more than the {size:,} bytes that it declares")
        yield piece
    if n_left:
        raise BagError(f"a chunk unpacks to {size - n_left:,} of the {size:,} bytes that it declares")


def _iter_decompressed(stored: Iterator[bytes], compression: str) -> Iterator[bytes]:
    decompressor: Any
    faults: tuple[type[Exception], ...]
    if compression == "bz2":
        decompressor, faults = bz2.BZ2Decompressor(), (OSError, EOFError, ValueError)
    else:
        import lz4.frame

        decompressor, faults = lz4.frame.LZ4FrameDecompressor(), (RuntimeError, EOFError, ValueError)
    try:
        while not decompressor.eof:
            data = next(stored, b"") if decompressor.needs_input else b""
            if decompressor.needs_input and not data:
                return
            piece = decompressor.decompress(data, BYTES_UNPACKED_AT_ONCE)
            if piece:
                yield piece
    except faults as error:
        raise BagError(f"a chunk can't be unpacked: {error}") from error
