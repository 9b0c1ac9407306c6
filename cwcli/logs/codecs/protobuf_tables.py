"""Compiles a protobuf message type into the tables of `cwcli.kernels.protobuf`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field
from typing import Any

import numpy as np
import numpy.typing as npt

from cwcli.kernels.protobuf import (
    BOOLEAN,
    FIXED32,
    FIXED64,
    GROUP,
    MESSAGE,
    N_COLUMNS,
    OCTETS,
    STORE_APPEND,
    STORE_ELEMENT,
    STORE_NOT,
    STORE_ROW,
    TEXT,
    VARINT32,
    VARINT64,
    ZIGZAG32,
    ZIGZAG64,
)
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.codecs.ros2msg import SchemaError

ProtobufMessageDescriptor = Any
"""Descriptor of a protobuf message type, of either implementation."""
ProtobufFieldDescriptor = Any
"""Descriptor of a field of a protobuf message, of either implementation."""

KIND_AND_DTYPE_BY_TYPE: dict[int, tuple[int, str]] = {
    1: (FIXED64, "f8"),
    2: (FIXED32, "f4"),
    3: (VARINT64, "i8"),
    4: (VARINT64, "u8"),
    5: (VARINT32, "i4"),
    6: (FIXED64, "u8"),
    7: (FIXED32, "u4"),
    8: (BOOLEAN, "?"),
    9: (TEXT, ""),
    10: (GROUP, ""),
    11: (MESSAGE, ""),
    12: (OCTETS, ""),
    13: (VARINT32, "u4"),
    14: (VARINT32, "i4"),
    15: (FIXED32, "i4"),
    16: (FIXED64, "i8"),
    17: (ZIGZAG32, "i4"),
    18: (ZIGZAG64, "i8"),
}
"""Field type (`FieldDescriptorProto.Type`) -> kind of the kernel, and NumPy type ("" for other than numbers)."""
PROTOBUF_TYPE_ENUM = 14
"""The field type (`FieldDescriptorProto.Type`) of an enum."""
MAX_LEAF_COLUMNS = 1 << 14
"""The greatest number of columns of a message type; further leaves are left out. Chosen by hand."""
MAX_SCHEMA_FIELDS = 1 << 16
"""The greatest number of fields of a message and all messages in it: nested types can double them at every level.
Chosen by hand."""
MAX_MESSAGE_NESTING = 64
"""The greatest depth of messages inside each other. Chosen by hand."""


@dataclass(frozen=True)
class LeafColumn:
    """A column that the tables fill.

    Attributes:
        chain: Field descriptors from the root to the leaf.
        kind: "fixed", "string", "blob", or "ragged".
        dtype: NumPy type of an element, "" for strings and blobs.
        presence: Slot of the flags that tell whether the leaf is present, or -1 if it always has a value or default.
        in_element: The leaf lies in a repeated message.
        closed: The values of a closed enumeration, or ().
    """

    path: str
    chain: tuple[Any, ...]
    kind: str
    dtype: str = ""
    presence: int = -1
    in_element: bool = False
    closed: tuple[int, ...] = ()


@dataclass
class ProtobufTables:
    """The tables of a message type for the kernel, and the columns that it fills.

    Attributes:
        fields, nodes, elements: Arguments of the kernel.
        slots: Fixed, string and blob leaves by slot.
        ragged: Ragged leaves by slot.
        n_presence, n_oneofs: Number of slots for presence flags and for oneofs.
    """

    fields: npt.NDArray[np.int32]
    nodes: npt.NDArray[np.int32]
    elements: npt.NDArray[np.int32]
    slots: list[LeafColumn]
    ragged: list[LeafColumn]
    n_presence: int
    n_oneofs: int


def compile_protobuf_tables(
    descriptor: ProtobufMessageDescriptor, wants: Callable[[str], bool] | None, blobs: frozenset[str] = frozenset()
) -> ProtobufTables:
    """Compile a message type.

    Args:
        wants: Tells which leaves become columns, None for all; the others are only checked.
        blobs: Paths of bytes fields of which only the place is stored.

    Raises:
        SchemaError: It is too large, or nested too deeply.
    """
    compiler = _Compiler(wants, blobs)
    compiler.add_message_and_get_node(descriptor, _MessagePosition())
    compiler.fill_rows_of_only_checked_messages()
    nodes: list[tuple[int, int]] = []
    fields: list[list[int]] = [[0] * N_COLUMNS]
    for rows in compiler.nodes:
        nodes.append((len(fields), len(rows)))
        fields.extend(rows)
    return ProtobufTables(
        np.array(fields, np.int32),
        np.array(nodes, np.int32),
        np.array(compiler.elements or [0], np.int32),
        compiler.slots,
        compiler.ragged,
        compiler.n_presence,
        compiler.n_oneofs,
    )


def is_repeated_field(field_descriptor: ProtobufFieldDescriptor) -> bool:
    """Tell whether a field descriptor is of a repeated field."""
    known = getattr(field_descriptor, "is_repeated", None)
    return bool(known) if known is not None else field_descriptor.label == 3


@dataclass(frozen=True)
class _MessagePosition:
    """The position of a message in the tree of messages.

    Attributes:
        prefix: Beginning of its leaves' paths.
        chain: Field descriptors from the root to it.
        types: Full names of the messages around it, without itself.
        presence: Slot of the nearest optional field above.
        element_slots: Ragged slots that the repeated message around it fills, or None outside of one.
    """

    prefix: str = ""
    chain: tuple[Any, ...] = ()
    types: tuple[str, ...] = ()
    presence: int = -1
    element_slots: list[int] | None = None


@dataclass
class _Compiler:
    """Collects the kernel's nodes and the leaves of a message type."""

    wants: Callable[[str], bool] | None
    blobs: frozenset[str]
    nodes: list[list[list[int]]] = field(default_factory=list)
    elements: list[int] = field(default_factory=list)
    slots: list[LeafColumn] = field(default_factory=list)
    ragged: list[LeafColumn] = field(default_factory=list)
    n_presence: int = 0
    n_oneofs: int = 0
    checked: dict[str, int] = field(default_factory=dict)
    unchecked: list[tuple[int, Any]] = field(default_factory=list)
    n_fields: int = 0

    def add_message_and_get_node(self, descriptor: ProtobufMessageDescriptor, place: _MessagePosition) -> int:
        """Add a message whose leaves may be wanted; return its node."""
        self._count_fields_and_check_limit(descriptor)
        if len(place.types) > MAX_MESSAGE_NESTING:
            raise SchemaError(f"its messages are nested more than {MAX_MESSAGE_NESTING} deep")
        rows: list[list[int]] = []
        self.nodes.append(rows)
        index = len(self.nodes) - 1
        oneofs: dict[str, int] = {}
        for each in sorted(descriptor.fields, key=lambda one: one.number):
            row = self._new_kernel_row_of_field(each, oneofs)
            kind, dtype = KIND_AND_DTYPE_BY_TYPE[each.type]
            path = place.prefix + each.name
            presence = place.presence
            if each.has_presence and place.element_slots is None:
                presence = row[5] = self._new_presence_slot()
            if kind == MESSAGE:
                self._add_nested_message(each, row, place, presence)
            elif kind < TEXT and self._is_leaf_wanted(path):
                self._add_scalar_leaf(each, row, dtype, place, presence)
            elif kind in (TEXT, OCTETS) and place.element_slots is None and not is_repeated_field(each):
                wanted = path in self.blobs if kind == OCTETS else self._is_leaf_wanted(path)
                if wanted:
                    self.slots.append(
                        LeafColumn(path, (*place.chain, each), "blob" if kind == OCTETS else "string", "", presence)
                    )
                    row[3:5] = STORE_ROW, len(self.slots) - 1
            rows.append(row)
        return index

    def _add_nested_message(
        self, field_descriptor: ProtobufFieldDescriptor, field_row: list[int], place: _MessagePosition, presence: int
    ) -> None:
        """Add the message inside a field, and set its node in the field's row."""
        path = place.prefix + field_descriptor.name
        inner_type = field_descriptor.message_type
        types = (*place.types, field_descriptor.containing_type.full_name)
        is_map = inner_type.GetOptions().map_entry
        if is_map or inner_type.full_name in types or not self._has_wanted_leaf_below(f"{path}."):
            field_row[7] = self._node_of_only_checked_message_type(inner_type)
            return
        element_slots: list[int] | None = [] if is_repeated_field(field_descriptor) else place.element_slots
        inner = _MessagePosition(f"{path}.", (*place.chain, field_descriptor), types, presence, element_slots)
        field_row[7] = self.add_message_and_get_node(inner_type, inner)
        if is_repeated_field(field_descriptor) and element_slots is not None:
            field_row[8], field_row[9] = len(self.elements), len(element_slots)
            for slot in element_slots:
                self.elements += [slot, np.dtype(self.ragged[slot].dtype).itemsize]

    def _add_scalar_leaf(
        self,
        field_descriptor: ProtobufFieldDescriptor,
        field_row: list[int],
        dtype: str,
        place: _MessagePosition,
        presence: int,
    ) -> None:
        """Add the column of a number, and set its slot in the field's row."""
        path, chain = place.prefix + field_descriptor.name, (*place.chain, field_descriptor)
        closed: tuple[int, ...] = ()
        if field_descriptor.type == PROTOBUF_TYPE_ENUM and getattr(field_descriptor.enum_type, "is_closed", False):
            closed = tuple(value.number for value in field_descriptor.enum_type.values)
        in_element = place.element_slots is not None
        if not in_element and not is_repeated_field(field_descriptor):
            self.slots.append(LeafColumn(path, chain, "fixed", dtype, presence, False, closed))
            field_row[3:5] = STORE_ROW, len(self.slots) - 1
            return
        self.ragged.append(LeafColumn(path, chain, "ragged", dtype, -1, in_element, closed))
        field_row[3:5] = STORE_APPEND if is_repeated_field(field_descriptor) else STORE_ELEMENT, len(self.ragged) - 1
        if place.element_slots is not None and not is_repeated_field(field_descriptor):
            place.element_slots.append(len(self.ragged) - 1)

    def _node_of_only_checked_message_type(self, descriptor: ProtobufMessageDescriptor) -> int:
        """Return the node of a message type without wanted leaves: one per type, which may lead back to itself."""
        known = self.checked.get(descriptor.full_name)
        if known is None:
            self._count_fields_and_check_limit(descriptor)
            self.nodes.append([])
            known = self.checked[descriptor.full_name] = len(self.nodes) - 1
            self.unchecked.append((known, descriptor))
        return known

    def fill_rows_of_only_checked_messages(self) -> None:
        """Fill in the fields of the messages without wanted leaves."""
        while self.unchecked:
            index, descriptor = self.unchecked.pop()
            oneofs: dict[str, int] = {}
            for each in sorted(descriptor.fields, key=lambda one: one.number):
                row = self._new_kernel_row_of_field(each, oneofs)
                if KIND_AND_DTYPE_BY_TYPE[each.type][0] == MESSAGE:
                    row[7] = self._node_of_only_checked_message_type(each.message_type)
                self.nodes[index].append(row)

    def _count_fields_and_check_limit(self, descriptor: ProtobufMessageDescriptor) -> None:
        """Count the fields of a message.

        Raises:
            SchemaError: There are more than `MAX_SCHEMA_FIELDS`.
        """
        self.n_fields += len(descriptor.fields) + 1
        if self.n_fields > MAX_SCHEMA_FIELDS:
            raise SchemaError(f"its messages hold more than {MAX_SCHEMA_FIELDS:,} fields")

    def _new_kernel_row_of_field(self, field_descriptor: ProtobufFieldDescriptor, oneofs: dict[str, int]) -> list[int]:
        """Return the kernel's row of a field, which stores nothing yet."""
        oneof = -1
        if field_descriptor.containing_oneof is not None and len(field_descriptor.containing_oneof.fields) > 1:
            if field_descriptor.containing_oneof.name not in oneofs:
                oneofs[field_descriptor.containing_oneof.name] = self.n_oneofs
                self.n_oneofs += 1
            oneof = oneofs[field_descriptor.containing_oneof.name]
        return [
            field_descriptor.number,
            KIND_AND_DTYPE_BY_TYPE[field_descriptor.type][0],
            int(is_repeated_field(field_descriptor)),
            STORE_NOT,
            -1,
            -1,
            oneof,
            0,
            0,
            0,
        ]

    def _is_leaf_wanted(self, path: str) -> bool:
        return (self.wants is None or self.wants(path)) and len(self.slots) + len(self.ragged) < MAX_LEAF_COLUMNS

    def _has_wanted_leaf_below(self, prefix: str) -> bool:
        """Tell whether a wanted leaf has a path with this prefix."""
        if self.wants is None:
            return True
        return self.wants(prefix) or any(blob.startswith(prefix) for blob in self.blobs)

    def _new_presence_slot(self) -> int:
        self.n_presence += 1
        return self.n_presence - 1
