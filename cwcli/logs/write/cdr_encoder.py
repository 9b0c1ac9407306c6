"""Encodes columns as ROS 2 messages in CDR, without a Python object per message.

Each number is aligned to its own size, counted from the end of the four-byte header. Fields after a text or a sequence
therefore have another offset in every row: the encoder keeps the length of each row.

Source: DDS-XTYPES 1.3, 7.4.3 (plain CDR, version 1), little-endian, as `rmw` implementations write it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache

import numpy as np

from cwcli.logs.codecs.ros2msg import PRIMITIVES, STRING, Definitions, MessageField, find_definition, parse_definitions
from cwcli.logs.write.byte_rows import ByteRows, join_rows
from cwcli.logs.write.cdr_fit import SECONDS, TIMES, unfit_numbers
from cwcli.logs.write.column_tree import ColumnError, Tree, elements, tree_of
from cwcli.logs.write.ros_schemas import ros_schema
from cwcli.logs.write.row_assembly import Fixed, Piece, Varying, assemble, constant
from cwcli.signals.columns import Int64Array, NumericArray, OutputField, Ragged, Repeated, Strings
from cwcli.signals.units import NS_PER_S

CDR_LITTLE_ENDIAN = b"\x00\x01\x00\x00"
"""The encapsulation header of plain little-endian CDR (DDSI-RTPS 2.5, 10)."""
MAX_ALIGNMENT = 8
"""The largest alignment of a number in bytes (CDR version 1)."""
NO_BYTES = np.zeros(MAX_ALIGNMENT, np.uint8)
"""The zero bytes from which padding is taken."""


def encode_cdr(schema_name: str, fields: Mapping[str, OutputField], n: int) -> ByteRows:
    """Encode n messages.

    Args:
        schema_name: A message of `cwcli.logs.write.ros_schemas`.
        fields: Dotted field path -> n rows; a missing field is zero, empty or false. A time may be given as int64 ns
            under its own name, a sequence of messages as `Repeated` or as `Ragged` leaves.

    Returns:
        n rows, each a message with its encapsulation header.

    Raises:
        KeyError: There is no such message.
        ColumnError: A path names no field, or a column has the wrong kind for it or holds a number that does not fit
            (`unfit_rows` finds such rows).
    """
    root, definitions = _definitions(schema_name)
    body = _Rows(np.zeros(n, np.int64))
    _add_message(body, definitions, root, tree_of(fields))
    return assemble([constant(CDR_LITTLE_ENDIAN), *body.pieces], n)


@lru_cache(maxsize=64)
def _definitions(schema_name: str) -> tuple[str, Definitions]:
    """Return short name of the root message and all message definitions of a schema that cwcli writes."""
    return parse_definitions(schema_name, ros_schema(schema_name))


class _Rows:
    """Rows that grow piece by piece.

    Attributes:
        pieces: The pieces so far.
        place: Shape (n,): bytes of each row after the encapsulation header.
    """

    def __init__(self, place: Int64Array) -> None:
        self.pieces: list[Piece] = []
        self.place = place

    def __len__(self) -> int:
        return len(self.place)

    def add(self, piece: Piece) -> None:
        """Append a piece to every row."""
        self.pieces.append(piece)
        self.place = self.place + (piece.size if isinstance(piece, Fixed) else piece.sizes)

    def align(self, size: int, where: np.ndarray[tuple[int, ...], np.dtype[np.bool_]] | None = None) -> None:
        """Append zeros up to a multiple of the size, in the rows of the mask `where`."""
        gap = -self.place % size
        if where is not None:
            gap[~where] = 0
        if not gap.any():
            return
        if (gap == gap[0]).all():
            self.add(constant(bytes(int(gap[0]))))
        else:
            self.add(Varying(NO_BYTES, np.zeros(len(gap), np.int64), gap))

    def numbers(self, code: str, values: NumericArray) -> None:
        """Append the same number of values to each row, aligned; `code` is a NumPy type without byte order."""
        dtype = np.dtype(f"<{code}")
        self.align(dtype.itemsize)
        self.add(Fixed(np.ascontiguousarray(values, dtype)))

    def counts(self, counts: Int64Array) -> None:
        """Append a 32-bit length to each row."""
        self.numbers("u4", counts)


def _add_message(rows: _Rows, definitions: Definitions, name: str, tree: Tree) -> None:
    fields = find_definition(definitions, name)
    unknown = sorted(set(tree) - {field.name for field in fields})
    if unknown:
        raise ColumnError(f"{name} has no field {', '.join(unknown)}")
    for field in fields:
        try:
            _add_field(rows, definitions, field, tree.get(field.name))
        except ColumnError as error:
            raise ColumnError(f"{name}.{field.name}: {error}") from error


def _add_field(rows: _Rows, definitions: Definitions, field: MessageField, column: OutputField | Tree | None) -> None:
    if column is not None and not isinstance(column, Mapping) and len(column) != len(rows):
        raise ColumnError(f"{len(column)} rows instead of {len(rows)}")
    is_array = field.is_sequence or field.length is not None
    if field.type in PRIMITIVES:
        if is_array:
            _add_array(rows, field, column)
        else:
            _add_number(rows, field, column)
    elif field.type == STRING and not is_array:
        _add_text(rows, column)
    elif field.type == STRING or field.length is not None:
        raise ColumnError("arrays of texts and of messages are not supported")
    elif field.is_sequence:
        _add_sequence(rows, definitions, field.type, column)
    else:
        _add_message(rows, definitions, field.type, _inner(field.type, column))


def _inner(name: str, column: OutputField | Tree | None) -> Tree:
    """Return the column tree of a message inside a message.

    Raises:
        ColumnError: The column is neither a tree nor a time.
    """
    if column is None:
        return {}
    if isinstance(column, Mapping):
        return column
    if name in TIMES and isinstance(column, np.ndarray):
        seconds, nanos = np.divmod(column, NS_PER_S)
        return {"sec": _fitting(SECONDS, seconds), "nanosec": nanos}
    raise ColumnError("it is a message: name the fields inside")


def _fitting(type_name: str, values: NumericArray) -> NumericArray:
    """Return the numbers unchanged.

    Raises:
        ColumnError: The primitive type can't represent some of them.
    """
    n_unfit = int(np.count_nonzero(unfit_numbers(type_name, values)))
    if n_unfit:
        raise ColumnError(f"{n_unfit} of {values.size} numbers do not fit in {type_name}")
    return values


def _add_number(rows: _Rows, field: MessageField, column: OutputField | Tree | None) -> None:
    if column is None:
        column = np.zeros(len(rows))
    if not isinstance(column, np.ndarray) or column.ndim != 1:
        raise ColumnError("it holds one number")
    rows.numbers(PRIMITIVES[field.type], _fitting(field.type, column))


def _add_array(rows: _Rows, field: MessageField, column: OutputField | Tree | None) -> None:
    code = PRIMITIVES[field.type]
    if column is None:
        column = np.zeros((len(rows), field.length or 0))
    if field.length is not None:
        if not isinstance(column, np.ndarray) or column.shape != (len(rows), field.length):
            raise ColumnError(f"it holds {field.length} numbers")
        rows.numbers(code, _fitting(field.type, column))
        return
    if isinstance(column, np.ndarray) and column.ndim == 2:
        column = Ragged(column.ravel(), np.arange(len(column) + 1, dtype=np.int64) * column.shape[1])
    if not isinstance(column, Ragged):
        raise ColumnError("it needs an (n, k) array or a ragged column")
    values = np.ascontiguousarray(_fitting(field.type, column.values), f"<{code}")
    counts = np.diff(column.offsets)
    rows.counts(counts)
    rows.align(values.itemsize, counts > 0)  # nothing is aligned for numbers that are not there
    rows.add(Varying(values.view(np.uint8), column.offsets[:-1] * values.itemsize, counts * values.itemsize))


def _add_text(rows: _Rows, column: OutputField | Tree | None) -> None:
    """Append texts: the length with the final zero, and the text. Absent texts are empty; a zero inside is replaced."""
    if column is None:
        column = Strings(np.full(len(rows), -1, np.int32), ())
    if not isinstance(column, Strings):
        raise ColumnError("it needs strings")
    texts = [value.replace("\0", "\N{REPLACEMENT CHARACTER}").encode(errors="replace") for value in column.values]
    entries = join_rows([text + b"\0" for text in (*texts, b"")])
    codes = np.where(column.codes < 0, len(texts), column.codes)
    rows.counts(entries.sizes[codes])
    rows.add(Varying(entries.data, entries.offsets[codes], entries.sizes[codes]))


def _add_sequence(rows: _Rows, definitions: Definitions, name: str, column: OutputField | Tree | None) -> None:
    """Append a sequence of messages. The size of an element depends on its start modulo eight."""
    if column is None:
        rows.counts(np.zeros(len(rows), np.int64))
        return
    repeated = column if isinstance(column, Repeated) else elements(column)
    tree = tree_of(repeated.fields)
    rows.counts(np.diff(repeated.offsets))

    def encode_elements_at(place: Int64Array) -> _Rows:
        each = _Rows(place)
        _add_message(each, definitions, name, tree)
        return each

    place = _element_places(rows.place, repeated.offsets, encode_elements_at)
    encoded = assemble(encode_elements_at(place).pieces, len(place))
    bounds = encoded.offsets[repeated.offsets]
    rows.add(Varying(encoded.data, bounds[:-1], np.diff(bounds)))


def _element_places(
    row_place: Int64Array, offsets: Int64Array, encode_elements_at: Callable[[Int64Array], _Rows]
) -> Int64Array:
    """Return the start of each element modulo eight, which is the end of the element before it in its row.

    Args:
        row_place: Shape (n,): start of the first element of each row.
        offsets: Shape (n + 1,): number of elements before each row.
        encode_elements_at: Encodes all elements for given starts.
    """
    total, counts = int(offsets[-1]), np.diff(offsets)
    ends: dict[int, list[int]] = {}
    open_places = set((row_place[counts > 0] % MAX_ALIGNMENT).tolist())
    while open_places:
        place = open_places.pop()
        end = encode_elements_at(np.full(total, place, np.int64)).place % MAX_ALIGNMENT
        ends[place] = end.tolist()
        open_places |= set(np.unique(end).tolist()) - set(ends)
    places: list[int] = []
    for row in np.flatnonzero(counts).tolist():
        place = int(row_place[row]) % MAX_ALIGNMENT
        for k in range(int(offsets[row]), int(offsets[row + 1])):
            places.append(place)
            place = ends[place][k]
    return np.array(places, np.int64)
