"""Columns as ROS 2 messages: rosbags and the official reader must read back what went in, for every message."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from mcap_ros2._dynamic import generate_dynamic
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from cwcli.export.ros.messages import ROS_CONVERSIONS
from cwcli.logs.codecs.ros2msg import PRIMITIVE_DTYPES, STRING_TYPE, MessageField, parse_message_definitions
from cwcli.logs.encoders import cdr_encoder
from cwcli.logs.encoders.byte_rows import ByteRows
from cwcli.logs.encoders.cdr_encoder import encode_cdr
from cwcli.logs.encoders.cdr_fit import unrepresentable_mask, unrepresentable_row_masks
from cwcli.logs.encoders.column_tree import ColumnError
from cwcli.logs.encoders.ros_schemas import ros2msg_schema_text
from cwcli.signals.columns import OutputField, Ragged, Repeated, Strings, slice_column

SCHEMAS = sorted({message.schema for message in ROS_CONVERSIONS.values()})
WORDS = ("", "ego", "Fahrzeug 7 äöü", "x" * 201)
N = 40


def random_numbers(code: str, shape: tuple[int, ...], rng: np.random.Generator) -> Any:
    if code.startswith("f"):
        return rng.normal(size=shape).astype(code)
    if code == "u1":
        return rng.integers(0, 2, shape)  # a bool, or a level
    return rng.integers(0, 2 ** (8 * int(code[1]) - 2), shape)


def random_column(definitions: Mapping[str, Any], field: MessageField, n: int, rng: np.random.Generator) -> Any:
    offsets = np.concatenate([[0], np.cumsum(rng.integers(0, 4, n))]).astype(np.int64)
    if field.type in PRIMITIVE_DTYPES:
        if field.length is not None:
            return random_numbers(PRIMITIVE_DTYPES[field.type], (n, field.length), rng)
        if field.is_sequence:
            return Ragged(random_numbers(PRIMITIVE_DTYPES[field.type], (int(offsets[-1]),), rng), offsets)
        return random_numbers(PRIMITIVE_DTYPES[field.type], (n,), rng)
    if field.type == STRING_TYPE:
        return Strings(rng.integers(-1, len(WORDS), n).astype(np.int32), WORDS)
    if field.is_sequence:
        return Repeated(offsets, random_columns(definitions, field.type, int(offsets[-1]), rng))
    return random_columns(definitions, field.type, n, rng)


def random_columns(
    definitions: Mapping[str, Any], name: str, n: int, rng: np.random.Generator
) -> dict[str, OutputField]:
    columns: dict[str, OutputField] = {}
    for field in definitions[name]:
        column = random_column(definitions, field, n, rng)
        if isinstance(column, dict):
            columns |= {f"{field.name}.{path}": inner for path, inner in column.items()}
        else:
            columns[field.name] = column
    return columns


def row_of(columns: Mapping[str, OutputField], row: int) -> dict[str, Any]:
    """One row as nested mappings, the slow way."""
    out: dict[str, Any] = {}
    for path, column in columns.items():
        *heads, last = path.split(".")
        place = out
        for head in heads:
            place = place.setdefault(head, {})
        if isinstance(column, Strings):
            place[last] = column.values[column.codes[row]] if column.codes[row] >= 0 else ""
        elif isinstance(column, Repeated):
            start, stop = column.offsets[row : row + 2]
            place[last] = [row_of(column.fields, k) for k in range(start, stop)]
        elif isinstance(column, Ragged):
            place[last] = column.values[column.offsets[row] : column.offsets[row + 1]].tolist()
        else:
            place[last] = column[row].tolist()
    return out


def plain(value: Any) -> Any:
    """A decoded message as nested mappings."""
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    if isinstance(value, np.ndarray):
        return value.tolist()
    if hasattr(value, "__slots__") or hasattr(value, "__dataclass_fields__"):
        names = getattr(value, "__dataclass_fields__", None) or value.__slots__
        return {name: plain(getattr(value, name)) for name in names if not name.startswith("_") and not name.isupper()}
    if isinstance(value, bytes):  # `byte` of the official reader
        return value[0]
    return int(value) if isinstance(value, bool) else value


def by_rosbags(schema: str, rows: ByteRows) -> list[Any]:
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(ros2msg_schema_text(schema), schema))
    return [plain(store.deserialize_cdr(each, schema)) for each in messages(rows)]


def by_mcap_ros2(schema: str, rows: ByteRows) -> list[Any]:
    decode = generate_dynamic(schema, ros2msg_schema_text(schema))[schema]
    return [plain(decode(each)) for each in messages(rows)]


def messages(rows: ByteRows) -> list[bytes]:
    return [rows.data[a:b].tobytes() for a, b in zip(rows.offsets[:-1], rows.offsets[1:], strict=True)]


@pytest.mark.parametrize("schema", SCHEMAS)
@pytest.mark.parametrize("read", [by_rosbags, by_mcap_ros2])
def test_others_read_what_went_in(schema: str, read: Any) -> None:
    root, definitions = parse_message_definitions(schema, ros2msg_schema_text(schema))
    columns = random_columns(definitions, root, N, np.random.default_rng(7))
    assert read(schema, encode_cdr(schema, columns, N)) == [row_of(columns, row) for row in range(N)]


@pytest.mark.parametrize("schema", ["nav_msgs/msg/Path", "cwcli_msgs/msg/Lanes", "diagnostic_msgs/msg/DiagnosticArray"])
def test_pieces_are_the_whole(schema: str) -> None:
    root, definitions = parse_message_definitions(schema, ros2msg_schema_text(schema))
    columns = random_columns(definitions, root, N, np.random.default_rng(3))
    parts = [
        each
        for start, stop in ((0, 1), (1, 17), (17, N))
        for each in messages(
            encode_cdr(schema, {path: slice_column(v, start, stop) for path, v in columns.items()}, stop - start)
        )
    ]
    assert parts == messages(encode_cdr(schema, columns, N))


def test_elements_are_encoded_together(monkeypatch: pytest.MonkeyPatch) -> None:
    """The passes over the elements of a path don't grow with its length."""
    passes: list[str] = []
    add_message = cdr_encoder._append_message

    def counted(rows: Any, definitions: Any, name: str, tree: Any) -> None:
        passes.append(name)
        add_message(rows, definitions, name, tree)

    monkeypatch.setattr(cdr_encoder, "_append_message", counted)
    numbers = []
    for n in (3, 300):
        passes.clear()
        offsets = np.array([0, 1, n + 1], np.int64)
        encode_cdr("nav_msgs/msg/Path", {"poses.pose.position.x": Ragged(np.arange(n + 1.0), offsets)}, 2)
        numbers.append(passes.count("geometry_msgs/PoseStamped"))
    assert numbers[0] == numbers[1] <= 3


def test_definitions_are_those_of_ros() -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    for schema in SCHEMAS:
        if schema in store.types:
            root, definitions = parse_message_definitions(schema, ros2msg_schema_text(schema))
            theirs = parse_message_definitions(schema, store.generate_msgdef(schema, ros_version=2)[0])[1]
            assert definitions == theirs, root
    assert sum(schema in store.types for schema in SCHEMAS) == len([s for s in SCHEMAS if "cwcli" not in s])


def test_a_message_is_what_the_standard_says() -> None:
    """By hand: sec, nanosec, the length of a text with its zero, the text, seven bytes of padding, seven doubles."""
    [message] = messages(
        encode_cdr(
            "geometry_msgs/msg/PoseStamped",
            {
                "header.stamp": np.array([2_000_000_003]),
                "header.frame_id": Strings(np.array([0], np.int32), ("mapp",)),
                "pose.orientation.w": np.array([1.0]),
            },
            1,
        )
    )
    expected = b"\0\1\0\0" + bytes([2, 0, 0, 0, 3, 0, 0, 0, 5, 0, 0, 0]) + b"mapp\0" + b"\0" * 7
    assert message == expected + np.array([0, 0, 0, 0, 0, 0, 1], "<f8").tobytes()


def test_a_text_holds_no_zero() -> None:
    """The zero ends a text: whoever reads it as C does would lose the rest."""
    hostile = {"name": Strings(np.array([0], np.int32), ("a\0b\ud800",))}
    [read] = by_rosbags("rcl_interfaces/msg/Log", encode_cdr("rcl_interfaces/msg/Log", hostile, 1))
    assert read["name"] == "a\N{REPLACEMENT CHARACTER}b?"


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"nothing": np.zeros(2)}, "std_msgs/Header has no field nothing"),
        ({"frame_id": np.zeros(2)}, "std_msgs/Header.frame_id: it needs strings"),
        ({"stamp": np.zeros((2, 3))}, "builtin_interfaces/Time.sec: it holds one number"),
        ({"frame_id": Strings(np.zeros(3, np.int32), ("a",))}, "3 rows instead of 2"),
    ],
)
def test_columns_that_do_not_fit(fields: dict[str, OutputField], said: str) -> None:
    inside = {f"header.{name}": column for name, column in fields.items()}
    with pytest.raises(ColumnError, match=said):
        encode_cdr("geometry_msgs/msg/PoseStamped", inside, 2)


@pytest.mark.parametrize(
    ("type_name", "values", "unfit"),
    [
        ("uint8", np.array([0, 255, 256, -1]), [False, False, True, True]),
        ("uint8", np.array([0.0, 255.0, 255.5, np.nan]), [False, False, True, True]),
        ("bool", np.array([0, 1, 2], np.uint8), [False, False, True]),
        ("int32", np.array([2**31 - 1, 2**31, -(2**31), -(2**31) - 1]), [False, True, False, True]),
        ("int64", np.array([2.0**62, 2.0**63, -(2.0**63), np.inf]), [False, True, False, True]),
        ("int64", np.array([2**63 - 1, 2**63], np.uint64), [False, True]),
        ("uint64", np.array([0, -1]), [False, True]),
        ("uint64", np.array([2.0**63, 2.0**64]), [False, True]),
        ("float32", np.array([1e38, 1e39, np.inf, np.nan]), [False, True, False, False]),
        ("float64", np.array([2**63 - 1]), [False]),
    ],
)
def test_numbers_of_a_type(type_name: str, values: Any, unfit: list[bool]) -> None:
    assert unrepresentable_mask(type_name, values).tolist() == unfit


def test_no_number_becomes_another() -> None:
    fields: dict[str, OutputField] = {"level": np.array([10, 300, -1]), "stamp": np.array([0, 1, 2**31]) * 10**9}
    found = {
        path: rows.tolist() for path, rows in unrepresentable_row_masks("rcl_interfaces/msg/Log", fields, 3).items()
    }
    assert found == {"level": [False, True, True], "stamp": [False, False, True]}
    for path, said in (
        ("level", "2 of 3 numbers do not fit in uint8"),
        ("stamp", "1 of 3 numbers do not fit in int32"),
    ):
        with pytest.raises(ColumnError, match=said):
            encode_cdr("rcl_interfaces/msg/Log", {path: fields[path]}, 3)


def test_elements_of_unequal_number_are_named() -> None:
    """Rows of two, one and no elements; the second leaf has one too few in the first row, and 2^31 s in the second."""
    stamps = Ragged(np.array([1, 2, 2**31]) * 1.0, np.array([0, 2, 3, 3]))
    x_m = Ragged(np.zeros(2), np.array([0, 1, 2, 2]))
    path = "poses.pose.position.x"
    fields: dict[str, OutputField] = {"poses.header.stamp.sec": stamps, path: x_m}
    found = {name: rows.tolist() for name, rows in unrepresentable_row_masks("nav_msgs/msg/Path", fields, 3).items()}
    assert found == {"poses.header.stamp.sec": [False, True, False], path: [True, False, False]}


def test_what_is_empty_fits() -> None:
    """A channel without a message, and one of two messages without an element."""
    stamps = {"header.stamp": np.zeros(0, np.int64)}
    nothing: dict[str, OutputField] = {**stamps, "pose.covariance": np.zeros((0, 36))}
    assert not unrepresentable_row_masks("nav_msgs/msg/Odometry", nothing, 0)
    none_each = np.zeros(3, np.int64)
    inside: dict[str, OutputField] = {**stamps, "pose.position.x": np.zeros(0)}
    assert not unrepresentable_row_masks("nav_msgs/msg/Path", {"poses": Repeated(none_each, inside)}, 2)
    assert not unrepresentable_row_masks(
        "nav_msgs/msg/Path", {"poses.pose.position.x": Ragged(np.zeros(0), none_each)}, 2
    )
