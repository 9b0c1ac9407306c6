"""Compiles a `ros2msg` definition into the operations of `cwcli.kernels.cdr`.

CDR (XCDR1): primitives are aligned to their size, counted from the end of the four-byte encapsulation header; a
string is a 32-bit length (with the final NUL) and its bytes; a sequence is a 32-bit count and its elements. Runs of
primitives whose padding is known become one operation.

Source: OMG DDSI-RTPS 2.5, 10; DDS-XTypes 1.3, 7.4.1 and 7.4.3.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import field

import numpy as np
import numpy.typing as npt

from cwcli.kernels.cdr import (
    OP_APPEND,
    OP_BLOB,
    OP_END,
    OP_FIXED,
    OP_LOOP,
    OP_REPEAT,
    OP_SEQUENCE,
    OP_SKIP,
    OP_STRING,
)
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.codecs.ros2msg import (
    PRIMITIVE_DTYPES,
    STRING_TYPE,
    WSTRING_TYPE,
    Definitions,
    MessageField,
    SchemaError,
    find_message_fields,
)

MAX_SEQUENCE_NESTING = 16
"""The greatest depth of sequences and arrays inside each other. Chosen by hand; the kernel's stack has this size."""
MAX_MESSAGE_NESTING = 64
"""The greatest depth of messages inside each other. Chosen by hand."""
MAX_SCHEMA_FIELDS = 1 << 16
"""The greatest number of fields of a message and all messages in it: nested types can double them at every level,
whether they are wanted or not. Chosen by hand."""
MAX_ELEMENTS_OF_LEAF_PER_MESSAGE = 1 << 24
"""The greatest number of elements of a leaf in one message, in all fixed arrays around it. Chosen by hand."""
MAX_BYTES_SKIPPED_BY_ONE_OPERATION = 1 << 30
"""The greatest number of bytes that one operation skips: the numbers of an operation are int32."""
MAX_ALIGNMENT_XCDR1_BYTES = 8
"""The largest alignment in bytes of XCDR1 (DDS-XTypes 1.3, 7.4.1)."""
MAX_ALIGNMENT_XCDR2_BYTES = 4
"""The largest alignment in bytes of XCDR2 (DDS-XTypes 1.3, 7.4.3)."""
OCTET_TYPES = ("uint8", "byte")
"""The primitive types of ROS 2 whose sequences are treated as blobs of bytes."""


@dataclass(frozen=True)
class LeafColumn:
    """A column that a program fills.

    Attributes:
        kind: "fixed", "string", "ragged" or "blob".
        dtype: NumPy type of an element, "" for strings and blobs.
        count: Elements of a fixed array, or of all fixed arrays around a leaf; None for a scalar or a sequence.
        is_bool: The column holds truth values.
    """

    path: str
    kind: str
    dtype: str = ""
    count: int | None = None
    is_bool: bool = False


@dataclass
class CdrProgram:
    """Operations, and the columns that they fill.

    Attributes:
        operations: Shape (m, 6), int32.
        slots: Fixed, string and blob leaves by slot.
        ragged: Ragged leaves by slot.
        has_loops: It holds sequences or arrays of strings or messages.
    """

    operations: npt.NDArray[np.int32]
    slots: list[LeafColumn]
    ragged: list[LeafColumn]
    has_loops: bool


IsLeafWanted = Callable[[str, bool], bool]
"""A function that tells whether a leaf is wanted, from its path and whether it is a sequence of octets."""


def compile_cdr_program(
    root: str,
    definitions: Definitions,
    wants: IsLeafWanted,
    *,
    blobs: frozenset[str] = frozenset(),
    max_align: int = MAX_ALIGNMENT_XCDR1_BYTES,
) -> CdrProgram:
    """Compile a message.

    Args:
        root: Short name of the message.
        definitions: From `ros2msg.parse_message_definitions`.
        wants: Tells which leaves become columns; the others are skipped.
        blobs: Paths of octet sequences of which only the place is stored.
        max_align: 8, or 4 for XCDR2.

    Raises:
        SchemaError: A message is not defined, contains itself or a wstring, or is too large.
    """
    compiler = _Compiler(definitions, wants, blobs, max_align)
    compiler.compile_message(root, "", ())
    operations = np.array(compiler.operations, np.int32).reshape(-1, 6)
    return CdrProgram(operations, compiler.slots, compiler.ragged, compiler.has_loops)


@dataclass
class _Compiler:
    """Collects operations and leaves; the position so far is `residue` modulo `modulus`, for the alignment."""

    definitions: Definitions
    wants: IsLeafWanted
    blobs: frozenset[str]
    max_align: int
    operations: list[list[int]] = field(default_factory=list)
    slots: list[LeafColumn] = field(default_factory=list)
    ragged: list[LeafColumn] = field(default_factory=list)
    has_loops: bool = False
    loops: list[int | None] = field(default_factory=list)
    n_fields: int = 0
    modulus: int = 8
    residue: int = 0

    def compile_message(self, name: str, prefix: str, parents: tuple[str, ...]) -> None:
        """Compile the fields of a message whose leaves' paths begin with `prefix`."""
        if name in parents or len(parents) > MAX_MESSAGE_NESTING:
            raise SchemaError(f"{name} contains itself")
        fields = find_message_fields(self.definitions, name)
        self.n_fields += len(fields) + 1
        if self.n_fields > MAX_SCHEMA_FIELDS:
            raise SchemaError(f"its messages hold more than {MAX_SCHEMA_FIELDS:,} fields")
        if not fields:
            self._emit_primitives("u1", 1, None)  # an empty message has one octet, as IDL allows no empty structure
        for each in fields:
            path = f"{prefix}{each.name}"
            if each.type == WSTRING_TYPE:
                raise SchemaError(f"{path} is a wstring, which CDR encoders write in different ways")
            if each.type in PRIMITIVE_DTYPES:
                self._compile_primitive_field(each, path)
            else:
                with self._enclose_in_loop(each):
                    if each.type == STRING_TYPE:
                        self._compile_string(path)
                    else:
                        self.compile_message(each.type, f"{path}.", (*parents, name))

    def _compile_primitive_field(self, field: MessageField, path: str) -> None:
        dtype = PRIMITIVE_DTYPES[field.type]
        is_octets = field.is_sequence and field.type in OCTET_TYPES
        is_wanted = self.wants(path, is_octets)
        is_bool = field.type == "bool"
        if field.is_sequence:
            size = int(dtype[1])
            if path in self.blobs and is_octets and not self.loops:
                self._emit_operation(OP_BLOB, 4, 0, 0, self._add_leaf_and_get_slot(LeafColumn(path, "blob")))
            else:
                slot = (
                    self._add_ragged_leaf_and_get_slot(LeafColumn(path, "ragged", dtype, None, is_bool))
                    if is_wanted
                    else -1
                )
                self._emit_operation(OP_SEQUENCE, min(size, self.max_align), size, 0, slot)
            self._mark_alignment_unknown()
        elif not is_wanted:
            self._emit_primitives(dtype, field.length or 1, None)
        elif self.loops:
            counts = [*self.loops, field.length or 1]
            static = None if None in counts else math.prod(n for n in counts if n is not None)
            if static is not None and static > MAX_ELEMENTS_OF_LEAF_PER_MESSAGE:
                raise SchemaError(f"{path} has {static:.3g} elements in every message")
            slot = self._add_ragged_leaf_and_get_slot(LeafColumn(path, "ragged", dtype, static, is_bool))
            self._emit_primitives(dtype, field.length or 1, (OP_APPEND, slot))
        else:
            slot = self._add_leaf_and_get_slot(LeafColumn(path, "fixed", dtype, field.length, is_bool))
            self._emit_primitives(dtype, field.length or 1, (OP_FIXED, slot))

    def _compile_string(self, path: str) -> None:
        is_wanted = not self.loops and self.wants(path, False)
        self._emit_operation(
            OP_STRING, 4, 0, 0, self._add_leaf_and_get_slot(LeafColumn(path, "string")) if is_wanted else -1
        )
        self._mark_alignment_unknown()

    @contextmanager
    def _enclose_in_loop(self, field: MessageField) -> Iterator[None]:
        """Enclose the operations emitted inside in a loop, if the field is a sequence or an array."""
        if not field.is_sequence and field.length is None:
            yield
            return
        self.has_loops = True
        if len(self.loops) == MAX_SEQUENCE_NESTING:
            raise SchemaError("sequences are nested too deeply")
        begin = len(self.operations)
        if field.is_sequence:
            self._emit_operation(OP_LOOP, 4, 0, 0, -1)
        else:
            self._emit_operation(OP_REPEAT, 1, 0, field.length or 1, -1)
        self._mark_alignment_unknown()
        self.loops.append(field.length)
        yield
        self.loops.pop()
        self._emit_operation(OP_END, 1, 0, 0, -1)
        self.operations[begin][5] = len(self.operations)
        self._mark_alignment_unknown()

    def _emit_primitives(self, dtype: str, count: int, use: tuple[int, int] | None) -> None:
        """Emit `count` primitives: skipped, or stored by the operation `use` (code, slot)."""
        size = int(dtype[1])
        align = min(size, self.max_align)
        padding = -self.residue % align if align <= self.modulus else None
        if use is not None:
            self._emit_operation(use[0], align, size, count, use[1])
        elif padding is None:
            self._emit_skip(align, size * count)
        else:
            self._emit_skip(1, padding + size * count)
        if padding is None:
            self.modulus, self.residue, padding = align, 0, 0
        self.residue = (self.residue + padding + size * count) % self.modulus

    def _emit_skip(self, align: int, n_bytes: int) -> None:
        """Emit a skip, joined with a skip right before it unless a loop begins or ends there."""
        last = self.operations[-1] if self.operations else None
        if (
            last is not None
            and last[0] == OP_SKIP
            and align == 1
            and last[2] + n_bytes <= MAX_BYTES_SKIPPED_BY_ONE_OPERATION
        ):
            last[2] += n_bytes
        else:
            self._emit_operation(OP_SKIP, align, n_bytes, 1, -1)

    def _emit_operation(self, code: int, align: int, size: int, count: int, slot: int) -> None:
        self.operations.append([code, align, size, count, slot, 0])

    def _mark_alignment_unknown(self) -> None:
        """Mark the alignment of the position as unknown."""
        self.modulus, self.residue = 1, 0

    def _add_leaf_and_get_slot(self, leaf: LeafColumn) -> int:
        self.slots.append(leaf)
        return len(self.slots) - 1

    def _add_ragged_leaf_and_get_slot(self, leaf: LeafColumn) -> int:
        self.ragged.append(leaf)
        return len(self.ragged) - 1
