"""Finds rows that a ROS 2 message can't represent: numbers beyond their types, unequal numbers of elements."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from cwcli.logs.codecs.ros2msg import PRIMITIVE_DTYPES, Definitions, find_message_fields, parse_message_definitions
from cwcli.logs.encoders.column_tree import Tree, build_column_tree, list_leaf_paths_and_columns
from cwcli.logs.encoders.ros_schemas import ros2msg_schema_text
from cwcli.signals.columns import BoolArray, Int64Array, NumericArray, OutputField, Ragged, Repeated
from cwcli.signals.units import NS_PER_S

BOOL_TYPE = "bool"
"""The name of the primitive type of truth values in ROS 2."""
TIME_TYPES = ("builtin_interfaces/Time", "builtin_interfaces/Duration")
"""The message types that may be given as one column of int64 ns."""
SECONDS_TYPE = "int32"
"""The primitive type of the seconds in `builtin_interfaces/Time` and `Duration`."""


def unrepresentable_row_masks(schema_name: str, fields: Mapping[str, OutputField], n: int) -> dict[str, BoolArray]:
    """Return field path -> mask (n,) of rows whose value the field can't represent, for fields with such rows.

    Args:
        schema_name, fields, n: As in `encode_cdr`. Columns of another kind than the field's are ignored.
    """
    root, definitions = parse_message_definitions(schema_name, ros2msg_schema_text(schema_name))
    found = _unrepresentable_rows_of_message(definitions, root, build_column_tree(fields), n)
    return {path: is_unfit for path, is_unfit in found.items() if is_unfit.any()}


def unrepresentable_mask(type_name: str, numbers: NumericArray) -> BoolArray:
    """Return the mask (any shape) of numbers that a primitive type can't represent; rounding to float32 is allowed."""
    values: npt.NDArray[Any] = numbers
    target = np.dtype(PRIMITIVE_DTYPES[type_name])
    if type_name != BOOL_TYPE and np.can_cast(values.dtype, target, "safe"):
        return np.zeros(values.shape, np.bool_)
    if target.kind == "f":
        with np.errstate(over="ignore"):
            beyond: BoolArray = np.isfinite(values) & ~np.isfinite(values.astype(target))
        return beyond
    low, high = (0, 1) if type_name == BOOL_TYPE else (np.iinfo(target).min, np.iinfo(target).max)
    if values.dtype.kind in "bui":
        outside: BoolArray = (values < low) | (values > high)
        return outside
    # In doubles the end of 64 bits is the next power of two, which the type does not hold.
    no_integer: BoolArray = ~((values >= low) & (values < float(high) + 1.0) & (values == np.floor(values)))
    return no_integer


def _unrepresentable_rows_of_message(definitions: Definitions, name: str, tree: Tree, n: int) -> dict[str, BoolArray]:
    """Return field path -> mask (n,) of rows that the message can't represent."""
    found: dict[str, BoolArray] = {}
    for field in find_message_fields(definitions, name):
        column = tree.get(field.name)
        if column is None:
            continue
        if field.type in PRIMITIVE_DTYPES:
            inner = {"": _unrepresentable_rows_of_leaf(field.type, column, n)}
        elif field.type in TIME_TYPES and isinstance(column, np.ndarray):
            inner = {"": _unrepresentable_rows_of_leaf(SECONDS_TYPE, column // NS_PER_S, n)}
        elif field.type not in definitions:
            continue
        elif field.is_sequence:
            inner = _unrepresentable_rows_of_sequence(definitions, field.type, column, n)
        else:
            inner = (
                _unrepresentable_rows_of_message(definitions, field.type, column, n)
                if isinstance(column, Mapping)
                else {}
            )
        found |= {".".join(filter(None, (field.name, path))): rows for path, rows in inner.items()}
    return found


def _unrepresentable_rows_of_leaf(type_name: str, column: OutputField | Tree, n: int) -> BoolArray:
    """Return the mask (n,) of rows with a number that the primitive type can't represent."""
    if isinstance(column, Ragged):
        return _mask_of_rows_with_unfit_element(unrepresentable_mask(type_name, column.values), column.offsets)
    if isinstance(column, np.ndarray) and len(column) == n:
        is_unfit = unrepresentable_mask(type_name, column)
        return np.asarray(is_unfit.any(axis=tuple(range(1, is_unfit.ndim))))
    return np.zeros(n, np.bool_)


def _unrepresentable_rows_of_sequence(
    definitions: Definitions, name: str, column: OutputField | Tree, n: int
) -> dict[str, BoolArray]:
    """Return field path -> mask (n,) of rows that a sequence of messages can't represent.

    Rows in which a leaf has another number of elements than the first leaf count, too.
    """
    if isinstance(column, Repeated):
        inner = _unrepresentable_rows_of_message(
            definitions, name, build_column_tree(column.fields), int(column.offsets[-1])
        )
        return {path: _mask_of_rows_with_unfit_element(is_unfit, column.offsets) for path, is_unfit in inner.items()}
    if not isinstance(column, Mapping):
        return {}
    found = _unrepresentable_rows_of_message(definitions, name, column, n)
    ragged = {
        path: np.diff(leaf.offsets) for path, leaf in list_leaf_paths_and_columns(column) if isinstance(leaf, Ragged)
    }
    counts = next(iter(ragged.values()), np.zeros(n, np.int64))
    for path, own in ragged.items():
        found[path] = found.get(path, np.zeros(n, np.bool_)) | (own != counts)
    return found


def _mask_of_rows_with_unfit_element(is_unfit: BoolArray, offsets: Int64Array) -> BoolArray:
    """Return the mask (n,) of rows with at least one marked element."""
    rows = np.zeros(len(offsets) - 1, np.bool_)
    rows[np.repeat(np.arange(len(rows)), np.diff(offsets))[is_unfit]] = True
    return rows
