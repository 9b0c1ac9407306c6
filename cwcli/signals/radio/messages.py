"""Decoding many messages of one type at once, from octets to columns."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from cwcli.kernels import uper
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.radio.program import Program

MISSING_CODE = int(np.iinfo(np.int64).min)
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
        return np.where(codes == MISSING_CODE, np.nan, codes.astype(np.float64))


def decode_messages(program: Program, octets: Octets, status: UInt8Array | None = None) -> DecodedMessages:
    """Decode messages of one type.

    Args:
        program: The program of the type.
        octets: The messages.
        status: Shape (n,): what is wrong with messages that are not to be decoded, else 0.

    Returns:
        Their components, and which messages can't be decoded.
    """
    n = len(octets)
    n_tables = len(program.lists) + 1
    status = np.zeros(n, np.uint8) if status is None else status.copy()
    tables = [np.full((n, program.count_columns(0)), MISSING_CODE, np.int64)]
    tables += [np.zeros((max(64, 4 * n), program.count_columns(k)), np.int64) for k in range(1, n_tables)]
    counts = np.zeros(n_tables, np.int64)
    current = np.zeros(n_tables, np.int64)
    data = np.ascontiguousarray(octets.data, np.uint8)
    done = 0
    while n and len(data):
        done = uper.decode(
            data,
            np.ascontiguousarray(octets.starts, np.int64),
            np.ascontiguousarray(octets.ends, np.int64),
            program=program.operations,
            tables=np.array([[table.ctypes.data, table.shape[1], len(table)] for table in tables], np.int64),
            counts=counts,
            current=current,
            first=done,
            missing=MISSING_CODE,
            status=status,
        )
        if done == n:
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
