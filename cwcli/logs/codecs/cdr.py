"""Decodes CDR messages (`cdr` with `ros2msg` schemas) to columns."""

from __future__ import annotations

from collections.abc import Collection
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from cwcli.kernels import cdr as kernel
from cwcli.logs.codecs.cdr_program import MAX_ALIGNMENT_XCDR2_BYTES, CdrProgram, LeafColumn, compile_cdr_program
from cwcli.logs.codecs.column_buffers import (
    BlobSpanBuffer,
    FixedColumnBuffer,
    Payloads,
    RaggedColumnBuffer,
    StringColumnBuffer,
    begin_ragged_batch_and_get_addresses,
    capacity_for_rows,
    row_zero_addresses,
    select_ragged_rows,
)
from cwcli.logs.codecs.compressed_messages import iter_decompressed_parts
from cwcli.logs.codecs.decoder import MAX_CACHED_SCHEMA_BYTES, DecodeOutcome
from cwcli.logs.codecs.ros2msg import parse_message_definitions
from cwcli.signals.columns import BoolArray, Field, Int64Array, NumericArray, Ragged

DECODE_FAILURE_REASON_BY_KERNEL_STATUS = {
    kernel.STATUS_SHORT: "the message ends before its fields do",
    kernel.STATUS_FOREIGN: "its encapsulation is not plain CDR",
}
"""Status of the kernel for a message that it could not decode -> reason shown to users."""
MAX_PREALLOCATED_BYTES = 1 << 28
"""Memory in bytes that is allocated before a message is seen: a schema can ask for rows of any size. Chosen by hand."""


@lru_cache(maxsize=32)
def _compile_program_and_xcdr2_operations(
    schema_name: str, schema_data: bytes, leaf_paths: frozenset[str] | None, blobs: frozenset[str]
) -> tuple[CdrProgram, npt.NDArray[np.int32]]:
    """Compile a schema to a program, and to its operations for XCDR2; `leaf_paths`: leaf paths, None for all."""
    root, definitions = parse_message_definitions(schema_name, schema_data.decode(errors="replace"))

    def is_wanted_leaf(path: str, is_octets: bool) -> bool:
        return not is_octets if leaf_paths is None else path in leaf_paths

    program = compile_cdr_program(root, definitions, is_wanted_leaf, blobs=blobs)
    second = compile_cdr_program(root, definitions, is_wanted_leaf, blobs=blobs, max_align=MAX_ALIGNMENT_XCDR2_BYTES)
    # XCDR2 puts a length before collections of strings and messages, which no ROS 2 recorder writes: not decoded.
    return program, np.zeros((0, 6), np.int32) if second.has_loops else second.operations


_compile_large_program_and_xcdr2_operations = lru_cache(maxsize=1)(_compile_program_and_xcdr2_operations.__wrapped__)
"""The same for large schemas, of which the last one is kept, because the channels of a schema follow each other."""


class CdrDecoder:
    """Decodes the messages of one channel.

    A column's type follows from the schema alone: sequences are `Ragged` even if all are equally long; leaves inside
    fixed arrays of messages are (n, k). Strings inside sequences and arrays are left out, and octet sequences unless
    they are named.

    Args:
        schema_name: Name of the schema in the file.
        schema_data: `ros2msg` text.
        fields: Wanted leaves, or None for all.
        blobs: Paths of the octet sequences that the method `blobs` returns.

    Raises:
        SchemaError: The schema can't be understood, or holds something that cwcli does not decode.
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
        wanted_fields = None if fields is None else frozenset(fields)
        compiled = (
            _compile_program_and_xcdr2_operations
            if len(schema_data) <= MAX_CACHED_SCHEMA_BYTES
            else _compile_large_program_and_xcdr2_operations
        )
        self._program, self._program_v2 = compiled(schema_name, schema_data, wanted_fields, frozenset(blobs))
        self.reset(n_expected)

    @property
    def empty_row_bytes(self) -> int:
        """Return 0, because an empty message can't be decoded."""
        return 0

    def reset(self, n_expected: int = 0) -> None:
        """Forget all messages."""
        self._slots: list[FixedColumnBuffer | StringColumnBuffer] = [
            _make_column_buffer(leaf) for leaf in self._program.slots
        ]
        self._ragged = [RaggedColumnBuffer(leaf.dtype) for leaf in self._program.ragged]
        self._row_bytes = sum(slot.array.itemsize * (leaf.count or 1) for leaf, slot in self._fixed_leaf_buffers())
        self._capacity = min(n_expected, MAX_PREALLOCATED_BYTES // max(self._row_bytes, 1))
        self._is_long_enough: list[BoolArray] = []
        self._is_ok: list[BoolArray] = []
        self._reasons: dict[str, int] = {}
        self._n = 0
        for slot in self._slots:
            slot.ensure_capacity(self._capacity)

    def decode_batch(self, payloads: Payloads) -> None:
        """Decode a batch of messages."""
        for part in iter_decompressed_parts(payloads) if len(payloads) else ():
            self._decode_uncompressed_batch(part)

    def _decode_uncompressed_batch(self, payloads: Payloads) -> None:
        is_long_enough = payloads.ends - payloads.starts >= self._row_bytes
        self._is_long_enough.append(is_long_enough)
        n_short = len(payloads) - int(is_long_enough.sum())
        if n_short:  # they get no row: a schema can ask for any number of bytes a row
            self._add_undecodable_count(DECODE_FAILURE_REASON_BY_KERNEL_STATUS[kernel.STATUS_SHORT], n_short)
            payloads = payloads.select_messages(np.flatnonzero(is_long_enough))
        n, first = len(payloads), self._n
        if not n:
            return
        self._grow_buffers(first + n)
        buffers, cursor_columns = begin_ragged_batch_and_get_addresses(self._ragged, n, payloads.n_bytes)
        status = np.zeros(n, np.uint8)
        kernel.walk(
            payloads.data,
            payloads.starts,
            payloads.ends,
            program=self._program.operations,
            program_v2=self._program_v2,
            slots=row_zero_addresses(self._slots, first, n),
            ragged=buffers,
            cursors=np.zeros(len(self._ragged), np.int64),
            cursor_columns=cursor_columns,
            first_row=first,
            status=status,
        )
        is_ok = status == kernel.STATUS_OK
        for slot in self._slots:
            slot.resolve_batch_spans(payloads.data, first, is_ok)
        for ragged in self._ragged:
            ragged.store_batch_elements()
        self._is_ok.append(is_ok)
        if not is_ok.all():
            for code, reason in DECODE_FAILURE_REASON_BY_KERNEL_STATUS.items():
                self._add_undecodable_count(reason, int((status == code).sum()))
        self._n += n

    def _add_undecodable_count(self, reason: str, count: int) -> None:
        if count:
            self._reasons[reason] = self._reasons.get(reason, 0) + count

    def blobs_of_last_batch(self, path: str) -> list[bytes | memoryview]:
        """Return a blob field of each message of the last batch, b"" for a message that is too short.

        Messages that are compressed one by one must be added one by one, because only the last part is returned.
        """
        for leaf, slot in zip(self._program.slots, self._slots, strict=True):
            if leaf.path == path and isinstance(slot, BlobSpanBuffer):
                is_long_enough = self._is_long_enough[-1]
                views = iter(slot.blobs_of_batch() if is_long_enough.any() else ())
                return [next(views) if is_long else b"" for is_long in is_long_enough.tolist()]
        raise KeyError(path)

    def outcome(self) -> DecodeOutcome:
        """Return which messages were decoded, and why others were not."""
        is_ok = np.concatenate([np.zeros(0, np.bool_), *self._is_long_enough])
        is_ok[is_ok] = np.concatenate([np.zeros(0, np.bool_), *self._is_ok])
        return DecodeOutcome(is_ok, self._reasons)

    def build_columns(self, rows: Int64Array) -> dict[str, Field]:
        """Return leaf path -> column for the given messages."""
        is_long_enough = np.concatenate([np.zeros(0, np.bool_), *self._is_long_enough])
        if not is_long_enough.all():
            rows = (np.cumsum(is_long_enough) - 1)[rows]
        fields: dict[str, Field] = {}
        for leaf, slot in zip(self._program.slots, self._slots, strict=True):
            if isinstance(slot, FixedColumnBuffer):
                fields[leaf.path] = _as_bool_if_declared(leaf, slot.array[rows])
            elif not isinstance(slot, BlobSpanBuffer):
                fields[leaf.path] = slot.build_strings(rows)
        for leaf, ragged in zip(self._program.ragged, self._ragged, strict=True):
            found = select_ragged_rows(ragged.build_ragged(), rows)
            values = _as_bool_if_declared(leaf, found.values)
            # Inside fixed arrays every row has the same number of elements.
            fields[leaf.path] = Ragged(values, found.offsets) if leaf.count is None else values.reshape(-1, leaf.count)
        return fields

    def _fixed_leaf_buffers(self) -> list[tuple[LeafColumn, FixedColumnBuffer]]:
        """Return the leaves of fixed size with their buffers."""
        pairs = zip(self._program.slots, self._slots, strict=True)
        return [(leaf, slot) for leaf, slot in pairs if isinstance(slot, FixedColumnBuffer)]

    def _grow_buffers(self, needed: int) -> None:
        capacity = capacity_for_rows(self._capacity, needed)
        if capacity != self._capacity:
            self._capacity = capacity
        for slot in self._slots:
            slot.ensure_capacity(capacity)


def _make_column_buffer(leaf: LeafColumn) -> FixedColumnBuffer | StringColumnBuffer:
    """Return an empty column buffer for a leaf."""
    if leaf.kind == "fixed":
        return FixedColumnBuffer(leaf.dtype, leaf.count)
    return StringColumnBuffer() if leaf.kind == "string" else BlobSpanBuffer()


def _as_bool_if_declared(leaf: LeafColumn, values: NumericArray) -> NumericArray:
    """Return the values, as truth values if the schema declares the leaf as bool."""
    return values != 0 if leaf.is_bool else values
