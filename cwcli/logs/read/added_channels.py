"""Channels that a run has added, as columns: the same that a reader of the written file gets."""

from __future__ import annotations

from collections.abc import Collection
from functools import lru_cache
from typing import Any

import numpy as np

from cwcli.kernels.protobuf import MESSAGE, OCTETS, TEXT
from cwcli.logs.codecs.column_buffers import Payloads, matrix_if_equal_lengths, order_values_by_first_use
from cwcli.logs.codecs.protobuf import ProtobufDecoder
from cwcli.logs.codecs.protobuf_tables import KIND_AND_DTYPE_BY_TYPE, is_repeated_field
from cwcli.logs.encoders.output_schema import PROTOBUF_MESSAGE_ENCODING, find_output_schema
from cwcli.logs.encoders.protobuf_encoder import encode_protobuf
from cwcli.logs.encoders.schemas import find_message_schema
from cwcli.logs.read.channels import ChannelInfo
from cwcli.signals.columns import (
    Columns,
    Field,
    OutputChannel,
    OutputField,
    Ragged,
    StreamedChannel,
    Strings,
    slice_column,
)

ENCODE_BLOCK_ROWS = 4096
"""The number of rows that are encoded and decoded at a time. Chosen by hand."""


def info_of_added_channel(channel: OutputChannel, channel_id: int) -> ChannelInfo:
    """Return the description of a channel in memory, as if the file declared it."""
    schema = find_output_schema(channel.schema_name)
    return ChannelInfo(
        id=channel_id,
        topic=channel.topic,
        schema_name=schema.name,
        schema_encoding=schema.encoding,
        message_encoding=schema.message_encoding,
        message_count=len(channel),
        schema_data=schema.data,
    )


def columns_of_added_channel(channel: OutputChannel, fields: Collection[str] | None) -> Columns:
    """Return a channel in memory as columns; `fields`: wanted leaves, None for all.

    The columns of a flat message type are used directly; those of other types are encoded and decoded.

    Raises:
        ValueError: The log times go back.
    """
    if isinstance(channel, StreamedChannel):
        columns = channel.make_rows(0, len(channel))
        channel = OutputChannel(channel.topic, channel.schema_name, channel.log_time_ns, columns)
    descriptor = find_message_schema(channel.schema_name).descriptor
    flat = _columns_of_flat_message(descriptor, channel)
    if flat is None:
        flat = _columns_by_encoding_and_decoding(descriptor, channel, fields)
    n = len(channel)
    order = np.argsort(channel.log_time_ns, kind="stable")
    if not np.array_equal(order, np.arange(n)):
        raise ValueError(f"log times of {channel.topic} go back")
    times = np.asarray(channel.log_time_ns, np.int64)
    return Columns(
        topic=channel.topic,
        schema_name=channel.schema_name,
        message_encoding=PROTOBUF_MESSAGE_ENCODING,
        log_time_ns=times,
        publish_time_ns=times,
        sequence=np.arange(n, dtype=np.uint32),
        fields={path: column for path, column in flat.items() if fields is None or path in fields},
    )


@lru_cache(maxsize=64)
def is_flat_message_type(schema_name: str) -> bool:
    """Tell whether a message type has no messages, enumerations and optional fields inside."""
    return not any(
        KIND_AND_DTYPE_BY_TYPE[each.type][0] == MESSAGE
        or each.enum_type is not None
        or (each.has_presence and not is_repeated_field(each))
        for each in find_message_schema(schema_name).descriptor.fields
    )


def _columns_of_flat_message(descriptor: Any, channel: OutputChannel) -> dict[str, Field] | None:
    """Return the columns of a flat message type; None for other types."""
    if not is_flat_message_type(channel.schema_name):
        return None
    flat: dict[str, Field] = {}
    n = len(channel)
    for each in descriptor.fields:
        kind, dtype = KIND_AND_DTYPE_BY_TYPE[each.type]
        if kind == OCTETS or (kind == TEXT and is_repeated_field(each)):
            continue
        field = channel.fields.get(each.name)
        column = (
            _column_of_absent_field(kind, dtype, n, repeated=is_repeated_field(each))
            if field is None
            else _column_as_read_back(field, dtype)
        )
        if column is None:
            return None
        flat[each.name] = column
    return flat if channel.fields.keys() <= set(descriptor.fields_by_name) else None


def _column_of_absent_field(kind: int, dtype: str, n: int, *, repeated: bool) -> Field:
    """Return the column of a field that is absent in all n messages."""
    if kind == TEXT:
        return Strings(np.zeros(n, np.int32), ("",) if n else ())
    return Ragged(np.zeros(0, dtype), np.zeros(n + 1, np.int64)) if repeated else np.zeros(n, dtype)


def _column_as_read_back(column: OutputField, dtype: str) -> Field | None:
    """Return a column as a reader would get it; None for a column of messages."""
    if isinstance(column, Strings):
        codes = np.where(column.codes < 0, np.int32(len(column.values)), column.codes).astype(np.int32)
        texts = (*column.values, "")
        index: dict[str, int] = {}
        code_of = np.array([index.setdefault(text, len(index)) for text in texts], np.int32)
        return order_values_by_first_use(Strings(code_of[codes], tuple(index)))
    if isinstance(column, Ragged):
        return matrix_if_equal_lengths(Ragged(np.asarray(column.values, dtype), column.offsets))
    if isinstance(column, np.ndarray):
        values = column.astype(dtype, copy=False)
        if values.ndim == 2 and not (values.shape[0] and values.shape[1]):
            return Ragged(np.zeros(0, dtype), np.zeros(values.shape[0] + 1, np.int64))
        return values
    return None


def _columns_by_encoding_and_decoding(
    descriptor: Any, channel: OutputChannel, fields: Collection[str] | None
) -> dict[str, Field]:
    """Encode a channel's messages and decode them to columns."""
    schema = find_message_schema(channel.schema_name)
    decoder = ProtobufDecoder(schema.name, schema.data, fields, n_expected=len(channel))
    for start in range(0, len(channel), ENCODE_BLOCK_ROWS):
        stop = min(start + ENCODE_BLOCK_ROWS, len(channel))
        rows = {path: slice_column(column, start, stop) for path, column in channel.fields.items()}
        messages = encode_protobuf(descriptor, rows, stop - start)
        decoder.decode_batch(Payloads(messages.data, messages.offsets[:-1].copy(), messages.offsets[1:].copy()))
    return decoder.build_columns(np.arange(len(channel)))
