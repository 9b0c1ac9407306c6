"""What a change did to a log, message by message: the first channel that differs, the warnings, and what was changed.

Two annotated logs of one drive are compared: the recorded channels first, then those of the stages in the order in
which the stages run, so that the first channel that differs is nearest to the cause. Messages are paired by their log
time and their place among those of the same time. The records of the runs say which version, option or constant
changed. Messages are decoded only where their checksums differ, and camera frames never.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from contextlib import suppress

import numpy as np
import numpy.typing as npt

from cwcli.channels.published import OWN_TOPIC_PREFIX, WARNINGS, schema_name_by_published_topic
from cwcli.channels.warning import (
    WARNING_FIELDS_FOR_EVENTS,
    WarningEvent,
    read_warnings,
    warning_events_with_known_start,
)
from cwcli.errors import CwcliError
from cwcli.evaluation.setting_changes import SettingChange, compare_settings
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.frames import IMAGE_SCHEMAS
from cwcli.logs.read.message_checksums import read_log_times_and_crc32_of_messages
from cwcli.logs.read.reader import Log
from cwcli.signals.columns import BoolArray, Columns, Field, FloatArray, Int64Array, Ragged, Strings
from cwcli.signals.inputs import normalise_schema_name
from cwcli.signals.units import NS_PER_S

MAX_SAME_WARNING_DIFFERENCE_S = 3.0
"""Warnings of one rule about one vehicle that were raised so near each other are the same one, s. Chosen by hand:
the hold-off of the rules is 1 s."""


@dataclass(frozen=True)
class ChannelChange:
    """A channel whose messages differ.

    Attributes:
        field: The first field that differs, "" where a message is missing or added.
        at_ns: Log time of the first message that differs.
        before, after: The values there; "" where there is no message.
        n_different: Number of messages that differ, or are in one run only.
        n_messages: Number of messages in either run; one that both hold counts once.
        largest: The largest difference of that field, in its unit; NaN where it holds no numbers.
    """

    topic: str
    field: str
    at_ns: int
    before: str
    after: str
    n_different: int
    n_messages: int
    largest: float


@dataclass(frozen=True)
class WarningChange:
    """A warning that appeared, vanished or moved.

    Attributes:
        kind: "appeared", "vanished" or "moved".
        rule, other_id: Its rule and the other vehicle.
        raised_ns: When it was raised, in the later run unless it vanished.
        moved_s: How much later it was raised than before, s; NaN where it appeared or vanished.
    """

    kind: str
    rule: str
    other_id: str
    raised_ns: int
    moved_s: float


@dataclass(frozen=True)
class LogDifference:
    """What differs between two annotated logs of one drive.

    Attributes:
        settings: The settings that differ, in the order of the stages.
        channels: The channels that differ, recorded ones first, then in the order of the stages.
        warnings: The warnings that differ, in order of time.
        start_ns: First log time of the earlier run, from which times are counted.
    """

    settings: tuple[SettingChange, ...]
    channels: tuple[ChannelChange, ...]
    warnings: tuple[WarningChange, ...]
    start_ns: int
    n_channels: int

    @property
    def has_no_difference(self) -> bool:
        """Whether nothing differs."""
        return not (self.settings or self.channels or self.warnings)

    def seconds_since_start(self, stamp_ns: int) -> float:
        """Return the seconds from the log's start to a time."""
        return (stamp_ns - self.start_ns) / NS_PER_S


def compare_messages(before: Log, after: Log, tolerances: Mapping[str, float] | None = None) -> LogDifference:
    """Compare two annotated logs of one drive, message by message.

    Args:
        before, after: The logs of the earlier and of the later run.
        tolerances: Field name -> difference up to which its values count as equal.

    Raises:
        InputError: A log is damaged, or a channel can't be decoded.
    """
    topics = _topics_in_order(before, after)
    changes = [_compare_topic(before, after, topic, tolerances or {}) for topic in topics]
    return LogDifference(
        tuple(compare_settings(before, after)),
        tuple(change for change in changes if change is not None),
        tuple(_compare_warnings(before, after)),
        before.start_ns,
        len(topics),
    )


def field_names(log: Log) -> set[str]:
    """Return the names of the fields of the channels that can be decoded, camera frames left out."""
    found: set[str] = set()
    for channel in log.channels:
        if normalise_schema_name(channel.schema_name) not in IMAGE_SCHEMAS:
            with suppress(CwcliError):
                found.update(log.columns(channel.topic).fields)
    return found


def _topics_in_order(before: Log, after: Log) -> list[str]:
    """Return the topics of both logs: recorded ones, then cwcli's in the order of the stages."""
    found = dict.fromkeys(channel.topic for log in (before, after) for channel in log.channels)
    own = [topic for topic in schema_name_by_published_topic() if topic in found]
    recorded = [topic for topic in found if not topic.startswith(OWN_TOPIC_PREFIX)]
    return [*recorded, *own, *(topic for topic in found if topic not in own and topic not in recorded)]


def _compare_topic(before: Log, after: Log, topic: str, tolerances: Mapping[str, float]) -> ChannelChange | None:
    """Compare the messages of one topic; None if they are equal within the tolerances."""
    checksums = [read_log_times_and_crc32_of_messages(log, topic) for log in (before, after)]
    if all(np.array_equal(*each) for each in zip(*checksums, strict=True)):
        return None
    rows, other_rows, lonely = _rows_of_message_pairs_and_unpaired(checksums[0][0], checksums[1][0])
    schemas = {channel.schema_name for log in (before, after) for channel in log.channels if channel.topic == topic}
    if not len(rows) or any(normalise_schema_name(name) in IMAGE_SCHEMAS for name in schemas):
        return _compare_undecoded(topic, checksums, rows, other_rows, lonely)
    early, late = before.columns(topic), after.columns(topic)
    n_messages = len(rows) + len(lonely)
    if len(early) != len(checksums[0][0]) or len(late) != len(checksums[1][0]):  # some can't be decoded
        return _compare_undecoded(topic, checksums, rows, other_rows, lonely)
    first: tuple[int, str, int] | None = None
    differs = np.zeros(len(rows), np.bool_)
    for name in dict.fromkeys((*early.fields, *late.fields)):
        mask = _field_difference_mask(early, late, name, rows, other_rows, tolerances)
        differs |= mask
        if mask.any():
            row = int(np.argmax(mask))
            at_ns = int(early.log_time_ns[rows[row]])
            if first is None or at_ns < first[0]:
                first = at_ns, name, row
    n_different = int(np.count_nonzero(differs)) + len(lonely)
    if lonely and (first is None or lonely[0][0] <= first[0]):
        at_ns, is_before = lonely[0]
        words = ("a message", "") if is_before else ("", "a message")
        return ChannelChange(topic, "", at_ns, *words, n_different, n_messages, math.nan)
    if first is None:
        return None
    at_ns, name, row = first
    values = (
        _field_text_or_empty(early.fields.get(name), int(rows[row])),
        _field_text_or_empty(late.fields.get(name), other_rows[row]),
    )
    largest = _largest_number_difference(early.fields.get(name), late.fields.get(name), rows, other_rows)
    return ChannelChange(topic, name, at_ns, *values, n_different, n_messages, largest)


def _compare_undecoded(
    topic: str,
    checksums: Sequence[tuple[Int64Array, npt.NDArray[np.uint32]]],
    rows: npt.NDArray[np.intp],
    other_rows: npt.NDArray[np.intp],
    unpaired_messages: Sequence[tuple[int, bool]],
) -> ChannelChange:
    """Compare messages that are not decoded by their checksums; one differs."""
    (early_ns, early), (_, late) = checksums
    differs = np.flatnonzero(early[rows] != late[other_rows])
    n_different = len(differs) + len(unpaired_messages)
    n_messages = len(rows) + len(unpaired_messages)
    first_ns = int(early_ns[rows[differs[0]]]) if len(differs) else None
    if unpaired_messages and (first_ns is None or unpaired_messages[0][0] <= first_ns):
        words = ("a message", "") if unpaired_messages[0][1] else ("", "a message")
        return ChannelChange(topic, "", unpaired_messages[0][0], *words, n_different, n_messages, math.nan)
    assert first_ns is not None  # a message differs
    return ChannelChange(topic, "", first_ns, "bytes", "other bytes", n_different, n_messages, math.nan)


def _rows_of_message_pairs_and_unpaired(
    early_ns: Int64Array, late_ns: Int64Array
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], list[tuple[int, bool]]]:
    """Pair messages by log time and place among those of that time.

    Returns:
        Rows of the pairs in both, and the others: log time, and whether they are in the earlier run; in order of time.
    """
    keys = [np.stack([each, _number_of_equal_times_before(each)], axis=1) for each in (early_ns, late_ns)]
    places = [{(int(time), int(place)): row for row, (time, place) in enumerate(each.tolist())} for each in keys]
    shared = [key for key in places[0] if key in places[1]]
    rows = np.array([places[0][key] for key in shared], np.intp)
    others = np.array([places[1][key] for key in shared], np.intp)
    lonely = [(key[0], True) for key in places[0] if key not in places[1]]
    lonely += [(key[0], False) for key in places[1] if key not in places[0]]
    return rows, others, sorted(lonely)


def _number_of_equal_times_before(sorted_times_ns: Int64Array) -> Int64Array:
    """Return the number of equal times before each one, which are neighbours."""
    starts = np.flatnonzero(np.concatenate([[True], np.diff(sorted_times_ns) != 0]))
    return np.arange(len(sorted_times_ns)) - np.repeat(starts, np.diff(np.append(starts, len(sorted_times_ns))))


def _field_difference_mask(
    early: Columns,
    late: Columns,
    field_name: str,
    early_rows: npt.NDArray[np.intp],
    late_rows: npt.NDArray[np.intp],
    tolerances: Mapping[str, float],
) -> BoolArray:
    """Return which pairs of messages differ in a field."""
    one, other = early.fields.get(field_name), late.fields.get(field_name)
    if one is None or other is None:
        return np.ones(len(early_rows), np.bool_)
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray) and one.shape[1:] == other.shape[1:]:
        left, right = one[early_rows], other[late_rows]
        if left.dtype.kind in "iub" and right.dtype.kind in "iub" and field_name not in tolerances:
            differs = np.asarray(left != right)
        else:
            differs = _number_difference_mask(left.astype(float), right.astype(float), tolerances.get(field_name, 0.0))
        return (
            np.asarray(differs.reshape(len(early_rows), -1).any(axis=1)) if len(early_rows) else np.zeros(0, np.bool_)
        )
    if isinstance(one, Strings) and isinstance(other, Strings):
        values: dict[str | None, int] = {None: -1}
        codes = [
            np.array([values.setdefault(text, len(values)) for text in each.values] + [-1]) for each in (one, other)
        ]
        return np.asarray(codes[0][one.codes[early_rows]] != codes[1][other.codes[late_rows]])
    if isinstance(one, Ragged) and isinstance(other, Ragged):
        return _sequence_difference_mask(one, other, early_rows, late_rows, tolerances.get(field_name, 0.0))
    texts = [
        [_field_text_or_empty(each, int(row)) for row in those]
        for each, those in ((one, early_rows), (other, late_rows))
    ]
    return np.array([left != right for left, right in zip(*texts, strict=True)], np.bool_)


def _sequence_difference_mask(
    early: Ragged,
    late: Ragged,
    early_rows: npt.NDArray[np.intp],
    late_rows: npt.NDArray[np.intp],
    tolerance: float,
) -> BoolArray:
    """Return which pairs of sequences have other lengths, or numbers that differ by more than a tolerance."""
    differs = np.diff(early.offsets)[early_rows] != np.diff(late.offsets)[late_rows]
    for k in np.flatnonzero(~differs):
        left = early.values[early.offsets[early_rows[k]] : early.offsets[early_rows[k] + 1]]
        right = late.values[late.offsets[late_rows[k]] : late.offsets[late_rows[k] + 1]]
        differs[k] = bool(_number_difference_mask(left.astype(float), right.astype(float), tolerance).any())
    return np.asarray(differs)


def _number_difference_mask(early_numbers: FloatArray, late_numbers: FloatArray, tolerance: float) -> BoolArray:
    """Return where numbers differ by more than a tolerance; NaN equals NaN."""
    with np.errstate(invalid="ignore"):
        is_equal = (np.abs(early_numbers - late_numbers) <= tolerance) | (early_numbers == late_numbers)
    return np.asarray(~is_equal & ~(np.isnan(early_numbers) & np.isnan(late_numbers)))


def _field_text_or_empty(field: Field | None, row: int) -> str:
    """Return the value of a message as text, "" where there is none."""
    if field is None:
        return ""
    if isinstance(field, Strings):
        return field.text_of_row(row)
    if isinstance(field, Ragged):
        return json.dumps(field.values[field.offsets[row] : field.offsets[row + 1]].tolist())
    return json.dumps(field[row].tolist())


def _largest_number_difference(
    early_field: Field | None,
    late_field: Field | None,
    early_rows: npt.NDArray[np.intp],
    late_rows: npt.NDArray[np.intp],
) -> float:
    """Return the largest difference of a field of numbers; NaN for another one."""
    if (
        not (isinstance(early_field, np.ndarray) and isinstance(late_field, np.ndarray))
        or early_field.shape[1:] != late_field.shape[1:]
    ):
        return math.nan
    differences = np.abs(early_field[early_rows].astype(float) - late_field[late_rows].astype(float))
    known = differences[np.isfinite(differences)]
    return float(known.max()) if len(known) else math.nan


def _compare_warnings(before: Log, after: Log) -> list[WarningChange]:
    """Return the warnings that appeared, vanished or moved, in order of time."""
    early, late = _read_warning_events_or_empty(before), _read_warning_events_or_empty(after)
    left = list(late)
    changes = []
    for event in early:
        same = [each for each in left if (each.rule, each.other_id) == (event.rule, event.other_id)]
        near = min(same, key=lambda each: abs(each.raised_ns - event.raised_ns), default=None)
        if near is None or abs(near.raised_ns - event.raised_ns) > MAX_SAME_WARNING_DIFFERENCE_S * NS_PER_S:
            changes.append(WarningChange("vanished", event.rule, event.other_id, event.raised_ns, math.nan))
            continue
        left.remove(near)
        if near.raised_ns != event.raised_ns:
            moved_s = (near.raised_ns - event.raised_ns) / NS_PER_S
            changes.append(WarningChange("moved", event.rule, event.other_id, near.raised_ns, moved_s))
    changes += [WarningChange("appeared", each.rule, each.other_id, each.raised_ns, math.nan) for each in left]
    return sorted(changes, key=lambda change: change.raised_ns)


def _read_warning_events_or_empty(log: Log) -> Sequence[WarningEvent]:
    """Return the warnings of a log; none where no rule has run."""
    if all(channel.topic != WARNINGS.topic for channel in log.channels):
        return ()
    return warning_events_with_known_start(read_warnings(log.columns(WARNINGS.topic, WARNING_FIELDS_FOR_EVENTS)))
