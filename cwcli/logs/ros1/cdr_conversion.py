"""Converts messages of ROS 1 to CDR, as ROS 2 writes it, by tables: no code is made from a definition.

How a message is cut into pieces and what is put between them depends on its size and on the lengths in it alone. Each
new case of these is kept as a plan, by which the next such message is converted at once.

ROS 1 packs fields without gaps, little-endian, a text or a sequence behind its length in four bytes
(http://wiki.ros.org/ROS/Technical%20Overview). CDR aligns each number to its size, counted from behind the first four
bytes, and ends a text with a zero byte (OMG CORBA 3.3, part 2, 9.3). A message without fields takes one byte in ROS 2.
"""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import Any, NamedTuple

from cwcli.logs.codecs.ros2msg import PRIMITIVE_DTYPES, STRING_TYPE, MessageField
from cwcli.logs.ros1.definitions import (
    HEADER_TYPE,
    SEQUENCE_NUMBER_FIELD_OF_ROS1_HEADER,
    Ros1Definition,
    has_ros1_header,
    is_number_or_text_type,
)

CDR_HEADER = b"\x00\x01\x00\x00"
"""The first bytes of a message: little-endian CDR (DDS-RTPS 2.3, 10.2)."""
SIZE_OF_TYPE = {name: int(dtype[1:]) for name, dtype in PRIMITIVE_DTYPES.items()}
"""Type of a number -> its size in bytes, which is its alignment, too."""
LENGTH_PREFIX_BYTES = 4
"""The size in bytes of the length in front of a text or a sequence, in ROS 1 and in CDR."""
ALLOWED_INNER_MESSAGES_OF_ANY_MESSAGE = 1 << 16
"""A message may hold this number of messages, however few bytes it has. Chosen by hand."""
ALLOWED_EXTRA_INNER_MESSAGES_PER_BYTE = 8
"""A message may hold this number of messages more for each of its bytes, as they may be inside each other. Chosen by
hand."""
MAX_PIECES_OF_ARRAY_COPIED_WITHOUT_LOOP = 64
"""Fixed arrays of messages up to this number of pieces are copied without a loop. Chosen by hand."""
MAX_CACHED_PLANS_PER_TYPE = 200
"""The greatest number of plans that are kept for a type. Chosen by hand: most types have one for each frame's name."""
MAX_PLAN_PIECES = 64
"""The greatest number of pieces, and of lengths, in a plan. Chosen by hand: what has more is rare, and long."""
MAX_BYTES_PLAN_PUTS_BETWEEN_PIECES = 256
"""The greatest number of bytes that a plan puts between the pieces. Chosen by hand."""
ALIGNMENT_PADDING_BY_SIZE = tuple(bytes(n) for n in range(8))
"""The zero bytes of the gap in front of an aligned number in CDR, by the size of the gap in bytes."""
_LENGTH_STRUCT = struct.Struct("<I")
"""A length in front of a text or a sequence."""
_UNPACK_LENGTH = _LENGTH_STRUCT.unpack_from
"""Reads such a length."""


class ConversionError(ValueError):
    """A message that does not fit its definition, or stands for too much."""


class Kind(IntEnum):
    """Kinds of steps of a conversion; what a step holds behind its kind is said in brackets."""

    NUMBERS = 0
    """Numbers of fixed count (bytes; pairs of alignment and bytes)."""
    TEXT = 1
    """One text ()."""
    TEXTS = 2
    """Texts (their number, or None where it is in the message)."""
    SEQUENCE = 3
    """Numbers whose count is in the message (alignment; bytes of one element)."""
    MESSAGES = 4
    """Messages (their layout; their number, or None where it is in the message)."""
    DROPPED = 5
    """Bytes that ROS 2 does not have (their number)."""
    EMPTY = 6
    """A message without fields ()."""


class Layout(NamedTuple):
    """How a message is converted.

    Attributes:
        steps: Tuples of a `Kind` and what it holds.
        min_bytes: Least size of the message in ROS 1.
        n_elements: Number of messages in every such message, itself among them.
    """

    steps: tuple[tuple[Any, ...], ...]
    min_bytes: int
    n_elements: int


class Plan(NamedTuple):
    """How all messages of one size with the same lengths in them are converted.

    Attributes:
        cut: Cuts the pieces out of such a message.
        template: The message as CDR, with `%b` in place of each piece.
    """

    cut: struct.Struct
    template: bytes


class Branch(NamedTuple):
    """A length in a message, on which the rest of its conversion depends.

    Attributes:
        at: Its place.
        found: Each value that was met -> what follows.
    """

    at: int
    found: dict[int, Branch | Plan]


class Ros1Converter:
    """Converts the messages of one type.

    Args:
        definition: The type.
    """

    def __init__(self, definition: Ros1Definition) -> None:
        self._layouts: dict[str, Layout] = {}
        self._definition = definition
        self._drops_sequence = has_ros1_header(definition)
        self._layout = self._layout_of_message(definition.root)
        self._plans: dict[int, Branch | Plan] = {}
        self._n_plans = 0

    def convert(self, data: bytes) -> bytes:
        """Return a message as CDR.

        Raises:
            ConversionError: It does not fit the definition, or holds too many messages.
        """
        plan = self._plans.get(len(data))
        while isinstance(plan, Branch):
            plan = plan.found.get(_UNPACK_LENGTH(data, plan.at)[0])
        if plan is not None:
            return plan.template % plan.cut.unpack(data)
        conversion = _Conversion(data)
        conversion.count_inner_messages_or_raise(self._layout, 1)
        conversion.convert_message(self._layout)
        if conversion.at != len(data):
            raise ConversionError("the message is longer than its definition")
        if self._n_plans < MAX_CACHED_PLANS_PER_TYPE and conversion.is_plannable:
            self._store_plan_if_small(conversion, len(data))
        return bytes(conversion.out)

    def _store_plan_if_small(self, conversion: _Conversion, n_bytes: int) -> None:
        """Keep how a message was converted for all of its size with the same lengths, unless that takes too much."""
        if conversion.n_put_bytes() > MAX_BYTES_PLAN_PUTS_BETWEEN_PIECES:
            return
        self._n_plans += 1
        found, key = self._plans, n_bytes
        for at, value in conversion.lengths:
            branch = found.setdefault(key, Branch(at, {}))
            assert isinstance(branch, Branch)  # whether a length follows depends on what led here
            found, key = branch.found, value
        found[key] = conversion.plan_from_converted_message()

    def _layout_of_message(self, name: str) -> Layout:
        found = self._layouts.get(name)
        if found is None:
            fields = self._definition.fields[name]
            steps: list[tuple[Any, ...]] = []
            if self._drops_sequence and name == HEADER_TYPE:
                steps.append((Kind.DROPPED, SIZE_OF_TYPE[SEQUENCE_NUMBER_FIELD_OF_ROS1_HEADER.type]))
                fields = fields[1:]
            for field in fields:
                _append_step(steps, self._conversion_step_of_field(field))
            if not steps:
                steps.append((Kind.EMPTY,))
            found = self._layouts[name] = Layout(
                tuple(steps), sum(map(_min_bytes_of_step, steps)), 1 + sum(map(_n_elements_of_step, steps))
            )
        return found

    def _conversion_step_of_field(self, field: MessageField) -> tuple[Any, ...]:
        """Return the step of one field."""
        count = None if field.is_sequence else field.length
        if field.type == STRING_TYPE:
            return (Kind.TEXTS, count) if field.is_sequence or field.length is not None else (Kind.TEXT,)
        if is_number_or_text_type(field.type):
            size = SIZE_OF_TYPE[field.type]
            if field.is_sequence:
                return Kind.SEQUENCE, size, size
            n_bytes = size * (1 if field.length is None else field.length)
            return Kind.NUMBERS, n_bytes, ((size, n_bytes),)
        layout = self._layout_of_message(field.type)
        only = layout.steps[0] if len(layout.steps) == 1 else (Kind.EMPTY,)
        if only[0] == Kind.NUMBERS:  # a message of numbers alone is no more than its numbers
            pieces = only[2]
            if field.is_sequence and len(pieces) == 1:
                return Kind.SEQUENCE, pieces[0][0], only[1]
            n = 1 if field.length is None else field.length
            if not field.is_sequence and (
                len(pieces) == 1 or n * len(pieces) <= MAX_PIECES_OF_ARRAY_COPIED_WITHOUT_LOOP
            ):
                repeated = ((pieces[0][0], n * only[1]),) if len(pieces) == 1 else pieces * n
                return Kind.NUMBERS, n * only[1], repeated
        return Kind.MESSAGES, layout, count if field.is_sequence or field.length is not None else 1


def _append_step(steps: list[tuple[Any, ...]], step: tuple[Any, ...]) -> None:
    """Append a step; numbers behind numbers become one step, and of one alignment one piece."""
    if step[0] != Kind.NUMBERS or not steps or steps[-1][0] != Kind.NUMBERS:
        steps.append(step)
        return
    _, n_bytes, pieces = steps.pop()
    joined_pieces = list(pieces)
    for size, length in step[2]:
        if joined_pieces[-1][0] == size:
            joined_pieces[-1] = size, joined_pieces[-1][1] + length
        else:
            joined_pieces.append((size, length))
    steps.append((Kind.NUMBERS, n_bytes + step[1], tuple(joined_pieces)))


def _min_bytes_of_step(step: tuple[Any, ...]) -> int:
    """Return the least size in ROS 1 of what a step converts."""
    kind = step[0]
    if kind in (Kind.NUMBERS, Kind.DROPPED):
        return int(step[1])
    if kind == Kind.TEXTS:
        return LENGTH_PREFIX_BYTES * (1 if step[1] is None else int(step[1]))
    if kind == Kind.MESSAGES:
        return LENGTH_PREFIX_BYTES if step[2] is None else int(step[2]) * int(step[1].min_bytes)
    return 0 if kind == Kind.EMPTY else LENGTH_PREFIX_BYTES


def _n_elements_of_step(step: tuple[Any, ...]) -> int:
    """Return the number of messages, and of texts in arrays, that a step converts in every message."""
    if step[0] == Kind.MESSAGES and step[2] is not None:
        return int(step[2]) * int(step[1].n_elements)
    return int(step[1] or 0) if step[0] == Kind.TEXTS else 0


class _Conversion:
    """One message on its way.

    Attributes:
        at: Bytes of the message that are converted.
        out: The message as CDR.
        lengths: Place and value of each length that was read.
        is_plannable: Whether the message has so few pieces and lengths that its plan is worth keeping.
    """

    __slots__ = ("_data", "_n_left", "_pieces", "at", "is_plannable", "lengths", "out")

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._n_left = ALLOWED_INNER_MESSAGES_OF_ANY_MESSAGE + ALLOWED_EXTRA_INNER_MESSAGES_PER_BYTE * len(data)
        self.at = 0
        self.out = bytearray(CDR_HEADER)
        self.lengths: list[tuple[int, int]] = []
        self._pieces: list[tuple[int, int, int]] = []  # place in the message, in the output, and size
        self.is_plannable = True

    def n_put_bytes(self) -> int:
        """Return the number of bytes of the output that are no copies."""
        return len(self.out) - sum(n for _, _, n in self._pieces)

    def plan_from_converted_message(self) -> Plan:
        """Return how the whole message was converted."""
        layout, template = ["<"], bytearray()
        at = out_at = 0
        for start, out_start, n in self._pieces:
            layout.append(f"{start - at}x{n}s")
            template += bytes(self.out[out_at:out_start]).replace(b"%", b"%%") + b"%b"
            at, out_at = start + n, out_start + n
        layout.append(f"{len(self._data) - at}x")
        template += bytes(self.out[out_at:]).replace(b"%", b"%%")
        return Plan(struct.Struct("".join(layout)), bytes(template))

    def count_inner_messages_or_raise(self, layout: Layout, n: int) -> None:
        """Count `n` messages before any of them is converted.

        Raises:
            ConversionError: They are too many, or more than the rest of the bytes can hold.
        """
        self._require_bytes(n * layout.min_bytes)
        self._n_left -= n * layout.n_elements
        if self._n_left < 0:
            raise ConversionError("the message holds too many messages")

    def _require_bytes(self, n_bytes: int) -> None:
        if n_bytes > len(self._data) - self.at:
            raise ConversionError("the message is shorter than its definition")

    def convert_message(self, layout: Layout) -> None:
        """Convert one message; only its least size was checked before (`count_inner_messages_or_raise`)."""
        out = self.out
        for step in layout.steps:
            kind = step[0]
            if kind == Kind.NUMBERS:
                self._require_bytes(step[1])
                for size, n_bytes in step[2]:
                    gap = -len(out) & (size - 1) if size < 8 else 4 - len(out) & 7
                    if gap:
                        out += ALIGNMENT_PADDING_BY_SIZE[gap]
                    self._copy_bytes(n_bytes)
            elif kind == Kind.TEXT:
                self._copy_text()
            elif kind == Kind.MESSAGES:
                self._convert_messages(step[1], step[2])
            elif kind == Kind.SEQUENCE:
                self._copy_sequence(step[1], step[2])
            elif kind == Kind.TEXTS:
                self._copy_texts(step[1])
            elif kind == Kind.DROPPED:
                self._require_bytes(step[1])
                self.at += step[1]
            else:
                out += ALIGNMENT_PADDING_BY_SIZE[1]

    def _copy_bytes(self, n: int) -> None:
        """Copy the next `n` bytes, which are there."""
        start, out_start = self.at, len(self.out)
        self.at = start + n
        self.out += self._data[start : self.at]
        if self.is_plannable:
            pieces = self._pieces
            if pieces and pieces[-1][0] + pieces[-1][2] == start and pieces[-1][1] + pieces[-1][2] == out_start:
                pieces[-1] = pieces[-1][0], pieces[-1][1], pieces[-1][2] + n
            else:
                pieces.append((start, out_start, n))
            self.is_plannable = len(pieces) <= MAX_PLAN_PIECES

    def _take_length(self) -> int:
        """Take a length from the message."""
        self._require_bytes(LENGTH_PREFIX_BYTES)
        (n,) = _UNPACK_LENGTH(self._data, self.at)
        if self.is_plannable:
            self.lengths.append((self.at, n))
            self.is_plannable = len(self.lengths) <= MAX_PLAN_PIECES
        self.at += LENGTH_PREFIX_BYTES
        return int(n)

    def _copy_and_return_length(self) -> int:
        """Take a length from the message, and write it."""
        n = self._take_length()
        self.out += ALIGNMENT_PADDING_BY_SIZE[-len(self.out) & 3]
        self.out += _LENGTH_STRUCT.pack(n)
        return n

    def _copy_text(self) -> None:
        n = self._take_length()
        self._require_bytes(n)
        out = self.out
        gap = -len(out) & 3
        if gap:
            out += ALIGNMENT_PADDING_BY_SIZE[gap]
        out += _LENGTH_STRUCT.pack(n + 1)
        self._copy_bytes(n)
        out += ALIGNMENT_PADDING_BY_SIZE[1]

    def _copy_texts(self, count: int | None) -> None:
        n = self._copy_and_return_length() if count is None else count
        self._require_bytes(n * LENGTH_PREFIX_BYTES)
        for _ in range(n):
            self._copy_text()

    def _copy_sequence(self, size: int, n_element_bytes: int) -> None:
        n_bytes = self._copy_and_return_length() * n_element_bytes
        self._require_bytes(n_bytes)
        if n_bytes:
            self.out += ALIGNMENT_PADDING_BY_SIZE[4 - len(self.out) & (size - 1)]
            self._copy_bytes(n_bytes)

    def _convert_messages(self, layout: Layout, count: int | None) -> None:
        if count is None:
            n = self._copy_and_return_length()
            self.count_inner_messages_or_raise(layout, n)
        else:  # counted with the message around it
            n = count
        for _ in range(n):
            self.convert_message(layout)
