"""Arranges columns with dotted names as the tree of a message."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cwcli.signals.columns import Int64Array, OutputField, Ragged, Repeated

Tree = Mapping[str, "OutputField | Tree"]


class ColumnError(ValueError):
    """The columns don't fit the message."""


def build_column_tree(fields: Mapping[str, OutputField]) -> Tree:
    """Turn columns by dotted path into nested mappings.

    Raises:
        ColumnError: A field is given whole and in parts.
    """
    tree: dict[str, OutputField | Tree] = {}
    below: dict[str, dict[str, OutputField]] = {}
    for path, column in fields.items():
        head, dot, rest = path.partition(".")
        if dot:
            below.setdefault(head, {})[rest] = column
        else:
            tree[head] = column
    for head, inner in below.items():
        if head in tree:
            raise ColumnError(f"both {head} and {head}.* are given")
        tree[head] = build_column_tree(inner)
    return tree


def repeated_from_ragged_leaves(column: OutputField | Tree) -> Repeated:
    """Join the ragged leaves of a repeated message to one `Repeated`; they must agree on the offsets.

    Raises:
        ColumnError: They don't, or are not ragged.
    """
    inside = dict(list_leaf_paths_and_columns(column)) if isinstance(column, Mapping) else {}
    offsets: Int64Array | None = None
    fields: dict[str, OutputField] = {}
    for path, leaf in inside.items():
        if not isinstance(leaf, Ragged):
            raise ColumnError(f"{path} must be ragged: it lies inside a repeated message")
        if offsets is not None and not np.array_equal(offsets, leaf.offsets):
            raise ColumnError("its fields differ in their number of elements")
        offsets = leaf.offsets
        fields[path] = leaf.values
    if offsets is None:
        raise ColumnError("it is a repeated message: name the fields inside")
    return Repeated(offsets, fields)


def list_leaf_paths_and_columns(tree: Tree, prefix: str = "") -> list[tuple[str, OutputField]]:
    """List dotted path and column of each leaf."""
    found: list[tuple[str, OutputField]] = []
    for name, node in tree.items():
        found += (
            list_leaf_paths_and_columns(node, f"{prefix}{name}.")
            if isinstance(node, Mapping)
            else [(prefix + name, node)]
        )
    return found
