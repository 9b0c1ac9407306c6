"""The official reader and decoders, message by message: what the columns must hold."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import NonSeekingReader, make_reader
from mcap_protobuf.decoder import DecoderFactory as ProtobufFactory
from mcap_ros2.decoder import DecoderFactory as Ros2Factory

from cwcli.signals.columns import Columns, Field, Ragged, Strings

SHARED_LOGS = Path(__file__).parents[3].parent / "shared" / "logs"
ABSENT = object()


@dataclass
class OfficialTopic:
    """Every message of one topic, as the official libraries give it."""

    encoding: str
    log_time_ns: list[int] = field(default_factory=list)
    publish_time_ns: list[int] = field(default_factory=list)
    sequence: list[int] = field(default_factory=list)
    messages: list[Any] = field(default_factory=list)
    n_undecodable: int = 0


def read_officially(data: bytes, *, seeking: bool = True) -> dict[str, OfficialTopic]:
    """All topics of a file; messages that the decoders refuse are counted."""
    stream = BytesIO(data)
    reader = make_reader(stream, validate_crcs=True) if seeking else NonSeekingReader(stream, validate_crcs=True)
    factories = (Ros2Factory(), ProtobufFactory())
    topics: dict[str, OfficialTopic] = {}
    for schema, channel, message in reader.iter_messages():
        topic = topics.setdefault(channel.topic, OfficialTopic(channel.message_encoding))
        try:
            if channel.message_encoding == "json":
                decoded = json.loads(message.data)
                if not isinstance(decoded, dict):
                    raise ValueError("not an object")
            else:
                decode = next(
                    found for each in factories if (found := each.decoder_for(channel.message_encoding, schema))
                )
                decoded = decode(message.data)
        except Exception:  # each decoder raises its own
            topic.n_undecodable += 1
            continue
        topic.log_time_ns.append(message.log_time)
        topic.publish_time_ns.append(message.publish_time)
        topic.sequence.append(message.sequence)
        topic.messages.append(decoded)
    return topics


def assert_same(columns: Columns, official: OfficialTopic, *, expect_paths: bool = True) -> None:
    """Every row of every column is what the official decoder says, and no leaf is missing."""
    assert columns.n_undecodable == official.n_undecodable
    assert columns.log_time_ns.tolist() == official.log_time_ns
    assert columns.publish_time_ns.tolist() == official.publish_time_ns
    assert columns.sequence.tolist() == official.sequence
    for path, column in columns.fields.items():
        assert len(column) == len(official.messages), path
        rows = list(_rows(column))
        is_text = isinstance(column, Strings)
        in_arrays = is_text and any(
            _is_in_array(each, path.split("."), official.encoding) for each in official.messages
        )
        for k, message in enumerate(official.messages):
            is_scalar = isinstance(column, Strings) or (isinstance(column, np.ndarray) and column.ndim == 1)
            expected = list(_values(message, path.split("."), official.encoding, is_scalar=is_scalar))
            if in_arrays:
                assert rows[k] == _text_of_array(expected), (path, k, rows[k], expected)
            else:
                assert _same(rows[k], expected, column), (path, k, rows[k], expected)
    if expect_paths:
        leaves = {leaf for message in official.messages for leaf in leaf_paths(message, official.encoding)}
        assert leaves <= set(columns.fields), leaves - set(columns.fields)


def leaf_paths(message: Any, encoding: str, prefix: str = "", in_list: bool = False) -> Iterator[str]:
    """Paths of the leaves that must be columns: no octets, no strings in arrays, nothing of empty arrays."""
    for name, value in _members(message, encoding):
        path = prefix + name
        if isinstance(value, str):
            if not in_list:
                yield path
        elif isinstance(value, bytes):
            continue
        elif _is_list(value):
            items = [item for item in value if not _is_list(item)]
            for item in items:
                if _is_message(item, encoding):
                    yield from leaf_paths(item, encoding, f"{path}.", True)
                elif not isinstance(item, str | bytes):
                    yield path
        elif _is_message(value, encoding):
            yield from leaf_paths(value, encoding, f"{path}.", in_list)
        else:
            yield path


def _members(message: Any, encoding: str) -> Iterator[tuple[str, Any]]:
    if encoding == "json":
        yield from message.items()
    elif encoding == "cdr":
        for name in message.__slots__:
            yield name, getattr(message, name)
    else:
        for each in message.DESCRIPTOR.fields:
            is_map = each.message_type is not None and each.message_type.GetOptions().map_entry
            if not is_map:
                yield each.name, getattr(message, each.name)


def _is_list(value: Any) -> bool:
    return not isinstance(value, str | bytes) and (
        isinstance(value, list) or type(value).__name__.startswith("Repeated")
    )


def _is_message(value: Any, encoding: str) -> bool:
    if encoding == "json":
        return isinstance(value, dict)
    return hasattr(value, "__slots__") if encoding == "cdr" else hasattr(value, "DESCRIPTOR")


def _values(value: Any, names: list[str], encoding: str, *, is_scalar: bool) -> Iterator[Any]:
    """All values of a leaf in one message, arrays flattened; ABSENT where an optional part of a scalar is not there."""
    if _is_list(value):
        for item in value:
            yield from _values(item, names, encoding, is_scalar=is_scalar)
    elif not names:
        if isinstance(value, bytes):
            yield from value
        elif not _is_message(value, encoding):
            yield value
    elif encoding == "json":
        if isinstance(value, dict) and names[0] in value:
            yield from _values(value[names[0]], names[1:], encoding, is_scalar=is_scalar)
    elif encoding == "cdr":
        yield from _values(getattr(value, names[0]), names[1:], encoding, is_scalar=is_scalar)
    else:
        each = value.DESCRIPTOR.fields_by_name[names[0]]
        if is_scalar and each.has_presence and not value.HasField(names[0]):
            yield ABSENT
        else:
            yield from _values(getattr(value, names[0]), names[1:], encoding, is_scalar=is_scalar)


def _is_in_array(value: Any, names: list[str], encoding: str, inside: bool = False) -> bool:
    """Whether an array holds a value of a leaf."""
    if _is_list(value):
        return any(_is_in_array(item, names, encoding, True) for item in value)
    if not names:
        return inside and not _is_message(value, encoding)
    is_there = encoding == "json" and isinstance(value, dict) and names[0] in value
    return is_there and _is_in_array(value[names[0]], names[1:], encoding, inside)


def _rows(column: Field) -> Iterator[Any]:
    if isinstance(column, Strings):
        for code in column.codes.tolist():
            yield column.values[code] if code >= 0 else None
    elif isinstance(column, Ragged):
        bounds = column.offsets.tolist()
        for start, stop in pairwise(bounds):
            yield column.values[start:stop].tolist()
    else:
        yield from column.tolist()


def _same(row: Any, expected: list[Any], column: Field) -> bool:
    if isinstance(column, Strings):
        return row == _text(expected[0] if expected else ABSENT)
    if isinstance(column, Ragged) or column.ndim == 2:
        return len(row) == len(expected) and all(map(_same_number, row, expected))
    return len(expected) <= 1 and _same_number(row, expected[0] if expected else ABSENT)


def _text(value: Any) -> str | None:
    if value is None or value is ABSENT:
        return None
    if isinstance(value, bool):
        return "true" if value else "false"
    return value if isinstance(value, str) else repr(value)


def _text_of_array(expected: list[Any]) -> str | None:
    """Of arrays of which most hold one text: several values are not told, and a number is never taken for a text."""
    if len(expected) > 1:
        return "[...]"
    value = expected[0] if expected else None
    return _text(float(value) if isinstance(value, int) and not isinstance(value, bool) else value)


def _same_number(found: Any, expected: Any) -> bool:
    if expected is ABSENT or expected is None or isinstance(expected, str):
        return isinstance(found, float) and math.isnan(found)
    if isinstance(expected, float) and math.isnan(expected):
        return math.isnan(found)
    if isinstance(found, float) and isinstance(expected, int) and not isinstance(expected, bool):
        return found == float(np.float64(expected))
    return bool(found == expected) and (math.copysign(1, found) == math.copysign(1, expected))
