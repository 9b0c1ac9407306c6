"""ROS 1 bags as they are found: cut, without an index, of version 1.2, encrypted, or contradicting themselves."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from cwcli.errors import InputError
from cwcli.logs.read.reader import Log
from cwcli.logs.ros1.cdr_conversion import ConversionError, Ros1Converter
from cwcli.logs.ros1.definitions import definition_checksum, parse_ros1_definition, ros2_definition_text
from tests.unit.logs_read.hostile_containers import (
    T0_S,
    bag,
    bag_header,
    chunk,
    connection,
    encrypted,
    field,
    message,
    record,
    u32,
)

N = 20
FLOAT = "float64 data\n"
FLOAT_CHECKSUM = "fdb28210bfa9d7c91146260178d9a584"
"""The checksum of the definition of std_msgs/Float64, from http://docs.ros.org/en/api/std_msgs/html/msg/Float64.html."""
CHECKSUMS = {
    "std_msgs/Header": "2176decaecbce78abc3b96ef049fabed",
    "sensor_msgs/Imu": "6a62c6daae103f4ff57a132d6f95cec2",
    "sensor_msgs/NavSatFix": "2d3a8cd499b9b4a0249fb98fd05cfa48",
}
"""From http://docs.ros.org/en/api/, the pages of these messages."""


def numbers(first: int, n: int, topic: str = "/x", checksum: str = FLOAT_CHECKSUM) -> bytes:
    """What is in a chunk with a connection and n numbers from `first` on."""
    sent = b"".join(message(0, struct.pack("<d", k), k) for k in range(first, first + n))
    return connection(0, topic, "std_msgs/Float64", FLOAT, checksum) + sent


def read(path: Path, *, recover: bool = True) -> tuple[list[float], dict[str, int]]:
    with Log.open(path, recover=recover) as log:
        columns = log.columns("/x")
        assert columns.log_time_ns.tolist() == [
            (T0_S + int(value)) * 10**9 for value in np.asarray(columns.fields["data"])
        ]
        return np.asarray(columns.fields["data"]).tolist(), log.faults.counts_by_reason()


CUT = "a bag without an index, or cut: messages may be missing at its end"


@pytest.mark.parametrize("compression", ["none", "bz2", "lz4"])
def test_bag_without_an_index_needs_recover(tmp_path: Path, compression: str) -> None:
    path = bag(tmp_path / "x.bag", [chunk(numbers(0, N), compression)], is_indexed=False)
    with pytest.raises(InputError, match="it has no index or is cut") as told:
        Log.open(path)
    assert "--recover" in told.value.hint
    assert read(path) == ([float(k) for k in range(N)], {CUT: 1})


@pytest.mark.parametrize("n_cut", [1, 4, 10, 40, 60, 200])
def test_bag_that_is_cut_in_a_chunk_keeps_what_is_whole(tmp_path: Path, n_cut: int) -> None:
    """A message takes the same bytes each: so many from the end are lost."""
    last = chunk(numbers(N, N))
    path = bag(tmp_path / "x.bag", [chunk(numbers(0, N), "lz4"), last])
    n_lost = -(-n_cut // len(message(0, bytes(8))))
    path.write_bytes(path.read_bytes()[:-n_cut])
    with pytest.raises(InputError, match="cut"):
        Log.open(path)
    assert read(path) == ([float(k) for k in range(2 * N - n_lost)], {CUT: 1})


def test_cut_compressed_chunk_loses_no_chunk_before_it(tmp_path: Path) -> None:
    path = bag(tmp_path / "x.bag", [chunk(numbers(0, N), "bz2"), chunk(numbers(N, N), "bz2")])
    path.write_bytes(path.read_bytes()[:-30])
    values, faults = read(path)
    assert values[:N] == [float(k) for k in range(N)]
    assert faults == {CUT: 1}


@pytest.mark.parametrize("where", ["data", "length", "header"])
def test_damage_in_the_middle_loses_one_chunk(tmp_path: Path, where: str) -> None:
    parts = [bytearray(chunk(numbers(k * N, N), "bz2")) for k in range(3)]
    at = {"data": len(parts[1]) // 2, "length": parts[1].index(b"op=\x05") + 60, "header": 2}[where]
    at = parts[1].index(b"BZh") - 2 if where == "length" else at  # in the length of the data: 16 MB more
    parts[1][at] ^= 0xFF
    path = bag(tmp_path / "x.bag", [bytes(each) for each in parts])
    with pytest.raises(InputError, match="damaged"):
        Log.open(path)
    values, faults = read(path)
    assert [value for value in values if not N <= value < 2 * N] == [
        float(k) for k in (*range(N), *range(2 * N, 3 * N))
    ]
    assert sum(faults.values()) >= 1


def test_bag_of_version_1_2_is_read(tmp_path: Path) -> None:
    """Records of that version, by http://wiki.ros.org/Bags/Format/1.2: no chunks, the time in two fields."""
    described = {"topic": b"/x", "type": b"std_msgs/Float64", "md5": FLOAT_CHECKSUM.encode(), "def": FLOAT.encode()}
    content = record({"op": b"\x01", **described}, b"")
    for k in range(N):
        time = {"sec": u32(T0_S + k), "nsec": u32(0)}
        content += record({"op": b"\x02", "topic": b"/x", "md5": described["md5"], **time}, struct.pack("<d", k))
    path = tmp_path / "x.bag"
    head = b"#ROSBAG V1.2\n"
    path.write_bytes(head + bag_header(len(head) + len(bag_header(0)) + len(content)) + content)
    assert read(path, recover=False) == ([float(k) for k in range(N)], {})
    path.write_bytes(head.replace(b"1.2", b"1.1") + content)
    with pytest.raises(InputError, match=r"bags that begin with '#ROSBAG V1.1' are not read"):
        Log.open(path)


def test_encrypted_bag_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="the bag is encrypted \\('rosbag/AesCbcEncryptor'\\), which is not read"):
        Log.open(encrypted(tmp_path), recover=True)


def test_connections_that_come_twice(tmp_path: Path) -> None:
    """The same once more, as each chunk and the index have it, is nothing; another one under its number is counted."""
    again = connection(0, "/x", "std_msgs/Float64", FLOAT, FLOAT_CHECKSUM)
    other = connection(0, "/y", "std_msgs/Float64", FLOAT, FLOAT_CHECKSUM)
    path = bag(tmp_path / "x.bag", [chunk(numbers(0, N) + again + other)], again)
    told = {"connections that come twice and differ (/x)": 1}
    assert read(path, recover=False) == ([float(k) for k in range(N)], told)


def test_two_publishers_of_a_topic_are_one_topic(tmp_path: Path) -> None:
    second = connection(7, "/x", "std_msgs/Float64", FLOAT, FLOAT_CHECKSUM) + message(7, struct.pack("<d", N), N)
    path = bag(tmp_path / "x.bag", [chunk(numbers(0, N) + second)])
    assert read(path, recover=False) == ([float(k) for k in range(N + 1)], {})


def test_definition_that_differs_from_its_checksum_is_counted(tmp_path: Path) -> None:
    path = bag(tmp_path / "x.bag", [chunk(numbers(0, N, checksum="0" * 32))])
    told = {"message types whose definition differs from its checksum (std_msgs/msg/Float64)": 1}
    assert read(path, recover=False) == ([float(k) for k in range(N)], told)


def test_index_that_counts_otherwise_is_counted(tmp_path: Path) -> None:
    info = {"op": b"\x06", "ver": u32(1), "chunk_pos": bytes(8), "start_time": bytes(8), "end_time": bytes(8)}
    tail = record(info | {"count": u32(1)}, u32(0) + u32(N + 3))
    path = bag(tmp_path / "x.bag", [chunk(numbers(0, N))], tail)
    told = {"messages that the index counts and the file does not hold": 3}
    assert read(path, recover=False)[1] == told


def test_message_of_no_connection_is_counted(tmp_path: Path) -> None:
    path = bag(tmp_path / "x.bag", [chunk(numbers(0, N) + message(9, bytes(8)))])
    assert read(path, recover=False)[1] == {"messages of connections that are not described": 1}


def definition_text(name: str) -> str:
    return get_typestore(Stores.ROS1_NOETIC).generate_msgdef(name.replace("/", "/msg/"))[0]


@pytest.mark.parametrize("name", CHECKSUMS)
def test_checksum_is_the_published_one(name: str) -> None:
    assert definition_checksum(parse_ros1_definition(name, definition_text(name))) == CHECKSUMS[name]


def random_message(rng: np.random.Generator, types: dict[str, object], name: str) -> bytes:
    """A message of ROS 1 with random numbers, texts and lengths."""

    def value(described: tuple[int, object]) -> bytes:
        kind, inner = int(described[0]), described[1]
        if kind == 1:
            base = inner[0]  # type: ignore[index]
            if base == "string":
                text = rng.integers(97, 122, rng.integers(9), np.uint8).tobytes()
                return u32(len(text)) + text
            return rng.bytes(int("".join(filter(str.isdigit, base)) or "8") // 8)
        if kind == 2:
            return random_message(rng, types, str(inner))
        if kind == 3:
            return b"".join(value(inner[0]) for _ in range(inner[1]))  # type: ignore[index]
        n = int(rng.integers(4))
        return u32(n) + b"".join(value(inner[0]) for _ in range(n))  # type: ignore[index]

    fields = types[name][1]  # type: ignore[index]
    return b"".join(value(each) for key, each in fields if not key.startswith("structure_needs"))


def test_messages_and_definitions_are_converted_as_the_library_does() -> None:
    """All message types of ROS 1 Noetic: definition, checksum and five random messages each."""
    noetic, latest = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.LATEST)
    header = "std_msgs/msg/Header"
    of_ros2 = latest.fielddefs[header]
    packed: dict[str, object] = {**noetic.fielddefs, header: ([], [("seq", (1, ("uint32", 0))), *of_ros2[1]])}
    rng = np.random.default_rng(5)
    n_types = 0
    for name in noetic.fielddefs:
        if name == header:
            continue
        text, checksum = noetic.generate_msgdef(name)
        types = get_types_from_msg(text, name)
        if header in types:
            types[header] = of_ros2
        store = get_typestore(Stores.EMPTY)
        store.register(types)
        definition = parse_ros1_definition(name, text)
        assert definition_checksum(definition) == checksum
        assert ros2_definition_text(definition) == store.generate_msgdef(name, ros_version=2)[0]
        converter = Ros1Converter(definition)
        for _ in range(5):
            data = random_message(rng, packed, name)
            assert converter.convert(data) == bytes(store.ros1_to_cdr(data, name)), name
            for wrong in (data + b"x", data[:-1]) if data else ():
                with pytest.raises(ConversionError):
                    converter.convert(wrong)
        n_types += 1
    assert n_types > 150


def test_header_field_with_an_equals_sign_in_its_value_is_kept(tmp_path: Path) -> None:
    described = field("topic", b"/a=b") + field("type", b"std_msgs/Float64") + field("md5sum", b"*")
    data = described + field("message_definition", FLOAT.encode())
    content = record({"op": b"\x07", "conn": u32(0), "topic": b"/a=b"}, data) + message(0, struct.pack("<d", 3.0))
    with Log.open(bag(tmp_path / "x.bag", [chunk(content)])) as log:
        assert np.asarray(log.columns("/a=b").fields["data"]).tolist() == [3.0]


PLANNED = {
    "a/Plain": "uint8 a\nfloat64 b\nint16[3] c\n",
    "a/Texts": "string s\nfloat64[] x\nstring[] names\nuint8 end\n",
    "a/Nested": "a/Point[] points\nstring s\na/Point[2] more\n" + f"{'=' * 80}\nMSG: a/Point\nfloat32 x\nstring name\n",
}


@pytest.mark.parametrize("name", PLANNED)
def test_a_plan_converts_as_a_converter_without_one(name: str) -> None:
    """Messages of the same size whose lengths differ, with percent signs in them, in any order."""
    rng = np.random.default_rng(1)
    definition = parse_ros1_definition(name, PLANNED[name])

    def text(n: int) -> bytes:
        return u32(n) + bytes(rng.choice([37, 98, 0, 255], n).tolist())

    def point() -> bytes:
        return rng.bytes(4) + text(int(rng.integers(4)))

    def sent() -> bytes:
        n, m, k = rng.integers(4, size=3).tolist()
        if name == "a/Plain":
            return rng.bytes(15)
        if name == "a/Texts":
            return text(n) + u32(m) + rng.bytes(8 * m) + u32(k) + b"".join(text(m) for _ in range(k)) + rng.bytes(1)
        return u32(n) + b"".join(point() for _ in range(n)) + text(m) + point() + point()

    planned = Ros1Converter(definition)
    for _ in range(300):
        data = sent()
        assert planned.convert(data) == Ros1Converter(definition).convert(data)
        for cut in (data[:-1], data + b"\0"):
            results = []
            for converter in (planned, Ros1Converter(definition)):
                try:
                    results.append(converter.convert(cut))
                except ConversionError:
                    results.append(b"refused")
            assert results[0] == results[1]


@pytest.mark.parametrize("order", ["conn op time", "op conn time", "time op conn", "conn time op"])
def test_the_order_of_a_message_header_does_not_matter(tmp_path: Path, order: str) -> None:
    fields = {"op": b"\x02", "conn": u32(0)}
    sent = b""
    for k in range(N):
        time = {"time": u32(T0_S + k) + u32(0)}
        sent += record({name: (fields | time)[name] for name in order.split()}, struct.pack("<d", k))
    content = connection(0, "/x", "std_msgs/Float64", FLOAT, FLOAT_CHECKSUM) + sent
    path = bag(tmp_path / "x.bag", [chunk(content)])
    assert read(path, recover=False) == ([float(k) for k in range(N)], {})
