"""Presents several files as the bytes of one log, and assigns common ids to their schemas and channels."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field
from itertools import accumulate
from operator import itemgetter
from typing import TYPE_CHECKING, Any

from cwcli.errors import InputError
from cwcli.input import MAX_CHUNK_BYTES, MAX_UNPACKED_TO_STORED_SIZE_RATIO, InputFile
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.format.records import MESSAGE_HEADER_BYTES, Channel, Schema

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

UNKNOWN_CHANNEL_ID = 0xFFFF
"""The channel id given to messages whose channel their file does not define; no channel of a log of parts has it."""


class JoinedFile(InputFile):
    """The bytes of several files, one after the other.

    Args:
        parts: Open files; closed with this.
        name: For messages.

    Attributes:
        parts: The files in the order of their bytes.
        numbering: Ids for the schemas and channels of all parts.
        notes: Faults of the parts, as text -> how often.
        listed_message_counts: The recorder's listing: file name -> messages, None if it does not say. Empty without a
            listing.
        n_listed_messages: Messages of all parts by the recorder's listing, or None.
        has_final_part_order: The parts are in the order of their times.
    """

    def __init__(self, parts: Sequence[InputFile], name: str) -> None:
        self.name = name
        self.descriptor = -1
        self.max_chunk_bytes = MAX_CHUNK_BYTES
        self.max_ratio = MAX_UNPACKED_TO_STORED_SIZE_RATIO
        self.refused_from = None
        self.numbering = IdAssignment()
        self.notes: dict[str, int] = {}
        self.listed_message_counts: dict[str, int | None] = {}
        self.n_listed_messages: int | None = None
        self.has_final_part_order = False
        self._inputs = None
        self._digest = None
        self._held = (0, memoryview(b""))
        self._is_checked = False
        self._lay_out_parts(parts)

    @property
    def disk_files(self) -> Sequence[InputFile]:
        """Return the files on the disk that this log consists of."""
        return [file for part in self.parts for file in part.disk_files]

    @property
    def n_stored_bytes(self) -> int:
        """The number of bytes that hold the content of all parts."""
        return sum(each.n_stored_bytes for each in self.parts)

    def set_final_part_order(self, parts: Sequence[InputFile]) -> None:
        """Keep these parts in this final order; close the others."""
        self.keep_only_parts(parts)
        self.has_final_part_order = True

    def keep_only_parts(self, parts: Sequence[InputFile]) -> None:
        """Keep these parts; close the others."""
        left_out = [each for each in self.parts if each not in parts]
        self._lay_out_parts(parts)
        for each in left_out:
            each.close()

    def start_byte_of_part(self, k: int) -> int:
        """Return the byte offset of part `k` in the log."""
        return self._starts[k]

    def part_and_offset(self, at: int) -> tuple[InputFile, int]:
        """Return the part that holds a byte, and the byte's offset in it."""
        k = self.part_index_at(at)
        return self.parts[k], at - self._starts[k]

    def part_index_at(self, at: int) -> int:
        """Return the number of the part that holds a byte."""
        return min(bisect_right(self._starts, at) - 1, len(self.parts) - 1)

    def __getitem__(self, place: slice) -> memoryview:
        """Return a slice of the log's bytes, cut at the end of the last part."""
        start, stop, _ = place.indices(self._size)
        part, at = self.part_and_offset(start)
        if stop - start <= len(part) - at:
            return part[at : at + max(stop - start, 0)]
        return self.read_into(memoryview(bytearray(stop - start)), start)

    def read_into(self, buffer: memoryview, start: int) -> memoryview:
        """Fill a buffer with the bytes from `start` on and return it."""
        n = 0
        while n < len(buffer):
            part, at = self.part_and_offset(start + n)
            size = min(len(part) - at, len(buffer) - n)
            if size <= 0:
                raise self._changed_file_error(f"its parts had {self._size} bytes")
            part.read_into(buffer[n : n + size], at)
            n += size
        return buffer

    def check_unchanged(self) -> None:
        """Check that no part has changed since it was opened."""
        for each in self.disk_files:
            each.check_unchanged()

    def _lay_out_parts(self, parts: Sequence[InputFile]) -> None:
        """Set the parts and compute their offsets and the total size."""
        self.parts = tuple(parts)
        ends = list(accumulate(map(len, self.parts)))
        self._starts = [0, *ends[:-1]]
        self._size = ends[-1]
        self.state = (-1, -1, self._size, 0)

    def _close(self) -> None:
        for each in self.parts:
            each.close()


@dataclass
class IdAssignment:
    """Assigns ids of the log to the schemas and channels of its parts, of which each part has its own.

    Equal schemas are one schema, however many records of a part hold them. Channels of two parts are one channel if
    topic, schema and message encoding are equal; if a part has several such channels, each is paired with a different
    one of the other part, preferably with equal metadata. The log's channel gets the metadata of the first part. A part
    keeps its ids if no other part uses them.
    """

    _schemas: dict[Any, dict[int, Any]] = field(default_factory=dict)
    _channels: dict[Any, dict[int, Any]] = field(default_factory=dict)

    def assign_schema_and_channel_ids(
        self, schemas: Mapping[int, Schema], channels: Mapping[int, Channel]
    ) -> tuple[dict[int, int], dict[int, int]]:
        """Return two mappings of an id in the part to the id in the log: of its schemas, and of its channels.

        Raises:
            InputError: The log needs more than 65,534 ids.
        """
        of_schemas = ((each.id, each[1:], None) for each in schemas.values())
        schema_ids = {0: 0, **_assign_log_ids_of_part(of_schemas, self._schemas, is_shared=True)}
        of_channels = (
            (
                each.id,
                (schema_ids.get(each.schema_id, 0), each.topic, each.message_encoding),
                tuple(sorted(each.metadata.items())),
            )
            for each in channels.values()
        )
        return schema_ids, _assign_log_ids_of_part(of_channels, self._channels, is_shared=False)


def _assign_log_ids_of_part(
    entries: Iterable[tuple[int, Any, Any]], known: dict[Any, dict[int, Any]], *, is_shared: bool
) -> dict[int, int]:
    """Return id in the part -> id in the log.

    Args:
        entries: Id in the part, content, and details in which equal entries of two parts may differ.
        known: Content -> id in the log -> details; extended here.
        is_shared: Entries of one part with equal content share one id.
    """
    used_ids = {new_id for ids in known.values() for new_id in ids}
    numbered: dict[int, int] = {}
    rest = []
    used: set[int] = set()
    ordered = sorted(entries, key=itemgetter(0))
    for own_id, content, details in ordered:  # entries that are equal in full go first
        same = (new_id for new_id, known_ in known.get(content, {}).items() if known_ == details)
        new_id = next((each for each in same if is_shared or each not in used), None)
        if new_id is None:
            rest.append((own_id, content, details))
        else:
            numbered[own_id] = new_id
            used.add(new_id)
    for own_id, content, details in rest:
        ids = known.setdefault(content, {})
        new_id = next((each for each in ids if is_shared or each not in used), None)
        if new_id is None:
            new_id = own_id if own_id not in used_ids and own_id < UNKNOWN_CHANNEL_ID else max(used_ids, default=0) + 1
            if new_id >= UNKNOWN_CHANNEL_ID:
                raise InputError("its parts have more than 65,534 ids of schemas or channels")
            ids[new_id] = details
            used_ids.add(new_id)
        numbered[own_id] = new_id
        used.add(new_id)
    return numbered


class ChannelRenumbering:
    """Replaces the channel ids in the messages of a part by those of the log.

    Args:
        ids: Channel id in the part -> id in the log; messages with another id get `UNKNOWN_CHANNEL_ID`.
    """

    def __init__(self, ids: Mapping[int, int]) -> None:
        self._ids = ids
        self._table: npt.NDArray[np.uint16] | None = None

    def log_channel_id(self, own_id: int) -> int:
        """Return the log's id of a channel of the part."""
        return self._ids.get(own_id, UNKNOWN_CHANNEL_ID)

    def renumber_channels_of_messages(self, data: memoryview) -> memoryview:
        """Return a copy of the records with the log's ids in all messages before the first damaged record."""
        import numpy as np

        from cwcli.kernels.message_scan import DAMAGED, Messages, scan_messages

        if self._table is None:
            table = np.full(1 << 16, UNKNOWN_CHANNEL_ID, np.uint16)
            table[list(self._ids)] = list(self._ids.values())
            self._table = table
        octets = np.frombuffer(bytearray(data), np.uint8)
        every = np.ones(1 << 16, np.uint8)
        at, status = 0, -1
        while at < len(octets) and status != DAMAGED:
            found = Messages((len(octets) - at) // MESSAGE_HEADER_BYTES + 1)
            at, status = scan_messages(octets, at, len(octets), every, found)
            ids = self._table[found.channel_id[: found.n]]
            places = found.payload_start[: found.n] - MESSAGE_HEADER_BYTES
            octets[places] = ids & 0xFF
            octets[places + 1] = ids >> 8
        return octets.data
