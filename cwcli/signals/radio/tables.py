"""The types of messages, read from the tables beside this file (`tools/message_tables.py` writes them).

A node is a list: its kind and what follows. `["int", low, high, extensible]`, `["enum", n, extensible]`,
`["sized", bits of a unit, low, high, extensible]`, `["list", node, low, high, extensible]`,
`["sequence", [[name, node, optional], ...], extensible]`, `["choice", [[name, node], ...], extensible]`, `["null"]`,
`["open", [[number, node], ...]]` (contents by the number before it) and `["unread"]` (everything from here on).

The types of CAM and DENM are those of ETSI's ASN.1 modules (3-clause BSD licence, copyright ETSI).
"""

from __future__ import annotations

import json
from importlib.resources import files
from typing import Any

from cwcli.signals.radio.types import Choice, Enum, Int, ListOf, Null, Open, Part, Seq, Sized, Type, Unread


def load_message_type(message: str) -> Type:
    """Read the type of a message: `bsm`, `cam`, `cpm`, `denm`, `sdsm` or `vam`."""
    return _parse_type_node(json.loads(files(__package__).joinpath(f"{message}.json").read_text(encoding="utf-8")))


def _parse_type_node(node: list[Any]) -> Type:  # noqa: PLR0911 - one for each kind
    match node:
        case ["int", low, high, extensible]:
            return Int(low, high, extensible)
        case ["enum", n, extensible]:
            return Enum(n, extensible)
        case ["sized", unit_bits, low, high, extensible]:
            return Sized(unit_bits, low, high, extensible)
        case ["list", element, low, high, extensible]:
            return ListOf(_parse_type_node(element), low, high, extensible)
        case ["sequence", parts, extensible]:
            return Seq(
                tuple(Part(name, _parse_type_node(inner), optional) for name, inner, optional in parts), extensible
            )
        case ["choice", parts, extensible]:
            return Choice(tuple(Part(name, _parse_type_node(inner)) for name, inner in parts), extensible)
        case ["null"]:
            return Null()
        case ["open", cases]:
            return Open({number: _parse_type_node(inner) for number, inner in cases})
        case ["unread"]:
            return Unread()
        case _:
            raise ValueError(f"unknown node {node!r}")
