"""A field of another system's messages as a flag, and its rises as warnings."""

from __future__ import annotations

from collections.abc import Callable
from itertools import islice

import numpy as np
import numpy.typing as npt

from cwcli.errors import DataError, MissingSignalError, UsageError
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.codecs.tree import UndecodableMessage
from cwcli.logs.read.reader import Log
from cwcli.signals.clocks import MIN_STAMP_TO_LOG_TIME_OFFSET_OF_TWO_CLOCKS_S
from cwcli.signals.columns import Columns, FirstAndLastNs, Int64Array, Strings, median_of_values
from cwcli.signals.field_condition import Condition, MissingValue, meets_condition, value_at_path
from cwcli.signals.leaf_fields import read_stamps
from cwcli.signals.stamp_fields import (
    CDR_FOXGLOVE_STAMP_FIELDS,
    HEADER_STAMP_FIELDS,
    JSON_STAMP_FIELDS,
    PROTOBUF_STAMP_FIELDS,
)
from cwcli.signals.units import NS_PER_S
from cwcli.text import format_count

STAMP_FIELDS = frozenset(
    {
        *HEADER_STAMP_FIELDS,
        *JSON_STAMP_FIELDS,
        *PROTOBUF_STAMP_FIELDS,
        *CDR_FOXGLOVE_STAMP_FIELDS,
        "stamp.sec",
        "stamp.nanosec",
    }
)
"""Fields that may hold the stamp of a message."""
MAX_LISTED_FIELDS = 40
"""Greatest number of fields that an error lists; chosen for short messages."""
MAX_SCANNED_MESSAGES = 1000
"""Number of messages that are searched for fields. Chosen for speed; not fitted."""
MAX_SET_SHARE_OF_WARNING_FLAG = 0.5
"""Share of messages above which a flag that is set is doubtful as a warning. Chosen by hand; not fitted."""

Int8Array = npt.NDArray[np.int8]
CONDITION_HOLDS, CONDITION_FAILS, FIELD_MISSING, NOT_COMPARABLE = 1, 0, -1, -2
"""Answers of a message: the condition holds, it does not, the field is missing, or its value is not comparable."""


@dataclass(frozen=True)
class FlagOverTime:
    """Times at which a condition held.

    Attributes:
        time_ns: Shape (n,), in order: when each message with the field was available.
        is_set: Shape (n,): whether the condition held.
    """

    time_ns: Int64Array
    is_set: npt.NDArray[np.bool_]
    notes: tuple[str, ...] = ()

    def warning_spans_ns(self) -> list[FirstAndLastNs]:
        """Return for each warning the times (ns) of the first and the last message in which it was set.

        A flag that is set in the first message is no warning, because the time at which it was raised is unknown.
        """
        change = np.diff(self.is_set.astype(np.int8))
        raised = np.flatnonzero(change == 1) + 1
        last = np.append(np.flatnonzero(change == -1), len(self.is_set) - 1)
        after = last[np.searchsorted(last, raised)] if len(raised) else raised
        return list(zip(self.time_ns[raised].tolist(), self.time_ns[after].tolist(), strict=True))


@dataclass(frozen=True)
class _ConditionAnswers:
    """Answer of each message (`CONDITION_HOLDS` and so on), in order of log time."""

    log_time_ns: Int64Array
    answers: Int8Array


def read_flag_from_topic(log: Log, topic: str, condition: Condition) -> FlagOverTime:
    """Read a topic as a flag.

    Raises:
        MissingSignalError: The topic holds no message.
        UsageError: No message has the field, or what is there can't be compared.
        DataError: No message can be decoded.
        InputError: The log is damaged, or its encoding is unknown.
    """
    columns = log.columns(topic, {*STAMP_FIELDS, condition.dotted_path} if condition.is_outside_lists else STAMP_FIELDS)
    if not len(columns) and not columns.n_undecodable:
        raise MissingSignalError(f"{topic} holds no message", where=log.name)
    if not len(columns):
        raise DataError(f"none of its {columns.n_undecodable} messages can be decoded", where=f"{log.name}: {topic}")
    by_column = _answers_from_column(columns, condition)
    said = by_column if by_column is not None else _answers_from_messages(log, topic, condition)
    if not len(said.answers):
        raise DataError("none of its messages can be decoded one by one", where=f"{log.name}: {topic}")
    n, n_unlike = len(said.answers), int((said.answers == NOT_COMPARABLE).sum())
    if n_unlike == n or not (said.answers != FIELD_MISSING).any():
        raise _missing_field_error(log, topic, condition, is_unlike=n_unlike > 0)
    notes = [f"{topic}: {format_count(columns.n_undecodable, 'message')} could not be decoded"] * bool(
        columns.n_undecodable
    )
    if n_unlike:
        notes.append(
            f"{topic}: in {n_unlike} of {n} messages `{condition.text}` can't be compared: it counts as not set"
        )
    is_known = said.answers != FIELD_MISSING
    if not is_known.all():
        notes.append(f"{topic}: {n - int(is_known.sum())} of {n} messages lack the field: the flag counts as unchanged")
    shift_ns, note = _clock_shift_ns_and_notes(columns, topic)
    flag = FlagOverTime(said.log_time_ns[is_known] + shift_ns, said.answers[is_known] == CONDITION_HOLDS)
    return FlagOverTime(flag.time_ns, flag.is_set, (*notes, *note, *_notes_on_implausible_flag(flag, topic, condition)))


def _notes_on_implausible_flag(flag: FlagOverTime, topic: str, condition: Condition) -> list[str]:
    """Return notes on a flag that never changes, or is set most of the time."""
    n, share = len(flag.is_set), float(flag.is_set.mean())
    if share == 0.0:
        return [f"{topic}: `{condition.text}` holds in none of {format_count(n, 'message')}: it never warned"]
    if share == 1.0:
        return [f"{topic}: `{condition.text}` holds in all of {format_count(n, 'message')}: a stuck flag is no warning"]
    notes = []
    if flag.is_set[0]:
        notes.append(f"{topic}: set in its first message: when that warning was raised is not known, it is not judged")
    if share > MAX_SET_SHARE_OF_WARNING_FLAG:
        notes.append(f"{topic}: `{condition.text}` holds in {100 * share:.0f} % of {n} messages: is it a warning?")
    return notes


def _clock_shift_ns_and_notes(columns: Columns, topic: str) -> tuple[int, list[str]]:
    """Return the shift (ns) of log times to the clock of the stamps, and a note if it is not 0.

    A warning counts from its log time, when others could know it. Where the clock of the recorder is not that of the
    stamps, which all states use, the median difference is removed.
    """
    stamp_ns, has_stamp = read_stamps(columns)
    if not has_stamp.any():
        return 0, []
    shift_ns = int(median_of_values(stamp_ns[has_stamp] - columns.log_time_ns[has_stamp]))
    if abs(shift_ns) <= MIN_STAMP_TO_LOG_TIME_OFFSET_OF_TWO_CLOCKS_S * NS_PER_S:
        return 0, []
    return shift_ns, [
        f"{topic}: its stamps are {shift_ns / NS_PER_S:+.3f} s from its log times: two clocks; its warnings are placed "
        "by the stamps, so a usual delay of them does not show"
    ]


def _answers_from_column(columns: Columns, condition: Condition) -> _ConditionAnswers | None:
    """Evaluate the condition on a column; None where the field is not a column of its own."""
    if not condition.is_outside_lists:
        return None
    found = columns.fields.get(condition.dotted_path)
    if isinstance(found, Strings):
        values: list[object] = [*found.values, None]  # the code -1 is the last
        codes: npt.NDArray[np.signedinteger] = found.codes
    elif isinstance(found, np.ndarray) and found.ndim == 1:
        distinct, codes = np.unique(found, return_inverse=True)
        values = distinct.tolist()
    else:
        return None
    answers = np.array([_condition_as_1_0_or_unknown(value, condition) for value in values], np.int8)
    return _ConditionAnswers(columns.log_time_ns, answers[codes])


def _answers_from_messages(log: Log, topic: str, condition: Condition) -> _ConditionAnswers:
    """Evaluate the condition message by message, for fields within lists."""
    log_time_ns: list[int] = []
    answers: list[int] = []
    n_fields = 0
    for at_ns, message in log.iter_message_trees(topic):
        if isinstance(message, UndecodableMessage):  # counted by the columns
            continue
        value = value_at_path(message, condition.path)
        n_fields += value is not MissingValue.FIELD
        log_time_ns.append(at_ns)
        answers.append(_condition_as_1_0_or_unknown(value, condition))
    times, said = np.array(log_time_ns, np.int64), np.array(answers, np.int8)
    if not n_fields:
        said[:] = FIELD_MISSING
    order = np.argsort(times, kind="stable")
    return _ConditionAnswers(times[order], said[order])


def _condition_as_1_0_or_unknown(value: object, condition: Condition) -> int:
    if value is MissingValue.ELEMENT:
        return FIELD_MISSING
    met = meets_condition(value, condition)
    return NOT_COMPARABLE if met is None else int(met)


def _missing_field_error(log: Log, topic: str, condition: Condition, *, is_unlike: bool) -> UsageError:
    """Return the error of a condition that fits no message, with the fields that there are."""
    known: dict[str, str] = {}
    for _, message in islice(log.iter_message_trees(topic), MAX_SCANNED_MESSAGES):
        if not isinstance(message, UndecodableMessage):
            _collect_field_kinds(message, "", known)
    shown = tuple(f"{path} ({kind})" for path, kind in list(known.items())[:MAX_LISTED_FIELDS])
    if len(known) > MAX_LISTED_FIELDS:
        shown += (f"and {len(known) - MAX_LISTED_FIELDS} more",)
    what = "what its messages hold there can't be compared so" if is_unlike else "its messages have no such field"
    what = f"{topic}:{condition.text}: {what}"
    return UsageError(what, where=log.name, found=shown, hint="name one of the fields found")


def _collect_field_kinds(value: object, path: str, kind_text_by_path: dict[str, str]) -> None:
    """Add the paths of the values in a message: `status[].name`, with their kind, or with an example of a text."""
    if isinstance(value, dict):
        for name, inner in value.items():
            _collect_field_kinds(inner, f"{path}.{name}" if path else str(name), kind_text_by_path)
    elif isinstance(value, list):
        for inner in value[:MAX_LISTED_FIELDS]:
            _collect_field_kinds(inner, f"{path}[]", kind_text_by_path)
        if not value:
            kind_text_by_path.setdefault(f"{path}[]", "an empty list")
    elif path not in kind_text_by_path:
        kind_text_by_path[path] = _value_kind_text(value)


def _value_kind_text(value: object) -> str:
    kinds: list[tuple[type, Callable[[object], str]]] = [
        (bool, lambda _: "true or false"),
        (int, lambda _: "a whole number"),
        (float, lambda _: "a number"),
        (str, lambda text: f"a text such as {str(text)[:20]!r}"),
    ]
    return next((words(value) for kind, words in kinds if isinstance(value, kind)), "nothing")
