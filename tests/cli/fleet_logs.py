"""Short logs for runs over many, and what lies in an output folder."""

from __future__ import annotations

import hashlib
from pathlib import Path

from mcap.reader import make_reader
from mcap.writer import Writer


def cut(source: Path, target: Path, *, start_s: float = 0.0, seconds: float = 5.0) -> Path:
    """A part of a log, with the official library."""
    with source.open("rb") as stream, target.open("wb") as out:
        reader = make_reader(stream)
        writer = Writer(out)
        writer.start()
        schemas: dict[int, int] = {}
        channels: dict[int, int] = {}
        begin_ns: int | None = None
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            begin_ns = message.log_time if begin_ns is None else begin_ns
            at_s = (message.log_time - begin_ns) / 1e9 - start_s
            if not 0.0 <= at_s < seconds:
                continue
            if schema.id not in schemas:
                schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
            if channel.id not in channels:
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, schemas[schema.id]
                )
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time, message.sequence
            )
        writer.finish()
    return target


def tree(folder: Path) -> dict[str, str]:
    """Relative name -> hash of every file but the run times."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != "run_times.json"
    }
