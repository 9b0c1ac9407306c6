"""An opened log, on which stages run (`cwcli.open`)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Literal, Self

from cwcli.errors import UsageError
from cwcli.input import MAX_CHUNK_BYTES, MAX_UNPACKED_TO_STORED_SIZE_RATIO
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read import reader
from cwcli.logs.read.read_bounds import DEFAULT_MAX_INPUT_BYTES_OF_PIPE_OR_URL, DEFAULT_TIMEOUT_S
from cwcli.logs.read.source import Source

if TYPE_CHECKING:
    import pyarrow as pa

    from cwcli.input import InputFile
    from cwcli.library.options import StageOptions
    from cwcli.library.result import Result
    from cwcli.pipeline.call import Call, Selection
    from cwcli.pipeline.execute import RunRules


@dataclass(frozen=True)
class Limits:
    """What a log may cost; what exceeds a limit counts as damage or as an attack.

    Attributes:
        max_chunk_bytes: Greatest size of a chunk of messages, stored or unpacked.
        max_input_bytes: Greatest number of bytes that come out of a pipe, a URL or a compressed file.
        max_ratio: Greatest total size of the unpacked chunks, as a multiple of the file's size (plus one chunk).
        timeout_s: Longest time in seconds in which a remote file must go on.
    """

    max_chunk_bytes: int = MAX_CHUNK_BYTES
    max_input_bytes: int = DEFAULT_MAX_INPUT_BYTES_OF_PIPE_OR_URL
    max_ratio: float = MAX_UNPACKED_TO_STORED_SIZE_RATIO
    timeout_s: float = DEFAULT_TIMEOUT_S


DEFAULT_LIMITS = Limits()
"""The limits of the command line."""


class Log:
    """A log that `cwcli.open` has opened; also a context manager.

    Attributes:
        name: File name as given, or `<stdin>`.
        start_ns, end_ns: First and last log time of its messages, ns since the epoch; 0 if there is none.
        n_messages: Number of its messages.
        topics: Topics of its channels, in the file's order.
    """

    def __init__(self, reader_log: reader.Log, selection: Selection) -> None:
        self._log = reader_log
        self._selection = selection
        self._is_closed = False
        self.name: str = reader_log.name
        self.start_ns: int = reader_log.start_ns
        self.end_ns: int = reader_log.end_ns
        self.n_messages: int = reader_log.n_messages
        self.topics: tuple[str, ...] = tuple(dict.fromkeys(channel.topic for channel in reader_log.channels))

    def run(
        self,
        *stages: str,
        options: StageOptions | None = None,
        clock: Literal["stamp", "log"] = "stamp",
        ego_station: str | None = None,
        calibration: str | Path | None = None,
        strict: bool = False,
        progress: Callable[[str], None] | None = None,
    ) -> Result:
        """Run stages on the log; each sees the channels of those before it. Nothing is written.

        Args:
            stages: Names of stages, which run in the order of the pipeline; each of them must find its signals. None
                named: as `cwcli run`, every default stage that the log has the signals for.
            options: Stage -> its options, with the names and values of the configuration file.
            clock: Time of a measurement: its header stamp, or when it was logged.
            ego_station: The ego's own id in V2X messages.
            calibration: File with the constants of the car's sensors, made by `cwcli calibrate`.
            strict: Rejected or repaired data, or sources that contradict each other, are an error.
            progress: Called with a text when a step begins.

        Raises:
            UsageError: A stage or an option does not exist, or a value is wrong.
            MissingSignalError: The log lacks a signal that a named stage needs, or nothing can run.
            InputError: The log is damaged, or changed while it was read.
            DataError: The data breaks its contract.
        """
        from cwcli.library.options import plan_named_stages, sensor_reading_from_options

        reading = sensor_reading_from_options(clock, ego_station, calibration)
        calls, rules = plan_named_stages(stages, options or {}, reading, strict=strict)
        return self.run_calls(calls, rules, progress)

    def run_calls(
        self, calls: Mapping[str, Call], rules: RunRules, progress: Callable[[str], None] | None = None
    ) -> Result:
        """Run configured stages on the log; `run` and the commands come here.

        Args:
            calls: Name -> configured stage, in order.
            rules: Which stages are left out, what is an error, and what will be written.
            progress: Called with a text when a step begins.

        Raises:
            CwcliError: As `run` does.
        """
        from cwcli.array_memory import bounded_array_memory
        from cwcli.library.result import Result
        from cwcli.pipeline.execute import run_stages

        self.require_open()
        with bounded_array_memory():
            outcome, annotated = run_stages(
                self._log,
                calls,
                self._selection,
                skip=rules.skip,
                strict=rules.strict,
                choice=rules.choice,
                step=progress or _ignore_step_name,
            )
        for file in self._log.file.disk_files:
            file.check_unchanged()
        return Result(self.require_open, annotated, outcome, rules.choice)

    def table(self, topic: str) -> pa.Table:
        """Read a channel as an Arrow table, one row a message; times are int64, ns since the epoch.

        Raises:
            MissingSignalError: There is no such channel.
            InputError: It can't be decoded, or the log is damaged.
        """
        from cwcli.library.tables import arrow_table_of_topic

        self.require_open()
        return arrow_table_of_topic(self._log, topic, self._selection)

    def close(self) -> None:
        """Close the file. Results stay readable, but can't be saved any more."""
        self._is_closed = True
        self._log.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the log; raises `InputError` if the file changed while it was read."""
        self._is_closed = True
        self._log.__exit__(kind, error, trace)

    def __repr__(self) -> str:
        return f"<cwcli.Log {self.name!r}: {self.n_messages} messages, {len(self.topics)} topics>"

    def require_open(self) -> None:
        """Raise `UsageError` if the log is closed."""
        if self._is_closed:
            raise UsageError("the log is closed", where=self.name, hint="open it again with cwcli.open")


def open_log(
    source: Source,
    *,
    topics: Mapping[str, str] | None = None,
    dbc: Sequence[str] = (),
    start: float | str | None = None,
    end: float | str | None = None,
    recover: bool = False,
    limits: Limits = DEFAULT_LIMITS,
) -> Log:
    """Open a log: an MCAP file, the folder of a recording, a URL, or several parts of one log.

    Args:
        source: Name of the log, or a list of the names of its parts.
        topics: Role -> topic to use for it, as `--topic` takes it: `{"ego_position": "/gps/fix"}`; with
            `/topic:field*unit` a field, as `--map` takes it.
        dbc: Files that say what the CAN frames of `topics` mean.
        start, end: Use messages from here, and before here: seconds from the log's start, or ISO 8601.
        recover: Read what is intact of a damaged log.
        limits: What the log may cost.

    Raises:
        InputError: It can't be read, or is damaged.
        UsageError: A topic choice or a time is wrong.
    """
    choices = role_options_with_dbc_files(topics or {}, dbc)
    return open_log_with_choices_and_span(source, choices, (start, end), recover=recover, limits=limits)


def open_log_with_choices_and_span(
    source: Source | InputFile,
    choices: Sequence[str],
    span: tuple[float | str | None, float | str | None],
    *,
    recover: bool,
    limits: Limits,
) -> Log:
    """Open a log and the part of it that is used; `cwcli.open` and the commands come here.

    Args:
        source: As in `open_log`, or a file that is open already.
        choices: `ROLE=/topic` or `ROLE=/topic:field` of each topic that the user chose.
        span: Start and end, as in `open_log`.
        recover: Read what is intact of a damaged log.
        limits: What the log may cost.

    Raises:
        CwcliError: As `open_log` does.
    """
    from cwcli.pipeline.selection import resolve_selection

    names = [str(name) for name in source] if isinstance(source, Sequence) and not isinstance(source, str) else source
    opened = reader.Log.open(
        names,
        recover=recover,
        max_chunk_bytes=limits.max_chunk_bytes,
        max_pipe_bytes=limits.max_input_bytes,
        max_ratio=limits.max_ratio,
        timeout_s=limits.timeout_s,
    )
    start, end = (None if time is None else str(time) for time in span)
    try:
        return Log(opened, resolve_selection(opened, choices, start, end))
    except BaseException:
        opened.close()
        raise


def role_options_with_dbc_files(topics: Mapping[str, str], dbc: Iterable[str]) -> list[str]:
    """Return `ROLE=/topic` of each choice; those with a field get the DBC files.

    Raises:
        UsageError: A role does not exist, or its fields can't be mapped.
    """
    from cwcli.channels.binding import check_topic_overrides, does_override_name_message_fields

    check_topic_overrides(topics, "topics:")
    files = list(map(str, dbc))
    fields = [
        f"{role}={text}" for role, text in topics.items() if files and does_override_name_message_fields(role, text)
    ]
    named = [f"{role}={text}" for role, text in topics.items() if f"{role}={text}" not in fields]
    if not fields:
        return named
    from cwcli.signals.mapping import merge_mapping_options

    return [*named, *merge_mapping_options(fields, files, "topics:")]


def _ignore_step_name(text: str) -> None:
    """Take the name of a step and show nothing."""
