"""Columns for the tests: by hand, and from logs through the official decoders."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, ParamSpec

import numpy as np
import pytest
from mcap.reader import make_reader

from cwcli.signals.build import build_bound_signal, build_signal
from cwcli.signals.builders.base import Reading
from cwcli.signals.canonical import Signal
from cwcli.signals.columns import Columns, Ragged, Strings, encode_strings
from cwcli.signals.inputs import find_input_for_role
from cwcli.signals.mapping import MAPPED_QUANTITIES_BY_ROLE, FieldMapping
from cwcli.signals.quality import Quality
from cwcli.signals.role import Role

LOGS = Path(__file__).parents[3].parent / "shared" / "logs"
T0_NS = 1_570_522_030_000_000_000
"""2019-10-08T08:07:10Z."""


def columns_of(
    schema_name: str,
    fields: Mapping[str, Any],
    *,
    topic: str = "/t",
    message_encoding: str = "cdr",
    log_time_ns: Any = None,
    n_undecodable: int = 0,
) -> Columns:
    """Columns from plain lists. Lists of strings become `Strings`; log time is 0.1 s apart when not given."""
    decoded = {path: _field(values) for path, values in fields.items()}
    n_rows = len(next(iter(decoded.values())))
    log_ns = T0_NS + 100_000_000 * np.arange(n_rows) if log_time_ns is None else np.asarray(log_time_ns, dtype=np.int64)
    return Columns(
        topic=topic,
        schema_name=schema_name,
        message_encoding=message_encoding,
        log_time_ns=log_ns,
        publish_time_ns=log_ns,
        sequence=np.arange(n_rows, dtype=np.uint32),
        fields=decoded,
        n_undecodable=n_undecodable,
    )


def stamp_fields(stamp_ns: Any) -> dict[str, Any]:
    """`header.stamp` leaves of stamps in ns."""
    stamp = np.asarray(stamp_ns, dtype=np.int64)
    return {"header.stamp.sec": stamp // 1_000_000_000, "header.stamp.nanosec": stamp % 1_000_000_000}


def development_log(name: str) -> Path:
    """A development log of ../shared/logs; the test is skipped where the checkout has none."""
    path = LOGS / name
    if not path.exists():
        pytest.skip(f"the development log {name} is not in ../shared/logs")
    return path


Built = ParamSpec("Built")


def with_known_kind(build: Callable[Built, tuple[Signal, Quality]]) -> Callable[Built, tuple[Any, Quality]]:
    """The same function for callers who know which kind of signal it builds: they may read each of its columns."""
    return build


def build_mapped(role: Role, columns: Columns, mapping: FieldMapping) -> tuple[Any, Quality]:
    """The signal of a channel whose fields a mapping names."""
    entry = find_input_for_role(role, MAPPED_QUANTITIES_BY_ROLE[role].schema)
    return build_bound_signal(entry, columns, Reading(role), mapping)


build_known_signal = with_known_kind(build_signal)


def official_columns(path: Path, topic: str) -> Columns:
    """A topic of a log through the official decoders, message by message."""
    from mcap_protobuf.decoder import DecoderFactory as ProtobufFactory
    from mcap_ros2.decoder import DecoderFactory as Ros2Factory

    rows: list[dict[str, Any]] = []
    log_ns: list[int] = []
    schema_name = encoding = ""
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[ProtobufFactory(), Ros2Factory()])
        summary = reader.get_summary()
        assert summary is not None
        is_json = any(c.topic == topic and c.message_encoding == "json" for c in summary.channels.values())
        messages: Iterable[tuple[Any, Any, Any, Any]]
        if is_json:
            messages = ((s, c, m, json.loads(m.data)) for s, c, m in reader.iter_messages(topics=[topic]))
        else:
            messages = reader.iter_decoded_messages(topics=[topic])
        for schema, channel, message, decoded in messages:
            schema_name, encoding = schema.name if schema else "", channel.message_encoding
            leaves: dict[str, Any] = {}
            _flatten("", decoded, leaves)
            rows.append(leaves)
            log_ns.append(message.log_time)
    paths = dict.fromkeys(path for row in rows for path in row)
    fields = {
        path: [row.get(path) for row in rows] for path in paths if _is_leaf(next(r[path] for r in rows if path in r))
    }
    return columns_of(schema_name, fields, topic=topic, message_encoding=encoding, log_time_ns=log_ns)


def _is_leaf(value: Any) -> bool:
    """Numbers, strings and lists of numbers; no byte blobs, no lists of messages."""
    if isinstance(value, (list, tuple)):
        return all(isinstance(item, (int, float)) for item in value)
    return not isinstance(value, bytes)


def _flatten(path: str, value: Any, leaves: dict[str, Any]) -> None:
    if isinstance(value, dict):
        items = list(value.items())
    elif hasattr(value, "DESCRIPTOR"):
        items = [(field.name, getattr(value, field.name)) for field in value.DESCRIPTOR.fields]
    elif hasattr(value, "__slots__") and not isinstance(value, (str, bytes, int, float, list, tuple)):
        items = [(name, getattr(value, name)) for name in value.__slots__]
    else:
        leaves[path] = value
        return
    for name, child in items:
        _flatten(f"{path}.{name}" if path else name, child, leaves)


def _field(values: Any) -> Any:
    if isinstance(values, (np.ndarray, Ragged, Strings)):
        return values
    values = list(values)
    if any(isinstance(value, str) for value in values):
        return encode_strings([value or "" for value in values])
    if any(isinstance(value, (list, tuple)) or hasattr(value, "__len__") for value in values):
        rows = [np.asarray(value if value is not None else (), dtype=np.float64) for value in values]
        if len({len(row) for row in rows}) == 1 and len(rows[0]):
            return np.stack(rows)
        offsets = np.concatenate([[0], np.cumsum([len(row) for row in rows])]).astype(np.int64)
        return Ragged(values=np.concatenate(rows) if rows else np.zeros(0), offsets=offsets)
    return np.array([np.nan if value is None else value for value in values])
