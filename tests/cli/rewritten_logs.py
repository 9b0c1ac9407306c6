"""Logs taken apart into messages, and written again by the official writer with some of them changed."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap.writer import Writer


@dataclass(frozen=True)
class Logged:
    """A message with its channel."""

    topic: str
    encoding: str
    schema: tuple[str, str, bytes]
    log_time_ns: int
    data: bytes


Edit = Callable[[Logged], Logged]


def read(path: Path) -> list[Logged]:
    """The messages of a log that have a schema, in log-time order."""
    with path.open("rb") as stream:
        return [
            Logged(
                channel.topic,
                channel.message_encoding,
                (schema.name, schema.encoding, schema.data),
                message.log_time,
                message.data,
            )
            for schema, channel, message in make_reader(stream).iter_messages()
            if schema is not None
        ]


def write(path: Path, messages: Iterable[Logged]) -> None:
    """A log with these messages, by the official writer."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channels: dict[Any, int] = {}
        for each in messages:
            key = (each.topic, each.encoding, each.schema)
            if key not in channels:
                channels[key] = writer.register_channel(each.topic, each.encoding, writer.register_schema(*each.schema))
            writer.add_message(channels[key], each.log_time_ns, each.data, each.log_time_ns)
        writer.finish()


def of(topic: str, edit: Edit) -> Edit:
    """The edit, for the messages of one topic."""
    return lambda each: edit(each) if each.topic == topic else each
