"""Columns as protobuf messages: the official parser must read back what went in, for every schema that cwcli writes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from google.protobuf.descriptor import Descriptor, FieldDescriptor
from google.protobuf.message_factory import GetMessageClass

from cwcli.logs.codecs.protobuf_tables import is_repeated_field
from cwcli.logs.encoders.byte_rows import ByteRows
from cwcli.logs.encoders.column_tree import ColumnError
from cwcli.logs.encoders.protobuf_encoder import encode_protobuf
from cwcli.logs.encoders.schemas import find_message_schema
from cwcli.signals.columns import OutputField, Ragged, Repeated, Strings, slice_column

SCHEMAS = [
    "cwcli.v1.VehicleState",
    "cwcli.v1.PredictedPath",
    "cwcli.v1.Warning",
    "cwcli.v1.Lanes",
    "cwcli.v1.LateralState",
    "cwcli.v1.Target",
    "foxglove.LocationFix",
    "foxglove.FrameTransform",
    "foxglove.PoseInFrame",
    "foxglove.PosesInFrame",
    "foxglove.SceneUpdate",
    "foxglove.ImageAnnotations",
    "foxglove.Log",
    "foxglove.CameraCalibration",
]
INTEGER_RANGES = {
    FieldDescriptor.TYPE_INT64: (-(2**63), 2**63 - 1),
    FieldDescriptor.TYPE_UINT64: (0, 2**63 - 1),
    FieldDescriptor.TYPE_INT32: (-(2**31), 2**31 - 1),
    FieldDescriptor.TYPE_UINT32: (0, 2**32 - 1),
    FieldDescriptor.TYPE_FIXED64: (0, 2**63 - 1),
    FieldDescriptor.TYPE_FIXED32: (0, 2**32 - 1),
    FieldDescriptor.TYPE_SFIXED64: (-(2**63), 2**63 - 1),
    FieldDescriptor.TYPE_SFIXED32: (-(2**31), 2**31 - 1),
    FieldDescriptor.TYPE_BOOL: (0, 1),
}
WORDS = ("", "ego", "Fahrzeug 7 äöü", "x" * 200)


def random_column(field: FieldDescriptor, n: int, rng: np.random.Generator) -> OutputField | dict[str, OutputField]:
    """A column for one field; nested messages as a mapping from inner paths."""
    if field.type == FieldDescriptor.TYPE_MESSAGE:
        if is_repeated_field(field):
            offsets = np.concatenate([[0], np.cumsum(rng.integers(0, 4, n))])
            return Repeated(offsets, random_columns(field.message_type, int(offsets[-1]), rng))
        return dict(random_columns(field.message_type, n, rng))
    if is_repeated_field(field):
        if rng.random() < 0.5:
            return np.stack([random_numbers(field, n, rng) for _ in range(3)], axis=1)
        offsets = np.concatenate([[0], np.cumsum(rng.integers(0, 5, n))])
        return Ragged(random_numbers(field, int(offsets[-1]), rng), offsets)
    if field.type in (FieldDescriptor.TYPE_STRING, FieldDescriptor.TYPE_BYTES):
        return Strings(rng.integers(-1, len(WORDS), n).astype(np.int32), WORDS)
    return random_numbers(field, n, rng)


def random_numbers(field: FieldDescriptor, n: int, rng: np.random.Generator) -> np.ndarray[Any, Any]:
    if field.type == FieldDescriptor.TYPE_DOUBLE:
        return rng.normal(size=n) * 10.0 ** rng.integers(-300, 300, n)
    if field.type == FieldDescriptor.TYPE_FLOAT:
        return rng.normal(size=n).astype(np.float32)
    if field.type == FieldDescriptor.TYPE_ENUM:
        return rng.choice([value.number for value in field.enum_type.values], n)
    low, high = INTEGER_RANGES[field.type]
    return rng.integers(low, high, n, endpoint=True) >> rng.integers(0, 40, n)


def random_columns(message: Descriptor, n: int, rng: np.random.Generator) -> dict[str, OutputField]:
    columns: dict[str, OutputField] = {}
    for field in message.fields:
        if is_repeated_field(field) and field.type in (FieldDescriptor.TYPE_STRING, FieldDescriptor.TYPE_BYTES):
            continue
        column = random_column(field, n, rng)
        if isinstance(column, Mapping):
            columns.update({f"{field.name}.{path}": inner for path, inner in column.items()})
        else:
            columns[field.name] = column
    return columns


def row_of(column: OutputField, i: int) -> Any:
    """Row i as plain Python: a number, a text, a list of numbers, or a list of mappings."""
    if isinstance(column, Strings):
        return "" if column.codes[i] < 0 else column.values[column.codes[i]]
    if isinstance(column, Ragged):
        return column.values[column.offsets[i] : column.offsets[i + 1]].tolist()
    if isinstance(column, Repeated):
        elements = range(int(column.offsets[i]), int(column.offsets[i + 1]))
        return [{path: row_of(inner, e) for path, inner in column.fields.items()} for e in elements]
    return column[i].tolist()


def assert_same(message: Any, expected: Mapping[str, Any]) -> None:
    for path, value in expected.items():
        found = message
        for name in path.split("."):
            found = getattr(found, name)
        if isinstance(value, list) and value and isinstance(value[0], dict):
            assert len(found) == len(value)
            for each, inner in zip(found, value, strict=True):
                assert_same(each, inner)
        elif isinstance(value, list):
            assert list(found) == value
        elif isinstance(found, bytes):
            assert found == value.encode()
        else:
            assert found == value, path


def parsed(rows: ByteRows, schema_name: str) -> list[Any]:
    message_class = GetMessageClass(find_message_schema(schema_name).descriptor)
    return [
        message_class.FromString(rows.data[a:b].tobytes()) for a, b in zip(rows.offsets, rows.offsets[1:], strict=False)
    ]


@pytest.mark.parametrize("n", [0, 1, 40])
@pytest.mark.parametrize("schema_name", SCHEMAS)
def test_official_parser_reads_the_same_values(schema_name: str, n: int) -> None:
    for seed in range(3):
        columns = random_columns(find_message_schema(schema_name).descriptor, n, np.random.default_rng(seed))
        messages = parsed(encode_protobuf(find_message_schema(schema_name).descriptor, columns, n), schema_name)
        assert len(messages) == n
        for i, message in enumerate(messages):
            assert_same(message, {path: row_of(column, i) for path, column in columns.items()})


@pytest.mark.parametrize("schema_name", SCHEMAS)
def test_slices_encode_like_the_whole(schema_name: str) -> None:
    descriptor = find_message_schema(schema_name).descriptor
    columns = random_columns(descriptor, 20, np.random.default_rng(5))
    whole = encode_protobuf(descriptor, columns, 20)
    part = encode_protobuf(descriptor, {path: slice_column(column, 7, 15) for path, column in columns.items()}, 8)
    assert part.data.tobytes() == whole.data[whole.offsets[7] : whole.offsets[15]].tobytes()


def test_zeros_are_written() -> None:
    """Equal strings give equal lengths, whatever the numbers are: that is what makes columns quick to read again."""
    columns: dict[str, OutputField] = {
        "stamp_ns": np.array([0, 5]),
        "id": Strings(np.zeros(2, np.int32), ("ego",)),
        "x_m": np.array([0.0, 1.0]),
    }
    rows = encode_protobuf(find_message_schema("cwcli.v1.VehicleState").descriptor, columns, 2)
    assert rows.sizes.tolist() == [9 + 5 + 9, 9 + 5 + 9]
    assert rows.data[:23].tobytes() == b"\x09" + bytes(8) + b"\x12\x03ego" + b"\x19" + bytes(8)


def test_nan_and_infinity_survive() -> None:
    values = np.array([np.nan, np.inf, -np.inf, -0.0])
    rows = encode_protobuf(find_message_schema("cwcli.v1.VehicleState").descriptor, {"length_m": values}, 4)
    found = np.array([message.length_m for message in parsed(rows, "cwcli.v1.VehicleState")])
    assert found.tobytes() == values.tobytes()


def test_timestamp_from_nanoseconds() -> None:
    stamp_ns = np.array([0, 1_700_000_000_123_456_789, -1])
    rows = encode_protobuf(find_message_schema("foxglove.Log").descriptor, {"timestamp": stamp_ns}, 3)
    found = [(m.timestamp.seconds, m.timestamp.nanos) for m in parsed(rows, "foxglove.Log")]
    assert found == [(0, 0), (1_700_000_000, 123_456_789), (-1, 999_999_999)]


def test_enum_by_name() -> None:
    state = Strings(np.array([0, 1, 2, -1], np.int32), ("raised", "held", "STATE_CLEARED"))
    rows = encode_protobuf(find_message_schema("cwcli.v1.Warning").descriptor, {"state": state}, 4)
    assert [message.state for message in parsed(rows, "cwcli.v1.Warning")] == [1, 2, 3, 0]


def test_repeated_messages_from_ragged_leaves() -> None:
    offsets = np.array([0, 2, 2, 3])
    columns: dict[str, OutputField] = {
        "poses.position.x": Ragged(np.array([1.0, 2.0, 3.0]), offsets),
        "poses.orientation.w": Ragged(np.array([4.0, 5.0, 6.0]), offsets),
    }
    messages = parsed(
        encode_protobuf(find_message_schema("foxglove.PosesInFrame").descriptor, columns, 3), "foxglove.PosesInFrame"
    )
    found = [[(pose.position.x, pose.orientation.w) for pose in message.poses] for message in messages]
    assert found == [[(1.0, 4.0), (2.0, 5.0)], [], [(3.0, 6.0)]]


@pytest.mark.parametrize(
    ("schema_name", "columns", "words"),
    [
        ("cwcli.v1.VehicleState", {"speed_kmh": np.zeros(2)}, "no field speed_kmh"),
        ("cwcli.v1.VehicleState", {"x_m": np.zeros(3)}, "3 rows instead of 2"),
        ("cwcli.v1.VehicleState", {"x_m": np.zeros((2, 2))}, "one number"),
        ("cwcli.v1.VehicleState", {"covariance": np.zeros(2)}, "repeated"),
        ("cwcli.v1.VehicleState", {"id": np.zeros(2)}, "needs strings"),
        ("cwcli.v1.VehicleState", {"x_m": Strings(np.zeros(2, np.int32), ("a",))}, "numbers, not strings"),
        ("cwcli.v1.VehicleState", {"x_m.y": np.zeros(2)}, "not a message"),
        ("cwcli.v1.Warning", {"state": Strings(np.zeros(2, np.int32), ("gone",))}, "no value gone"),
        ("foxglove.PoseInFrame", {"pose": np.zeros(2)}, "name the fields inside"),
        ("foxglove.PosesInFrame", {"poses.position.x": np.zeros(2)}, "must be ragged"),
        ("foxglove.LocationFix", {"timestamp": np.zeros(2, np.int64), "timestamp.nanos": np.zeros(2)}, "both"),
    ],
)
def test_columns_that_do_not_fit_are_refused(schema_name: str, columns: dict[str, OutputField], words: str) -> None:
    with pytest.raises(ColumnError, match=words):
        encode_protobuf(find_message_schema(schema_name).descriptor, columns, 2)
