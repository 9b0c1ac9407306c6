"""Converts files that are not MCAP when they are opened: files compressed with zstd, ROS 1 bags, rosbag2 databases.

The converted log is a temporary file without a name, which exists as long as the log is open. The hash, and the file
that must not change or be overwritten, are those of the original file.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import IO, cast

from cwcli.errors import InputError, OutputError
from cwcli.input import InputFile
from cwcli.logs.format.joined_file import JoinedFile
from cwcli.logs.read.read_bounds import BYTES_PER_GIGABYTE, COPY_BLOCK_BYTES, ReadBounds
from cwcli.logs.read.source_format import SourceFormat

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
"""The first bytes of a zstd frame (RFC 8878, 3.1.1)."""
MAX_ZSTD_LAYERS = 8
"""Largest number of times that a file may be packed by zstd. Chosen by hand: once is common, twice happens, and each
layer costs a copy of the file."""
ROS1_BAG_MAGIC = b"#ROSBAG V"
"""The first bytes of a ROS 1 bag (http://wiki.ros.org/Bags/Format)."""
SQLITE_MAGIC = b"SQLite format 3\0"
"""The first bytes of a SQLite database (https://www.sqlite.org/fileformat2.html)."""


class ConvertedFile(InputFile):
    """A converted file.

    Args:
        descriptor: Descriptor of the temporary file; closed with this.
        original: The file that the user named; closed with this.
        more: Further files that were read with it; closed with this.

    Attributes:
        original: The file that the user named.
        source_format: What the original was; None where it is MCAP inside a compressed file.
    """

    source_format: SourceFormat | None = None

    def __init__(self, descriptor: int, original: InputFile, more: Sequence[InputFile] = ()) -> None:
        self.original = original
        self._more = more
        super().__init__(descriptor, original.name)

    @property
    def disk_files(self) -> Sequence[InputFile]:
        """Return the file that the user named, and those that were read with it."""
        return [*self.original.disk_files, *self._more]

    @property
    def n_stored_bytes(self) -> int:
        """The number of bytes that hold the content: those of the original."""
        return self.original.n_stored_bytes

    def check_unchanged(self) -> None:
        """Check that the original files have not changed since they were opened."""
        for each in (self.original, *self._more):
            each.check_unchanged()

    def _close(self) -> None:
        super()._close()
        for each in (self.original, *self._more):
            each.close()


def source_formats(file: InputFile) -> list[SourceFormat]:
    """Return the formats of the converted files that a log consists of; empty for a log of MCAP files alone."""
    if isinstance(file, JoinedFile):
        return [each for part in file.parts for each in source_formats(part)]
    if isinstance(file, ConvertedFile) and file.source_format is not None:
        return [file.source_format]
    return []


def convert_if_needed(file: InputFile, bounds: ReadBounds) -> InputFile:
    """Return the file itself if it is a log, else the log that it is converted to.

    Args:
        file: An open file; closed where this fails.

    Raises:
        InputError: It can't be read.
        OutputError: There is no room for what it becomes.
        UsageError: A package is not installed that it needs.
    """
    try:
        bounds.refuse_holes(file)
        head = bytes(file[:16])
        n_layers = 0
        while head.startswith(ZSTD_MAGIC):
            if (n_layers := n_layers + 1) > MAX_ZSTD_LAYERS:
                what = f"it is packed by zstd more than {MAX_ZSTD_LAYERS} times"
                raise InputError(what, where=file.name, hint="zstd -d unpacks it once")
            file = _convert_into_temporary_file(file, partial(_decompress_file, file, bounds))
            head = bytes(file[:16])
        if head.startswith((ROS1_BAG_MAGIC, SQLITE_MAGIC)):
            return _convert_bag_file(file, bounds, is_ros1=head.startswith(ROS1_BAG_MAGIC))
        return file
    except BaseException:
        file.close()
        raise


def _convert_bag_file(file: InputFile, bounds: ReadBounds, *, is_ros1: bool) -> InputFile:
    from cwcli.logs.read.reader_process import convert_in_process
    from cwcli.logs.read.sqlite_files import open_journals

    source = SourceFormat("a ROS 1 bag" if is_ros1 else "a rosbag2 database")
    if isinstance(file, ConvertedFile):
        source.add_compression("zstd")
    journals = [] if is_ros1 else open_journals(file)
    try:
        for each in journals:
            bounds.refuse_holes(each)
        fill = partial(convert_in_process, file, source, None if is_ros1 else journals, bounds)
        log_file = _convert_into_temporary_file(file, fill, journals)
    except BaseException:
        for each in journals:
            each.close()
        raise
    log_file.source_format = source
    log_file.notes = {**file.notes, **source.notes}
    return log_file


def _convert_into_temporary_file(
    file: InputFile, fill: Callable[[IO[bytes]], None], files_read_with_it: Sequence[InputFile] = ()
) -> ConvertedFile:
    """A temporary file that `fill` has written, in place of `file` and what was read with it."""
    import tempfile

    try:
        with tempfile.TemporaryFile(prefix="cwcli-", suffix=".mcap") as target:
            fill(target)
            target.flush()
            return ConvertedFile(os.dup(target.fileno()), file, files_read_with_it)
    except OSError as error:
        raise OutputError(
            f"{file.name} can't be converted: {error.strerror}",
            where=tempfile.gettempdir(),
            hint="point TMPDIR to a folder with more room",
        ) from error


def _decompress_file(file: InputFile, bounds: ReadBounds, target: IO[bytes]) -> None:
    import zstandard

    max_bytes = bounds.max_unpacked_bytes(file.n_stored_bytes)
    unpacker = zstandard.ZstdDecompressor().stream_reader(
        cast("IO[bytes]", _BlockStream(file)), read_across_frames=True
    )
    n_bytes = 0
    try:
        while block := unpacker.read(COPY_BLOCK_BYTES):
            n_bytes += len(block)
            if n_bytes > max_bytes:
                what = f"it unpacks to more than {max_bytes / BYTES_PER_GIGABYTE:g} GB"
                raise InputError(what, where=file.name, hint="--max-ratio and --max-input read more")
            target.write(block)
    except zstandard.ZstdError as error:
        raise InputError(f"it can't be decompressed: {error}", where=file.name) from error


class _BlockStream:
    """A file as zstandard reads one."""

    def __init__(self, file: InputFile) -> None:
        self._pieces = _iter_file_blocks(file)

    def read(self, size: int = -1) -> bytes:
        """Return the next block, whatever size is asked for, as the reader accepts."""
        return next(self._pieces, b"")


def _iter_file_blocks(file: InputFile) -> Iterator[bytes]:
    for at in range(0, len(file), COPY_BLOCK_BYTES):
        yield bytes(file[at : at + COPY_BLOCK_BYTES])
