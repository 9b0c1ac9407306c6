"""The shared options: one name, one meaning, everywhere."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import typer

if TYPE_CHECKING:
    from cwcli.estimation.calibration import Calibration
    from cwcli.pipeline.channel_choice import ChannelChoice

MEGABYTE = 1_000_000
GIGABYTE = 1_000_000_000
_INPUT, _OUTPUT = "Input", "Output"  # headings of the help

LogArgument = Annotated[str, typer.Argument(metavar="LOG", show_default=False, help="MCAP file; - is standard input.")]
LogsArgument = Annotated[
    list[str],
    typer.Argument(
        metavar="LOG",
        show_default=False,
        help="MCAP files, folders of them, patterns or URLs; - is standard input (without -d).",
    ),
]


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
            help="What the CAN frames of --map mean (needs the extra cwcli[can]). Repeatable.",
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
    recover: Annotated[
        bool, typer.Option("--recover", help="Read what is intact of a damaged log and say how much was lost.")
    ] = False
    max_chunk: Annotated[
        int,
        typer.Option(
            "--max-chunk",
            metavar="MB",
            min=1,
            help="A chunk of the log that unpacks to more than this many megabytes is damaged, or an attack.",
        ),
    ] = 256
    max_input: Annotated[
        float,
        typer.Option(
            "--max-input",
            metavar="GB",
            min=0,
            help="Most that is taken from a pipe, which is copied to a temporary file.",
        ),
    ] = 64
    strict: Annotated[bool, typer.Option("--strict", help="Rejected or repaired data is an error (exit code 5).")] = (
        False
    )

    @property
    def topics(self) -> list[str]:
        """`--topic`, and `--map` with the files of `--dbc`.

        Raises:
            UsageError: A mapping names no field, or a role that has none.
        """
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
            help="V2X station id of the ego vehicle, so that its own messages are not a remote vehicle.",
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
