"""Decodes protobuf messages to columns.

The kernel decodes common messages, the official parser all others (text beyond ASCII, groups, undeclared wire types,
damage). Both fill the same columns.
"""

from __future__ import annotations

import gc
from collections.abc import Collection, Iterator
from functools import lru_cache
from typing import Any

import numpy as np

from cwcli.kernels import protobuf as kernel
from cwcli.logs.codecs.column_buffers import (
    BlobSpanBuffer,
    FixedColumnBuffer,
    Payloads,
    RaggedColumnBuffer,
    StringColumnBuffer,
    begin_ragged_batch_and_get_addresses,
    capacity_for_rows,
    matrix_if_equal_lengths,
    order_values_by_first_use,
    row_zero_addresses,
    select_ragged_rows,
)
from cwcli.logs.codecs.decoder import MAX_CACHED_SCHEMA_BYTES, DecodeOutcome
from cwcli.logs.codecs.protobuf_tables import (
    LeafColumn,
    ProtobufMessageDescriptor,
    compile_protobuf_tables,
    is_repeated_field,
)
from cwcli.logs.codecs.ros2msg import SchemaError
from cwcli.signals.columns import BoolArray, Field, Int64Array, NumericArray, Strings

MAX_PREALLOCATED_BYTES = 1 << 28
"""Memory in bytes that is allocated before a message is seen. Chosen by hand."""
MAX_COLUMN_BYTES_PER_MESSAGE_BYTE = 8
"""Bytes of a sequence column per byte of a message: a packed varint of one byte becomes an int64."""
INVALID_MESSAGE_REASON = "the message is not a valid one of its schema"
"""The reason shown to users for a message that the official parser refuses."""


class ProtobufDecoder:
    """Decodes the messages of one channel.

    An absent scalar is 0, the default of the format. An absent field that the schema marks as optional, and every field
    of an absent message, is NaN in a float column (strings: -1). Repeated scalars are (n, k) if all messages have the
    same number of them, else `Ragged`; leaves of repeated messages are always `Ragged`. Bytes, repeated strings, maps
    and messages inside a message of their own type are left out.

    Args:
        schema_name: Full name of the message type.
        schema_data: Serialised `FileDescriptorSet`.
        fields: Wanted leaves, or None for all.
        blobs: Paths of the bytes fields that the method `blobs` returns.

    Raises:
        SchemaError: The schema can't be understood.
    """

    def __init__(
        self,
        schema_name: str,
        schema_data: bytes,
        fields: Collection[str] | None,
        *,
        blobs: Collection[str] = (),
        n_expected: int = 0,
    ) -> None:
        descriptor = find_message_descriptor(schema_name, schema_data)
        self._descriptor = descriptor
        self._parser: Any = None
        wanted = None
        if fields is not None:
            names = frozenset(fields)
            prefixes = {name[: k + 1] for name in names for k, letter in enumerate(name) if letter == "."}
            wanted = (names | prefixes).__contains__
        self._tables = compile_protobuf_tables(descriptor, wanted, frozenset(blobs))
        self.reset(n_expected)

    def reset(self, n_expected: int = 0) -> None:
        """Forget all messages."""
        self._slots: list[FixedColumnBuffer | StringColumnBuffer] = [
            _make_column_buffer(leaf) for leaf in self._tables.slots
        ]
        self._ragged = [RaggedColumnBuffer(leaf.dtype) for leaf in self._tables.ragged]
        self._presence = [FixedColumnBuffer(np.uint8) for _ in range(self._tables.n_presence)]
        self._oneofs = [FixedColumnBuffer(np.int32) for _ in range(self._tables.n_oneofs)]
        self.empty_row_bytes = sum(slot.array.itemsize for slot in self._slots if isinstance(slot, FixedColumnBuffer))
        self.empty_row_bytes += 4 * sum(isinstance(slot, StringColumnBuffer) for slot in self._slots) + len(
            self._presence
        )
        self._capacity = min(n_expected, MAX_PREALLOCATED_BYTES // max(self.empty_row_bytes, 1))
        self._is_ok: list[BoolArray] = []
        self._n = 0
        self._n_undecodable = 0

    def decode_batch(self, payloads: Payloads) -> None:
        """Decode a batch of messages."""
        n, first = len(payloads), self._n
        if not n:
            return
        self._capacity = capacity_for_rows(self._capacity, first + n)
        for slot in (*self._slots, *self._presence):
            slot.ensure_capacity(self._capacity)
        for oneof in self._oneofs:
            oneof.array = np.zeros(n, np.int32)
        buffers, cursor_columns = begin_ragged_batch_and_get_addresses(
            self._ragged, n, MAX_COLUMN_BYTES_PER_MESSAGE_BYTE * payloads.n_bytes
        )
        status = np.zeros(n, np.uint8)
        kernel.walk(
            payloads.data,
            payloads.starts,
            payloads.ends,
            fields=self._tables.fields,
            nodes=self._tables.nodes,
            elements=self._tables.elements,
            slots=row_zero_addresses(self._slots, first, n),
            presence=row_zero_addresses(self._presence, first, n),
            oneofs=row_zero_addresses(self._oneofs, first, n) - 4 * first,
            ragged=buffers,
            cursors=np.zeros(len(self._ragged), np.int64),
            cursor_columns=cursor_columns,
            first_row=first,
            status=status,
        )
        is_ok = status == kernel.STATUS_OK
        self._reject_unknown_enum_values(is_ok, first)
        for slot in self._slots:
            slot.resolve_batch_spans(payloads.data, first, is_ok)
        instead: list[dict[int, NumericArray]] = [{} for _ in self._ragged]
        for row in np.flatnonzero(~is_ok).tolist():
            is_ok[row] = self._decode_with_official_parser(payloads.message_bytes(row), first, row, instead)
        for ragged, rows in zip(self._ragged, instead, strict=True):
            ragged.store_batch_elements(rows)
        self._is_ok.append(is_ok)
        self._n += n

    def blobs_of_last_batch(self, path: str) -> list[bytes | memoryview]:
        """Return a blob field of each message of the last batch."""
        for leaf, slot in zip(self._tables.slots, self._slots, strict=True):
            if leaf.path == path and isinstance(slot, BlobSpanBuffer):
                return slot.blobs_of_batch()
        raise KeyError(path)

    def outcome(self) -> DecodeOutcome:
        """Return which messages were decoded, and why others were not."""
        is_ok = np.concatenate([np.zeros(0, np.bool_), *self._is_ok])
        n_bad = int((~is_ok).sum())
        return DecodeOutcome(is_ok, {INVALID_MESSAGE_REASON: n_bad} if n_bad else {})

    def build_columns(self, rows: Int64Array) -> dict[str, Field]:
        """Return leaf path -> column for the given messages."""
        fields: dict[str, Field] = {}
        for leaf, slot in zip(self._tables.slots, self._slots, strict=True):
            if isinstance(slot, BlobSpanBuffer):
                continue
            is_there = None
            if leaf.presence >= 0 and self._n:
                is_there = self._presence[leaf.presence].array[rows] != 0
            if isinstance(slot, StringColumnBuffer):
                strings = slot.build_strings(rows) if self._n else Strings(np.zeros(0, np.int32), ())
                fields[leaf.path] = _blank_absent_strings(strings, is_there)
            else:
                fields[leaf.path] = _replace_absent_by_nan(slot.array[rows], is_there)
        for leaf, ragged in zip(self._tables.ragged, self._ragged, strict=True):
            found = select_ragged_rows(ragged.build_ragged(), rows)
            fields[leaf.path] = found if leaf.in_element else matrix_if_equal_lengths(found)
        return fields

    def _reject_unknown_enum_values(self, is_ok: BoolArray, first: int) -> None:
        """Clear `is_ok` for messages whose closed enumerations need the official parser."""
        n = len(is_ok)
        for leaf, slot in zip(self._tables.slots, self._slots, strict=True):
            if leaf.closed and isinstance(slot, FixedColumnBuffer):
                is_ok &= np.isin(slot.array[first : first + n], (*leaf.closed, 0))
        for leaf, ragged in zip(self._tables.ragged, self._ragged, strict=True):
            if leaf.closed:
                values, offsets = ragged.batch_values_and_offsets()
                is_known = np.isin(values, leaf.closed)
                if leaf.in_element and leaf.chain[-1].default_value:
                    is_known &= values != 0  # the kernel's value of an absent number, here not the default
                n_unknown_before = np.concatenate([[0], np.cumsum(~is_known)])
                is_ok &= np.diff(n_unknown_before[offsets]) == 0

    def _decode_with_official_parser(
        self, message: bytes, first: int, row: int, instead: list[dict[int, NumericArray]]
    ) -> bool:
        """Decode one message with the official parser; return whether that was possible."""
        if self._parser is None:
            try:
                self._parser = make_message_class(self._descriptor)
            except SchemaError:
                self._parser = object  # which parses nothing: each message counts as one that can't be decoded
        parsed = self._parser()
        at = first + row
        for presence in self._presence:
            presence.array[at] = 0
        try:
            parsed.ParseFromString(message)
        except Exception:  # the parser's own error class has changed its place between versions
            return False
        for leaf, slot in zip(self._tables.slots, self._slots, strict=True):
            is_there, value = _leaf_presence_and_value(parsed, leaf)
            if leaf.presence >= 0:
                self._presence[leaf.presence].array[at] = is_there
            if isinstance(slot, BlobSpanBuffer):
                slot.instead[row] = value
            elif isinstance(slot, StringColumnBuffer):
                # A string that is not UTF-8, which proto2 allows, comes out as bytes.
                slot.set_string_of_row(
                    at, value if isinstance(value, bytes) else value.encode(errors="surrogateescape")
                )
            else:
                slot.array[at] = value
        for leaf, ragged, rows in zip(self._tables.ragged, self._ragged, instead, strict=True):
            rows[row] = np.array(list(_iter_repeated_values(parsed, leaf.chain)), ragged.dtype)
        return True


def find_message_descriptor(schema_name: str, schema_data: bytes) -> ProtobufMessageDescriptor:
    """Return the descriptor of a message type from its own pool: another file may define the same name differently.

    Raises:
        SchemaError: The schema can't be understood.
    """
    if len(schema_data) <= MAX_CACHED_SCHEMA_BYTES:
        return _find_descriptor(schema_name, schema_data)
    return _find_descriptor_in_large_schema(schema_name, schema_data)


@lru_cache(maxsize=32)
def _find_descriptor(schema_name: str, schema_data: bytes) -> ProtobufMessageDescriptor:
    """Return the descriptor of a message type; the pools of the last small schemas are kept."""
    from google.protobuf.descriptor_pb2 import FileDescriptorSet
    from google.protobuf.descriptor_pool import DescriptorPool

    try:
        waiting = {each.name: each for each in FileDescriptorSet.FromString(schema_data).file}
    except Exception as error:
        raise SchemaError("the schema is not a FileDescriptorSet") from error
    pool = DescriptorPool()

    def add_with_dependencies(name: str) -> None:
        each = waiting.pop(name, None)
        if each is not None:
            for dependency in each.dependency:
                add_with_dependencies(dependency)
            pool.Add(each)

    try:
        while waiting:
            add_with_dependencies(next(iter(waiting)))
        return pool.FindMessageTypeByName(schema_name)
    except (TypeError, KeyError, ValueError, RecursionError) as error:
        reason = str(error).strip().splitlines()[0][:120] if str(error).strip() else "it is incomplete"
        raise SchemaError(f"the schema can't be used: {reason}") from error


@lru_cache(maxsize=1)
def _find_descriptor_in_large_schema(schema_name: str, schema_data: bytes) -> ProtobufMessageDescriptor:
    """Return the same for a large schema: one pool is kept, because the channels of a schema follow each other."""
    gc.collect()  # a pool holds forty times the bytes of its schema, and only the cyclic collector frees it
    return _find_descriptor.__wrapped__(schema_name, schema_data)


def make_message_class(descriptor: ProtobufMessageDescriptor) -> Any:
    """Return the official class of a message type.

    Raises:
        SchemaError: Its types refer to each other too deeply for the library, which makes all their classes.
    """
    from google.protobuf.message_factory import GetMessageClass

    try:
        return GetMessageClass(descriptor)
    except RecursionError as error:
        raise SchemaError("the schema can't be used: its types refer to each other too deeply") from error


def _make_column_buffer(leaf: LeafColumn) -> FixedColumnBuffer | StringColumnBuffer:
    """Return an empty column buffer for a leaf."""
    if leaf.kind == "fixed":
        return FixedColumnBuffer(leaf.dtype)
    return StringColumnBuffer() if leaf.kind == "string" else BlobSpanBuffer()


def _leaf_presence_and_value(parsed: Any, leaf: LeafColumn) -> tuple[bool, Any]:
    """Return whether a leaf is present, and its value or default."""
    at, is_there = parsed, True
    for each in leaf.chain:
        if each.has_presence and not at.HasField(each.name):
            is_there = False
        at = getattr(at, each.name)
    return is_there, at


def _iter_repeated_values(parsed: Any, chain: tuple[Any, ...]) -> Iterator[Any]:
    """Yield all values of a leaf below repeated fields, in order."""
    each, rest = chain[0], chain[1:]
    value = getattr(parsed, each.name)
    for one in value if is_repeated_field(each) else (value,):
        if rest:
            yield from _iter_repeated_values(one, rest)
        else:
            yield one


def _replace_absent_by_nan(values: NumericArray, is_there: BoolArray | None) -> NumericArray:
    """Return the values as floats with NaN for absent ones; unchanged if none is absent."""
    if is_there is None or is_there.all():
        return values
    shown = values.astype(np.float64)
    shown[~is_there] = np.nan
    return shown


def _blank_absent_strings(strings: Strings, is_there: BoolArray | None) -> Strings:
    """Return the strings with code -1 for absent ones."""
    if is_there is None or is_there.all():
        return strings
    codes = np.where(is_there, strings.codes, np.int32(-1)).astype(np.int32)
    return order_values_by_first_use(Strings(codes, strings.values))
