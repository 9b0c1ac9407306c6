"""JSON columns against Python's json module, on generated and on odd messages."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cwcli.logs.codecs.column_buffers import Payloads
from cwcli.logs.codecs.json import INVALID_JSON_REASON, NOT_AN_OBJECT_REASON, JsonDecoder
from cwcli.logs.read.reader import Log
from cwcli.signals.columns import Field, Ragged, Strings
from tests.unit.logs_read.builders import T0_NS, Declared, Sent, log_bytes
from tests.unit.logs_read.official import assert_same, read_officially


def columns_of(*messages: bytes | str | dict[str, Any], fields: list[str] | None = None) -> dict[str, Any]:
    """The columns of messages that must all be decodable."""
    octets = [_bytes(each) for each in messages]
    ends = np.cumsum([len(each) for each in octets])
    decoder = JsonDecoder(fields)
    decoder.decode_batch(Payloads(np.frombuffer(b"".join(octets), np.uint8), np.concatenate([[0], ends[:-1]]), ends))
    assert decoder.outcome().is_ok.all()
    return decoder.build_columns(np.arange(len(octets)))


def _bytes(message: bytes | str | dict[str, Any]) -> bytes:
    if isinstance(message, dict):
        return json.dumps(message).encode()
    return message if isinstance(message, bytes) else message.encode()


def check(tmp_path: Path, messages: list[bytes], **options: Any) -> Log:
    """The columns equal the json module's rows."""
    path = tmp_path / "log.mcap"
    sent = [Sent("/m", T0_NS + k, each) for k, each in enumerate(messages)]
    data = log_bytes([Declared("/m", "json", "M", "jsonschema", b"{}")], sent, **options)
    path.write_bytes(data)
    with Log.open(path) as log:
        assert_same(log.columns("/m"), read_officially(data)["/m"], expect_paths=False)
        return log


FLOATS = (1e-310, -0.0, math.inf, math.nan, 0.1, 1e22, 5e-324)
TEXTS = ("", "text", "ü", 'quote " and \\ back', "line\nbreak", "\u0001", "\ud83d\ude00")


def random_value(rng: np.random.Generator, depth: int) -> Any:
    """A JSON value; keys do not hold dots."""
    kinds = [
        lambda: int(rng.integers(-(10**6), 10**6)),
        lambda: float(rng.choice([rng.normal(), rng.normal() * 1e300, *FLOATS])),
        lambda: bool(rng.integers(0, 2)),
        lambda: None,
        lambda: TEXTS[int(rng.integers(len(TEXTS)))],
        lambda: [random_value(rng, depth - 1) for _ in range(rng.integers(0, 4))],
        lambda: {f"k{k}": random_value(rng, depth - 1) for k in rng.permutation(4)[: rng.integers(0, 4)]},
    ]
    return kinds[int(rng.integers(len(kinds) if depth else 5))]()


@pytest.mark.parametrize("seed", range(12))
def test_random_messages_of_a_fixed_shape_with_gaps(tmp_path: Path, seed: int) -> None:
    """Each key keeps its kind of value, as in a recording; keys go missing, come late and in another order."""
    rng = np.random.default_rng(seed)
    kinds = {
        "int": lambda: int(rng.integers(-(10**17), 10**17)),
        "float": lambda: float(rng.normal() * 10.0 ** rng.integers(-30, 30)),
        "number": lambda: int(rng.integers(9)) if rng.random() < 0.5 else float(rng.normal()),
        "bool": lambda: bool(rng.integers(0, 2)),
        "text": lambda: str(rng.choice(["", "a", "ü", 'x"y', "\n"])),
        "nothing": lambda: None,
        "three": lambda: [float(value) for value in rng.normal(size=3)],
        "list": lambda: [int(value) for value in rng.integers(0, 9, rng.integers(0, 4))],
        "object": lambda: {"x": float(rng.normal()), "y": {"z": int(rng.integers(9))}},
        "objects": lambda: [{"r": float(rng.normal()), "a": [1, 2]} for _ in range(rng.integers(0, 3))],
        "matrix": lambda: [[1, 2], [3, 4.5]],
    }
    messages = []
    for k in range(80):
        keys = [name for name in kinds if rng.random() < 0.9 or k == 0]
        if k % 7 == 3:
            rng.shuffle(keys)
        message = {name: kinds[name]() for name in keys if k > 20 or name != "late"}
        if k > 40:
            message["late"] = k
        spaces = None if k % 5 else 1
        messages.append(json.dumps(message, indent=spaces, ensure_ascii=bool(k % 2)).encode())
    check(tmp_path, messages, chunk_size=3000)


@pytest.mark.parametrize("seed", range(20))
def test_random_messages_equal_decoding_by_the_slow_path(seed: int) -> None:
    """Keys that change their kind of value: what the kernel makes of it is what the json module makes of it."""
    rng = np.random.default_rng(200 + seed)
    messages = [{f"k{k}": random_value(rng, 3) for k in range(3)} for _ in range(30)]
    texts = [json.dumps(each).encode() for each in messages]
    # A key with an escape in it that nobody asks for sends the message the slow way.
    slow = [text[:-1] + b', "\\u007a": {}}' for text in texts]
    fast_columns, slow_columns = columns_of(*texts), columns_of(*slow)
    assert set(fast_columns) == set(slow_columns) - {"z"}
    for path, column in fast_columns.items():
        assert _comparable(column) == _comparable(slow_columns[path]), path
        alone = columns_of(*texts, fields=[path])
        assert _comparable(alone[path]) == _comparable(column), path


def _comparable(column: Field) -> Any:
    if isinstance(column, Strings):
        return [column.values[code] if code >= 0 else None for code in column.codes]
    if isinstance(column, Ragged):
        return repr(column.values.tolist()), column.values.dtype, column.offsets.tolist()
    return repr(column.tolist()), column.dtype


def test_escape_beside_bytes_that_are_not_text_is_not_read(tmp_path: Path) -> None:
    log = check(tmp_path, [b'{"t": "a"}', b'{"t": "\\n\xf5"}', b'{"t": "\\n"}'])
    assert log.faults.undecodable["/m"] == {INVALID_JSON_REASON: 1}


@pytest.mark.parametrize("seed", range(4))
def test_flipped_and_cut_messages_are_what_the_json_module_makes_of_them(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(300 + seed)
    messages = []
    for k in range(200):
        text = {"a": k, "b": {"c": k / 7, "d": "text é"}, "e": [k, k + 0.5], "f": True, "g": None, "h": -1.5e-7}
        data = bytearray(json.dumps(text, ensure_ascii=False).encode())
        if k % 3 == 1:
            data[int(rng.integers(len(data)))] = int(rng.integers(256))
        elif k % 3 == 2:
            del data[int(rng.integers(len(data))) :]
        messages.append(bytes(data))
    log = check(tmp_path, messages, chunk_size=3000)
    assert log.faults.undecodable["/m"][INVALID_JSON_REASON] > 20


def test_kinds_of_columns() -> None:
    columns = columns_of(
        {"i": 1, "m": 1, "f": 0.5, "b": True, "s": "x", "t": [1, 2], "u": [1], "n": None, "o": {"p": 2}, "w": "é"},
        {"i": 2, "m": 2.5, "f": 1.5, "b": False, "s": "y", "t": [3, 4], "u": [], "n": None, "w": "\n"},
    )
    assert columns["i"].dtype == np.int64 and columns["i"].tolist() == [1, 2]
    assert columns["m"].dtype == np.float64 and columns["m"].tolist() == [1.0, 2.5]
    assert columns["b"].dtype == np.bool_
    assert columns["s"].values == ("x", "y")
    assert columns["w"].values == ("é", "\n")
    assert columns["t"].tolist() == [[1, 2], [3, 4]] and columns["t"].dtype == np.int64
    assert isinstance(columns["u"], Ragged) and columns["u"].offsets.tolist() == [0, 1, 1]
    assert np.isnan(columns["n"]).all()
    assert np.array_equal(columns["o.p"], [2.0, np.nan], equal_nan=True)
    assert "o" not in columns


def test_mixed_strings_and_numbers_become_strings() -> None:
    column = columns_of({"v": "a"}, {"v": 12}, {"v": 0.5}, {"v": True}, {"v": None}, {})["v"]
    assert [column.values[code] if code >= 0 else None for code in column.codes] == [
        "a",
        "12",
        "0.5",
        "true",
        None,
        None,
    ]


def test_objects_in_arrays_become_ragged_leaves() -> None:
    columns = columns_of({"r": [{"x": 1.5, "k": [1, 2]}, {"x": 2.5}]}, {"r": []}, {"r": [{"x": None}]})
    assert columns["r.x"].offsets.tolist() == [0, 2, 2, 3]
    assert np.array_equal(columns["r.x"].values, [1.5, 2.5, np.nan], equal_nan=True)
    assert columns["r.k"].offsets.tolist() == [0, 2, 2, 2]


def test_one_string_in_arrays_is_that_string() -> None:
    columns = columns_of(
        {"r": [{"x": 1.5}, {"s": "a", "t": "a"}], "w": ["\u00e9"]},
        {"r": [{"s": "b"}]},
        {"r": {"s": "c", "t": "a"}, "w": []},
        {"r": [{"t": "a"}, {"t": "b"}]},
    )
    several = ["a", None, "a", "[...]"]
    for path, expected in (("r.s", ["a", "b", "c", None]), ("w", ["\u00e9", None, None, None]), ("r.t", several)):
        assert _comparable(columns[path]) == expected


@pytest.mark.parametrize(
    ("odd", "expected"),
    [
        ('{"r": [{"s": null}]}', None),
        ('{"r": [{"s": 32}]}', "32.0"),
        ('{"r": [{"s": true}]}', "true"),
        ('{"r": [{"s": "a"}, {"s": "b"}]}', "[...]"),
        ('{"r": {"s": 32}}', "32.0"),
        ('{"r": []}', None),
    ],
)
def test_one_odd_message_leaves_the_texts_of_the_others(odd: str, expected: str | None) -> None:
    usual = ['{"r": [{"s": "a"}]}', '{"r": [{}, {"s": "\\u00e9"}]}']
    for messages in ([odd, *usual], [*usual, odd], [*usual, odd.replace("s", "\\u0073")]):
        found = _comparable(columns_of(*messages)["r.s"])
        assert sorted(found, key=str) == sorted(["a", "é", expected], key=str)


def test_a_refused_message_with_a_broken_text_in_an_array_leaves_the_others() -> None:
    octets = [b'{"r": ["\\u0061"]}', b'{"r": ["\\n\xb4"]}', b'{"r": ["b"]}']
    ends = np.cumsum([len(each) for each in octets])
    decoder = JsonDecoder(None)
    decoder.decode_batch(Payloads(np.frombuffer(b"".join(octets), np.uint8), np.concatenate([[0], ends[:-1]]), ends))
    assert decoder.outcome().is_ok.tolist() == [True, False, True]
    assert _comparable(decoder.build_columns(np.array([0, 2]))["r"]) == ["a", "b"]


def test_one_text_leaves_the_numbers_of_the_others() -> None:
    found = columns_of('{"r": [{"s": 1}]}', '{"r": [{"s": "a"}]}', '{"r": [{"s": 2}, {"s": 3}]}')["r.s"]
    assert np.array_equal(found.values, [1.0, np.nan, 2.0, 3.0], equal_nan=True)
    assert found.offsets.tolist() == [0, 1, 2, 4]
    nothing_alone = columns_of('{"r": ["a", "b"]}', '{"r": ["a"]}')
    assert not nothing_alone


@pytest.mark.parametrize(
    "text",
    ["0", "-0", "0.0", "-0.0", "1e5", "1E+5", "1.5e-3", "123456789012345678", "-999999999999999999", "0.1", "1e400",
     "-1e400", "1e-400", "2.2250738585072014e-308", "9007199254740993.0", "179769313486231570000000000000000000000e270",
     "0.000000000000000000000000000000000000000012345678901234567890", "1234567890.12345678901234567890", "NaN",
     "Infinity", "-Infinity", "1234567890123456789", "123456789012345678901234567890", "4.35", "0.3", "2.675", "1e22",
     "1e23", "8.5e-23", "5e-324", "48.98239328", "8.390306734567891", "-77.83046021234567"],
)  # fmt: skip
def test_numbers_are_those_of_the_json_module(text: str) -> None:
    value = columns_of(f'{{"v": {text}}}')["v"][0]
    expected = json.loads(text)
    if isinstance(expected, int) and abs(expected) < 2**63:
        assert isinstance(value, np.int64) and value == expected
    else:
        assert repr(float(value)) == repr(float(expected))


@pytest.mark.parametrize(
    "text",
    ["", " ", "{", "}", "[]", "1", '"a"', "null", '{"a" 1}', '{"a": 1,}', '{"a": 01}', '{"a": 1.}', '{"a": .5}',
     '{"a": +1}', '{"a": tru}', '{"a": "\t"}', '{"a": "\\x"}', '{"a": "\\u12"}', "{'a': 1}",
     '{"a": 1} {"b": 2}', '{"a": 1}x',
     "{a: 1}", '{"a": nan}', '{"a": 1e}', '{"a": -}', '{"a": [1,]}', '{"a": [1 2]}', '{"a": --1}',
     '{,}', '{"a": 1e+}', "\x00"],
)  # fmt: skip
def test_what_the_json_module_refuses_is_counted(tmp_path: Path, text: str) -> None:
    log = check(tmp_path, [b'{"a": 1}', text.encode(), b'{"a": 2}'])
    reasons = log.faults.undecodable["/m"]
    assert sum(reasons.values()) == 1
    assert set(reasons) <= {INVALID_JSON_REASON, NOT_AN_OBJECT_REASON}


def test_unusual_but_valid(tmp_path: Path) -> None:
    deep = '{"a": ' * 300 + "1" + "}" * 300
    check(
        tmp_path,
        [
            b'{"a": 1, "a": 2}',
            b'{"\\u0061": 3}',
            b'\xef\xbb\xbf{"a": 4}',
            '{"a": 5}'.encode("utf-16-le"),
            b' \t\r\n{ "a" : 6 }\n',
            b'{"a": 7, "b": {"c": "\\ud83d\\ude00", "d": "\\n"}, "long key " : [[[1]], []]}',
            deep.encode(),
            b"{}",
            b'{"a": 1e5, "": 2}',
        ],
    )


def test_duplicate_key_with_arrays_counts_once() -> None:
    assert columns_of(b'{"a": [1, 2], "a": [3]}', b'{"a": [4]}')["a"].tolist() == [[3], [4]]


def test_floats_of_all_lengths_are_those_of_the_json_module() -> None:
    rng = np.random.default_rng(7)
    digits = rng.integers(1, 22, 20_000)
    texts = [f"{rng.normal() * 10.0 ** rng.integers(-6, 6):.{k}g}" for k in digits]
    texts += [repr(value) for value in rng.normal(size=20_000).tolist()]
    texts += [f"{int(a)}.{int(b):019d}" for a, b in rng.integers(0, 10**9, (5_000, 2))]
    # Halfway between two doubles, and next to it.
    texts += [f"{2**53 + k}.{tail}" for k in range(40) for tail in ("0", "5", "50000000001", "49999999999")]
    found = columns_of(*(f'{{"v": {text}, "w": 0.5}}' for text in texts))["v"]
    expected = np.array([float(json.loads(text)) for text in texts])
    assert np.array_equal(found.view(np.uint64), expected.view(np.uint64))


def test_keys_that_need_escapes() -> None:
    columns = columns_of({'a"b': 1, "c\\d": 2, "e\nf": 3}, {'a"b': 4, "c\\d": 5, "e\nf": 6})
    assert {path: column.tolist() for path, column in columns.items()} == {
        'a"b': [1, 4],
        "c\\d": [2, 5],
        "e\nf": [3, 6],
    }
    decoder = JsonDecoder(None)
    text = b'{"a\\"b": 1}{"a"b": 1}'
    decoder.decode_batch(Payloads(np.frombuffer(text, np.uint8), np.array([0, 11]), np.array([11, 21])))
    assert decoder.outcome().is_ok.tolist() == [True, False]


def test_more_keys_than_are_learned_do_not_become_columns() -> None:
    columns = columns_of({f"key{k}": k for k in range(5000)}, {"key0": 1, "other": 2})
    assert len(columns) == 4096


def test_long_integers_lose_no_digit_up_to_64_bits() -> None:
    column = columns_of(f'{{"v": {2**63 - 1}}}', f'{{"v": {-(2**63)}}}')["v"]
    assert column.tolist() == [2**63 - 1, -(2**63)]
