"""Protobuf columns against the official parser, on generated and on odd messages."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorProto, FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass

from cwcli.errors import InputError
from cwcli.logs.codecs.column_buffers import Payloads
from cwcli.logs.codecs.protobuf import INVALID_MESSAGE_REASON, ProtobufDecoder
from cwcli.logs.read.reader import Log
from cwcli.signals.columns import Ragged
from tests.protobuf_bytes import encode_varint
from tests.unit.logs_read.builders import T0_NS, Declared, Sent, log_bytes
from tests.unit.logs_read.official import assert_same, read_officially

SCALARS = {k: k for k in (1, 2, 3, 4, 5, 6, 7, 8, 13, 15, 16, 17, 18)}  # FieldDescriptorProto.Type of all numbers
TEXT, NESTED, OCTETS, ENUM = 9, 11, 12, 14
OPTIONAL, REPEATED = 1, 3


def odd_schema(syntax: str = "proto3") -> bytes:
    """`test.Root`: every scalar, alone and repeated, nested, in a oneof, optional, in a map, in itself."""
    file = FileDescriptorProto(name="root.proto", package="test")
    if syntax == "proto3":
        file.syntax = "proto3"
    colour = file.enum_type.add(name="Colour")
    for name, number in (("NONE", 0), ("RED", 1), ("BLUE", 7)):
        colour.value.add(name=name, number=number)
    inner = file.message_type.add(name="Inner")
    inner.field.add(name="x", number=1, type=1, label=OPTIONAL)
    inner.field.add(name="k", number=2, type=17, label=OPTIONAL)
    inner.field.add(name="many", number=3, type=5, label=REPEATED)
    inner.field.add(name="name", number=4, type=TEXT, label=OPTIONAL)
    inner.field.add(name="self", number=5, type=NESTED, type_name=".test.Inner", label=OPTIONAL)
    inner.field.add(name="deep", number=6, type=NESTED, type_name=".test.Deep", label=OPTIONAL)
    deep = file.message_type.add(name="Deep")
    deep.field.add(name="z", number=1, type=2, label=OPTIONAL)
    root = file.message_type.add(name="Root")
    for number in SCALARS:
        root.field.add(name=f"one_{number}", number=number, type=number, label=OPTIONAL)
        root.field.add(name=f"some_{number}", number=100 + number, type=number, label=REPEATED)
    root.field.add(name="text", number=30, type=TEXT, label=OPTIONAL)
    root.field.add(name="texts", number=31, type=TEXT, label=REPEATED)
    root.field.add(name="blob", number=32, type=OCTETS, label=OPTIONAL)
    root.field.add(name="colour", number=33, type=ENUM, type_name=".test.Colour", label=OPTIONAL)
    root.field.add(name="colours", number=34, type=ENUM, type_name=".test.Colour", label=REPEATED)
    root.field.add(name="inner", number=35, type=NESTED, type_name=".test.Inner", label=OPTIONAL)
    root.field.add(name="inners", number=36, type=NESTED, type_name=".test.Inner", label=REPEATED)
    root.oneof_decl.add(name="choice")
    root.field.add(name="choice_number", number=40, type=1, label=OPTIONAL, oneof_index=0)
    root.field.add(name="choice_text", number=41, type=TEXT, label=OPTIONAL, oneof_index=0)
    root.field.add(name="choice_inner", number=42, type=NESTED, type_name=".test.Inner", label=OPTIONAL, oneof_index=0)
    if syntax == "proto3":
        root.oneof_decl.add(name="_maybe")
        root.field.add(name="maybe", number=43, type=5, label=OPTIONAL, oneof_index=1, proto3_optional=True)
    entry = root.nested_type.add(name="ByNameEntry")
    entry.options.map_entry = True
    entry.field.add(name="key", number=1, type=TEXT, label=OPTIONAL)
    entry.field.add(name="value", number=2, type=1, label=OPTIONAL)
    root.field.add(name="by_name", number=44, type=NESTED, type_name=".test.Root.ByNameEntry", label=REPEATED)
    return FileDescriptorSet(file=[file]).SerializeToString()


def message_class(schema: bytes, name: str = "test.Root") -> Any:
    """The official class."""
    pool = DescriptorPool()
    for file in FileDescriptorSet.FromString(schema).file:
        pool.Add(file)
    return GetMessageClass(pool.FindMessageTypeByName(name))


def random_message(rng: np.random.Generator, make: Any) -> Any:
    """A message with some of its fields."""
    message = make()
    for number in SCALARS:
        if rng.random() < 0.6:
            setattr(message, f"one_{number}", _scalar(rng, number))
        getattr(message, f"some_{number}").extend(_scalar(rng, number) for _ in range(rng.integers(0, 4)))
    if rng.random() < 0.5:
        message.text = str(rng.choice(["", "abc", "é", "x" * 200]))
    message.texts.extend(["a", "é"][: rng.integers(0, 3)])
    message.blob = rng.bytes(int(rng.integers(0, 5)))
    message.colour = int(rng.choice([0, 1, 7]))
    message.colours.extend(int(value) for value in rng.choice([0, 1, 7], rng.integers(0, 3)))
    if rng.random() < 0.5:
        _fill_inner(rng, message.inner)
    for _ in range(rng.integers(0, 3)):
        _fill_inner(rng, message.inners.add())
    choice = rng.integers(0, 4)
    if choice == 1:
        message.choice_number = float(rng.normal())
    elif choice == 2:
        message.choice_text = "chosen"
    elif choice == 3:
        _fill_inner(rng, message.choice_inner)
    if rng.random() < 0.5 and "maybe" in message.DESCRIPTOR.fields_by_name:
        message.maybe = int(rng.integers(0, 2))
    for k in range(rng.integers(0, 3)):
        message.by_name[f"key{k}"] = float(k)
    return message


def _fill_inner(rng: np.random.Generator, inner: Any) -> None:
    if rng.random() < 0.7:
        inner.x, inner.k = float(rng.normal()), int(rng.integers(-9, 9))
    inner.many.extend(int(value) for value in rng.integers(-300, 300, rng.integers(0, 3)))
    if rng.random() < 0.3:
        inner.name, inner.deep.z = "name", 0.5
    if rng.random() < 0.2:
        inner.self.x = 1.0


def _scalar(rng: np.random.Generator, kind: int) -> Any:
    if kind == 1:
        return float(rng.choice([0.0, -0.0, np.inf, np.nan, rng.normal()]))
    if kind == 2:
        return float(np.float32(rng.normal()))
    if kind == 8:
        return bool(rng.integers(0, 2))
    bits = 64 if kind in (3, 4, 6, 16, 18) else 32
    low = 0 if kind in (4, 6, 7, 13) else -(1 << (bits - 1))
    anything = int.from_bytes(rng.bytes(bits // 8), "little", signed=low < 0)
    return (low, low + (1 << bits) - 1, anything, 0, 1, 300)[int(rng.integers(6))]


def check(tmp_path: Path, schema: bytes, messages: list[bytes]) -> Log:
    """The columns equal the official parser's rows."""
    path = tmp_path / "log.mcap"
    channel = Declared("/m", "protobuf", "test.Root", "protobuf", schema)
    data = log_bytes([channel], [Sent("/m", T0_NS + k, each) for k, each in enumerate(messages)], chunk_size=4000)
    path.write_bytes(data)
    with Log.open(path) as log:
        assert_same(log.columns("/m"), read_officially(data)["/m"], expect_paths=False)
        return log


@pytest.mark.parametrize("syntax", ["proto2", "proto3"])
@pytest.mark.parametrize("seed", range(4))
def test_random_messages(tmp_path: Path, syntax: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    schema = odd_schema(syntax)
    make = message_class(schema)
    check(tmp_path, schema, [random_message(rng, make).SerializeToString() for _ in range(60)])


def test_all_leaves_are_columns(tmp_path: Path) -> None:
    schema = odd_schema()
    decoder = ProtobufDecoder("test.Root", schema, None)
    expected = {f"{word}_{k}" for k in SCALARS for word in ("one", "some")}
    expected |= {"text", "colour", "colours", "choice_number", "choice_text", "maybe"}
    for prefix in ("inner", "choice_inner"):
        expected |= {f"{prefix}.{name}" for name in ("x", "k", "many", "name", "deep.z")}
    expected |= {f"inners.{name}" for name in ("x", "k", "many", "deep.z")}
    assert set(decoder.build_columns(np.zeros(0, np.int64))) == expected


@pytest.mark.parametrize("seed", range(4))
def test_shuffled_damaged_and_foreign_bytes(tmp_path: Path, seed: int) -> None:
    """Fields in any order and twice, unknown fields, flipped and cut bytes: as the official parser decides."""
    rng = np.random.default_rng(100 + seed)
    schema = odd_schema()
    make = message_class(schema)
    messages = []
    for k in range(150):
        parts = [random_message(rng, make).SerializeToString() for _ in range(2)]
        parts.append(b"\xa2\x1f\x03abc\xa8\x1f\x05")  # fields 500 and 501 are unknown
        rng.shuffle(parts)
        data = bytearray(b"".join(parts))
        if k % 3 == 1:
            data[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))
        elif k % 3 == 2:
            del data[int(rng.integers(len(data))) :]
        messages.append(bytes(data))
    check(tmp_path, schema, messages)


def test_packed_and_unpacked_are_the_same(tmp_path: Path) -> None:
    schema = odd_schema()
    packed = b"\xca\x06\x02\x01\x02"  # some_5 (105), length-delimited
    unpacked = b"\xc8\x06\x01\xc8\x06\x02"
    log = check(tmp_path, schema, [packed, unpacked, packed + unpacked, b""])
    assert log.faults.counts_by_reason() == {}


def test_overlong_varints_groups_and_nesting(tmp_path: Path) -> None:
    nested = b""
    for _ in range(90):
        nested = b"\x2a" + encode_varint(len(nested)) + nested  # Inner.self
    log = check(
        tmp_path,
        odd_schema(),
        [
            b"\x28\x85\x80\x80\x80\x80\x80\x80\x80\x80\x00",  # one_5 in ten bytes
            b"\x28" + b"\xff" * 10 + b"\x01",  # eleven bytes
            b"\x2b\x2c",  # a group
            b"\x9a\x02" + encode_varint(len(nested)) + nested,  # inner, ninety levels
            b"\x2d\0\0\0\0",  # one_5 with the wire type of a fixed32
            b"\x00\x01",  # field number 0
            b"\xf2\x01\x02\xff\xfe",  # text that is not UTF-8
        ],
    )
    assert log.faults.undecodable["/m"][INVALID_MESSAGE_REASON] >= 3


def test_absent_parts_are_nan_and_left_out_scalars_are_zero() -> None:
    schema = odd_schema()
    make = message_class(schema)
    full = make(one_3=5, maybe=0)
    full.inner.x = 0.0
    decoder = ProtobufDecoder("test.Root", schema, ["one_3", "one_1", "maybe", "inner.x", "text", "choice_text"])
    data = full.SerializeToString()
    decoder.decode_batch(Payloads(np.frombuffer(data, np.uint8), np.array([0, 0]), np.array([len(data), 0])))
    columns: dict[str, Any] = decoder.build_columns(np.arange(2))
    assert columns["one_3"].dtype == np.int64 and columns["one_3"].tolist() == [5, 0]
    assert columns["one_1"].tolist() == [0.0, 0.0]
    assert np.array_equal(columns["maybe"], [0.0, np.nan], equal_nan=True)
    assert np.array_equal(columns["inner.x"], [0.0, np.nan], equal_nan=True)
    assert columns["text"].codes.tolist() == [0, 0] and columns["text"].values == ("",)
    assert columns["choice_text"].codes.tolist() == [-1, -1]


def test_repeated_scalars_are_a_matrix_only_if_all_rows_have_as_many() -> None:
    schema = odd_schema()
    make = message_class(schema)

    def column(*rows: list[float]) -> Any:
        messages = [make(some_1=row).SerializeToString() for row in rows]
        ends = np.cumsum([len(each) for each in messages])
        decoder = ProtobufDecoder("test.Root", schema, ["some_1"])
        decoder.decode_batch(
            Payloads(np.frombuffer(b"".join(messages), np.uint8), np.concatenate([[0], ends[:-1]]), ends)
        )
        return decoder.build_columns(np.arange(len(rows)))["some_1"]

    assert column([1.0, 2.0], [3.0, 4.0]).tolist() == [[1.0, 2.0], [3.0, 4.0]]
    ragged = column([1.0, 2.0], [3.0])
    assert isinstance(ragged, Ragged) and ragged.offsets.tolist() == [0, 2, 3]


def closed_enum_schema() -> bytes:
    """`test.Root` of proto2: enumerations in repeated parts, whose defaults are 0 and 1, and a repeated one."""
    file = FileDescriptorProto(name="root.proto", package="test")
    for name, values in (("Zero", (0, 1)), ("One", (1, 0, 5))):
        added = file.enum_type.add(name=name)
        for number in values:
            added.value.add(name=f"{name.upper()}_{number}", number=number)
    part, root = file.message_type.add(name="Part"), file.message_type.add(name="Root")
    part.field.add(name="zero", number=1, type=ENUM, type_name=".test.Zero", label=OPTIONAL)
    part.field.add(name="one", number=2, type=ENUM, type_name=".test.One", label=OPTIONAL)
    root.field.add(name="parts", number=1, type=NESTED, type_name=".test.Part", label=REPEATED)
    root.field.add(name="ones", number=2, type=ENUM, type_name=".test.One", label=REPEATED)
    return FileDescriptorSet(file=[file]).SerializeToString()


@pytest.mark.parametrize(
    ("message", "needs_parser"),
    [
        (b"\x0a\x04\x08\x01\x10\x05", False),  # a part with zero = 1, one = 5
        (b"\x0a\x02\x10\x05", False),  # a part without `zero`, whose default is 0
        (b"\x0a\x02\x08\x01", True),  # a part without `one`, whose default is 1
        (b"\x0a\x04\x08\x09\x10\x05", True),  # a part whose `zero` is unknown
        (b"\x0a\x06\x08\x01\x08\x09\x10\x05", True),  # the same, behind a known one, which stays
        (b"\x10\x05\x10\x00", False),  # ones = 5, 0
        (b"\x10\x05\x10\x09", True),  # ones = 5 and an unknown one, which is dropped
        (b"", False),
    ],
)
def test_only_values_that_an_enumeration_does_not_know_need_the_official_parser(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, message: bytes, needs_parser: bool
) -> None:
    parsed: list[bytes] = []
    parse = ProtobufDecoder._decode_with_official_parser

    def record(self: Any, data: bytes, *others: Any) -> bool:
        parsed.append(data)
        return parse(self, data, *others)

    monkeypatch.setattr(ProtobufDecoder, "_decode_with_official_parser", record)
    known = b"\x0a\x04\x08\x01\x10\x01\x10\x01"
    check(tmp_path, closed_enum_schema(), [known, message, known])
    assert parsed == [message] * needs_parser


def test_same_schema_id_and_name_in_two_files_do_not_mix(tmp_path: Path) -> None:
    for k, kind in enumerate((1, 5)):
        file = FileDescriptorProto(name="root.proto", package="test", syntax="proto3")
        file.message_type.add(name="Root").field.add(name="v", number=1, type=kind, label=OPTIONAL)
        schema = FileDescriptorSet(file=[file]).SerializeToString()
        log = check(tmp_path, schema, [message_class(schema)(v=3).SerializeToString()])
        with Log.open(log.name) as again:
            assert np.asarray(again.columns("/m").fields["v"]).dtype == (np.float64, np.int32)[k]


@pytest.mark.parametrize("schema", [b"\xff\xff", b"", odd_schema()[:-30]])
def test_unusable_schema_is_an_error(tmp_path: Path, schema: bytes) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(log_bytes([Declared("/m", "protobuf", "test.Root", "protobuf", schema)], [Sent("/m", T0_NS, b"")]))
    with Log.open(path) as log, pytest.raises(InputError, match="/m"):
        log.columns("/m")
