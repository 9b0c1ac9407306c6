"""CDR columns against the official decoder, on generated definitions and messages."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap_ros2._cdr import CdrWriter, EncapsulationKind
from mcap_ros2._dynamic import _for_each_msgdef, _write_complex_type
from mcap_ros2._vendor.rosidl_adapter.parser import MessageSpecification

from cwcli.errors import InputError
from cwcli.logs.codecs.cdr import CdrDecoder
from cwcli.logs.codecs.column_buffers import Payloads
from cwcli.logs.codecs.ros2msg import SchemaError, parse_message_definitions
from cwcli.logs.read.reader import Log
from cwcli.signals.columns import Ragged, Strings
from tests.unit.logs_read.builders import T0_NS, Declared, Sent, log_bytes
from tests.unit.logs_read.official import assert_same, read_officially

LINE = "=" * 80
INTEGERS = {f"{sign}int{bits}": (bits, sign == "u") for bits in (8, 16, 32, 64) for sign in ("", "u")}
PRIMITIVES = ["bool", "byte", "float32", "float64", *INTEGERS]


def encode(schema_name: str, text: str, value: dict[str, Any], kind: int = EncapsulationKind.CDR_LE) -> bytes:
    """One message by the official encoder."""
    definitions: dict[str, MessageSpecification] = {}

    def note(name: str, short_name: str, definition: MessageSpecification) -> None:
        definitions[name] = definitions[short_name] = definition

    _for_each_msgdef(schema_name, text, note)
    stream = BytesIO()
    root = definitions[schema_name]
    _write_complex_type(root.msg_name, root.fields, definitions, value, CdrWriter(stream, kind=EncapsulationKind(kind)))
    return stream.getvalue()


class Definitions:
    """Random message definitions, and random values for them."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.texts: dict[str, str] = {}
        self.fields: dict[str, list[tuple[str, str, str]]] = {}

    def message(self, name: str, depth: int) -> None:
        fields, lines = [], []
        for k in range(int(self.rng.integers(1, 7))):
            base = self._type(name, k, depth)
            shape = str(self.rng.choice(["", "", "", "[3]", "[]", "[<=4]"]))
            fields.append((f"f{k}", base, shape))
            lines.append(f"{base}{shape} f{k}")
        if self.rng.random() < 0.3:
            lines.insert(0, "# a comment\nuint8 LIMIT=3  # a constant\nstring NAME='a = b'")
        self.texts[name] = "\n".join(lines) + "\n"
        self.fields[name] = fields

    def text(self) -> str:
        """The schema; the root is the message made last."""
        root, *others = reversed(self.texts)
        return f"\n{LINE}\n".join([self.texts[root], *(f"MSG: {name}\n{self.texts[name]}" for name in others)])

    def value(self, name: str) -> dict[str, Any]:
        """A random message."""
        return {field: self._field(base, shape) for field, base, shape in self.fields[name]}

    def _type(self, name: str, k: int, depth: int) -> str:
        choice = self.rng.random()
        if depth and choice < 0.25:
            inner = f"test_msgs/{name.rpartition('/')[2]}F{k}"
            self.message(inner, depth - 1)
            return inner
        if choice < 0.4:
            return "string" if choice < 0.35 else "string<=12"
        return str(self.rng.choice(PRIMITIVES))

    def _field(self, base: str, shape: str) -> Any:
        if not shape:
            return self._one(base)
        n = 3 if shape == "[3]" else int(self.rng.integers(0, 4))
        values = [self._one(base) for _ in range(n)]
        return bytes(values) if base in ("uint8", "byte") else values

    def _one(self, base: str) -> Any:
        if base in self.fields:
            return self.value(base)
        if base.startswith("string"):
            return "".join(self.rng.choice(list("ab é"), int(self.rng.integers(0, 5))))
        if base == "bool":
            return bool(self.rng.integers(0, 2))
        if base.startswith("float"):
            return float(np.float32(self.rng.normal()))
        bits, unsigned = INTEGERS.get(base, (8, True))
        low = 0 if unsigned else -(1 << (bits - 1))
        anything = int.from_bytes(self.rng.bytes(bits // 8), "little", signed=not unsigned)
        return (low, low + (1 << bits) - 1, anything)[int(self.rng.integers(3))]


@pytest.mark.parametrize("seed", range(25))
def test_random_definitions(tmp_path: Path, seed: int) -> None:
    definitions = Definitions(seed)
    definitions.message("test_msgs/Root", 2)
    text = definitions.text()
    messages = []
    for k in range(40):
        kind = EncapsulationKind.CDR_BE if k % 5 == 4 else EncapsulationKind.CDR_LE
        data = encode("test_msgs/Root", text, definitions.value("test_msgs/Root"), kind)
        messages.append(Sent("/m", T0_NS + k, data))
    path = tmp_path / "log.mcap"
    data = log_bytes([Declared("/m", "cdr", "test_msgs/Root", "ros2msg", text.encode())], messages)
    path.write_bytes(data)
    with Log.open(path) as log:
        assert_same(log.columns("/m"), read_officially(data)["/m"])


@pytest.mark.parametrize("seed", range(10))
def test_projection_of_random_definitions(seed: int) -> None:
    definitions = Definitions(seed)
    definitions.message("test_msgs/Root", 2)
    text = definitions.text()
    payloads = payloads_of([encode("test_msgs/Root", text, definitions.value("test_msgs/Root")) for _ in range(20)])
    whole = decoded(text, payloads, None)
    for path in whole:
        alone = decoded(text, payloads, [path])
        assert list(alone) == [path]
        assert repr(alone[path]) == repr(whole[path])


def payloads_of(messages: list[bytes]) -> Payloads:
    """Messages as a decoder takes them."""
    sizes = np.array([len(each) for each in messages], np.int64)
    ends = np.cumsum(sizes)
    return Payloads(np.frombuffer(b"".join(messages) or b"\0", np.uint8), ends - sizes, ends)


def decoded(text: str, payloads: Payloads, fields: list[str] | None) -> Any:
    """All messages, which must be decodable."""
    decoder = CdrDecoder("test_msgs/Root", text.encode(), fields)
    decoder.decode_batch(payloads)
    assert decoder.outcome().is_ok.all()
    return decoder.build_columns(np.arange(len(payloads)))


def test_column_types_follow_from_the_definition() -> None:
    text = f"""bool flag
int8 small
uint64 large
float64[2] pair
float32[] many
string name
string[] names
uint8[] blob
uint8[4] quad
test_msgs/Point[2] two
test_msgs/Point[] some
{LINE}
MSG: test_msgs/Point
float64 x
int32 id
"""
    point = {"x": 1.5, "id": 7}
    value = {
        "flag": True, "small": -5, "large": 2**64 - 1, "pair": [1.0, 2.0], "many": [0.5], "name": "a", "names": ["b"],
        "blob": b"xyz", "quad": b"\1\2\3\4", "two": [point, point], "some": [point],
    }  # fmt: skip
    payloads = payloads_of([encode("test_msgs/Root", text, value)] * 2)
    columns = decoded(text, payloads, None)
    assert columns["flag"].dtype == np.bool_
    assert columns["small"].tolist() == [-5, -5]
    assert columns["large"].tolist() == [2**64 - 1] * 2
    assert columns["pair"].tolist() == [[1.0, 2.0]] * 2
    assert isinstance(columns["many"], Ragged) and columns["many"].offsets.tolist() == [0, 1, 2]
    assert isinstance(columns["name"], Strings) and columns["name"].values == ("a",)
    assert columns["quad"].shape == (2, 4)
    assert columns["two.id"].tolist() == [[7, 7], [7, 7]]
    assert isinstance(columns["some.x"], Ragged) and columns["some.x"].values.tolist() == [1.5, 1.5]
    assert set(columns) == {
        "flag",
        "small",
        "large",
        "pair",
        "many",
        "name",
        "quad",
        "two.x",
        "two.id",
        "some.x",
        "some.id",
    }
    assert decoded(text, payloads, ["blob"])["blob"].values.tobytes() == b"xyzxyz"


def test_every_cut_of_a_message_is_undecodable() -> None:
    text = "string name\nfloat64[] samples\nuint16 last\n"
    whole = encode("test_msgs/Root", text, {"name": "abc", "samples": [1.0, 2.0], "last": 5})
    decoder = CdrDecoder("test_msgs/Root", text.encode(), None)
    decoder.decode_batch(payloads_of([whole[:cut] for cut in range(len(whole))] + [whole]))
    outcome = decoder.outcome()
    assert outcome.is_ok.tolist() == [False] * len(whole) + [True]
    assert sum(outcome.reasons.values()) == len(whole)
    columns: dict[str, Any] = decoder.build_columns(np.array([len(whole)]))
    assert columns["samples"].values.tolist() == [1.0, 2.0]
    assert columns["last"].tolist() == [5]


@pytest.mark.parametrize("text", ["string s\nuint8 b\n", "uint8[] s\nuint8 b\n", "float64[] s\n", "string[] s\n"])
def test_huge_length_in_a_message_is_undecodable(text: str) -> None:
    decoder = CdrDecoder("test_msgs/Root", text.encode(), ["s"])
    decoder.decode_batch(payloads_of([b"\0\1\0\0" + b"\xff" * 4 + b"\0" * 16, b"\0\1\0\0\xff\xff\xff\x7f" + b"\0" * 9]))
    assert not decoder.outcome().is_ok.any()


def test_empty_string_of_length_zero_and_bytes_that_are_not_text() -> None:
    text = "string s\nuint8 b\n"
    messages = [b"\0\1\0\0\0\0\0\0\7", b"\0\1\0\0\1\0\0\0\0\7", b"\0\1\0\0\3\0\0\0\xff\xfe\0\7"]
    columns = decoded(text, payloads_of(messages), None)
    assert columns["b"].tolist() == [7, 7, 7]
    assert [columns["s"].values[code] for code in columns["s"].codes] == ["", "", "\\xff\\xfe"]


def test_plain_cdr2_aligns_to_four_bytes() -> None:
    text = "uint8 a\nfloat64 b\n"
    version_1 = b"\0\1\0\0\5" + b"\0" * 7 + np.float64(2.5).tobytes()
    version_2 = b"\0\7\0\0\5" + b"\0" * 3 + np.float64(2.5).tobytes()
    big_endian = b"\0\6\0\0\5" + b"\0" * 3 + np.array(2.5, ">f8").tobytes()
    columns = decoded(text, payloads_of([version_1, version_2, big_endian]), None)
    assert columns["b"].tolist() == [2.5] * 3


@pytest.mark.parametrize("kind", [2, 3, 8, 9, 10, 11, 200])
def test_other_encapsulations_are_undecodable(kind: int) -> None:
    decoder = CdrDecoder("test_msgs/Root", b"uint8 a\n", None)
    decoder.decode_batch(payloads_of([bytes([0, kind, 0, 0, 5])]))
    assert decoder.outcome().reasons == {"its encapsulation is not plain CDR": 1}


def test_empty_message_has_one_octet(tmp_path: Path) -> None:
    text = f"test_msgs/Nothing n\nuint32 a\n{LINE}\nMSG: test_msgs/Nothing\n"
    assert decoded(text, payloads_of([b"\0\1\0\0\0\0\0\0\5\0\0\0"]), None)["a"].tolist() == [5]


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("wstring w\n", "wstring"),
        ("test_msgs/Missing m\n", "does not define test_msgs/Missing"),
        ("Root again\n", "contains itself"),
        ("what is this\n???\n", "not a field"),
        ("float64[0] none\n", "not a field"),
    ],
)
def test_schema_that_can_not_be_used_is_an_error_that_names_the_channel(tmp_path: Path, text: str, what: str) -> None:
    path = tmp_path / "log.mcap"
    channel = Declared("/m", "cdr", "test_msgs/msg/Root", "ros2msg", text.encode())
    path.write_bytes(log_bytes([channel], [Sent("/m", T0_NS, b"\0\1\0\0\0")]))
    with Log.open(path) as log, pytest.raises(InputError, match=what) as caught:
        log.columns("/m")
    assert "/m" in str(caught.value)
    with pytest.raises(SchemaError):
        CdrDecoder("test_msgs/msg/Root", text.encode(), None)


def test_definitions_with_constants_defaults_bounds_and_comments() -> None:
    text = "# top\nint32 LIMIT=5 # five\nint32 a 3\nstring<=5 b 'x = y'\t# text\nint8[<=3] c [1, 2]\r\n"
    text += "Header header\nmsg/Deep d\n"
    root, definitions = parse_message_definitions("pkg/msg/Root", text)
    assert root == "pkg/Root"
    assert [(each.name, each.type, each.is_sequence, each.length) for each in definitions[root]] == [
        ("a", "int32", False, None),
        ("b", "string", False, None),
        ("c", "int8", True, None),
        ("header", "std_msgs/Header", False, None),
        ("d", "msg/Deep", False, None),
    ]


def test_lines_end_where_the_official_parser_ends_them(tmp_path: Path) -> None:
    r"""At vertical tabs and their like, too: `f\vfloat64` was one name, and what followed was read 8 bytes early."""
    text = "uint8 a\x0bfloat64 b\x0cuint8 c\u2028uint8 d # e\ruint8 g\n"
    message = b"\0\1\0\0\5" + b"\0" * 7 + np.float64(2.5).tobytes() + b"\7\x08\x09"
    path = tmp_path / "log.mcap"
    data = log_bytes([Declared("/m", "cdr", "test_msgs/Root", "ros2msg", text.encode())], [Sent("/m", T0_NS, message)])
    path.write_bytes(data)
    with Log.open(path) as log:
        found = log.columns("/m")
    assert_same(found, read_officially(data)["/m"])
    assert {name: np.asarray(column).tolist() for name, column in found.fields.items()} == {
        "a": [5], "b": [2.5], "c": [7], "d": [8], "g": [9],
    }  # fmt: skip


def test_array_longer_than_the_messages_is_not_allocated() -> None:
    """16 million numbers a row, a million rows promised, messages of 100 bytes."""
    schema = b"float64[16000000] latitude\n"
    decoder = CdrDecoder("test_msgs/msg/Huge", schema, None, n_expected=1_000_000)
    starts = 100 * np.arange(500)
    decoder.decode_batch(Payloads(np.zeros(50_000, np.uint8), starts, starts + 100))
    outcome = decoder.outcome()
    assert not outcome.is_ok.any()
    assert outcome.reasons == {"the message ends before its fields do": 500}
    assert np.asarray(decoder.build_columns(np.zeros(0, np.int64))["latitude"]).shape == (0, 16_000_000)


def test_array_of_four_thousand_million_elements_is_an_error() -> None:
    with pytest.raises(SchemaError, match="too long"):
        parse_message_definitions("test_msgs/msg/Huge", "float64[4000000000] latitude\n")
