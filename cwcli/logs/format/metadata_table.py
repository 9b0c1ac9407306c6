"""The metadata records of a log, held in little memory and found at once: there may be a million."""

from __future__ import annotations

from array import array
from collections.abc import Collection, Iterator
from typing import NamedTuple

from cwcli.errors import InputError
from cwcli.logs.format.records import METADATA, Data, MetadataIndex

MAX_METADATA = 1 << 21
MANY = 32
"""So many in a row are taken by the kernel; fewer are not worth its import."""
BLOCK_BYTES = 1 << 16
BLOCK_RECORDS = 1 << 12


class Run(NamedTuple):
    """Metadata records that follow one another in the file: its bytes, and the rows of the table."""

    start: int
    end: int
    first: int
    stop: int


class MetadataTable:
    """Where metadata records are and what they are called.

    Attributes:
        names: Of each row.
    """

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
        """One more."""
        self._places.extend((offset, length))
        self.names.append(name)

    def extend(self, data: Data, at: int, end: int, opcode: int, name: str) -> int:
        """Those that follow one another from an offset on, or the records that index them.

        Args:
            data: The file, or its summary.
            at, end: Where to walk.
            opcode: Of the records.
            name: Of the file, for messages.

        Returns:
            Where the first record is that is another one, or not whole, or has to be looked at by itself.

        Raises:
            InputError: They are too many.
        """
        from cwcli.kernels.metadata_scan import scan_metadata, scan_metadata_index

        scan = scan_metadata if opcode == METADATA else scan_metadata_index
        room = array("Q", bytes(16 * BLOCK_RECORDS))
        while at < end:
            n_bytes, n = scan(data[at : min(at + BLOCK_BYTES, end)], at, room, self.names)
            self._places.extend(room[: 2 * n])
            check_metadata_count(name, len(self))
            at += n_bytes
            if not n:
                break
        return at

    def runs(self) -> Iterator[Run]:
        """The rows in order of their offsets, those together that lie side by side."""
        offsets, lengths = self._places[::2], self._places[1::2]
        first = start = end = 0
        for row, (offset, length) in enumerate(zip(offsets, lengths, strict=True)):
            if offset != end or not row:
                if row:
                    yield Run(start, end, first, row)
                first, start = row, offset
            end = offset + length
        if offsets:
            yield Run(start, end, first, len(offsets))

    def without(self, run: Run, names: Collection[str]) -> Iterator[Run]:
        """The parts of a run between records of certain names."""
        first, start = run.first, run.start
        for row in range(run.first, run.stop) if names else ():
            if self.names[row] in names:
                offset, length, _ = self[row]
                if row > first:
                    yield Run(start, offset, first, row)
                first, start = row + 1, offset + length
        if first < run.stop:
            yield Run(start, run.end, first, run.stop)

    def sort(self) -> None:
        """Put the rows in the order of their offsets."""
        offsets = self._places[::2]
        order = sorted(range(len(self)), key=offsets.__getitem__)
        if any(row != k for k, row in enumerate(order)):
            self._places = array("Q", [each for row in order for each in self._places[2 * row : 2 * row + 2]])
            self.names = [self.names[row] for row in order]


def check_metadata_count(name: str, n: int) -> None:
    """Check that a file's metadata can be held in memory.

    Raises:
        InputError: It has too many records of it.
    """
    if n > MAX_METADATA:
        what = f"it holds more than {MAX_METADATA:,} metadata records"
        raise InputError(what, where=name, hint="`mcap filter` makes a log without them")
