"""The level `kernel`: messages through a decoder, and through the official one."""

from __future__ import annotations

import json
import logging
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import Message
from google.protobuf.message_factory import GetMessageClass
from mcap_ros2._dynamic import generate_dynamic

from cwcli.logs.codecs.column_buffers import Payloads
from cwcli.logs.codecs.decoder import Decoder
from cwcli.logs.codecs.registry import make_decoder
from cwcli.logs.codecs.ros2msg import SchemaError
from cwcli.logs.read.channels import ChannelInfo
from cwcli.signals.columns import Columns, Field, Ragged, Strings
from tests.fuzz.messages import Messages
from tests.unit.logs_read.official import OfficialTopic, assert_same

logging.getLogger("mcap_ros2").setLevel(logging.CRITICAL)


def check_messages(case: Messages) -> tuple[int, int]:
    """Decode messages; how many were accepted, and of how many all values were compared with the official ones.

    Raises:
        AssertionError: A value is not the official one.
        Exception: Any other is a bug, too.
    """
    decoder = _decoder(case)
    if decoder is None:
        return 0, 0
    shown: dict[str, list[bytes]] = {}
    for start in range(0, len(case.payloads), case.n_at_once):
        decoder.decode_batch(_payloads(case.payloads[start : start + case.n_at_once]))
        for path in case.blobs:
            with suppress(KeyError):  # the mutated schema holds no such octets
                blobs = decoder.blobs_of_last_batch(path)
                shown.setdefault(path, []).extend(map(bytes, blobs))
    is_ok = decoder.outcome().is_ok
    decode = _official(case)
    rows, decoded = [], []
    for row in np.flatnonzero(is_ok).tolist():
        found = _decoded(decode, case.payloads[row]) if decode else None
        if found is not None and _can_be_compared(case, row, found):
            rows.append(row)
            decoded.append(found)
    everything = decoder.build_columns(np.flatnonzero(is_ok))
    assert all(len(column) == is_ok.sum() for column in everything.values())
    official = OfficialTopic(case.encoding, [0] * len(rows), [0] * len(rows), [0] * len(rows), decoded)
    none = np.zeros(len(rows), np.int64)
    fields = decoder.build_columns(np.array(rows, np.int64))
    if case.encoding == "json":
        fields = {path: column for path, column in fields.items() if not _is_mixed(path, column, decoded)}
    columns = Columns("/m", case.schema_name, case.encoding, none, none, none.astype(np.uint32), fields)
    assert_same(columns, official, expect_paths=False)
    for path, found in shown.items():
        for row, message in zip(rows, decoded, strict=True):
            assert found[row] == bytes(getattr(message, path)), path
    return int(is_ok.sum()), len(rows)


def _decoder(case: Messages) -> Decoder | None:
    schema_encoding = {"cdr": "ros2msg", "protobuf": "protobuf", "json": ""}[case.encoding]
    channel = ChannelInfo(
        1, "/m", case.schema_name, schema_encoding, case.encoding, len(case.payloads), schema_data=case.schema
    )
    try:
        return make_decoder(channel, case.fields, blobs=case.blobs, n_expected=len(case.payloads))
    except SchemaError:
        return None


def _payloads(messages: Sequence[bytes]) -> Payloads:
    """In memory of their own, whose end the sanitizer knows."""
    sizes = np.array([len(each) for each in messages], np.int64)
    ends = np.cumsum(sizes)
    return Payloads(np.array(bytearray(b"".join(messages)), np.uint8), ends - sizes, ends)


def _official(case: Messages) -> Callable[[bytes], Any] | None:
    """The official decoder; None if it refuses the schema."""
    try:
        if case.encoding == "json":
            return lambda payload: _shown(json.loads(payload))
        if case.encoding == "cdr":
            return generate_dynamic(case.schema_name, case.schema.decode(errors="replace"))[case.schema_name]
        pool = DescriptorPool()
        for file in FileDescriptorSet.FromString(case.schema).file:
            pool.Add(file)
        return GetMessageClass(pool.FindMessageTypeByName(case.schema_name)).FromString
    except Exception:  # each raises its own
        return None


def _decoded(decode: Callable[[bytes], Any], payload: bytes) -> Any:
    try:
        return decode(payload)
    except Exception:  # each decoder raises its own
        return None


def _can_be_compared(case: Messages, row: int, decoded: Any) -> bool:
    """Without what the official decoder reads in another way by design."""
    if case.encoding == "cdr":
        return case.payloads[row][1] < 2  # it takes XCDR2 for XCDR1
    if case.encoding == "json":  # `a.b` is one key here, and a key in an object there
        return isinstance(decoded, dict) and not any("." in key for key in _keys(decoded))
    return all(isinstance(text, str) for text in _texts(decoded))  # proto2 takes what is not UTF-8, as bytes


def _keys(value: Any) -> Iterator[str]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield key
            yield from _keys(inner)
    elif isinstance(value, list):
        for each in value:
            yield from _keys(each)


def _texts(message: Any) -> Iterator[object]:
    for field, value in message.ListFields():
        is_one = isinstance(value, str | bytes | Message) or not hasattr(value, "__iter__")
        for each in [value] if is_one else value:
            if field.type == field.TYPE_STRING:
                yield each
            elif isinstance(each, Message):
                yield from _texts(each)


def _shown(value: Any) -> Any:
    """Half of a surrogate pair is shown as an escape, and an integer beyond 64 bits is a float."""
    if isinstance(value, int) and abs(value) >= 1 << 63:
        return float(value) if abs(value) < 1 << 1023 else math.copysign(math.inf, value)
    if isinstance(value, str):
        return value.encode(errors="surrogatepass").decode(errors="backslashreplace")
    if isinstance(value, list):
        return [_shown(each) for each in value]
    return {key: _shown(each) for key, each in value.items()} if isinstance(value, dict) else value


def _is_mixed(path: str, column: Field, decoded: list[Any]) -> bool:
    """A text or null where other messages have an array of numbers adds nothing to the array."""
    if isinstance(column, Strings) or (not isinstance(column, Ragged) and column.ndim == 1):
        return False
    return any(value is None or isinstance(value, str) for value in (_alone(each, path) for each in decoded))


def _alone(message: Any, path: str) -> Any:
    """What stands at a path outside of arrays; no text and not None if nothing does."""
    for name in path.split("."):
        if not isinstance(message, dict) or name not in message:
            return ()
        message = message[name]
    return message
