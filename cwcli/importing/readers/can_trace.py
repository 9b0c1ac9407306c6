"""CAN traces: ASC, BLF, candump and PEAK's TRC, read by `python-can`; a DBC file says what the frames mean.

Only messages with a signal that can be a quantity by its name are decoded. ASC and TRC traces count from their start;
the date in them or in a BLF file is local time without a zone, and is not used for ASC and TRC.
"""

from __future__ import annotations

import io
import logging
import re
from array import array
from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import Any

import numpy as np

from cwcli.errors import DataError, InputError, MissingSignalError, UsageError, install_hint
from cwcli.importing.names import COLUMN_WORDS_BY_QUANTITY, quantities_of_name
from cwcli.importing.readers.base import FileHead, ImportKind
from cwcli.importing.tables import Answers, Question, SourceTable
from cwcli.importing.text_file import iter_text_lines
from cwcli.importing.times import MAX_STAMP_NS
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.can import MAX_FRAME_BYTES, DbcMessage, decode_all_signals, load_dbc_messages
from cwcli.signals.resample import interpolate_signal_at_times
from cwcli.signals.units import NS_PER_S
from cwcli.text import format_count

CANDUMP_LINE_PATTERN = re.compile(r"^\(\d+\.\d+\)\s+\S+\s+[0-9A-Fa-f]{3,8}#")
"""Pattern of a line that `candump -l` writes: time, bus, identifier and data."""
SHOWN_CANDUMP_LINE_PATTERN = re.compile(
    r"^\s*(?P<time>\(\d{10}\.\d+\))\s+(?P<bus>\S+)\s+(?:[RT]X\s+\S\s+\S\s+)?(?P<id>[0-9A-F]{3}|[0-9A-F]{8})"
    r"\s+\[\d+\]\s*(?P<data>(?:[0-9A-F]{2}\s*)*|remote request)(?:'.*'\s*)?(?P<error>ERRORFRAME\s*)?$"
)
"""Pattern of a line that `candump -ta` shows on the screen, with the time since 1970."""
ASC_HEADER_PATTERN = re.compile(
    r"^(date\s|base\s+(hex|dec)\b|\d+\.\d+\s+(\d+|CANFD)\s+[0-9A-Fa-f]+x?\s+[RT]x)", re.IGNORECASE
)
"""A line near the start of an ASC trace."""
N_ASC_HEAD_LINES = 5
"""Number of lines at the start of an ASC trace in which it tells what its times count from. Chosen by hand."""
MAX_INTERPOLATED_LONGITUDE_GAP_S = 1.5
"""Longest gap between two frames of a longitude, s, across which it is put to the times of the latitude. Chosen by
hand: receivers give a place a second."""
BLF_MAGIC, TRC_FIRST_WORD = b"LOGG", ";$FILEVERSION"
"""First bytes of a BLF file, and of a TRC trace."""
TRC_DATE_WORD = ";$STARTTIME"
"""Word before the date of a TRC trace, in local time."""
MAX_CLASSIC_FRAME_BYTES = 8
"""Number of bytes beyond which a frame is one of CAN FD (ISO 11898-1)."""


@dataclass
class FramesOfMessage:
    """The frames of a message: n times in ns, their data padded to `MAX_FRAME_BYTES` each, and their lengths."""

    stamp_ns: array[int] = field(default_factory=lambda: array("q"))
    data: bytearray = field(default_factory=bytearray)
    n_octets: array[int] = field(default_factory=lambda: array("B"))


def accepts_candump(head: FileHead) -> bool:
    """Tell whether the lines are those of candump."""
    return bool(head.lines) and any(
        pattern.match(head.lines[0]) for pattern in (CANDUMP_LINE_PATTERN, SHOWN_CANDUMP_LINE_PATTERN)
    )


def accepts_trc(head: FileHead) -> bool:
    """Tell whether the lines are those of a TRC trace."""
    return bool(head.lines) and head.lines[0].startswith(TRC_FIRST_WORD)


def accepts_asc(head: FileHead) -> bool:
    """Tell whether the lines are those of an ASC trace."""
    lines = head.lines[:5]
    return sum(bool(ASC_HEADER_PATTERN.match(line)) for line in lines) >= 2


def accepts_blf(head: FileHead) -> bool:
    """Tell whether the file is a BLF trace."""
    return head.data.startswith(BLF_MAGIC)


def read_message_tables_of_trace(path: str, answers: Answers, kind: str) -> Sequence[SourceTable]:
    """Return a table of each message that has a signal which can be a quantity.

    Raises:
        AmbiguousError: No DBC file is named.
        MissingSignalError: None of its messages is in the trace, or none has a quantity.
        InputError: The trace is damaged.
        UsageError: A DBC file can't be read, or a package is missing.
    """
    if not answers.dbc:
        raise Question(
            path, "a CAN trace holds bytes; which signals they are is in a DBC file", "--dbc car.dbc"
        ).as_error()
    columns_by_user = {column for column, _ in answers.columns.values() if column}
    messages = {}
    for message in load_dbc_messages(answers.dbc):
        if any(_can_be_quantity(signal.name) or signal.name in columns_by_user for signal in message.signals):
            messages[message.frame_id, bool(message.is_extended_frame)] = message
    frames, n_frames, notes = _read_frames_by_message(path, kind, messages)
    found = [(messages[key], rows) for key, rows in frames.items() if rows.stamp_ns]
    if not found:
        names = tuple(sorted(message.name for message in messages.values()))
        raise MissingSignalError(
            f"none of its {n_frames} frames is a message of {', '.join(answers.dbc)} with a quantity",
            where=path,
            found=names[:20],
            hint="--dbc FILE names the file of this bus; --column QUANTITY=SIGNAL names a signal",
        )
    decoded = [(message, _decode_message(message, rows)) for message, rows in found]
    notes += _pair_places_of_different_frames([columns for _, columns in decoded])
    tables = [_build_table_of_message(path, kind, message, columns, messages) for message, columns in decoded]
    tables[0].notes.extend(notes)
    return tables


def _can_be_quantity(name: str) -> bool:
    return any(
        COLUMN_WORDS_BY_QUANTITY[quantity].kind not in {"time", "text", "number"}
        for quantity in quantities_of_name(name)
    )


def _decode_message(message: DbcMessage, frames: FramesOfMessage) -> dict[str, Any]:
    """Return the times of a message's frames in ns and their signals, (n,) each; NaN where a frame lacks a signal."""
    octets = np.frombuffer(frames.data, np.uint8).reshape(-1, MAX_FRAME_BYTES)
    n_octets = np.array(frames.n_octets, np.int64)
    values: dict[str, Any] = {"time": None} | decode_all_signals(octets, n_octets, message)
    values["time"] = np.array(frames.stamp_ns, np.int64)
    return values


def _build_table_of_message(
    path: str, kind: str, message: DbcMessage, columns: dict[str, Any], messages: Mapping[Any, DbcMessage]
) -> SourceTable:
    unit_by_signal = {
        signal.name: signal.unit or "" for each in (*messages.values(), message) for signal in each.signals
    }
    units = {"time": "ns", **{name: unit_by_signal[name] for name in columns if name != "time"}}
    return SourceTable.of_arrays(path, message.name, kind, columns, units=units)


def _pair_places_of_different_frames(tables: list[dict[str, Any]]) -> list[str]:
    """Put the longitude between its frames to the times of the latitude, where no frame holds both; return notes.

    It changes nothing where several signals can be either, or no latitude is valid.
    """
    signals = {
        quantity: [(table, name) for table in tables for name in table if quantities_of_name(name) == [quantity]]
        for quantity in ("latitude", "longitude")
    }
    if any(len(found) != 1 for found in signals.values()):
        return []
    (latitudes, latitude), (longitudes, longitude) = signals["latitude"][0], signals["longitude"][0]
    known, stamp_ns = np.isfinite(longitudes[longitude]), longitudes["time"]
    has_latitude = np.isfinite(latitudes[latitude])
    if not has_latitude.any() or (latitudes is longitudes and (known & has_latitude).any()):
        return []
    values = interpolate_signal_at_times(
        stamp_ns[known], longitudes.pop(longitude)[known], latitudes["time"], max_gap_s=MAX_INTERPOLATED_LONGITUDE_GAP_S
    )
    latitudes[longitude] = np.where(has_latitude, values, np.nan)
    return [f"{longitude} is put to the times of {latitude}, between its own frames"]


class _TraceLines(io.TextIOBase):
    """A text trace as python-can reads it: lines of a bounded length, with times from the start of the trace.

    Where an ASC trace says `timestamps relative`, each of its lines tells the time since the line before.
    """

    def __init__(self, path: str, kind: str) -> None:
        super().__init__()
        self._lines = iter_text_lines(path, "utf-8")
        if kind == "candump":
            self._lines = map(self._candump_line_as_in_a_file, self._lines)
        elif kind == "trc":
            self._lines = (line for line in self._lines if not line.startswith(TRC_DATE_WORD))
        self._n_head_lines_left = N_ASC_HEAD_LINES
        self._sum_us: int | None = None
        self._is_shown_on_screen = False
        self.n_lines_left_out = 0

    def _candump_line_as_in_a_file(self, line: str) -> str:
        """Return a line that candump shows on the screen as it writes it into a file; an empty one for no data."""
        found = SHOWN_CANDUMP_LINE_PATTERN.match(line)
        self._is_shown_on_screen |= found is not None
        if found is None and (not self._is_shown_on_screen or not line.strip() or CANDUMP_LINE_PATTERN.match(line)):
            return line
        if found is None or found["error"]:
            self.n_lines_left_out += 1
            return "\n"
        data = "R" if found["data"].startswith("remote") else "".join(found["data"].split())
        is_long = len(data) > 2 * MAX_CLASSIC_FRAME_BYTES
        return f"{found['time']} {found['bus']} {found['id']}{'##0' if is_long else '#'}{data}\n"

    def readline(self, size: int | None = -1, /) -> str:  # type: ignore[override]
        """Return the next line, "" at the end."""
        line = next(self._lines, "")
        if self._n_head_lines_left > 0:
            self._n_head_lines_left -= 1
            if re.search(r"\btimestamps\s+relative\b", line, re.IGNORECASE):
                self._sum_us = 0
                return re.sub(r"(timestamps\s+)relative", r"\1absolute", line, flags=re.IGNORECASE)
        if self._sum_us is None:
            return line
        found = re.match(r"\s*(\d{1,18})\.(\d{1,9})(?=\s)", line)
        if not found:
            return line
        self._sum_us += int(found.group(1)) * 1_000_000 + int(found.group(2).ljust(6, "0")[:6])
        return f"{self._sum_us // 1_000_000}.{self._sum_us % 1_000_000:06d}{line[found.end() :]}"

    def __next__(self) -> str:  # type: ignore[override]  # a text file gives lines of text
        """Return the next line."""
        if line := self.readline():
            return line
        raise StopIteration


def _read_frames_by_message(
    path: str, kind: str, messages: dict[tuple[int, bool], DbcMessage]
) -> tuple[dict[tuple[int, bool], FramesOfMessage], int, list[str]]:
    """Return the frames of each message by its identifier and whether it is extended, the number of all, and notes."""
    try:
        import can
    except ImportError as error:
        raise UsageError("CAN traces need python-can", hint=install_hint("import")) from error
    logging.getLogger("can").addHandler(logging.NullHandler())  # it warns of each line that it leaves out
    reader_of_kind = {
        "asc": can.ASCReader,
        "blf": can.BLFReader,
        "candump": can.CanutilsLogReader,
        "trc": can.TRCReader,
    }
    frames = {key: FramesOfMessage() for key in messages}
    n_frames = n_without_time = 0
    try:
        source = path if kind == "blf" else _TraceLines(path, kind)
        with reader_of_kind[kind](source) as reader:
            for frame in reader:
                n_frames += 1
                rows = frames.get((frame.arbitration_id, frame.is_extended_id))
                if rows is None or frame.is_error_frame or frame.is_remote_frame:
                    continue
                if not abs(frame.timestamp) < MAX_STAMP_NS / NS_PER_S:
                    n_without_time += 1
                    continue
                data = bytes(frame.data)[:MAX_FRAME_BYTES]
                rows.stamp_ns.append(round(frame.timestamp * 1e6) * (NS_PER_S // 1_000_000))
                rows.data.extend(data.ljust(MAX_FRAME_BYTES, b"\0"))
                rows.n_octets.append(len(data))
    except InputError:
        raise
    except Exception as error:  # python-can raises whatever the damage makes: struct.error, zlib.error, TypeError
        why = str(error) or type(error).__name__
        if not n_frames:
            raise InputError(f"the trace can't be read: {why}", where=path) from error
        raise InputError(f"the trace is damaged behind {n_frames} frames: {why}", where=path) from error
    if not n_frames:
        raise DataError("it has no frames", where=path)
    notes = [f"{n_without_time} frames have an impossible time and are left out"] if n_without_time else []
    if isinstance(source, _TraceLines) and source.n_lines_left_out:
        lines = format_count(source.n_lines_left_out, "line")
        notes.append(f"{lines} of error frames, or not as candump shows frames: left out")
    return frames, n_frames, notes


def _make_trace_kind(name: str, summary: str, suffix: str, accepts: Any) -> ImportKind:
    return ImportKind(
        summary, (suffix,), accepts, lambda path, answers: read_message_tables_of_trace(path, answers, name)
    )


ASC = _make_trace_kind("asc", "CAN traces as ASC, with a DBC file (needs python-can and cantools)", ".asc", accepts_asc)
BLF = _make_trace_kind("blf", "CAN traces as BLF, with a DBC file (needs python-can and cantools)", ".blf", accepts_blf)
TRC = _make_trace_kind("trc", "CAN traces of PEAK as TRC, with a DBC file", ".trc", accepts_trc)
CANDUMP_KIND = _make_trace_kind(
    "candump", "CAN traces of candump, with a DBC file (needs python-can and cantools)", ".log", accepts_candump
)
