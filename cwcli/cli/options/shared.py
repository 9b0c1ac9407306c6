"""The options that commands share; each has the same name and meaning everywhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from cwcli.cli.options import lazy_typer as typer
from cwcli.cli.options.complete import complete_role_topics
from cwcli.errors import UsageError
from cwcli.lazy_dataclass import dataclass

if TYPE_CHECKING:
    from cwcli.estimation.calibration import Calibration
    from cwcli.library.log import Limits
    from cwcli.logs.read.reader import Log
    from cwcli.logs.read.source import Source
    from cwcli.pipeline.channel_choice import ChannelChoice

BYTES_PER_MEGABYTE = 1_000_000
"""Bytes in a megabyte, as `--max-chunk` counts."""
BYTES_PER_GIGABYTE = 1_000_000_000
"""Bytes in a gigabyte, as `--max-input` counts."""
DEFAULT_MAX_CHUNK_MB, DEFAULT_MAX_UNPACKED_TO_LOG_SIZE_RATIO, DEFAULT_MAX_INPUT_GB = 256, 64, 64
"""Defaults of `--max-chunk` in MB, `--max-ratio` as a factor, and `--max-input` in GB; chosen by hand."""
DEFAULT_TIMEOUT_S = 60.0
"""Default of `--timeout` in seconds; chosen by hand."""
LARGEST_LIMIT_OPTION_VALUE = 1_000_000
"""Largest value of these options; chosen: larger ones bound nothing and their bytes could overflow."""
_INPUT_HEADING, _OUTPUT_HEADING = "Input", "Output"
"""Headings of groups of options in the help."""

LogArgument = Annotated[
    list[str],
    typer.Argument(
        metavar="LOG",
        help="MCAP file, folder of a recording, or URL; - is standard input. With --as-one: all parts of one log.",
    ),
]
LogsArgument = Annotated[
    list[str],
    typer.Argument(
        metavar="LOG", help="MCAP files, folders of them, patterns or URLs; - is standard input (without -d)."
    ),
]
StartOption = Annotated[
    str | None,
    typer.Option(
        "--start",
        metavar="TIME",
        help="Use messages from this time on: seconds from the log's start, or ISO 8601 (UTC if it names no zone).",
    ),
]
EndOption = Annotated[
    str | None, typer.Option("--end", metavar="TIME", help="Use messages before this time, written as for --start.")
]
AsOneOption = Annotated[
    bool, typer.Option("--as-one", help="Read the named logs, or those in the folder, as the parts of one log.")
]

MaxChunkOption = Annotated[
    int,
    typer.Option(
        "--max-chunk",
        metavar="MB",
        min=1,
        max=LARGEST_LIMIT_OPTION_VALUE,
        help="Refuse a chunk of the log that unpacks to more than this many megabytes.",
    ),
]
MaxRatioOption = Annotated[
    float,
    typer.Option(
        "--max-ratio",
        metavar="TIMES",
        min=0,
        max=LARGEST_LIMIT_OPTION_VALUE,
        help="Refuse chunks beyond a total of --max-chunk plus this many times the log's size, unpacked.",
    ),
]
MaxInputOption = Annotated[
    float,
    typer.Option(
        "--max-input",
        metavar="GB",
        min=0,
        max=LARGEST_LIMIT_OPTION_VALUE,
        help="Largest content of a pipe, a URL or a compressed file, which is first copied to a temporary file.",
    ),
]
TimeoutOption = Annotated[
    float,
    typer.Option(
        "--timeout",
        metavar="S",
        min=0.1,
        max=LARGEST_LIMIT_OPTION_VALUE,
        help="Give up a URL that sends nothing for this many seconds.",
    ),
]


def source_of_logs(logs: Sequence[str], as_one: bool) -> Source:
    """The source that a command reads: the only log, or all logs as the parts of one.

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


def source_names(source: Source) -> list[str]:
    """List the names of a log or of its parts."""
    return [str(source)] if isinstance(source, str | Path) else list(source)


class LogLimits:
    """How a log is opened, by the values of `--recover`, `--max-chunk`, `--max-input`, `--max-ratio`, `--timeout`."""

    recover: bool
    max_chunk: int
    max_ratio: float
    max_input: float
    timeout: float

    @property
    def resource_limits(self) -> Limits:
        """What a log may cost."""
        from cwcli.library.log import Limits

        return Limits(self.max_chunk_bytes, self.max_pipe_bytes, self.max_ratio, self.timeout)

    @property
    def max_chunk_bytes(self) -> int:
        """The value of `--max-chunk` in bytes."""
        return self.max_chunk * BYTES_PER_MEGABYTE

    @property
    def max_pipe_bytes(self) -> int:
        """The value of `--max-input` in bytes."""
        return int(self.max_input * BYTES_PER_GIGABYTE)

    def open_log(self, source: Source) -> Log:
        """Open a log with these limits; raises as `Log.open` does."""
        from cwcli.logs.read.reader import Log

        return Log.open(
            source,
            recover=self.recover,
            max_chunk_bytes=self.max_chunk_bytes,
            max_pipe_bytes=self.max_pipe_bytes,
            max_ratio=self.max_ratio,
            timeout_s=self.timeout,
        )


@dataclass(frozen=True)
class ReadingOptions(LogLimits):
    """Options of reading a log: topics, time span and limits."""

    heading: ClassVar[str] = _INPUT_HEADING
    topic: Annotated[
        list[str],
        typer.Option(
            "--topic",
            metavar="ROLE=/NAME",
            autocompletion=complete_role_topics,
            help="Use this topic for a role, e.g. ego_position=/gps/fix. Repeatable.",
        ),
    ] = field(default_factory=list)
    map: Annotated[
        list[str],
        typer.Option(
            "--map",
            metavar="ROLE=/NAME:FIELD",
            help="Use this field for a role, with a unit or a factor, e.g. ego_speed=/status:speed*kmh. Repeatable.",
        ),
    ] = field(default_factory=list)
    dbc: Annotated[
        list[str],
        typer.Option(
            "--dbc",
            metavar="FILE",
            help="DBC file with the CAN messages that --map names (needs the extra cwcli-drive[can]). Repeatable.",
        ),
    ] = field(default_factory=list)
    start: StartOption = None
    end: EndOption = None
    as_one: AsOneOption = False
    recover: Annotated[
        bool, typer.Option("--recover", help="Read the intact parts of a damaged log and report how much was lost.")
    ] = False
    max_chunk: MaxChunkOption = DEFAULT_MAX_CHUNK_MB
    max_ratio: MaxRatioOption = DEFAULT_MAX_UNPACKED_TO_LOG_SIZE_RATIO
    max_input: MaxInputOption = DEFAULT_MAX_INPUT_GB
    timeout: TimeoutOption = DEFAULT_TIMEOUT_S
    strict: Annotated[
        bool,
        typer.Option(
            "--strict",
            help="End with an error (exit code 5) if data were rejected or repaired, or if sources were corrected "
            "or contradict each other.",
        ),
    ] = False

    @property
    def topics_and_mappings(self) -> list[str]:
        """The values of `--topic`, and those of `--map` with the files of `--dbc`.

        Raises:
            UsageError: A mapping names no field, or a role that has none.
        """
        if not self.map:
            return list(self.topic)
        from cwcli.signals.mapping import merge_mapping_options

        return [*self.topic, *merge_mapping_options(self.map, self.dbc)]


@dataclass(frozen=True)
class LimitOptions(LogLimits):
    """Damage and limits of logs."""

    heading: ClassVar[str] = _INPUT_HEADING
    recover: Annotated[
        bool, typer.Option("--recover", help="Read the intact parts of damaged logs and report how much was lost.")
    ] = False
    max_chunk: MaxChunkOption = DEFAULT_MAX_CHUNK_MB
    max_ratio: MaxRatioOption = DEFAULT_MAX_UNPACKED_TO_LOG_SIZE_RATIO
    max_input: MaxInputOption = DEFAULT_MAX_INPUT_GB
    timeout: TimeoutOption = DEFAULT_TIMEOUT_S


@dataclass(frozen=True)
class SensorOptions:
    """Options of reading sensor messages."""

    heading: ClassVar[str] = _INPUT_HEADING
    clock: Annotated[
        Literal["stamp", "log"],
        typer.Option(
            "--clock", help="Time of a measurement: stamp, the one in its header; log, when the recorder stored it."
        ),
    ] = "stamp"
    ego_station: Annotated[
        str | None,
        typer.Option(
            "--ego-station",
            metavar="ID",
            help="The ego's own id in V2X messages or OSI traces, so that it is not taken for a remote vehicle.",
        ),
    ] = None


@dataclass(frozen=True)
class CalibrationOptions:
    """Option for the constants of the car's sensors from earlier drives."""

    heading: ClassVar[str] = _INPUT_HEADING
    calibration: Annotated[
        str | None,
        typer.Option(
            "--calibration",
            metavar="FILE",
            help="Constants of the car's sensors, written by `cwcli calibrate` from other drives.",
        ),
    ] = None

    def load_if_named(self) -> Calibration | None:
        """Load the calibration file, or return None if none is named.

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
        "--output", "-o", metavar="FILE", help="Write the log with the new channels here; - is standard output."
    ),
]
ForceOption = Annotated[bool, typer.Option("--force", "-f", help="Overwrite files that exist.")]


def _complete_topics(incomplete: str) -> list[str]:
    from cwcli.channels.published import schema_name_by_published_topic

    return [topic for topic in schema_name_by_published_topic() if topic.startswith(incomplete)]


@dataclass(frozen=True)
class WritingOptions:
    """Options of writing the annotated log."""

    heading: ClassVar[str] = _OUTPUT_HEADING
    output: OutputOption = None
    replace: Annotated[bool, typer.Option("--replace", help="Replace the channels that an earlier run wrote.")] = False
    split: Annotated[
        Literal["one", "like-input"],
        typer.Option(
            "--split",
            help="one: write one file; like-input: write one file for each part of the input into the folder -o.",
        ),
    ] = "one"
    force: ForceOption = False
    channels: Annotated[
        list[str],
        typer.Option(
            "--channels",
            metavar="/NAME",
            show_default="all",
            autocompletion=_complete_topics,
            help="Limit the new channels to these; * stands for any characters; separate several by commas. "
            "Repeatable.",
        ),
    ] = field(default_factory=list)

    @property
    def channel_choice(self) -> ChannelChoice:
        """The channels to write, parsed from `--channels`."""
        from cwcli.pipeline.channel_choice import ChannelChoice

        return ChannelChoice.parse(self.channels)

    @property
    def is_folder_of_parts(self) -> bool:
        """Whether the output is a folder of parts."""
        return self.output is not None and self.split == "like-input"


MetricsOption = Annotated[
    str | None,
    typer.Option(
        "--metrics",
        metavar="FILE",
        rich_help_panel=_OUTPUT_HEADING,
        help="Write the metrics table here (.parquet or .csv).",
    ),
]
MetricsDirOption = Annotated[
    str | None,
    typer.Option(
        "--metrics-dir",
        metavar="DIR",
        rich_help_panel=_OUTPUT_HEADING,
        help="Write every table of every stage into this folder, as Parquet.",
    ),
]


@dataclass(frozen=True)
class RunInputOptions(CalibrationOptions, SensorOptions, ReadingOptions):
    """All options of what the stages of a run read."""


@dataclass(frozen=True)
class RunOutputOptions(WritingOptions):
    """All options of what a run on one log writes."""

    metrics_dir: MetricsDirOption = None


@dataclass(frozen=True)
class StageOutputOptions(WritingOptions):
    """All options of what the command of one stage writes."""

    metrics: MetricsOption = None
    metrics_dir: MetricsDirOption = None
