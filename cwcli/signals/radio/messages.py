"""Decoding many messages of one type at once, from octets to columns."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np
import numpy.typing as npt

from cwcli.kernels import uper
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import Field, FloatArray, Int64Array, Strings
from cwcli.signals.radio.program import Program, compile_asn1_type, load_message_type

CODE_OF_MISSING_COMPONENT = int(np.iinfo(np.int64).min)
"""The code of a component that a message does not have."""
DECODE_FAULT_TEXTS: dict[int, str] = {
    uper.UPER_SHORT: "truncated message",
    uper.UPER_RANGE: "code outside its range",
    uper.UPER_LENGTH: "length disagrees with the contents",
    uper.UPER_FRAGMENTED: "length beyond 16,383",
}
"""The reason why a message can't be decoded, by status code."""

UInt8Array = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class Octets:
    """Octets of n messages: message i is `data[starts[i]:ends[i]]`."""

    data: UInt8Array
    starts: Int64Array
    ends: Int64Array

    def __len__(self) -> int:
        return len(self.starts)

    def select_messages(self, rows: npt.NDArray[np.intp]) -> Octets:
        """Return some of the messages."""
        return Octets(self.data, self.starts[rows], self.ends[rows])


@dataclass(frozen=True)
class DecodedMessages:
    """The components of decoded messages; a message that can't be decoded has none.

    Attributes:
        status: Shape (n,): 0, or the code of a fault, or as it was given.
        components: Path -> shape (n,), or for a component of a list's elements (e,), as the message codes them.
        rows: Path of each list -> shape (e,): the message that each element is in.
    """

    status: UInt8Array
    components: Mapping[str, Int64Array]
    rows: Mapping[str, Int64Array]

    def component_codes(self, path: str) -> Int64Array:
        """Return a component as the message codes it, the code for missing where it is absent."""
        return self.components[path]

    def component_numbers(self, path: str) -> FloatArray:
        """Return a component as numbers, NaN where it is absent."""
        codes = self.components[path]
        return np.where(codes == CODE_OF_MISSING_COMPONENT, np.nan, codes.astype(np.float64))


@dataclass(frozen=True)
class PackedMessage:
    """A message in the packed encoding, and the components of it that are read.

    Attributes:
        name: Name of its ASN.1 type, see `load_message_type`.
        components: The path of each quantity's component.
        objects_path: The list of the road users that it describes; "" where it describes its sender.
        message_id, version: The required values of the header, for ETSI's messages.
    """

    name: str
    components: Mapping[str, str]
    objects_path: str = ""
    message_id: int | None = None
    version: int = 0

    @cached_property
    def program(self) -> Program:
        """The program that decodes the components."""
        lists = (self.objects_path,) if self.objects_path else ()
        return compile_asn1_type(load_message_type(self.name), tuple(self.components.values()), lists)

    def read_quantities(self, decoded: DecodedMessages) -> dict[str, Field]:
        """Return the numbers of each quantity, NaN where it is absent: one row a message, or one row an object."""
        values = {name: decoded.component_numbers(path) for name, path in self.components.items()}
        if not self.objects_path:
            return dict(values)
        rows = decoded.rows[self.objects_path]
        is_of_object = {name: path.startswith(f"{self.objects_path}.") for name, path in self.components.items()}
        return {name: each if is_of_object[name] else each[rows] for name, each in values.items()}


def format_station_ids(codes: Int64Array) -> Strings:
    """Return ids of four octets as texts in hexadecimal, "" where there is none."""
    distinct, inverse = np.unique(codes, return_inverse=True)
    names = tuple("" if code == CODE_OF_MISSING_COMPONENT else f"{code:08x}" for code in distinct)
    return Strings(inverse.astype(np.int32), names)


def decode_messages(program: Program, octets: Octets, status: UInt8Array | None = None) -> DecodedMessages:
    """Decode messages of one type.

    Args:
        status: Shape (n,): what is wrong with messages that are not to be decoded, else 0.

    Returns:
        Their components, and which messages can't be decoded.
    """
    n = len(octets)
    n_tables = len(program.lists) + 1
    status = np.zeros(n, np.uint8) if status is None else status.copy()
    tables = [np.full((n, program.count_columns(0)), CODE_OF_MISSING_COMPONENT, np.int64)]
    tables += [np.zeros((max(64, 4 * n), program.count_columns(k)), np.int64) for k in range(1, n_tables)]
    counts = np.zeros(n_tables, np.int64)
    current = np.zeros(n_tables, np.int64)
    data = np.ascontiguousarray(octets.data, np.uint8)
    n_decoded = 0
    while n and len(data):
        n_decoded = uper.decode(
            data,
            np.ascontiguousarray(octets.starts, np.int64),
            np.ascontiguousarray(octets.ends, np.int64),
            program=program.operations,
            tables=np.array([[table.ctypes.data, table.shape[1], len(table)] for table in tables], np.int64),
            counts=counts,
            current=current,
            first=n_decoded,
            missing=CODE_OF_MISSING_COMPONENT,
            status=status,
        )
        if n_decoded == n:
            break
        tables[1:] = [np.concatenate([table, np.zeros_like(table)]) for table in tables[1:]]
    if not len(data):
        status[:] = uper.UPER_SHORT
    counts[0] = n
    return DecodedMessages(
        status,
        {path: tables[of][: counts[of], column] for path, (of, column) in program.columns.items()},
        {path: tables[of][: counts[of], 0] for path, of in program.lists.items()},
    )
