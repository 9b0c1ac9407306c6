"""Schemas and messages that are legal to parse and wrong to trust: told or counted, quickly and in little memory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from google.protobuf.descriptor_pb2 import DescriptorProto, FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet
from mcap.writer import CompressionType, Writer

from cwcli.logs.encoders.schemas import find_message_schema
from cwcli.logs.read.reader import Log
from cwcli.signals.columns import Strings
from tests.cli.bounded import bounded
from tests.cli.rewritten_logs import Logged, of, read, write

N_LEVELS = 40
STATE = "cwcli.v1.VehicleState"
RULE = "=" * 80
T0_NS = 1_700_000_000_000_000_000


@pytest.fixture(scope="session")
def messages(intersection: Path) -> list[Logged]:
    """Those of the bundled log."""
    return read(intersection)


def with_definition(change: Callable[[str], str]) -> Callable[[Logged], Logged]:
    """The `ros2msg` text of a channel, changed."""

    def edit(each: Logged) -> Logged:
        name, encoding, text = each.schema
        return replace(each, schema=(name, encoding, change(text.decode()).encode()))

    return edit


def in_front(*lines: str) -> Callable[[str], str]:
    """More fields before those of the root message, which begin with its header."""
    return lambda text: text.replace("std_msgs/Header header", "\n".join((*lines, "std_msgs/Header header")), 1)


def two_of_the_next(text: str) -> str:
    """A tree of messages, each of which holds the next kind twice: 2^40 leaves."""
    parts = [f"{RULE}\nMSG: p/E{k}\np/E{k + 1} a\np/E{k + 1} b" for k in range(N_LEVELS)]
    return "\n".join((in_front("p/E0 junk")(text), *parts, f"{RULE}\nMSG: p/E{N_LEVELS}\nfloat64 x", ""))


def arrays_in_arrays(text: str) -> str:
    """2^24 headers of 2^24 stamps of 2^24 seconds: 2^72 elements, 0 in 64 bits."""
    many = 1 << 24
    text = text.replace("std_msgs/Header header", f"std_msgs/Header[{many}] header", 1)
    text = text.replace("Time stamp", f"Time[{many}] stamp")
    return f"{text}\n{RULE}\nMSG: builtin_interfaces/Time\nint32[{many}] sec\nuint32 nanosec\n"


@pytest.mark.parametrize(
    ("change", "code", "words"),
    [
        (two_of_the_next, 3, "its messages hold more than 65,536 fields"),
        (in_front(f"float64[{'9' * 5000}] much"), 3, "an array of the schema is too long"),
        (arrays_in_arrays, 3, "header.stamp.sec has 4.72e+21 elements in every message"),
        (in_front(*(f"float64[16777216] z{k}" for k in range(40))), 5, "201 undecodable"),
    ],
    ids=["two of the next, 40 times", "a length of 5000 digits", "2^72 elements", "5 GB to skip"],
)
def test_definition_that_asks_for_too_much(
    messages: list[Logged], tmp_path: Path, change: Callable[[str], str], code: int, words: str
) -> None:
    write(tmp_path / "in.mcap", map(of("/gps/fix", with_definition(change)), messages))
    for options in ([], ["--recover"]):
        ended = bounded(tmp_path, "estimate", "in.mcap", "-o", "out.mcap", *options)
        assert ended.code == code, ended.shown
        assert ended.shown.startswith("error: in.mcap: ")
        assert words in ended.shown.splitlines()[0]
        assert [path.name for path in tmp_path.iterdir()] == ["in.mcap"]


def tree_of_messages() -> bytes:
    """`VehicleState` with a field of a type that holds the next one twice, 40 times."""
    descriptors = FileDescriptorSet.FromString(find_message_schema(STATE).data)
    file = next(each for each in descriptors.file if any(type_.name == "VehicleState" for type_ in each.message_type))
    state = next(each for each in file.message_type if each.name == "VehicleState")
    add(state, "junk", 500, ".cwcli.v1.E0")
    for k in range(N_LEVELS):
        inner = file.message_type.add(name=f"E{k}")
        add(inner, "a", 1, f".cwcli.v1.E{k + 1}")
        add(inner, "b", 2, f".cwcli.v1.E{k + 1}")
    add(file.message_type.add(name=f"E{N_LEVELS}"), "x", 1, None)
    return descriptors.SerializeToString()


def add(message: DescriptorProto, name: str, number: int, type_name: str | None) -> None:
    """A field of a message type, or a double."""
    each = message.field.add(name=name, number=number, label=FieldDescriptorProto.LABEL_OPTIONAL)
    each.type = FieldDescriptorProto.TYPE_DOUBLE if type_name is None else FieldDescriptorProto.TYPE_MESSAGE
    if type_name is not None:
        each.type_name = type_name


def test_protobuf_types_that_double(tmp_path: Path) -> None:
    schema = (STATE, "protobuf", tree_of_messages())
    states = [Logged("/cwcli/ego/state", "protobuf", schema, T0_NS + k, b"") for k in range(50)]
    write(tmp_path / "in.mcap", states)
    ended = bounded(tmp_path, "predict", "in.mcap", "-o", "out.mcap")
    assert ended.code == 3
    assert "/cwcli/ego/state (cwcli.v1.VehicleState) can't be read: its messages hold more" in ended.shown


def test_protobuf_types_that_double_where_nobody_looks(messages: list[Logged], tmp_path: Path) -> None:
    schema = (STATE, "protobuf", tree_of_messages())
    write(tmp_path / "in.mcap", map(of("/truth/ego", lambda each: replace(each, schema=schema)), messages))
    assert bounded(tmp_path, "estimate", "in.mcap", "-o", "out.mcap").code == 0


def one_message(message: DescriptorProto, *, syntax: str = "proto2") -> bytes:
    """A descriptor set with one message type in the package `t`."""
    file = FileDescriptorProto(name="t.proto", package="t", syntax=syntax, message_type=[message])
    return FileDescriptorSet(file=[file]).SerializeToString()


def test_string_of_proto2_that_is_not_utf8(tmp_path: Path) -> None:
    """The format allows it there: it is shown with escapes, as in every other encoding."""
    message = DescriptorProto(name="Name")
    message.field.add(
        name="id", number=1, type=FieldDescriptorProto.TYPE_STRING, label=FieldDescriptorProto.LABEL_OPTIONAL
    )
    schema = ("t.Name", "protobuf", one_message(message))
    texts = (b"plain", b"\xff\xfe", "ä".encode())
    write(
        tmp_path / "in.mcap",
        [Logged("/id", "protobuf", schema, T0_NS + k, b"\x0a" + bytes([len(t)]) + t) for k, t in enumerate(texts)],
    )
    with Log.open(tmp_path / "in.mcap") as log:
        column = log.columns("/id").fields["id"]
    assert isinstance(column, Strings)
    assert [column.values[code] for code in column.codes] == ["plain", "\\xff\\xfe", "ä"]


def many(path: Path, topic: str, encoding: str, schema: tuple[str, str, bytes], messages: list[bytes]) -> None:
    """A log of many messages in small chunks: far larger in memory than on the disk."""
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD)
        writer.start()
        channel = writer.register_channel(topic, encoding, writer.register_schema(*schema))
        for k, data in enumerate(messages):
            writer.add_message(channel, T0_NS + k, data, T0_NS + k)
        writer.finish()


def test_short_messages_of_a_long_type_take_no_rows(messages: list[Logged], tmp_path: Path) -> None:
    """400,000 rows of 64 kB would be 26 GB."""
    fix = next(each for each in messages if each.topic == "/gps/fix")
    name, encoding, text = fix.schema
    schema = (name, encoding, text.replace(b"float64[9] position_covariance", b"float64[8000] position_covariance"))
    whole = b"\0\1\0\0" + bytes(8 * 8000 + 200)
    many(tmp_path / "in.mcap", "/gps/fix", "cdr", schema, [*[b"\0\1\0\0" + bytes(60)] * 200_000, whole] * 2)
    ended = bounded(tmp_path, "estimate", "in.mcap", "-o", "out.mcap")
    assert ended.code == 5
    assert "400000 undecodable" in ended.shown or "400,000 undecodable" in ended.shown
    with Log.open(tmp_path / "in.mcap") as log:
        columns = log.columns("/gps/fix", ["latitude", "position_covariance"])
    assert columns.n_undecodable == 400_000
    covariance = columns.fields["position_covariance"]
    assert isinstance(covariance, np.ndarray)
    assert covariance.shape == (2, 8000)


def test_empty_messages_of_a_wide_type(tmp_path: Path) -> None:
    """A protobuf message may leave out all of its 4,000 fields: 100,000 of them would be 3.6 GB."""
    message = DescriptorProto(name="VehicleState")
    for k in range(4000):
        add(message, f"f{k}", k + 1, None)
    descriptors = FileDescriptorSet(
        file=[FileDescriptorProto(name="w.proto", package="cwcli.v1", syntax="proto3", message_type=[message])]
    )
    schema = (STATE, "protobuf", descriptors.SerializeToString())
    many(tmp_path / "in.mcap", "/cwcli/ego/state", "protobuf", schema, [b""] * 100_000)
    ended = bounded(tmp_path, "predict", "in.mcap", "-o", "out.mcap")
    assert ended.code == 3
    assert "GB with fields that they leave out" in ended.shown


@pytest.mark.parametrize("text", [b'{"a":' * 700 + b"1" + b"}" * 700, b'{"a":' + b"[" * 700 + b"]" * 700 + b"}"])
def test_deeply_nested_json_as_a_table(messages: list[Logged], tmp_path: Path, text: bytes) -> None:
    def edit(each: Logged) -> Logged:
        return replace(each, data=text)

    write(tmp_path / "in.mcap", map(of("/v2x/bsm", edit), messages))
    ended = bounded(tmp_path, "run", "in.mcap", "-d", "out", "--tables")
    assert ended.code in (0, 5), ended.shown


def test_a_json_list_that_is_deep_is_flattened_as_others_are(tmp_path: Path) -> None:
    texts = (b'{"a": ' + b"[" * 400 + b"1, 2" + b"]" * 400 + b"}", b'{"a": [[3], [4]]}')
    write(
        tmp_path / "in.mcap",
        [Logged("/j", "json", ("X", "jsonschema", b"{}"), T0_NS + k, text) for k, text in enumerate(texts)],
    )
    with Log.open(tmp_path / "in.mcap") as log:
        column = log.columns("/j").fields["a"]
    assert isinstance(column, np.ndarray)
    assert column.tolist() == [[1, 2], [3, 4]]
