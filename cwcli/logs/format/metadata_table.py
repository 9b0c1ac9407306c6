"""A compact table of the metadata records of a log: there may be a million."""

from __future__ import annotations

from array import array
from collections.abc import Collection, Iterator
from typing import NamedTuple

from cwcli.errors import InputError
from cwcli.logs.format.records import ByteSource, MetadataIndex, Opcode

MAX_METADATA_RECORDS = 1 << 21
"""The greatest number of metadata records of a file, so that the table fits in memory. Chosen by hand."""
MIN_RECORDS_FOR_KERNEL = 32
"""The number of consecutive metadata records from which the compiled kernel scans on; fewer are not worth its import.
Chosen by hand."""
SCAN_BLOCK_BYTES = 1 << 16
"""Bytes that one call of the kernel scans. Chosen by hand."""
SCAN_BLOCK_RECORDS = 1 << 12
"""The greatest number of records that one call of the kernel returns. Chosen by hand."""


class MetadataRun(NamedTuple):
    """Consecutive metadata records in the file: their bytes, and their rows in the table."""

    start: int
    end: int
    first: int
    stop: int


class MetadataTable:
    """Offset, length and name of each metadata record."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self._places = array("Q")  # offset and length of each row in turns

    def __len__(self) -> int:
        return len(self.names)

    def __getitem__(self, row: int) -> MetadataIndex:
        return MetadataIndex(self._places[2 * row], self._places[2 * row + 1], self.names[row])

    def __iter__(self) -> Iterator[MetadataIndex]:
        return map(MetadataIndex, self._places[::2], self._places[1::2], self.names)

    def append(self, offset: int, length: int, name: str) -> None:
        """Add one record."""
        self._places.extend((offset, length))
        self.names.append(name)

    def append_consecutive_records_and_get_end(
        self, data: ByteSource, at: int, end: int, opcode: int, file_name: str
    ) -> int:
        """Add the consecutive metadata records, or metadata index records, from an offset on.

        Args:
            at, end: The byte range to scan.
            file_name: The file's name, for messages.

        Returns:
            Offset of the first record that has another opcode, is not whole, or needs the general reader.

        Raises:
            InputError: There are too many metadata records.
        """
        from cwcli.kernels.metadata_scan import scan_metadata, scan_metadata_index

        scan = scan_metadata if opcode == Opcode.METADATA else scan_metadata_index
        room = array("Q", bytes(16 * SCAN_BLOCK_RECORDS))
        while at < end:
            n_bytes, n = scan(data[at : min(at + SCAN_BLOCK_BYTES, end)], at, room, self.names)
            self._places.extend(room[: 2 * n])
            check_metadata_count(file_name, len(self))
            at += n_bytes
            if not n:
                break
        return at

    def contiguous_runs(self) -> Iterator[MetadataRun]:
        """Yield the rows in order of their offsets, consecutive records as one run."""
        offsets, lengths = self._places[::2], self._places[1::2]
        first = start = end = 0
        for row, (offset, length) in enumerate(zip(offsets, lengths, strict=True)):
            if offset != end or not row:
                if row:
                    yield MetadataRun(start, end, first, row)
                first, start = row, offset
            end = offset + length
        if offsets:
            yield MetadataRun(start, end, first, len(offsets))

    def split_run_around_names(self, run: MetadataRun, names: Collection[str]) -> Iterator[MetadataRun]:
        """Yield the pieces of a run that are left without the records of certain names."""
        first, start = run.first, run.start
        for row in range(run.first, run.stop) if names else ():
            if self.names[row] in names:
                offset, length, _ = self[row]
                if row > first:
                    yield MetadataRun(start, offset, first, row)
                first, start = row + 1, offset + length
        if first < run.stop:
            yield MetadataRun(start, run.end, first, run.stop)

    def sort_by_offset(self) -> None:
        offsets = self._places[::2]
        order = sorted(range(len(self)), key=offsets.__getitem__)
        if any(row != k for k, row in enumerate(order)):
            self._places = array("Q", [each for row in order for each in self._places[2 * row : 2 * row + 2]])
            self.names = [self.names[row] for row in order]


def check_metadata_count(name: str, n: int) -> None:
    """Check that a file's metadata can be held in memory.

    Raises:
        InputError: It has more than `MAX_METADATA_RECORDS` metadata records.
    """
    if n > MAX_METADATA_RECORDS:
        what = f"it holds more than {MAX_METADATA_RECORDS:,} metadata records"
        raise InputError(what, where=name, hint="`mcap filter` makes a log without them")
