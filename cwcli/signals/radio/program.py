"""Compiling an ASN.1 type into the operations of the kernel `uper`.

A type is read from the file beside this one that is named like its message (`tools/message_tables.py` writes them). It
is a list, its kind and what follows, as far as the unaligned packed encoding sees it:

- `["int", low, high, extensible]`, without `high` as many octets as it takes;
- `["enum", n, extensible]`, n values counted from 0;
- `["sized", bits of a unit, low, high, extensible]`, a string of `low` to `high` units;
- `["list", type, low, high, extensible]`;
- `["sequence", [[name, type, optional], ...], extensible]`, where what later versions add at the end is skipped;
- `["choice", [[name, type], ...], extensible]`, where an alternative of a later version is skipped;
- `["open", [[number, type], ...]]`, contents by the number right before it; unknown contents are skipped;
- `["null"]`, which takes no bits, and `["unread"]`: everything from here on is skipped.

The types of CAM and DENM are those of ETSI's ASN.1 modules (3-clause BSD licence, copyright ETSI).
"""

from __future__ import annotations

import json
from collections.abc import Collection
from importlib.resources import files
from typing import Any

import numpy as np
import numpy.typing as npt

from cwcli.kernels import uper
from cwcli.lazy_dataclass import dataclass

Asn1Type = list[Any]
"""An ASN.1 type as the list that stands for it, see above."""
MAX_NESTING_DEPTH = 48
"""The largest depth of nested types that the kernel's stack allows."""
DISCARDED_VALUE_COLUMN = -1
"""The column of a value that is decoded and not kept."""


@dataclass(frozen=True)
class Program:
    """The kernel's operations for a type and the components wanted of it.

    Attributes:
        operations: Shape (m, 8), int64; see `kernels/uper.pyx`.
        columns: Path of a component -> its table and column. Column 0 of the table of a list is the message's row.
        lists: Path of each list that has a table -> the table, from 1 on.
    """

    operations: npt.NDArray[np.int64]
    columns: dict[str, tuple[int, int]]
    lists: dict[str, int]

    def count_columns(self, table: int) -> int:
        """Return the number of columns of a table."""
        return max([0, *(column for of, column in self.columns.values() if of == table)]) + 1


def load_message_type(message: str) -> Asn1Type:
    """Read the type of a message: `bsm`, `cam`, `cpm`, `denm`, `sdsm` or `vam`."""
    found: Asn1Type = json.loads(files(__package__).joinpath(f"{message}.json").read_text(encoding="utf-8"))
    return found


def compile_asn1_type(root: Asn1Type, wanted_paths: Collection[str], list_paths: Collection[str] = ()) -> Program:
    """Compile a type into the kernel's operations.

    Args:
        wanted_paths: Paths of components, names joined by dots; a choice's own path is the index of its alternative.
        list_paths: Paths of lists that get a table, a row for each element. Of elements of other lists the last one
            that has the component counts.

    Raises:
        ValueError: A path does not exist, or the type is nested too deeply (a mistake in a table of this package).
    """
    compiler = _Compiler(frozenset(wanted_paths), frozenset(list_paths))
    compiler.emit_operations_of_type(root, "", 0, 0)
    compiler.emit_operation_and_return_index(uper.UPER_END)
    unknown = (compiler.wanted - compiler.columns.keys()) | (compiler.tabled - compiler.lists.keys())
    if unknown:
        raise ValueError(f"no such component: {', '.join(sorted(unknown))}")
    return Program(np.array(compiler.rows, np.int64), compiler.columns, compiler.lists)


class _Compiler:
    def __init__(self, wanted: frozenset[str], tabled: frozenset[str]) -> None:
        self.wanted = wanted
        self.tabled = tabled
        self.rows: list[list[int]] = []
        self.columns: dict[str, tuple[int, int]] = {}
        self.lists: dict[str, int] = {}
        self.widths = [0]

    def emit_operation_and_return_index(
        self, operation: int, a: int = 0, b: int = 0, c: int = 0, d: int = 0, *, jump: int = 0
    ) -> int:
        """Append one operation without a column for its value; return its index."""
        self.rows.append([operation, a, b, c, d, 0, DISCARDED_VALUE_COLUMN, jump])
        return len(self.rows) - 1

    def assign_output_column_if_wanted(self, operation_index: int, path: str, output_table: int) -> None:
        """Assign a column to the operation's value, where its path is wanted."""
        if path in self.wanted:
            self.columns[path] = (output_table, self.widths[output_table])
            self.rows[operation_index][5:7] = self.columns[path]
            self.widths[output_table] += 1

    def emit_operations_of_type(self, node: Asn1Type, path: str, output_table: int, depth: int) -> None:
        if depth > MAX_NESTING_DEPTH:
            raise ValueError(f"{path}: nested too deeply")
        match node:
            case ["int", low, high, extensible]:
                self.assign_output_column_if_wanted(
                    self._emit_integer_operation(low, high, extensible), path, output_table
                )
            case ["enum", n, extensible]:
                operation = uper.UPER_ENUM_EXT if extensible else uper.UPER_INT
                self.assign_output_column_if_wanted(
                    self.emit_operation_and_return_index(operation, _n_bits_for_number_of_values(n), 0, n - 1),
                    path,
                    output_table,
                )
            case ["sized", unit_bits, low, high, extensible]:
                size = _kernel_limit_and_bits_of_size(low, high)
                row = self.emit_operation_and_return_index(uper.UPER_SIZED, unit_bits, low, *size, jump=int(extensible))
                self.assign_output_column_if_wanted(row, path, output_table)
            case ["sequence", parts, extensible]:
                self._emit_sequence_operations(parts, path, output_table, depth, is_extensible=extensible)
            case ["choice", alternatives, extensible]:
                self._emit_choice_operations(alternatives, path, output_table, depth, is_extensible=extensible)
            case ["list", element, low, high, extensible]:
                high, width = _kernel_limit_and_bits_of_size(low, high)
                loop = self.emit_operation_and_return_index(uper.UPER_LIST, width, low, high, int(extensible))
                self._emit_list_element_operations(loop, element, path, output_table, depth)
            case ["open", cases]:
                self._emit_open_type_operations(cases, path, output_table, depth)
            case ["null"]:
                pass
            case ["unread"]:
                self.emit_operation_and_return_index(uper.UPER_END)
            case _:
                raise ValueError(f"unknown node {node!r}")

    def _emit_integer_operation(self, low: int | None, high: int | None, extensible: bool) -> int:
        if low is None or high is None:
            return self.emit_operation_and_return_index(uper.UPER_BIG, int(low is not None), low or 0)
        operation = uper.UPER_INT_EXT if extensible else uper.UPER_INT
        return self.emit_operation_and_return_index(
            operation, _n_bits_for_number_of_values(high - low + 1), low, high - low
        )

    def _emit_sequence_operations(
        self, parts: list[Any], path: str, output_table: int, depth: int, *, is_extensible: bool
    ) -> None:
        self.emit_operation_and_return_index(
            uper.UPER_SEQUENCE, int(is_extensible), sum(optional for _, _, optional in parts)
        )
        for name, part, is_optional in parts:
            option = self.emit_operation_and_return_index(uper.UPER_OPTION) if is_optional else None
            self.emit_operations_of_type(part, _path_of_component(path, name), output_table, depth + 1)
            if option is not None:
                self.rows[option][7] = len(self.rows)
        self.emit_operation_and_return_index(uper.UPER_SEQUENCE_END)

    def _emit_choice_operations(
        self, alternatives: list[Any], path: str, output_table: int, depth: int, *, is_extensible: bool
    ) -> None:
        n = len(alternatives)
        choice = self.emit_operation_and_return_index(
            uper.UPER_CHOICE, _n_bits_for_number_of_values(n), n, int(is_extensible)
        )
        self.assign_output_column_if_wanted(choice, path, output_table)
        doors = [self.emit_operation_and_return_index(uper.UPER_ALTERNATIVE) for _ in alternatives]
        exits = []
        for door, (name, part) in zip(doors, alternatives, strict=True):
            self.rows[door][7] = len(self.rows)
            self.emit_operations_of_type(part, _path_of_component(path, name), output_table, depth + 1)
            exits.append(self.emit_operation_and_return_index(uper.UPER_ALTERNATIVE))
        for row in (*exits, choice):
            self.rows[row][7] = len(self.rows)

    def _emit_list_element_operations(
        self, list_operation_index: int, element: Asn1Type, path: str, output_table: int, depth: int
    ) -> None:
        """Append the operations of a list's elements; a wanted list gets a table of its own."""
        inner = output_table
        if path in self.tabled:
            inner = len(self.widths)
            self.widths.append(1)
            self.lists[path] = inner
        self.rows[list_operation_index][5] = inner if inner != output_table else 0
        self.emit_operations_of_type(element, path, inner, depth + 1)
        self.emit_operation_and_return_index(uper.UPER_LIST_END)
        self.rows[list_operation_index][7] = len(self.rows)

    def _emit_open_type_operations(
        self, cases: list[tuple[int, Asn1Type]], path: str, output_table: int, depth: int
    ) -> None:
        start = self.emit_operation_and_return_index(uper.UPER_OPEN, 0, len(cases))
        doors = [self.emit_operation_and_return_index(uper.UPER_CASE, number) for number, _ in cases]
        exits = []
        for door, (_, contents) in zip(doors, cases, strict=True):
            self.rows[door][7] = len(self.rows)
            self.emit_operations_of_type(contents, path, output_table, depth + 1)
            self.emit_operation_and_return_index(uper.UPER_OPEN_END)
            exits.append(self.emit_operation_and_return_index(uper.UPER_ALTERNATIVE))
        for row in (*exits, start):
            self.rows[row][7] = len(self.rows)


def _path_of_component(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def _kernel_limit_and_bits_of_size(low: int, high: int | None) -> tuple[int, int]:
    """Return the greatest number of elements (-1: any) and the bits of their number, as the kernel takes them."""
    return (-1, 0) if high is None else (high, _n_bits_for_number_of_values(high - low + 1))


def _n_bits_for_number_of_values(n_values: int) -> int:
    """Return the number of bits of a number with so many values."""
    return (n_values - 1).bit_length()
