"""`cwcli info`."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cwcli.cli.console import Console
from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.options.shared import LogArgument, ReadingOptions, SensorOptions, one_log
from cwcli.cli.options.values import utc
from cwcli.cli.tables import Cell, table
from cwcli.cli.text import count, duration, join_names, paragraph, shown, size
from cwcli.errors import EXIT_DONE, EXIT_GATE_FAILED
from cwcli.signals.units import NS_PER_S

if TYPE_CHECKING:
    from cwcli.channels.binding import Bindings
    from cwcli.channels.reasons import Reason
    from cwcli.logs.read.reader import Log
    from cwcli.pipeline.recording_contract import RecordingContract

EXAMPLES = (
    "cwcli info drive.mcap",
    "cwcli info drive.mcap --doctor",
    "cwcli info drive.mcap --expect contract.toml",
    "cwcli info drive.mcap --json | jq .commands",
)

Document = dict[str, Any]
MAX_NAMES = 100
MAX_FACT = 5000
"""Characters."""


DoctorOption = Annotated[
    bool, typer.Option("--doctor", help="Read the messages too: gaps, delays, drifting clocks, what can be used.")
]
ExpectOption = Annotated[
    str | None,
    typer.Option(
        "--expect",
        metavar="FILE",
        show_default=False,
        help="A recording contract (TOML); exit code 1 where the log does not keep it.",
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
    from cwcli.logs.read.reader import Log

    console = Console(quiet=talk.quiet)
    contract = None if expect is None else _contract(expect)
    with Log.open(
        one_log(log, reading.as_one),
        recover=reading.recover,
        max_chunk_bytes=reading.max_chunk_bytes,
        max_pipe_bytes=reading.max_pipe_bytes,
        max_ratio=reading.max_ratio,
    ) as opened:
        document = describe(opened, reading, sensors)
        if doctor or reading.map or contract:
            document["health"] = _health(opened)
        if doctor or reading.map:
            _look_for_fields(opened, document)
            document["inputs"] = _inputs(opened, document, reading, sensors)
        if contract:
            document["contract"] = _judged(contract, document)
    if talk.json:
        console.document("info", document)
    else:
        show(console, document)
    keeps = all(verdict["holds"] for verdict in document.get("contract", ()))
    return EXIT_DONE if keeps else EXIT_GATE_FAILED


def describe(log: Log, reading: ReadingOptions, sensors: SensorOptions) -> Document:
    """What `--json` prints."""
    from cwcli.channels.binding import EVERY_ROLE, bind, parse_overrides
    from cwcli.channels.reasons import reasons

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
        for binding in (each for one in bound for each in (one, *one.parts)):
            roles.setdefault(binding.topic, []).append(str(role))
    why = reasons(log.channels, bindings)
    if reading.dbc:
        _explain_can_channels(log, why, reading.dbc)
    duration_s = max(log.end_ns - log.start_ns, 0) / NS_PER_S
    return {
        "name": log.name,
        "size_bytes": sum(map(len, log.file.files)),
        "profile": log.profile,
        "library": _container(log) or log.library,
        "start_ns": log.start_ns,
        "end_ns": log.end_ns,
        "start": utc(log.start_ns),
        "duration_s": duration_s,
        "messages": log.n_messages,
        "chunks": log.n_chunks,
        "compression": [] if _container(log) else list(log.compressions),
        "channels": [
            _channel(channel, duration_s, roles.get(channel.topic, []), why.get(channel.topic))
            for channel in log.channels
        ],
        "attachments": [{"name": entry.name, "size_bytes": entry.size} for entry in log.attachments],
        "metadata": list(log.metadata_names),
        "commands": _commands(set(map(str, bindings.by_role)), set(map(str, bindings.undecided))),
        "notes": [*bindings.notes, *_of_stations(log, bindings)],
        "faults": log.faults.counts(),
    }


def _container(log: Log) -> str:
    """What the log was converted from when it was opened, by the first of its files; "" for an MCAP file."""
    from cwcli.logs.read.converted import BAG_MAGIC, DATABASE_MAGIC

    head = bytes(log.file.files[0][:16])
    kinds = {BAG_MAGIC: "converted from a ROS 1 bag", DATABASE_MAGIC: "converted from a rosbag2 database"}
    return next((words for magic, words in kinds.items() if head.startswith(magic)), "")


def _explain_can_channels(log: Log, why: dict[str, Reason], files: list[str]) -> None:
    """Say of each channel of CAN frames without a role which signals of the DBC files a role could take."""
    from cwcli.channels.reasons import explain_can_frames
    from cwcli.signals.can import list_signals
    from cwcli.signals.input_rows import CAN_SCHEMAS
    from cwcli.signals.inputs import normalise

    signals = list_signals(files)
    for channel in log.channels:
        if channel.topic in why and channel.message_count and normalise(channel.schema_name) in CAN_SCHEMAS:
            why[channel.topic] = explain_can_frames(channel.topic, signals, files)


def _of_stations(log: Log, bindings: Bindings) -> list[str]:
    """What to say of a log without the ego's position whose radios may have heard it."""
    from cwcli.pipeline.stations import MOST_NAMED, stations_heard
    from cwcli.signals.inputs import input_for
    from cwcli.signals.role import Role
    from cwcli.text import printable

    role = Role.EGO_POSITION
    if role in bindings or role in bindings.undecided:
        return []
    entries = {each.topic: input_for(role, each.schema_name) for each in log.channels if each.message_count != 0}
    topics = [topic for topic, entry in entries.items() if entry is not None and entry.needs_ego_station]
    if not topics:
        return []
    heard = stations_heard(log).most_common(MOST_NAMED)
    named = " or ".join(printable(station) for station, _ in heard) or "ID"
    return [f"a station of {', '.join(topics)} can be the ego: --ego-station {named}"]


def _channel(channel: Any, duration_s: float, roles: list[str], reason: Reason | None) -> Document:
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
        "try": [] if reason is None else list(reason.tries),
    }


def _health(log: Log) -> list[Document]:
    """The health of each topic with messages, but cwcli's own, as numbers; None where one is not known."""
    from cwcli.channels.published import OWN_PREFIX
    from cwcli.pipeline.health import examine

    topics = dict.fromkeys(each.topic for each in log.channels if each.message_count != 0)
    found = examine(log, [topic for topic in topics if not topic.startswith(OWN_PREFIX)])
    return [{name: _known(value) for name, value in asdict(each).items()} for each in found]


def _look_for_fields(log: Log, document: Document) -> None:
    """What to try for a type that no role takes, by the fields of its messages where no definition lists them."""
    from cwcli.channels.reasons import MAX_TRIES, UNKNOWN_TYPE, suggestions
    from cwcli.errors import CwcliError
    from cwcli.signals.columns import Strings

    for channel in document["channels"]:
        if channel["why_not"] != UNKNOWN_TYPE or channel["try"]:
            continue
        try:
            fields = log.columns(channel["topic"]).fields
        except CwcliError as error:
            channel["why_not"] = f"{UNKNOWN_TYPE}, and it can't be read: {error.what}"
            continue
        paths = [path for path, field in fields.items() if not isinstance(field, Strings)]
        channel["try"] = list(suggestions(channel["topic"], paths))[:MAX_TRIES]


def _known(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _inputs(log: Log, document: Document, reading: ReadingOptions, sensors: SensorOptions) -> list[Document]:
    """What of the channels with a role can be used."""
    from cwcli.channels.binding import parse_overrides
    from cwcli.signals.role import Role
    from cwcli.stages.inputs.sources import SourceConfig, read_sources

    config = SourceConfig(clock=sensors.clock, ego_station=sensors.ego_station, topics=parse_overrides(reading.topics))
    filled = {role for channel in document["channels"] for role in channel["roles"]}
    sources = read_sources(
        log, config, command="info", optional=[role for role in Role if role in filled and role.signals]
    )
    document["notes"] += [note for note in sources.notes if note not in document["notes"]]
    names = ("topic", "role", "read", "used", "rejected", "repaired", "set_aside")
    return [{name: getattr(each, name) for name in names} for each in sources.counts()]


def _contract(path: str) -> RecordingContract:
    from cwcli.channels.binding import EVERY_ROLE
    from cwcli.pipeline.recording_contract import RecordingContract

    return RecordingContract.read(path, EVERY_ROLE)


def _judged(contract: RecordingContract, document: Document) -> list[Document]:
    from cwcli.signals.inputs import normalise

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
    wanted = {each.get("schema", "") for each in contract.topics.values()}
    verdicts = contract.judge(
        totals={"duration_s": document["duration_s"], "messages": document["messages"]},
        roles={role for channel in document["channels"] for role in channel["roles"]},
        schemas={topic: name if name in wanted else normalise(name) for topic, name in schemas.items()},
        topics={topic: health.get(topic, absent) for topic in schemas},
    )
    return [each._asdict() for each in verdicts]


def _commands(bound: set[str], undecided: set[str]) -> Document:
    from cwcli.pipeline.needs import readiness
    from cwcli.stages import STAGES

    return {
        entry.stage.name: {
            "ready": entry.is_ready,
            "after": list(entry.after),
            "missing": [role for role in entry.missing if role not in undecided],
            "choose": [role for role in entry.missing if role in undecided],
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
    unused = [each for each in document["channels"] if each["why_not"]]
    if unused:
        console.summary(table(("topic", "why it is not used"), [(each["topic"], each["why_not"]) for each in unused]))
        for line in dict.fromkeys(f"try: {line}" for each in unused for line in each["try"]):
            console.summary(line)
        console.summary("")
    _show_read(console, document)
    console.summary(table(("command", "can run", "not in the log"), _command_rows(document["commands"])))
    for note in document["notes"]:
        console.note(note)
    for fault, n in document["faults"].items():
        console.note(f"{fault}: {n}")


def _show_read(console: Console, document: Document) -> None:
    """What needed the messages to be read."""
    if "health" in document:
        heads = ("topic", "rate [Hz]", "gaps", "longest [s]", "delay [ms]", "drift [ms/min]", "out of order", "bad")
        rows = [
            (
                *(each["topic"], _shown(each["rate_hz"], 1), each["gaps"], _shown(each["longest_gap_s"], 2)),
                *(_shown(each["delay_s"], 1, 1e3), _shown(each["drift_ms_per_min"], 1), each["out_of_order"]),
                "all" if each["undecodable"] < 0 else each["undecodable"],
            )
            for each in document["health"]
        ]
        console.summary(table(heads, rows))
        console.summary("")
    if document.get("inputs"):
        counts = [
            (each["topic"], each["role"], each["read"], each["used"], _reasons(each)) for each in document["inputs"]
        ]
        console.summary(table(("topic", "role", "read", "used", "else"), counts))
        console.summary("")
    if "contract" in document:
        judged = [
            (each["about"], each["condition"], each["found"], "kept" if each["holds"] else "BROKEN")
            for each in document["contract"]
        ]
        console.summary(table(("of", "contract", "found", "verdict"), judged))
        console.summary("")


def _shown(value: float | None, digits: int, factor: float = 1.0) -> str | None:
    return None if value is None else f"{factor * value:.{digits}f}"


def _reasons(counted: Document) -> str:
    found = {**counted["rejected"], **counted["repaired"], **counted["set_aside"]}
    return ", ".join(f"{n} {reason}" for reason, n in found.items()) or "-"


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
        if entry["missing"] or entry["choose"]:
            if not STAGES[name].instead_of:
                lacks = [f"needs {join_names(entry['missing'])}"] if entry["missing"] else []
                lacks += [f"has several for {join_names(entry['choose'])}"] if entry["choose"] else []
                rows.append((name, "no", ", ".join(lacks)))
            continue
        answer = "yes" if entry["ready"] else f"after {join_names(entry['after'])}"
        rows.append((name, answer, f"could use {join_names(entry['would_use'])}" if entry["would_use"] else "-"))
    return rows
