"""Compiling an ASN.1 type into the operations of the kernel `uper`."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import numpy.typing as npt

from cwcli.kernels import uper
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.radio.types import Choice, Enum, Int, ListOf, Null, Open, Part, Seq, Sized, Type, Unread

MAX_NESTING_DEPTH = 48
"""The largest depth of nested types that the kernel's stack allows."""
NO_COLUMN = -1
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


def compile_type(root: Type, wanted: Collection[str], lists: Collection[str] = ()) -> Program:
    """Compile a type into the kernel's operations.

    Args:
        root: The type of the message.
        wanted: Paths of components, names joined by dots; a choice's own path is the index of its alternative.
        lists: Paths of lists that get a table, with a row for each element. Of elements of other lists the last one
            that has the component counts.

    Raises:
        ValueError: A path does not exist, or the type is nested too deeply (a mistake in a table of this package).
    """
    compiler = _Compiler(frozenset(wanted), frozenset(lists))
    compiler.compile_node(root, "", 0, 0)
    compiler.emit_operation(uper.UPER_END)
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

    def emit_operation(self, operation: int, a: int = 0, b: int = 0, c: int = 0, d: int = 0, *, jump: int = 0) -> int:
        """Append one operation without a column for its value; return its index."""
        self.rows.append([operation, a, b, c, d, 0, NO_COLUMN, jump])
        return len(self.rows) - 1

    def assign_column(self, row: int, path: str, table: int) -> None:
        """Assign a column to the operation's value, where its path is wanted."""
        if path in self.wanted:
            self.columns[path] = (table, self.widths[table])
            self.rows[row][5:7] = self.columns[path]
            self.widths[table] += 1

    def compile_node(self, node: Type, path: str, table: int, depth: int) -> None:
        if depth > MAX_NESTING_DEPTH:
            raise ValueError(f"{path}: nested too deeply")
        match node:
            case Int():
                self.assign_column(self._emit_integer(node), path, table)
            case Enum():
                operation = uper.UPER_ENUM_EXT if node.extensible else uper.UPER_INT
                self.assign_column(self.emit_operation(operation, _bits_for_values(node.n), 0, node.n - 1), path, table)
            case Sized():
                high = -1 if node.high is None else node.high
                width = 0 if node.high is None else _bits_for_values(node.high - node.low + 1)
                row = self.emit_operation(
                    uper.UPER_SIZED, node.unit_bits, node.low, high, width, jump=int(node.extensible)
                )
                self.assign_column(row, path, table)
            case Seq():
                self._emit_sequence(node, path, table, depth)
            case Choice():
                self._emit_choice(node, path, table, depth)
            case ListOf():
                self._emit_list(node, path, table, depth)
            case Open():
                self._emit_open_type(node, path, table, depth)
            case Null():
                pass
            case Unread():
                self.emit_operation(uper.UPER_END)

    def _emit_integer(self, node: Int) -> int:
        if node.low is None or node.high is None:
            return self.emit_operation(uper.UPER_BIG, int(node.low is not None), node.low or 0)
        span = node.high - node.low
        operation = uper.UPER_INT_EXT if node.extensible else uper.UPER_INT
        return self.emit_operation(operation, _bits_for_values(span + 1), node.low, span)

    def _emit_sequence(self, node: Seq, path: str, table: int, depth: int) -> None:
        self.emit_operation(uper.UPER_SEQUENCE, int(node.extensible), sum(part.optional for part in node.parts))
        for part in node.parts:
            option = self.emit_operation(uper.UPER_OPTION) if part.optional else None
            self._emit_component(part, path, table, depth)
            if option is not None:
                self.rows[option][7] = len(self.rows)
        self.emit_operation(uper.UPER_SEQUENCE_END)

    def _emit_choice(self, node: Choice, path: str, table: int, depth: int) -> None:
        n = len(node.alternatives)
        choice = self.emit_operation(uper.UPER_CHOICE, _bits_for_values(n), n, int(node.extensible))
        self.assign_column(choice, path, table)
        doors = [self.emit_operation(uper.UPER_ALTERNATIVE) for _ in node.alternatives]
        exits = []
        for door, part in zip(doors, node.alternatives, strict=True):
            self.rows[door][7] = len(self.rows)
            self._emit_component(part, path, table, depth)
            exits.append(self.emit_operation(uper.UPER_ALTERNATIVE))
        for row in (*exits, choice):
            self.rows[row][7] = len(self.rows)

    def _emit_list(self, node: ListOf, path: str, table: int, depth: int) -> None:
        inner = table
        if path in self.tabled:
            inner = len(self.widths)
            self.widths.append(1)
            self.lists[path] = inner
        high = -1 if node.high is None else node.high
        width = 0 if node.high is None else _bits_for_values(node.high - node.low + 1)
        loop = self.emit_operation(uper.UPER_LIST, width, node.low, high, int(node.extensible))
        self.rows[loop][5] = inner if inner != table else 0
        self.compile_node(node.element, path, inner, depth + 1)
        self.emit_operation(uper.UPER_LIST_END)
        self.rows[loop][7] = len(self.rows)

    def _emit_open_type(self, node: Open, path: str, table: int, depth: int) -> None:
        start = self.emit_operation(uper.UPER_OPEN, 0, len(node.cases))
        doors = [self.emit_operation(uper.UPER_CASE, number) for number in node.cases]
        exits = []
        for door, contents in zip(doors, node.cases.values(), strict=True):
            self.rows[door][7] = len(self.rows)
            self.compile_node(contents, path, table, depth + 1)
            self.emit_operation(uper.UPER_OPEN_END)
            exits.append(self.emit_operation(uper.UPER_ALTERNATIVE))
        for row in (*exits, start):
            self.rows[row][7] = len(self.rows)

    def _emit_component(self, part: Part, path: str, table: int, depth: int) -> None:
        self.compile_node(part.type, f"{path}.{part.name}" if path else part.name, table, depth + 1)


def _bits_for_values(n_values: int) -> int:
    """Return the number of bits of a number with so many values."""
    return (n_values - 1).bit_length()
