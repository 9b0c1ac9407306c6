"""Channels that a run has added, as columns: the same that a reader of the written file gets."""

from __future__ import annotations

from collections.abc import Collection
from functools import lru_cache
from typing import Any

import numpy as np

from cwcli.kernels.protobuf import MESSAGE, OCTETS, TEXT
from cwcli.logs.codecs.protobuf import ProtobufDecoder
from cwcli.logs.codecs.protobuf_tables import KINDS, is_repeated
from cwcli.logs.codecs.slots import Payloads, as_matrix, first_seen
from cwcli.logs.read.channels import ChannelInfo
from cwcli.logs.write.protobuf_encoder import encode_columns
from cwcli.logs.write.schemas import message_schema
from cwcli.logs.write.written_schema import MESSAGE_ENCODING, written_schema
from cwcli.signals.columns import (
    Columns,
    Field,
    OutputChannel,
    OutputField,
    Ragged,
    StreamedChannel,
    Strings,
    column_rows,
)

BLOCK_ROWS = 4096
"""The number of rows that are encoded and decoded at a time. Chosen by hand."""


def memory_info(channel: OutputChannel, channel_id: int) -> ChannelInfo:
    """Return the description of a channel in memory, as if the file declared it."""
    schema = written_schema(channel.schema_name)
    return ChannelInfo(
        id=channel_id,
        topic=channel.topic,
        schema_name=schema.name,
        schema_encoding=schema.encoding,
        message_encoding=schema.message_encoding,
        message_count=len(channel),
        schema_data=schema.data,
    )


def memory_columns(channel: OutputChannel, fields: Collection[str] | None) -> Columns:
    """Return a channel in memory as columns; `fields`: wanted leaves, None for all.

    The columns of a flat message type are used directly; those of other types are encoded and decoded.

    Raises:
        ValueError: The log times go back.
    """
    if isinstance(channel, StreamedChannel):
        columns = channel.rows(0, len(channel))
        channel = OutputChannel(channel.topic, channel.schema_name, channel.log_time_ns, columns)
    descriptor = message_schema(channel.schema_name).descriptor
    flat = _flat_fields(descriptor, channel)
    if flat is None:
        flat = _decoded_fields(descriptor, channel, fields)
    n = len(channel)
    order = np.argsort(channel.log_time_ns, kind="stable")
    if not np.array_equal(order, np.arange(n)):
        raise ValueError(f"log times of {channel.topic} go back")
    times = np.asarray(channel.log_time_ns, np.int64)
    return Columns(
        topic=channel.topic,
        schema_name=channel.schema_name,
        message_encoding=MESSAGE_ENCODING,
        log_time_ns=times,
        publish_time_ns=times,
        sequence=np.arange(n, dtype=np.uint32),
        fields={path: column for path, column in flat.items() if fields is None or path in fields},
    )


@lru_cache(maxsize=64)
def is_flat(schema_name: str) -> bool:
    """Tell whether a message type has no messages, enumerations and optional fields inside."""
    return not any(
        KINDS[each.type][0] == MESSAGE or each.enum_type is not None or (each.has_presence and not is_repeated(each))
        for each in message_schema(schema_name).descriptor.fields
    )


def _flat_fields(descriptor: Any, channel: OutputChannel) -> dict[str, Field] | None:
    """Return the columns of a flat message type; None for other types."""
    if not is_flat(channel.schema_name):
        return None
    flat: dict[str, Field] = {}
    n = len(channel)
    for each in descriptor.fields:
        kind, dtype = KINDS[each.type]
        if kind == OCTETS or (kind == TEXT and is_repeated(each)):
            continue
        given = channel.fields.get(each.name)
        column = _default(kind, dtype, n, repeated=is_repeated(each)) if given is None else _plain(given, dtype)
        if column is None:
            return None
        flat[each.name] = column
    return flat if channel.fields.keys() <= set(descriptor.fields_by_name) else None


def _default(kind: int, dtype: str, n: int, *, repeated: bool) -> Field:
    """Return the column of a field that is absent in all n messages."""
    if kind == TEXT:
        return Strings(np.zeros(n, np.int32), ("",) if n else ())
    return Ragged(np.zeros(0, dtype), np.zeros(n + 1, np.int64)) if repeated else np.zeros(n, dtype)


def _plain(column: OutputField, dtype: str) -> Field | None:
    """Return a column as a reader would get it; None for a column of messages."""
    if isinstance(column, Strings):
        codes = np.where(column.codes < 0, np.int32(len(column.values)), column.codes).astype(np.int32)
        texts = (*column.values, "")
        index: dict[str, int] = {}
        code_of = np.array([index.setdefault(text, len(index)) for text in texts], np.int32)
        return first_seen(Strings(code_of[codes], tuple(index)))
    if isinstance(column, Ragged):
        return as_matrix(Ragged(np.asarray(column.values, dtype), column.offsets))
    if isinstance(column, np.ndarray):
        values = column.astype(dtype, copy=False)
        if values.ndim == 2 and not (values.shape[0] and values.shape[1]):
            return Ragged(np.zeros(0, dtype), np.zeros(values.shape[0] + 1, np.int64))
        return values
    return None


def _decoded_fields(descriptor: Any, channel: OutputChannel, fields: Collection[str] | None) -> dict[str, Field]:
    """Encode a channel's messages and decode them to columns."""
    schema = message_schema(channel.schema_name)
    decoder = ProtobufDecoder(schema.name, schema.data, fields, n_expected=len(channel))
    for start in range(0, len(channel), BLOCK_ROWS):
        stop = min(start + BLOCK_ROWS, len(channel))
        rows = {path: column_rows(column, start, stop) for path, column in channel.fields.items()}
        messages = encode_columns(descriptor, rows, stop - start)
        decoder.add(Payloads(messages.data, messages.offsets[:-1].copy(), messages.offsets[1:].copy()))
    return decoder.finish(np.arange(len(channel)))
