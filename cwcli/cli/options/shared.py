"""The shared options: one name, one meaning, everywhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import typer

from cwcli.cli.options.complete import role_topics
from cwcli.errors import UsageError

if TYPE_CHECKING:
    from cwcli.estimation.calibration import Calibration
    from cwcli.logs.read.source import Source
    from cwcli.pipeline.channel_choice import ChannelChoice

MEGABYTE = 1_000_000
GIGABYTE = 1_000_000_000
MAX_CHUNK_MB, MAX_RATIO, MAX_INPUT_GB = 256, 64, 64
NO_LIMIT = 1_000_000
"""Largest value of the three: a TB a chunk, a PB of input. More bounds nothing, and may be too many bytes to count."""
_INPUT, _OUTPUT = "Input", "Output"  # headings of the help

LogArgument = Annotated[
    list[str],
    typer.Argument(
        metavar="LOG",
        show_default=False,
        help="MCAP file, folder of a recording, or URL; - is standard input. With --as-one several, the parts of one.",
    ),
]
LogsArgument = Annotated[
    list[str],
    typer.Argument(
        metavar="LOG",
        show_default=False,
        help="MCAP files, folders of them, patterns or URLs; - is standard input (without -d).",
    ),
]
AsOneOption = Annotated[
    bool, typer.Option("--as-one", help="The logs that are named, or lie in the folder, are the parts of one log.")
]

MaxChunkOption = Annotated[
    int,
    typer.Option(
        "--max-chunk",
        metavar="MB",
        min=1,
        max=NO_LIMIT,
        help="A chunk of the log that unpacks to more than this many megabytes is damaged, or an attack.",
    ),
]
MaxRatioOption = Annotated[
    float,
    typer.Option(
        "--max-ratio",
        metavar="TIMES",
        min=0,
        max=NO_LIMIT,
        help="All chunks may unpack to one of --max-chunk and so many times the log's size; the others are damaged.",
    ),
]
MaxInputOption = Annotated[
    float,
    typer.Option(
        "--max-input",
        metavar="GB",
        min=0,
        max=NO_LIMIT,
        help="Most that comes out of a pipe, a URL or a compressed file: it is copied to a temporary file first.",
    ),
]


def one_log(logs: Sequence[str], as_one: bool) -> Source:
    """The log that a command takes: the only one, or the one that consists of all.

    Raises:
        UsageError: There are several, and not `as_one`.
    """
    if as_one:
        return tuple(logs)
    if len(logs) > 1:
        raise UsageError(
            f"{len(logs)} logs are named, and this takes one", hint="--as-one takes them as the parts of one log"
        )
    return logs[0]


def names_of(source: Source) -> list[str]:
    """The names of a log, or of its parts."""
    return [str(source)] if isinstance(source, str | Path) else list(source)


@dataclass(frozen=True)
class ReadingOptions:
    """How the input is read, and which part of it is used."""

    heading: ClassVar[str] = _INPUT
    topic: Annotated[
        list[str],
        typer.Option(
            "--topic",
            metavar="ROLE=/NAME",
            show_default=False,
            autocompletion=role_topics,
            help="Use this topic for a role, e.g. ego_position=/gps/fix. Repeatable.",
        ),
    ] = field(default_factory=list)
    map: Annotated[
        list[str],
        typer.Option(
            "--map",
            metavar="ROLE=/NAME:FIELD",
            show_default=False,
            help="Use this field for a role, with a unit or a factor, e.g. ego_speed=/status:speed*kmh. Repeatable.",
        ),
    ] = field(default_factory=list)
    dbc: Annotated[
        list[str],
        typer.Option(
            "--dbc",
            metavar="FILE",
            show_default=False,
            help="What the CAN frames of --map mean (needs the extra cwcli-drive[can]). Repeatable.",
        ),
    ] = field(default_factory=list)
    start: Annotated[
        str | None,
        typer.Option(
            "--start",
            metavar="TIME",
            show_default=False,
            help="Use messages from here on: seconds from the log's start, or ISO 8601 (UTC if it names no zone).",
        ),
    ] = None
    end: Annotated[
        str | None,
        typer.Option("--end", metavar="TIME", show_default=False, help="Use messages before here; as --start."),
    ] = None
    as_one: AsOneOption = False
    recover: Annotated[
        bool, typer.Option("--recover", help="Read what is intact of a damaged log and say how much was lost.")
    ] = False
    max_chunk: MaxChunkOption = MAX_CHUNK_MB
    max_ratio: MaxRatioOption = MAX_RATIO
    max_input: MaxInputOption = MAX_INPUT_GB
    strict: Annotated[
        bool,
        typer.Option(
            "--strict", help="Rejected or repaired data, or sources that contradict each other: an error (exit code 5)."
        ),
    ] = False

    @property
    def topics(self) -> list[str]:
        """`--topic`, and `--map` with the files of `--dbc`.

        Raises:
            UsageError: A mapping names no field, or a role that has none.
        """
        if not self.map:
            return list(self.topic)
        from cwcli.signals.mapping import with_files

        return [*self.topic, *with_files(self.map, self.dbc)]

    @property
    def max_chunk_bytes(self) -> int:
        """`--max-chunk`."""
        return self.max_chunk * MEGABYTE

    @property
    def max_pipe_bytes(self) -> int:
        """`--max-input`."""
        return int(self.max_input * GIGABYTE)


@dataclass(frozen=True)
class SensorOptions:
    """How the sensors' own messages are read: for the commands that use them."""

    heading: ClassVar[str] = _INPUT
    clock: Annotated[
        Literal["stamp", "log"],
        typer.Option("--clock", help="Time of a measurement: its header stamp, or when it was logged."),
    ] = "stamp"
    ego_station: Annotated[
        str | None,
        typer.Option(
            "--ego-station",
            metavar="ID",
            show_default=False,
            help="The ego's own id, so that it is not a remote vehicle: of its V2X messages, or in OSI traces.",
        ),
    ] = None


@dataclass(frozen=True)
class CalibrationOptions:
    """What is known of the sensors beforehand: for the commands that use it."""

    heading: ClassVar[str] = _INPUT
    calibration: Annotated[
        str | None,
        typer.Option(
            "--calibration",
            metavar="FILE",
            show_default=False,
            help="Constants of the car's sensors from other drives, made by `cwcli calibrate`.",
        ),
    ] = None

    def load(self) -> Calibration | None:
        """The calibration, if one was named.

        Raises:
            UsageError: The file's content is wrong.
            InputError: The file can't be read.
        """
        if self.calibration is None:
            return None
        from cwcli.estimation.calibration import load_calibration

        return load_calibration(self.calibration)


OutputOption = Annotated[
    str | None,
    typer.Option(
        "--output",
        "-o",
        metavar="FILE",
        show_default=False,
        help="Write the log with the new channels here; - is standard output.",
    ),
]
ForceOption = Annotated[bool, typer.Option("--force", "-f", help="Overwrite files that exist.")]


def _topics(incomplete: str) -> list[str]:
    from cwcli.channels.published import topics

    return [topic for topic in topics() if topic.startswith(incomplete)]


@dataclass(frozen=True)
class WritingOptions:
    """Where the annotated log goes."""

    heading: ClassVar[str] = _OUTPUT
    output: OutputOption = None
    replace: Annotated[
        bool, typer.Option("--replace", help="Leave out channels of an earlier run that the new ones replace.")
    ] = False
    split: Annotated[
        Literal["one", "like-input"],
        typer.Option(
            "--split",
            help="One file, or the parts in which the log came into the folder that -o names.",
        ),
    ] = "one"
    force: ForceOption = False
    channels: Annotated[
        list[str],
        typer.Option(
            "--channels",
            metavar="/NAME",
            show_default="all",
            autocompletion=_topics,
            help="Of the new channels, these alone are written; * is any part, several with commas. Repeatable.",
        ),
    ] = field(default_factory=list)

    @property
    def choice(self) -> ChannelChoice:
        """`--channels`."""
        from cwcli.pipeline.channel_choice import ChannelChoice

        return ChannelChoice.parse(self.channels)

    @property
    def is_folder(self) -> bool:
        """Whether the output is a folder of parts."""
        return self.output is not None and self.split == "like-input"


MetricsOption = Annotated[
    str | None,
    typer.Option(
        "--metrics",
        metavar="FILE",
        show_default=False,
        rich_help_panel=_OUTPUT,
        help="Write the metrics table here (.parquet or .csv).",
    ),
]
MetricsDirOption = Annotated[
    str | None,
    typer.Option(
        "--metrics-dir",
        metavar="DIR",
        show_default=False,
        rich_help_panel=_OUTPUT,
        help="Write every table of every stage into this folder, as Parquet.",
    ),
]
