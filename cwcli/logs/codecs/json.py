"""Decodes JSON messages to columns; see `json_columns` for the types of the columns.

The kernel decodes common messages, Python's json module all others. Both fill the same columns.
"""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Iterator
from dataclasses import field
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from cwcli.kernels import json_walk as kernel
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.codecs.column_buffers import Payloads, capacity_for_rows
from cwcli.logs.codecs.decoder import DecodeOutcome
from cwcli.logs.codecs.json_columns import (
    TAG_ABSENT,
    TAG_ARRAY,
    TAG_INTERNED_STRING,
    JsonColumnBuffer,
    LeafBuffers,
    TagsAndValuesOfElements,
    tag_and_int64_bits_of_scalar,
)
from cwcli.signals.columns import BoolArray, Field, Int64Array

LEAF_VALUE_BYTES = 9
"""Memory in bytes of one leaf in one message: a value of 8 bytes and its tag."""
INVALID_JSON_REASON = "the message is not valid JSON"
"""The reason shown to users for a message that can't be parsed."""
NOT_AN_OBJECT_REASON = "the message is not a JSON object"
"""The reason shown to users for a message that is valid JSON but no object."""
MAX_OBJECT_DEPTH = 256
"""The greatest depth of objects inside each other whose keys are learned; deeper ones are left out. Chosen by hand."""
MAX_LEARNED_KEYS = 4096
"""The greatest number of keys that are learned; with more of them keys are data rather than names. Chosen by hand."""
Tables = tuple[npt.NDArray[np.uint8], npt.NDArray[np.int32], npt.NDArray[np.int32]]
_CHARACTERS_TO_ESCAPE_PATTERN = re.compile(r'["\\\x00-\x1f]')
"""The characters that JSON texts must escape (RFC 8259, 7)."""


@dataclass
class JsonKey:
    """A key of an object.

    Attributes:
        path: Dotted path from the message.
        slot: Number of its column, or -1.
        below: Keys of the object that is its value (or of the objects in its array), or None.
    """

    path: str
    slot: int = -1
    below: dict[str, JsonKey] | None = None


@dataclass
class KeyTree:
    """The known keys of a JSON channel.

    Attributes:
        root: Keys of the message.
        paths: Path of the key of each slot.
        learns: Unknown keys become columns.
    """

    root: dict[str, JsonKey] = field(default_factory=dict)
    paths: list[str] = field(default_factory=list)
    learns: bool = False

    @classmethod
    def from_leaf_paths(cls, fields: Collection[str] | None, blobs: Collection[str] = ()) -> KeyTree:
        """Return the tree of the wanted leaves; with None for `fields` a tree that learns all keys."""
        tree = cls(learns=fields is None)
        for path in dict.fromkeys((*(fields or ()), *blobs)):
            keys = tree.root
            names = path.split(".")
            for k, name in enumerate(names):
                key = keys.setdefault(name, JsonKey(".".join(names[: k + 1])))
                if k + 1 < len(names):
                    key.below = keys = {} if key.below is None else key.below
            if key.slot < 0:
                tree._assign_slot(key)
        return tree

    def add_keys_of_objects(self, value: object, keys: dict[str, JsonKey], prefix: str = "", depth: int = 0) -> None:
        """Add the keys of an object, or of the objects in an array, to `keys`."""
        if depth > MAX_OBJECT_DEPTH:
            return
        if isinstance(value, list):
            for each in iter_nested_elements(value):
                self.add_keys_of_objects(each, keys, prefix, depth)
        elif isinstance(value, dict):
            for name, inner in value.items():
                key = keys.get(name)
                if key is None:
                    if len(self.paths) >= MAX_LEARNED_KEYS:
                        self.learns = False
                        return
                    key = keys[name] = JsonKey(prefix + name)
                    self._assign_slot(key)
                if _contains_object(inner):
                    if key.below is None:
                        key.below = {}
                    self.add_keys_of_objects(inner, key.below, f"{key.path}.", depth + 1)

    def to_kernel_tables(self) -> Tables:
        """Return keys, entries and nodes as arrays for `cwcli.kernels.json_walk`."""
        text = bytearray()
        entries: list[list[int]] = []
        nodes: list[list[int]] = [[0, 0]]
        waiting: list[tuple[int, dict[str, JsonKey]]] = [(0, self.root)]
        while waiting:
            node, keys = waiting.pop()
            nodes[node] = [len(entries), len(keys)]
            for name, key in keys.items():
                child = -1
                if key.below is not None:
                    child = len(nodes)
                    nodes.append([0, 0])
                    waiting.append((child, key.below))
                octets = name.encode(errors="surrogatepass")
                size = -1 if _CHARACTERS_TO_ESCAPE_PATTERN.search(name) else len(octets)
                entries.append([len(text), size, key.slot, child])
                text += octets
        return (
            np.frombuffer(bytes(text) or b"\0", np.uint8),
            np.array(entries or [[0, 0, -1, -1]], np.int32),
            np.array(nodes, np.int32),
        )

    def _assign_slot(self, key: JsonKey) -> None:
        key.slot = len(self.paths)
        self.paths.append(key.path)


@lru_cache(maxsize=16)
def _tree_of_wanted_leaves(fields: tuple[str, ...], blobs: tuple[str, ...]) -> tuple[KeyTree, Tables]:
    """Return the key tree of the wanted leaves, which learns no further keys, and its tables for the kernel."""
    tree = KeyTree.from_leaf_paths(fields, blobs)
    return tree, tree.to_kernel_tables()


class JsonDecoder:
    """Decodes the messages of one channel. The schema is ignored: the keys come from the messages.

    Args:
        fields: Wanted leaves, or None for all.
        blobs: Paths of the base64 strings that the method `blobs` returns.
    """

    def __init__(self, fields: Collection[str] | None, *, blobs: Collection[str] = (), n_expected: int = 0) -> None:
        if fields is None:
            self._tree = KeyTree.from_leaf_paths(fields, blobs)
            self._tables = self._tree.to_kernel_tables()
        else:
            self._tree, self._tables = _tree_of_wanted_leaves(tuple(fields), tuple(blobs))
        self._blobs = frozenset(blobs)
        self._blob_rows: dict[str, list[bytes | memoryview]] = {}
        self.reset(n_expected)

    @property
    def empty_row_bytes(self) -> int:
        """Return the memory in bytes that a message without any field takes."""
        return LEAF_VALUE_BYTES * sum(slot is not None for slot in self._slots)

    def reset(self, n_expected: int = 0) -> None:
        """Forget all messages."""
        self._rooms: list[LeafBuffers] = []
        self._slots: list[JsonColumnBuffer | None] = []
        self._add_leaf_buffers()
        self._capacity = n_expected
        self._is_ok: list[BoolArray] = []
        self._reasons: dict[str, int] = {}
        self._n = 0
        self._batch = (0, 0)

    def decode_batch(self, payloads: Payloads) -> None:
        """Decode a batch of messages."""
        n, first = len(payloads), self._n
        if not n:
            return
        # An element of an array takes at least two bytes: itself, and the comma or bracket after it.
        self._batch = (n, max(payloads.n_bytes // 2 + 8, self._batch[1]))
        self._capacity = capacity_for_rows(self._capacity, first + n)
        for room in self._rooms:
            room.prepare_batch(self._capacity, *self._batch)
        status = np.zeros(n, np.uint8)
        self._decode_and_learn_keys(payloads, status)
        is_ok = status == kernel.STATUS_OK
        instead: list[dict[int, TagsAndValuesOfElements]] = [{} for _ in self._slots]
        for row in np.flatnonzero(~is_ok).tolist():
            is_ok[row] = self._decode_with_json_module(payloads.message_bytes(row), row, int(status[row]), instead)
        for path in self._blobs:
            self._blob_rows[path] = self._get_or_create_leaf_column(self._tree.paths.index(path)).take_blobs_of_batch(
                payloads, first
            )
        no_counts = np.broadcast_to(np.int64(0), n)
        is_seen = np.concatenate([room.tags[:, first : first + n].any(axis=1) for room in self._rooms])
        used = np.concatenate([room.cursors[:, -1] for room in self._rooms]).tolist()
        for k, (is_there, n_elements, rows) in enumerate(zip(is_seen.tolist(), used, instead, strict=True)):
            if is_there or n_elements or rows or self._slots[k] is not None:
                self._get_or_create_leaf_column(k).store_elements_and_intern_strings(
                    payloads, first, rows, n_elements, no_counts
                )
        self._is_ok.append(is_ok)
        self._n += n

    def blobs_of_last_batch(self, path: str) -> list[bytes | memoryview]:
        """Return a base64 field of each message of the last batch, still in base64."""
        return self._blob_rows[path]

    def outcome(self) -> DecodeOutcome:
        """Return which messages were decoded, and why others were not."""
        return DecodeOutcome(np.concatenate([np.zeros(0, np.bool_), *self._is_ok]), self._reasons)

    def build_columns(self, rows: Int64Array) -> dict[str, Field]:
        """Return leaf path -> column for the given messages."""
        fields: dict[str, Field] = {}
        if not self._n:
            return fields
        for path, slot in zip(self._tree.paths, self._slots, strict=True):
            if slot is not None and path not in self._blobs:
                column = slot.build_column(rows)
                if column is not None:
                    fields.setdefault(path, column)
        return fields

    def _add_leaf_buffers(self) -> None:
        """Add buffers for the leaves that the tree has learned."""
        n_new = len(self._tree.paths) - len(self._slots)
        self._rooms.append(LeafBuffers(n_new))
        self._slots += [None] * n_new

    def _get_or_create_leaf_column(self, k: int) -> JsonColumnBuffer:
        """Return the column of a leaf, created at its first occurrence."""
        slot = self._slots[k]
        if slot is None:
            leaf, rooms = k, iter(self._rooms)
            while leaf >= len(room := next(rooms)):
                leaf -= len(room)
            slot = self._slots[k] = JsonColumnBuffer(room, leaf, self._n)
        return slot

    def _decode_and_learn_keys(self, payloads: Payloads, status: npt.NDArray[np.uint8]) -> None:
        """Decode the batch with the kernel; at a message with unknown keys learn them and decode it again."""
        n = len(payloads)
        at = self._run_decode_kernel(payloads, status, 0)
        learned_at = -1
        while at < n:
            if at == learned_at:  # its keys can't be learned
                status[at] = kernel.STATUS_ODD
                for room in self._rooms:
                    room.cursors[:, at] = room.cursors[:, at - 1] if at else 0
                at += 1
            else:
                self._learn_keys_of_message(payloads.message_bytes(at))
                learned_at = at
            at = self._run_decode_kernel(payloads, status, at)

    def _run_decode_kernel(self, payloads: Payloads, status: npt.NDArray[np.uint8], begin: int) -> int:
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

    def _learn_keys_of_message(self, message: bytes) -> None:
        """Add the keys of a message to the tree."""
        try:
            value = json.loads(message)
        except (ValueError, RecursionError):
            value = None
        self._tree.add_keys_of_objects(value, self._tree.root)
        if len(self._tree.paths) > len(self._slots):
            self._add_leaf_buffers()
            self._rooms[-1].prepare_batch(self._capacity, *self._batch)
        self._tables = self._tree.to_kernel_tables()

    def _decode_with_json_module(
        self, message: bytes, row: int, status: int, json_elements_by_row: list[dict[int, TagsAndValuesOfElements]]
    ) -> bool:
        """Decode one message with the json module; return whether that was possible."""
        try:
            if status == kernel.STATUS_NOT_ASCII:
                message.decode("utf-8", "surrogatepass")
                return True
            value = json.loads(message)
        except (ValueError, RecursionError):
            for room in self._rooms:  # drop what the kernel has stored of the message
                room.tags[:, self._n + row] = TAG_ABSENT
            return self._count_refused_message_and_return_false(INVALID_JSON_REASON)
        if not isinstance(value, dict):
            return self._count_refused_message_and_return_false(NOT_AN_OBJECT_REASON)
        if self._tree.learns:
            self._learn_keys_of_message(message)
            json_elements_by_row.extend({} for _ in range(len(json_elements_by_row), len(self._slots)))
        self._store_object(value, self._tree.root, row, json_elements_by_row, in_array=False)
        return True

    def _count_refused_message_and_return_false(self, reason: str) -> bool:
        self._reasons[reason] = self._reasons.get(reason, 0) + 1
        return False

    def _store_object(
        self,
        value: dict[str, object],
        keys: dict[str, JsonKey],
        row: int,
        json_elements_by_row: list[dict[int, TagsAndValuesOfElements]],
        *,
        in_array: bool,
    ) -> None:
        for name, inner in value.items():
            key = keys.get(name)
            if key is not None:
                self._store_value(inner, key, row, json_elements_by_row, in_array=in_array)

    def _store_value(
        self,
        value: object,
        key: JsonKey,
        row: int,
        json_elements_by_row: list[dict[int, TagsAndValuesOfElements]],
        *,
        in_array: bool,
    ) -> None:
        slot = self._get_or_create_leaf_column(key.slot) if key.slot >= 0 else None
        if isinstance(value, dict):
            if key.below is not None:
                self._store_object(value, key.below, row, json_elements_by_row, in_array=in_array)
        elif isinstance(value, list):
            before = _count_elements_or_zero(json_elements_by_row, key.slot, row)
            for each in iter_nested_elements(value):
                self._store_value(each, key, row, json_elements_by_row, in_array=True)
            if (
                slot is not None
                and not in_array
                and _count_elements_or_zero(json_elements_by_row, key.slot, row) > before
            ):
                slot.tags[self._n + row] = TAG_ARRAY
        elif slot is None:
            return
        elif in_array:
            tags, values = json_elements_by_row[key.slot].setdefault(row, ([], []))
            tag, number = (
                (TAG_INTERNED_STRING, slot.code_of_string(value))
                if isinstance(value, str)
                else tag_and_int64_bits_of_scalar(value)
            )
            tags.append(tag)
            values.append(number)
        elif isinstance(value, str):
            slot.set_string(self._n + row, value)
        else:
            slot.tags[self._n + row], slot.values_as_int64_bits[self._n + row] = tag_and_int64_bits_of_scalar(value)


def _count_elements_or_zero(json_elements_by_row: list[dict[int, TagsAndValuesOfElements]], slot: int, row: int) -> int:
    """Return how many elements the json module has found for a column in a row."""
    return len(json_elements_by_row[slot][row][0]) if slot >= 0 and row in json_elements_by_row[slot] else 0


def iter_nested_elements(value: list[object]) -> Iterator[object]:
    """Yield the elements of nested lists in order, without recursion, so that any depth works."""
    waiting = [iter(value)]
    while waiting:
        for each in waiting[-1]:
            if isinstance(each, list):
                waiting.append(iter(each))
                break
            yield each
        else:
            waiting.pop()


def _contains_object(value: object) -> bool:
    return isinstance(value, dict) or (
        isinstance(value, list) and any(isinstance(each, dict) for each in iter_nested_elements(value))
    )
