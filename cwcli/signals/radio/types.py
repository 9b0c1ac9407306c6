"""ASN.1 types as far as the unaligned packed encoding sees them, for the tables of messages.

Names are those of the standards; restrictions that the encoding does not see are left out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field

from cwcli.lazy_dataclass import dataclass


@dataclass(frozen=True)
class Int:
    """INTEGER: `low` to `high`, extensible or not; without `high` as many octets as it takes."""

    low: int | None
    high: int | None
    extensible: bool = False


@dataclass(frozen=True)
class Enum:
    """ENUMERATED with `n` values, counted from 0; a later one counts on from `n`."""

    n: int
    extensible: bool = False


@dataclass(frozen=True)
class Sized:
    """A string: `low` to `high` units of some bits (1: BIT STRING, 8: OCTET STRING, 7: IA5String)."""

    unit_bits: int
    low: int
    high: int | None
    extensible: bool = False


@dataclass(frozen=True)
class Part:
    """A component of a sequence; one with a default is optional."""

    name: str
    type: Type
    optional: bool = False


@dataclass(frozen=True)
class Seq:
    """SEQUENCE. What later versions add behind its last component is skipped."""

    parts: tuple[Part, ...]
    extensible: bool = False


@dataclass(frozen=True)
class Choice:
    """CHOICE, its alternatives in the order of their tags. One of a later version is skipped."""

    alternatives: tuple[Part, ...]
    extensible: bool = False


@dataclass(frozen=True)
class ListOf:
    """SEQUENCE OF: `low` to `high` elements."""

    element: Type
    low: int
    high: int | None
    extensible: bool = False


@dataclass(frozen=True)
class Open:
    """An open type whose contents depend on the number right before it; unknown contents are skipped."""

    cases: Mapping[int, Type] = field(default_factory=dict)


@dataclass(frozen=True)
class Null:
    """NULL, which takes no bits."""


@dataclass(frozen=True)
class Unread:
    """The unread rest of a message: everything from here on is skipped."""


Type = Int | Enum | Sized | Seq | Choice | ListOf | Open | Null | Unread
