"""Leaves inside a sequence of messages (`returns.range`), brought to one row per element."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.signals.columns import Columns, FloatArray, Int64Array, Ragged
from cwcli.signals.leaf_fields import find_field
from cwcli.signals.quality import RowLedger


def find_ragged_field(columns: Columns, *paths: str) -> Ragged | None:
    """Return the first of these fields that is there, as `Ragged`; None when there is none, or when it holds
    strings."""
    field = find_field(columns, *paths)
    if field is None or isinstance(field, Ragged):
        return field
    if not isinstance(field, np.ndarray):
        return None
    width = field.shape[1] if field.ndim == 2 else 1
    return Ragged(field.reshape(-1), np.arange(len(field) + 1, dtype=np.int64) * width)


class Elements:
    """The elements of a sequence in each message, counted by one leaf that every element has.

    Attributes:
        offsets: Shape (s + 1,): message k has the elements `offsets[k]:offsets[k + 1]`. A message is rejected, and then
            has none, when a leaf that every element must have is there more or less often.
    """

    def __init__(self, columns: Columns, ledger: RowLedger | None, *required: str) -> None:
        """Count the elements; `required` are the leaves that every one has, the first one counts them."""
        self._columns = columns
        leaves = [find_ragged_field(columns, path) for path in required]
        counts = [
            np.zeros(len(columns), np.int64) if leaf is None else np.diff(leaf.offsets).astype(np.int64)
            for leaf in leaves
        ]
        differs = np.zeros(len(columns), np.bool_)
        for other in counts[1:]:
            differs |= other != counts[0]
        if ledger is not None:
            ledger.reject(differs, "its elements do not all have the same fields")
        self.counts: Int64Array = np.where(differs, 0, counts[0]).astype(np.int64)
        self.offsets: Int64Array = np.concatenate([[0], np.cumsum(self.counts)]).astype(np.int64)

    def __len__(self) -> int:
        return int(self.offsets[-1])

    @property
    def message_rows(self) -> npt.NDArray[np.intp]:
        """The row of each element's message, shape (n,)."""
        return np.repeat(np.arange(len(self.counts)), self.counts)

    def read_numbers(self, *paths: str, width: int = 1) -> FloatArray:
        """Read a leaf, shape (n,), or (n, width) where each element holds `width` values.

        NaN in the messages in which it is there more or less often than it should be: then its values can't be given to
        elements.
        """
        out = np.full((len(self), width), np.nan)
        leaf = find_ragged_field(self._columns, *paths)
        if leaf is not None:
            lengths = np.diff(leaf.offsets)
            fits = lengths == self.counts * width
            theirs = leaf.values[np.repeat(fits, lengths)]
            out[np.repeat(fits, self.counts)] = theirs.astype(np.float64).reshape(-1, width)
        return out[:, 0] if width == 1 else out

    def sum_per_message(self, values: FloatArray) -> FloatArray:
        """Return the sum of `values` (n,) over the elements of each message, shape (s,); it tells repeated messages
        apart."""
        return np.bincount(self.message_rows, weights=values, minlength=len(self.counts)).astype(np.float64)


def offsets_and_indices_of_selected_sequences(
    offsets: Int64Array, rows: npt.NDArray[np.intp]
) -> tuple[Int64Array, npt.NDArray[np.intp]]:
    """Return the new offsets of the sequences `rows`, placed one after the other, and the indices of their elements."""
    counts = np.diff(offsets)[rows]
    new = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    index = np.repeat(offsets[rows] - new[:-1], counts) + np.arange(int(new[-1]))
    return new, index.astype(np.intp)
