"""The tables of V2X messages (`v2x_tables/*.csv`): one row a quantity, with its data element and its path per encoding.

`etsi_elements.csv` and `sae_elements.csv` define the data elements of the standards. The table of a message names the
quantity, its element (none where the code is used as it is), and in a column for each encoding the path of the ASN.1
component or of the leaf field. In paths of messages
- `@motion.` stands for the container that the row `@motion` gives; an empty cell there repeats the one to its left;
- `?` behind a component says that it is optional: a ROS message has a flag for it;
- `:choice` says that the value is the index of the component's alternative;
- `path&4` names a field of flags and the bit that is set when the value is there.

The ROS messages of ETSI are generated from the ASN.1 modules, and so are their leaf fields here.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from cwcli.lazy_dataclass import dataclass

_TABLES_FOLDER = Path(__file__).with_suffix("")
"""The folder of the tables."""


@dataclass(frozen=True)
class Element:
    """A data element of a standard.

    Attributes:
        element: Name in the standard.
        unit: Size of one step, in the unit that the quantity's name says (degrees for angles, metres, ...).
        sign: -1 where the standard counts the other way round than cwcli.
        low, high: Range of the codes that are values.
        unavailable: Codes that say that there is no value.
        out_of_range: Codes that say that the value is not valid and must not be used.
    """

    element: str
    unit: float
    sign: int
    low: int
    high: int
    unavailable: tuple[int, ...] = ()
    out_of_range: tuple[int, ...] = ()


@dataclass(frozen=True)
class MessageTable:
    """The quantities of a message, in the order of their rows.

    Attributes:
        elements: The data element of each coded quantity.
        columns: Encoding -> quantity -> path, for the quantities that the encoding has.
    """

    elements: dict[str, Element]
    columns: dict[str, dict[str, str]]


@cache
def load_message_table(message: str, standard: str) -> MessageTable:
    """Read the table of a message with the data elements of `etsi` or `sae`."""
    known = load_elements(standard)
    rows = _read_table_rows(message)
    elements = {row["quantity"]: known[row["element"]] for row in rows if row["element"]}
    encodings = [name for name in rows[0] if name not in ("quantity", "element")]
    containers: dict[str, dict[str, str]] = {name: {} for name in encodings}
    columns: dict[str, dict[str, str]] = {name: {} for name in encodings}
    for row in rows:
        path = ""
        for name in encodings:
            if row["quantity"].startswith("@"):
                path = row[name] or path
                containers[name][row["quantity"]] = _replace_container_names(path, containers[name])
            elif row[name]:
                columns[name][row["quantity"]] = _replace_container_names(row[name], containers[name])
    return MessageTable(elements, columns)


@cache
def load_elements(standard: str) -> dict[str, Element]:
    """Read the data elements of `etsi` or `sae`, by name."""
    return {
        row["element"]: Element(
            row["element"],
            float(row["step"]),
            int(row["sign"]),
            int(row["low"]),
            int(row["high"]),
            tuple(map(int, row["unavailable"].split())),
            tuple(map(int, row["out_of_range"].split())),
        )
        for row in _read_table_rows(f"{standard}_elements")
    }


def _read_table_rows(name: str) -> list[dict[str, str]]:
    """Return the rows of a table as column -> cell; cells that a line leaves out at its end are empty."""
    lines = (_TABLES_FOLDER / f"{name}.csv").read_text(encoding="utf-8").splitlines()
    head, *rows = ([cell.strip() for cell in line.split(",")] for line in lines)
    return [dict(zip(head, row + [""] * (len(head) - len(row)), strict=True)) for row in rows]


def _replace_container_names(text: str, containers: Mapping[str, str]) -> str:
    return re.sub(r"@\w+", lambda match: containers[match[0]], text)


def strip_table_marks_from_path(path: str) -> str:
    """Return the path of an ASN.1 component without the marks of the table."""
    return path.replace("?", "").removesuffix(":choice")


@cache
def ros_leaf_path(path: str) -> str:
    """Return the leaf field that the ROS messages of ETSI have for a component."""
    return _snake_case_dotted_path(strip_table_marks_from_path(path)) + (
        ".choice" if path.endswith(":choice") else ".value"
    )


def ros_presence_paths(paths: Mapping[str, str]) -> dict[str, str]:
    """Return quantity -> leaf field of the flag that says whether it is there, for the optional ones of ETSI."""
    return {
        name: f"{_snake_case_dotted_path(path.partition('?')[0])}_is_present"
        for name, path in paths.items()
        if "?" in path
    }


def ros_leaf_fields_of_components(paths: Mapping[str, str]) -> tuple[str, ...]:
    """Return the leaf fields that the ROS messages of ETSI have for components, and the flags of the optional ones."""
    return (*map(ros_leaf_path, paths.values()), *ros_presence_paths(paths).values())


def parse_presence_bits(flags: Mapping[str, str]) -> list[tuple[str, str, int]]:
    """Return (quantity, path, bit) for each field of flags that a column of a table names."""
    cells = ((name, cell.partition("&")) for name, text in flags.items() for cell in text.split())
    return [(name, path, int(bit)) for name, (path, _, bit) in cells]


def _snake_case_dotted_path(path: str) -> str:
    return re.sub(r"(?<=[a-z0-9])[A-Z]+", lambda match: f"_{match[0].lower()}", path)
