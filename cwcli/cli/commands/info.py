"""`cwcli info`."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

from cwcli.cli.console import Console
from cwcli.cli.info_texts import format_utc_time, health_verdict, join_first_names_and_count_rest, unused_channel_rows
from cwcli.cli.options import lazy_typer as typer
from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.options.shared import LogArgument, ReadingOptions, SensorOptions, source_of_logs
from cwcli.cli.report import format_reason_counts
from cwcli.cli.tables import Cell, format_table
from cwcli.cli.text import (
    finite_or_none,
    format_byte_size,
    format_count,
    format_duration,
    join_names,
    shorten_and_escape,
    wrap_paragraph,
)
from cwcli.errors import EXIT_DONE, EXIT_GATE_FAILED
from cwcli.signals.units import NS_PER_S

if TYPE_CHECKING:
    from cwcli.channels.binding import Bindings
    from cwcli.channels.reasons import UnboundReason
    from cwcli.logs.read.reader import Log
    from cwcli.pipeline.recording_contract import RecordingContract

EXAMPLES = (
    "cwcli info drive.mcap",
    "cwcli info drive.mcap --doctor",
    "cwcli info drive.mcap --expect contract.toml",
    "cwcli info drive.mcap --json | jq .commands",
)
"""Command lines at the end of the command's `--help`."""

Document = dict[str, Any]
MAX_NAMED_ATTACHMENTS_OR_METADATA_RECORDS = 100
"""Largest number of attachments or metadata records that are named; chosen by hand."""
MAX_CHANNELS_SHOWN = 500
"""Greatest number of channels in a table. Chosen by hand: ten times what cars record."""
MAX_LOG_FACT_CHARACTERS = 5000
"""Longest text of one fact about a log, in characters; chosen by hand."""


DoctorOption = Annotated[
    bool,
    typer.Option("--doctor", help="Read the messages too: report gaps, delays, drifting clocks and usable messages."),
]
ExpectOption = Annotated[
    str | None,
    typer.Option(
        "--expect",
        metavar="FILE",
        help="Check the log against this recording contract (TOML); exit code 1 if a condition fails.",
    ),
]


def command(
    log: LogArgument,
    reading: ReadingOptions,
    sensors: SensorOptions,
    talk: TalkOptions,
    doctor: DoctorOption = False,
    expect: ExpectOption = None,
) -> int:
    """List what a log holds and what cwcli can do with it.

    Shows every channel with its rate and the role that cwcli would give it, why the others have none and what to try,
    and for each command whether the log has the signals that it needs.
    """

    console = Console(quiet=talk.quiet)
    contract = None if expect is None else _read_contract(expect)
    with reading.open_log(source_of_logs(log, reading.as_one)) as opened:
        document = describe_log(opened, reading, sensors)
        if doctor or reading.map or contract:
            document["health"] = _topic_health_documents(opened)
        if doctor or reading.map:
            document["inputs"] = _count_usable_messages(opened, document, reading, sensors)
        if contract:
            document["contract"] = _judge_contract(contract, document)
        document["verdict"] = health_verdict(document)
    if talk.json:
        console.print_document("info", document)
    else:
        print_log_description(console, document)
    keeps = all(verdict["holds"] for verdict in document.get("contract", ()))
    return EXIT_DONE if keeps else EXIT_GATE_FAILED


def describe_log(log: Log, reading: ReadingOptions, sensors: SensorOptions) -> Document:
    """Describe a log without reading its messages: the content of `--json`."""
    from cwcli.channels.binding import ALL_ROLE_NAMES, bind_roles, parse_role_overrides
    from cwcli.channels.reasons import REASONS_COMPLETED_BY_FIRST_MESSAGES, unbound_reasons_by_topic

    bindings = bind_roles(
        log.channels,
        parse_role_overrides(reading.topics_and_mappings),
        required=(),
        optional=ALL_ROLE_NAMES,
        ego_station=sensors.ego_station,
        where=log.name,
    )
    roles: dict[str, list[str]] = {}
    for role, bound in bindings.by_role.items():
        for binding in (each for one in bound for each in (one, *one.parts)):
            roles.setdefault(binding.topic, []).append(str(role))
    why = unbound_reasons_by_topic(log.channels, bindings)
    if reading.dbc:
        _add_dbc_signals_to_reasons(log, why, reading.dbc)
    if any(reason.why in REASONS_COMPLETED_BY_FIRST_MESSAGES for reason in why.values()):
        from cwcli.pipeline.message_fields import complete_reasons_of_unknown_channels

        complete_reasons_of_unknown_channels(log, why)
    duration_s = max(log.end_ns - log.start_ns, 0) / NS_PER_S
    container = _container_document(log)
    station_notes = _suggest_ego_stations_and_list_notes(log, why, bindings)
    return {
        "name": log.name,
        "size_bytes": sum(map(len, log.file.disk_files)),
        "profile": container["profile"],
        "library": container["library"],
        "start_ns": log.start_ns,
        "end_ns": log.end_ns,
        "start": format_utc_time(log.start_ns),
        "duration_s": duration_s,
        "messages": log.n_messages,
        "chunks": container["chunks"],
        "compression": container["compression"],
        "channels": [
            _channel_document(channel, duration_s, roles.get(channel.topic, []), why.get(channel.topic))
            for channel in log.channels
        ],
        "attachments": [{"name": entry.name, "size_bytes": entry.size} for entry in log.attachments],
        "metadata": list(log.metadata_names),
        "commands": _readiness_of_commands(set(map(str, bindings.by_role)), set(map(str, bindings.undecided))),
        "notes": [*bindings.notes, *station_notes],
        "faults": log.faults.counts_by_reason(),
    }


def _container_document(log: Log) -> Document:
    """Describe how the messages are stored in the file that the user named, not in the copy of a converted one."""
    from cwcli.logs.read.converted import source_formats

    formats = source_formats(log.file)
    if not formats:
        return {
            "profile": log.profile,
            "library": log.library,
            "chunks": log.n_chunks,
            "compression": list(log.compressions),
        }
    return {
        "profile": "",
        "library": f"converted from {formats[0].name}",
        "chunks": sum(each.n_chunks for each in formats),
        "compression": list(dict.fromkeys(name for each in formats for name in each.compressions)),
    }


def _add_dbc_signals_to_reasons(log: Log, why: dict[str, UnboundReason], files: list[str]) -> None:
    """Say of each channel of CAN frames without a role which signals of the DBC files a role could take."""
    from cwcli.channels.reasons import explain_can_frames
    from cwcli.signals.can import list_dbc_signal_names
    from cwcli.signals.input_rows import CAN_FRAME_SCHEMAS
    from cwcli.signals.inputs import normalise_schema_name

    signals = list_dbc_signal_names(files)
    for channel in log.channels:
        if (
            channel.topic in why
            and channel.message_count
            and normalise_schema_name(channel.schema_name) in CAN_FRAME_SCHEMAS
        ):
            why[channel.topic] = explain_can_frames(channel.topic, signals, files)


def _suggest_ego_stations_and_list_notes(log: Log, why: dict[str, UnboundReason], bindings: Bindings) -> list[str]:
    """Put a heard station's ID into the suggestions `--ego-station ID`; return notes on stations that may be the ego.

    Messages are read only where the log lacks the ego's position and has V2X messages.
    """
    from cwcli.channels.reasons import EGO_STATION_OPTION
    from cwcli.signals.inputs import find_input_for_role
    from cwcli.signals.role import Role

    lists_option = [topic for topic, reason in why.items() if EGO_STATION_OPTION in reason.tries]
    role, topics = Role.EGO_POSITION, []
    if role not in bindings and role not in bindings.undecided:
        entries = {
            each.topic: find_input_for_role(role, each.schema_name) for each in log.channels if each.message_count != 0
        }
        topics = [topic for topic, entry in entries.items() if entry is not None and entry.needs_ego_station]
    if not topics and not lists_option:
        return []
    from cwcli.pipeline.stations import (  # imports numpy, which most logs do not need
        MAX_STATIONS_IN_ERROR,
        count_stations_by_topic,
        shell_quote_station_id,
    )

    stations_by_topic = count_stations_by_topic(log)
    for topic in lists_option:
        for station, _ in stations_by_topic.get(topic, Counter()).most_common(1):
            option = EGO_STATION_OPTION.replace("ID", shell_quote_station_id(station))
            tries = (option if each == EGO_STATION_OPTION else each for each in why[topic].tries)
            why[topic] = why[topic]._replace(tries=tuple(tries))
    if not topics:
        return []
    most = sum(stations_by_topic.values(), Counter[str]()).most_common(MAX_STATIONS_IN_ERROR)
    named = " or ".join(shell_quote_station_id(station) for station, _ in most) or "ID"
    return [f"a station of {', '.join(topics)} can be the ego: --ego-station {named}"]


def _channel_document(channel: Any, duration_s: float, roles: list[str], reason: UnboundReason | None) -> Document:
    count = channel.message_count
    rate_hz = None if count is None or count < 2 or duration_s <= 0 else (count - 1) / duration_s
    return {
        "topic": channel.topic,
        "schema": channel.schema_name,
        "encoding": channel.message_encoding,
        "messages": count,
        "rate_hz": rate_hz,
        "roles": roles,
        "why_not": None if reason is None else reason.why,
        "fields": [] if reason is None else list(reason.fields),
        "try": [] if reason is None else list(reason.tries),
    }


def _topic_health_documents(log: Log) -> list[Document]:
    """Examine each topic with messages except cwcli's own; unknown numbers are None."""
    from cwcli.channels.published import OWN_TOPIC_PREFIX
    from cwcli.pipeline.health import measure_topic_health

    topics = dict.fromkeys(each.topic for each in log.channels if each.message_count != 0)
    found = measure_topic_health(log, [topic for topic in topics if not topic.startswith(OWN_TOPIC_PREFIX)])
    return [
        {name: finite_or_none(value) if isinstance(value, float) else value for name, value in asdict(each).items()}
        for each in found
    ]


def _count_usable_messages(
    log: Log, document: Document, reading: ReadingOptions, sensors: SensorOptions
) -> list[Document]:
    """Read the channels with a role, and count used, rejected and repaired messages of each."""
    from cwcli.channels.binding import parse_role_overrides
    from cwcli.signals.role import Role
    from cwcli.stages.inputs.sources import SourceConfig, read_sensor_signals

    config = SourceConfig(
        clock=sensors.clock, ego_station=sensors.ego_station, topics=parse_role_overrides(reading.topics_and_mappings)
    )
    filled = {role for channel in document["channels"] for role in channel["roles"]}
    sources = read_sensor_signals(
        log, config, command="info", optional=[role for role in Role if role in filled and role.signals]
    )
    document["notes"] += [note for note in sources.notes if note not in document["notes"]]
    names = ("topic", "role", "read", "used", "rejected", "repaired", "set_aside")
    return [{name: getattr(each, name) for name in names} for each in sources.input_message_counts()]


def _read_contract(path: str) -> RecordingContract:
    from cwcli.channels.binding import ALL_ROLE_NAMES
    from cwcli.pipeline.recording_contract import RecordingContract

    return RecordingContract.read_toml(path, ALL_ROLE_NAMES)


def _judge_contract(contract: RecordingContract, document: Document) -> list[Document]:
    from cwcli.signals.inputs import normalise_schema_name

    health = {
        each["topic"]: {name: math.nan if value is None else value for name, value in each.items()}
        for each in document["health"]
    }
    for each in health.values():
        if each["undecodable"] < 0:
            each["undecodable"] = math.nan
    nothing = {"messages": 0, "undecodable": 0, "out_of_order": 0, "longest_gap_s": document["duration_s"]}
    absent = dict.fromkeys(("rate_hz", "delay_s", "drift_ms_per_min"), math.nan) | nothing
    schemas = {each["topic"]: each["schema"] for each in document["channels"]}
    required_schemas = {each.get("schema", "") for each in contract.topics.values()}
    verdicts = contract.check_log(
        totals={"duration_s": document["duration_s"], "messages": document["messages"]},
        roles={role for channel in document["channels"] for role in channel["roles"]},
        schemas={
            topic: name if name in required_schemas else normalise_schema_name(name) for topic, name in schemas.items()
        },
        topics={topic: health.get(topic, absent) for topic in schemas},
    )
    return [each._asdict() for each in verdicts]


def _readiness_of_commands(bound: set[str], undecided: set[str]) -> Document:
    from cwcli.pipeline.needs import readiness_of_each_stage
    from cwcli.stages import STAGES

    return {
        entry.stage.name: {
            "ready": entry.is_ready,
            "after": list(entry.after),
            "missing": [role for role in entry.missing if role not in undecided],
            "choose": [role for role in entry.missing if role in undecided],
            "would_use": list(entry.unused),
        }
        for entry in readiness_of_each_stage(bound, STAGES)
    }


def print_log_description(console: Console, document: Document) -> None:
    """Print the description of a log as tables."""
    console.print_heading(document["name"])
    for name, text in _log_facts(document):
        console.print_summary(
            wrap_paragraph(shorten_and_escape(text, MAX_LOG_FACT_CHARACTERS), first=f"{name:<12}", rest=" " * 12)
        )
    console.print_summary("")
    rows: list[tuple[Cell, ...]] = [
        (
            channel["topic"],
            channel["schema"] or "-",
            channel["encoding"] or "-",
            channel["messages"],
            None if channel["rate_hz"] is None else f"{channel['rate_hz']:.1f}",
            ", ".join(channel["roles"]) or "-",
        )
        for channel in document["channels"][:MAX_CHANNELS_SHOWN]
    ]
    console.print_summary(format_table(("topic", "schema", "encoding", "messages", "rate [Hz]", "used as"), rows))
    if len(document["channels"]) > len(rows):
        console.print_summary(f"and {len(document['channels']) - len(rows):,} more (--json lists all)")
    console.print_summary("")
    unused = [each for each in document["channels"] if each["why_not"]][:MAX_CHANNELS_SHOWN]
    if unused:
        console.print_summary(format_table(("topic", "why it is not used"), unused_channel_rows(unused)))
        for line in dict.fromkeys(f"try: {line}" for each in unused for line in each["try"]):
            console.print_summary(line)
        console.print_summary("")
    _print_message_checks(console, document)
    heads = ("stage", "can run", "missing signals")
    console.print_summary(format_table(heads, _stage_command_rows(document["commands"])))
    for note in dict.fromkeys(document["notes"]):
        console.print_note(note)
    for fault, n in document["faults"].items():
        console.print_note(f"{fault}: {n}")


def _print_message_checks(console: Console, document: Document) -> None:
    """Print the tables of health, inputs and contract, for which messages were read."""
    if "health" in document:
        numbers = (
            "rate [Hz]",
            "gaps of messages",
            "longest gap [s]",
            "median of log time minus stamp [ms]",
            "clock drift [ms/min]",
            "messages out of order",
            "messages damaged",
        )
        rows = [
            (
                *(
                    each["topic"],
                    _format_scaled_number(each["rate_hz"], 1),
                    each["gaps"],
                    _format_scaled_number(each["longest_gap_s"], 2),
                ),
                *(
                    _format_scaled_number(each["delay_s"], 1, 1e3),
                    _format_scaled_number(each["drift_ms_per_min"], 1),
                    each["out_of_order"],
                ),
                "all" if each["undecodable"] < 0 else each["undecodable"],
            )
            for each in document["health"]
        ]
        console.print_summary(format_table(("topic", *numbers), rows))
        console.print_summary("")
    if document.get("inputs"):
        counts = [
            (each["topic"], each["role"], each["read"], each["used"], _reasons_text(each))
            for each in document["inputs"]
        ]
        console.print_summary(
            format_table(("topic", "used as", "messages read", "messages used", "why others are not used"), counts)
        )
        console.print_summary("")
    if "contract" in document:
        checks = [
            (each["about"], each["condition"], each["found"], "kept" if each["holds"] else "BROKEN")
            for each in document["contract"]
        ]
        console.print_summary(
            format_table(
                ("topic or log", "condition of the contract", "value in the log", "condition kept or broken"), checks
            )
        )
        console.print_summary("")


def _format_scaled_number(value: float | None, digits: int, factor: float = 1.0) -> str | None:
    return None if value is None else f"{factor * value:.{digits}f}"


def _reasons_text(counted: Document) -> str:
    kinds = ("rejected", "repaired", "set_aside")
    return format_reason_counts({reason: n for kind in kinds for reason, n in counted[kind].items()}) or "-"


def _log_facts(document: Document) -> list[tuple[str, str]]:
    compression = join_names(document["compression"]) or "none"
    chunks = f" in {format_count(document['chunks'], 'chunk')}" if document["chunks"] else ""
    facts = [
        ("size", format_byte_size(document["size_bytes"])),
        ("start", document["start"]),
        ("duration", format_duration(document["duration_s"])),
        ("messages", f"{document['messages']}{chunks}, compression {compression}"),
        ("profile", document["profile"] or "-"),
        ("library", document["library"] or "-"),
        ("health", document["verdict"]),
    ]
    if document["attachments"]:
        facts.append(
            (
                "attachments",
                join_first_names_and_count_rest(
                    [f"{each['name']} ({format_byte_size(each['size_bytes'])})" for each in document["attachments"]],
                    MAX_NAMED_ATTACHMENTS_OR_METADATA_RECORDS,
                ),
            )
        )
    if document["metadata"]:
        facts.append(
            (
                "metadata",
                join_first_names_and_count_rest(document["metadata"], MAX_NAMED_ATTACHMENTS_OR_METADATA_RECORDS),
            )
        )
    return facts


def _stage_command_rows(commands: Document) -> list[tuple[Cell, ...]]:
    """Make a table row for each stage; a variant of another stage is listed only if it can run."""
    from cwcli.stages import STAGES

    rows: list[tuple[Cell, ...]] = []
    for name, entry in commands.items():
        if entry["missing"] or entry["choose"]:
            if not STAGES[name].instead_of:
                lacks = [f"needs {join_names(entry['missing'])}"] if entry["missing"] else []
                lacks += [f"has several for {join_names(entry['choose'])}"] if entry["choose"] else []
                rows.append((name, "no", ", ".join(lacks)))
            continue
        answer = "yes" if entry["ready"] else f"after {join_names(entry['after'])}"
        rows.append((name, answer, f"could use {join_names(entry['would_use'])}" if entry["would_use"] else "-"))
    return rows
