"""Decodes JSON messages to columns; see `json_columns` for the types of the columns.

The kernel decodes common messages, Python's json module all others. Both fill the same columns.
"""

from __future__ import annotations

import json
from collections.abc import Collection
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from cwcli.kernels import json_walk as kernel
from cwcli.logs.codecs.decoder import Outcome
from cwcli.logs.codecs.json_columns import ABSENT, ARRAY, CODED, Elements, JsonSlot, Room, scalar
from cwcli.logs.codecs.json_tree import Key, KeyTree, Tables, elements
from cwcli.logs.codecs.slots import BoolArray, Payloads, grown_capacity
from cwcli.signals.columns import Field, Int64Array

SLOT_BYTES = 9
"""Memory in bytes of one leaf in one message: a value of 8 bytes and its tag."""
INVALID = "the message is not valid JSON"
"""The reason shown to users for a message that can't be parsed."""
NO_OBJECT = "the message is not a JSON object"
"""The reason shown to users for a message that is valid JSON but no object."""


@lru_cache(maxsize=16)
def _known_tree(fields: tuple[str, ...], blobs: tuple[str, ...]) -> tuple[KeyTree, Tables]:
    """Return the key tree of the wanted leaves, which learns no further keys, and its tables for the kernel."""
    tree = KeyTree.of(fields, blobs)
    return tree, tree.tables()


class JsonDecoder:
    """Decodes the messages of one channel. The schema is ignored: the keys come from the messages.

    Args:
        fields: Wanted leaves, or None for all.
        blobs: Paths of the base64 strings that the method `blobs` returns.
        n_expected: Number of messages, if known.
    """

    def __init__(self, fields: Collection[str] | None, *, blobs: Collection[str] = (), n_expected: int = 0) -> None:
        if fields is None:
            self._tree = KeyTree.of(fields, blobs)
            self._tables = self._tree.tables()
        else:
            self._tree, self._tables = _known_tree(tuple(fields), tuple(blobs))
        self._blobs = frozenset(blobs)
        self._blob_rows: dict[str, list[bytes | memoryview]] = {}
        self.restart(n_expected)

    @property
    def empty_row_bytes(self) -> int:
        """Return the memory in bytes that a message without any field takes."""
        return SLOT_BYTES * sum(slot is not None for slot in self._slots)

    def restart(self, n_expected: int = 0) -> None:
        """Forget all messages."""
        self._rooms: list[Room] = []
        self._slots: list[JsonSlot | None] = []
        self._add_room()
        self._capacity = n_expected
        self._is_ok: list[BoolArray] = []
        self._reasons: dict[str, int] = {}
        self._n = 0
        self._batch = (0, 0)

    def add(self, payloads: Payloads) -> None:
        """Decode a batch of messages."""
        n, first = len(payloads), self._n
        if not n:
            return
        # An element of an array takes at least two bytes: itself, and the comma or bracket after it.
        self._batch = (n, max(payloads.n_bytes // 2 + 8, self._batch[1]))
        self._capacity = grown_capacity(self._capacity, first + n)
        for room in self._rooms:
            room.begin(self._capacity, *self._batch)
        status = np.zeros(n, np.uint8)
        self._walk_all(payloads, status)
        is_ok = status == kernel.STATUS_OK
        instead: list[dict[int, Elements]] = [{} for _ in self._slots]
        for row in np.flatnonzero(~is_ok).tolist():
            is_ok[row] = self._decide(payloads.message(row), row, int(status[row]), instead)
        for path in self._blobs:
            self._blob_rows[path] = self._slot(self._tree.paths.index(path)).take_places(payloads, first)
        no_counts = np.broadcast_to(np.int64(0), n)
        is_seen = np.concatenate([room.tags[:, first : first + n].any(axis=1) for room in self._rooms])
        used = np.concatenate([room.cursors[:, -1] for room in self._rooms]).tolist()
        for k, (is_there, n_elements, rows) in enumerate(zip(is_seen.tolist(), used, instead, strict=True)):
            if is_there or n_elements or rows or self._slots[k] is not None:
                self._slot(k).end(payloads, first, rows, n_elements, no_counts)
        self._is_ok.append(is_ok)
        self._n += n

    def blobs(self, path: str) -> list[bytes | memoryview]:
        """Return a base64 field of each message of the last batch, still in base64."""
        return self._blob_rows[path]

    def outcome(self) -> Outcome:
        """Return which messages were decoded, and why others were not."""
        return Outcome(np.concatenate([np.zeros(0, np.bool_), *self._is_ok]), self._reasons)

    def finish(self, rows: Int64Array) -> dict[str, Field]:
        """Return leaf path -> column for the given messages."""
        fields: dict[str, Field] = {}
        if not self._n:
            return fields
        for path, slot in zip(self._tree.paths, self._slots, strict=True):
            if slot is not None and path not in self._blobs:
                column = slot.finish(rows)
                if column is not None:
                    fields.setdefault(path, column)
        return fields

    def _add_room(self) -> None:
        """Add buffers for the leaves that the tree has learned."""
        n_new = len(self._tree.paths) - len(self._slots)
        self._rooms.append(Room(n_new))
        self._slots += [None] * n_new

    def _slot(self, k: int) -> JsonSlot:
        """Return the column of a leaf, created at its first occurrence."""
        slot = self._slots[k]
        if slot is None:
            leaf, rooms = k, iter(self._rooms)
            while leaf >= len(room := next(rooms)):
                leaf -= len(room)
            slot = self._slots[k] = JsonSlot(room, leaf, self._n)
        return slot

    def _walk_all(self, payloads: Payloads, status: npt.NDArray[np.uint8]) -> None:
        """Decode the batch with the kernel; at a message with unknown keys learn them and decode it again."""
        n = len(payloads)
        at = self._walk(payloads, status, 0)
        learned = -1
        while at < n:
            if at == learned:  # its keys can't be learned
                status[at] = kernel.STATUS_ODD
                for room in self._rooms:
                    room.cursors[:, at] = room.cursors[:, at - 1] if at else 0
                at += 1
            else:
                self._learn(payloads.message(at))
                learned = at
            at = self._walk(payloads, status, at)

    def _walk(self, payloads: Payloads, status: npt.NDArray[np.uint8], begin: int) -> int:
        """Run the kernel from message `begin` on; return the message at which it stopped."""
        places = np.concatenate([room.addresses for room in self._rooms], axis=1)
        n_slots = len(self._slots)
        keys, entries, nodes = self._tables
        cursors = [room.cursors[:, begin - 1] for room in self._rooms] if begin else [np.zeros(n_slots, np.int64)]
        return kernel.walk(
            payloads.data,
            payloads.starts,
            payloads.ends,
            keys=keys,
            entries=entries,
            nodes=nodes,
            tags=places[0],
            values=places[1],
            element_tags=places[2],
            element_values=places[3],
            cursors=np.concatenate(cursors),
            cursor_columns=places[4],
            learns=self._tree.learns,
            begin=begin,
            first_row=self._n,
            status=status,
        )

    def _learn(self, message: bytes) -> None:
        """Add the keys of a message to the tree."""
        try:
            value = json.loads(message)
        except (ValueError, RecursionError):
            value = None
        self._tree.learn(value, self._tree.root)
        if len(self._tree.paths) > len(self._slots):
            self._add_room()
            self._rooms[-1].begin(self._capacity, *self._batch)
        self._tables = self._tree.tables()

    def _decide(self, message: bytes, row: int, status: int, instead: list[dict[int, Elements]]) -> bool:
        """Decode one message with the json module; return whether that was possible."""
        try:
            if status == kernel.STATUS_NOT_ASCII:
                message.decode("utf-8", "surrogatepass")
                return True
            value = json.loads(message)
        except (ValueError, RecursionError):
            for room in self._rooms:  # drop what the kernel has stored of the message
                room.tags[:, self._n + row] = ABSENT
            return self._refuse(INVALID)
        if not isinstance(value, dict):
            return self._refuse(NO_OBJECT)
        if self._tree.learns:
            self._learn(message)
            instead.extend({} for _ in range(len(instead), len(self._slots)))
        self._put_object(value, self._tree.root, row, instead, in_array=False)
        return True

    def _refuse(self, reason: str) -> bool:
        self._reasons[reason] = self._reasons.get(reason, 0) + 1
        return False

    def _put_object(
        self,
        value: dict[str, object],
        keys: dict[str, Key],
        row: int,
        instead: list[dict[int, Elements]],
        *,
        in_array: bool,
    ) -> None:
        for name, inner in value.items():
            key = keys.get(name)
            if key is not None:
                self._put(inner, key, row, instead, in_array=in_array)

    def _put(self, value: object, key: Key, row: int, instead: list[dict[int, Elements]], *, in_array: bool) -> None:
        slot = self._slot(key.slot) if key.slot >= 0 else None
        if isinstance(value, dict):
            if key.below is not None:
                self._put_object(value, key.below, row, instead, in_array=in_array)
        elif isinstance(value, list):
            before = _n_elements(instead, key.slot, row)
            for each in elements(value):
                self._put(each, key, row, instead, in_array=True)
            if slot is not None and not in_array and _n_elements(instead, key.slot, row) > before:
                slot.tags[self._n + row] = ARRAY
        elif slot is None:
            return
        elif in_array:
            tags, values = instead[key.slot].setdefault(row, ([], []))
            tag, number = (CODED, slot.code(value)) if isinstance(value, str) else scalar(value)
            tags.append(tag)
            values.append(number)
        elif isinstance(value, str):
            slot.put_string(self._n + row, value)
        else:
            slot.tags[self._n + row], slot.values[self._n + row] = scalar(value)


def _n_elements(instead: list[dict[int, Elements]], slot: int, row: int) -> int:
    """Return how many elements the json module has found for a column in a row."""
    return len(instead[slot][row][0]) if slot >= 0 and row in instead[slot] else 0
