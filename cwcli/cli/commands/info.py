"""`cwcli info`."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from cwcli.cli.console import Console
from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.options.shared import LogArgument, ReadingOptions, SensorOptions
from cwcli.cli.options.values import utc
from cwcli.cli.tables import Cell, table
from cwcli.cli.text import count, duration, join_names, paragraph, shown, size
from cwcli.signals.units import NS_PER_S

if TYPE_CHECKING:
    from cwcli.logs.read.reader import Log

EXAMPLES = ("cwcli info drive.mcap", "cwcli info drive.mcap --json | jq .commands")

Document = dict[str, Any]
MAX_NAMES = 100
MAX_FACT = 5000
"""Characters."""


def command(log: LogArgument, reading: ReadingOptions, sensors: SensorOptions, talk: TalkOptions) -> None:
    """List what a log holds and what cwcli can do with it.

    Shows every channel with its rate and the role that cwcli would give it, and for each command whether the log has
    the signals that it needs.
    """
    from cwcli.logs.read.reader import Log

    console = Console(quiet=talk.quiet)
    with Log.open(
        log,
        recover=reading.recover,
        max_chunk_bytes=reading.max_chunk_bytes,
        max_pipe_bytes=reading.max_pipe_bytes,
    ) as opened:
        document = describe(opened, reading, sensors)
    if talk.json:
        console.data(json.dumps(document, indent=2, allow_nan=False))
    else:
        show(console, document)


def describe(log: Log, reading: ReadingOptions, sensors: SensorOptions) -> Document:
    """What `--json` prints."""
    from cwcli.channels.binding import EVERY_ROLE, bind, parse_overrides

    bindings = bind(
        log.channels,
        parse_overrides(reading.topics),
        required=(),
        optional=EVERY_ROLE,
        ego_station=sensors.ego_station,
        where=log.name,
    )
    roles: dict[str, list[str]] = {}
    for role, bound in bindings.by_role.items():
        for binding in bound:
            roles.setdefault(binding.topic, []).append(str(role))
    duration_s = max(log.end_ns - log.start_ns, 0) / NS_PER_S
    return {
        "name": log.name,
        "size_bytes": len(log.file),
        "profile": log.profile,
        "library": log.library,
        "start_ns": log.start_ns,
        "end_ns": log.end_ns,
        "start": utc(log.start_ns),
        "duration_s": duration_s,
        "messages": log.n_messages,
        "chunks": log.n_chunks,
        "compression": list(log.compressions),
        "channels": [_channel(channel, duration_s, roles.get(channel.topic, [])) for channel in log.channels],
        "attachments": [{"name": entry.name, "size_bytes": entry.size} for entry in log.attachments],
        "metadata": list(log.metadata_names),
        "commands": _commands(set(map(str, bindings.by_role))),
        "notes": list(bindings.notes),
        "faults": log.faults.counts(),
    }


def _channel(channel: Any, duration_s: float, roles: list[str]) -> Document:
    count = channel.message_count
    rate_hz = None if count is None or count < 2 or duration_s <= 0 else (count - 1) / duration_s
    return {
        "topic": channel.topic,
        "schema": channel.schema_name,
        "encoding": channel.message_encoding,
        "messages": count,
        "rate_hz": rate_hz,
        "roles": roles,
    }


def _commands(bound: set[str]) -> Document:
    from cwcli.pipeline.needs import readiness
    from cwcli.stages import STAGES

    return {
        entry.stage.name: {
            "ready": entry.is_ready,
            "after": list(entry.after),
            "missing": list(entry.missing),
            "would_use": list(entry.unused),
        }
        for entry in readiness(bound, STAGES)
    }


def show(console: Console, document: Document) -> None:
    """The document as tables of at most 80 columns."""
    console.heading(document["name"])
    for name, text in _facts(document):
        console.summary(paragraph(shown(text, MAX_FACT), first=f"{name:<12}", rest=" " * 12))
    console.summary("")
    rows: list[tuple[Cell, ...]] = [
        (
            channel["topic"],
            channel["schema"] or "-",
            channel["encoding"] or "-",
            channel["messages"],
            None if channel["rate_hz"] is None else f"{channel['rate_hz']:.1f}",
            ", ".join(channel["roles"]) or "-",
        )
        for channel in document["channels"]
    ]
    console.summary(table(("topic", "schema", "encoding", "messages", "Hz", "role"), rows))
    console.summary("")
    console.summary(table(("command", "can run", "not in the log"), _command_rows(document["commands"])))
    for note in document["notes"]:
        console.note(note)
    for fault, n in document["faults"].items():
        console.note(f"{fault}: {n}")


def _facts(document: Document) -> list[tuple[str, str]]:
    compression = join_names(document["compression"]) or "none"
    facts = [
        ("size", size(document["size_bytes"])),
        ("start", document["start"]),
        ("duration", duration(document["duration_s"])),
        ("messages", f"{document['messages']} in {count(document['chunks'], 'chunk')}, compression {compression}"),
        ("profile", document["profile"] or "-"),
        ("library", document["library"] or "-"),
    ]
    if document["attachments"]:
        facts.append(
            (
                "attachments",
                _first([f"{each['name']} ({size(each['size_bytes'])})" for each in document["attachments"]]),
            )
        )
    if document["metadata"]:
        facts.append(("metadata", _first(document["metadata"])))
    return facts


def _first(names: list[str]) -> str:
    """The first of many names."""
    more = len(names) - MAX_NAMES
    return ", ".join(names[:MAX_NAMES]) + (f" and {more:,} more" if more > 0 else "")


def _command_rows(commands: Document) -> list[tuple[Cell, ...]]:
    """A row a stage. One that is another way to run a stage is listed where it is open."""
    from cwcli.stages import STAGES

    rows: list[tuple[Cell, ...]] = []
    for name, entry in commands.items():
        if entry["missing"]:
            if not STAGES[name].instead_of:
                rows.append((name, "no", f"needs {join_names(entry['missing'])}"))
            continue
        answer = "yes" if entry["ready"] else f"after {join_names(entry['after'])}"
        rows.append((name, answer, f"could use {join_names(entry['would_use'])}" if entry["would_use"] else "-"))
    return rows
