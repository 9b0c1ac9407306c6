"""Schemas and channels of the topics of a database."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from cwcli.logs.codecs.ros2msg import SchemaError
from cwcli.logs.format.records import Channel, Schema

MAX_CHANNELS = 0xFFFF
"""The greatest number of channels: the format has 16 bits for their ids, from 1 on (MCAP specification)."""


def iter_schemas_and_channels(
    connections: Any, definitions_of_recording: Mapping[str, bytes | SchemaError], store: Any, notes: dict[str, int]
) -> Iterator[Schema | Channel]:
    """Yield schemas and channels; channels of undefined types have no schema, which `notes` gets.

    Args:
        connections: Topics with `id`, `topic` and `msgtype`.
        definitions_of_recording: Type -> its definition (`ros2msg`), or why the one in IDL is not read.
        store: Type store of `rosbags` for other types, or None.
        notes: Gets undefined types, as text -> 1.

    Raises:
        ValueError: There are more topics than a log has ids for.
    """
    schema_ids: dict[str, int] = {}
    unknown: dict[str, str] = {}
    if len(connections) > MAX_CHANNELS:
        raise ValueError(f"it has {len(connections)} topics, and a log has room for {MAX_CHANNELS}")
    for each in connections:
        if each.msgtype not in schema_ids:
            text = definitions_of_recording.get(each.msgtype) or _definition_from_store(store, each.msgtype)
            if text is None or isinstance(text, SchemaError):
                what = "without a definition" if text is None else "whose definition in IDL is not read"
                unknown[each.msgtype] = f"message types {what} ({each.msgtype}{'' if text is None else f': {text}'})"
                schema_ids[each.msgtype] = 0
            else:
                schema_ids[each.msgtype] = len(schema_ids) + 1
                yield Schema(schema_ids[each.msgtype], each.msgtype, "ros2msg", text)
        yield Channel(each.id, schema_ids[each.msgtype], each.topic, "cdr", {})
    notes.update((unknown[name], 1) for name in sorted(unknown))


def _definition_from_store(store: Any, name: str) -> bytes | None:
    """Return the definition of a type that a type store knows, else None."""
    if store is None:
        return None
    from rosbags.typesys import TypesysError

    try:
        return str(store.generate_msgdef(name, ros_version=2)[0]).encode()
    except (KeyError, TypesysError, RecursionError):
        return None
