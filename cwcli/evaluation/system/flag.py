"""A field of another system's messages as a flag, and its rises as warnings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice

import numpy as np
import numpy.typing as npt

from cwcli.errors import DataError, MissingSignalError, UsageError
from cwcli.logs.codecs.tree import BadMessage
from cwcli.logs.read.reader import Log
from cwcli.signals.clocks import OTHER_CLOCK_S
from cwcli.signals.columns import Columns, Int64Array, Strings
from cwcli.signals.field_condition import Condition, Missing, holds, value_at
from cwcli.signals.leaf_fields import stamps
from cwcli.signals.stamp_fields import CDR_FOXGLOVE_STAMP, HEADER_STAMP, JSON_STAMPS, PROTOBUF_STAMP
from cwcli.signals.units import NS_PER_S
from cwcli.text import count

STAMPS = frozenset({*HEADER_STAMP, *JSON_STAMPS, *PROTOBUF_STAMP, *CDR_FOXGLOVE_STAMP, "stamp.sec", "stamp.nanosec"})
"""Fields that may hold the stamp of a message."""
MAX_LISTED = 40
"""Greatest number of fields that an error lists; chosen for short messages."""
MESSAGES_LISTED = 1000
"""Number of messages that are searched for fields. Chosen for speed; not fitted."""
MOSTLY = 0.5
"""Share of messages above which a flag that is set is doubtful as a warning. Chosen by hand; not fitted."""

Int8Array = npt.NDArray[np.int8]
HOLDS, NOT, UNSAID, UNLIKE = 1, 0, -1, -2
"""Answers of a message: the condition holds, it does not, the field is missing, or its value is not comparable."""


@dataclass(frozen=True)
class Flag:
    """Times at which a condition held.

    Attributes:
        time_ns: Shape (n,), in order: when each message with the field was available.
        is_set: Shape (n,): whether the condition held.
        notes: Notes for the user.
    """

    time_ns: Int64Array
    is_set: npt.NDArray[np.bool_]
    notes: tuple[str, ...] = ()

    def spans(self) -> list[tuple[int, int]]:
        """Return for each warning the times (ns) of the first and the last message in which it was set.

        A flag that is set in the first message is no warning, because the time at which it was raised is unknown.
        """
        change = np.diff(self.is_set.astype(np.int8))
        raised = np.flatnonzero(change == 1) + 1
        last = np.append(np.flatnonzero(change == -1), len(self.is_set) - 1)
        after = last[np.searchsorted(last, raised)] if len(raised) else raised
        return list(zip(self.time_ns[raised].tolist(), self.time_ns[after].tolist(), strict=True))


@dataclass(frozen=True)
class _Said:
    """Answer of each message (`HOLDS` and so on), in order of log time."""

    log_time_ns: Int64Array
    said: Int8Array


def read_flag(log: Log, topic: str, condition: Condition) -> Flag:
    """Read a topic as a flag.

    Raises:
        MissingSignalError: The topic holds no message.
        UsageError: No message has the field, or what is there can't be compared.
        DataError: No message can be decoded.
        InputError: The log is damaged, or its encoding is unknown.
    """
    columns = log.columns(topic, {*STAMPS, condition.plain_path} if condition.is_plain else STAMPS)
    if not len(columns) and not columns.n_undecodable:
        raise MissingSignalError(f"{topic} holds no message", where=log.name)
    if not len(columns):
        raise DataError(f"none of its {columns.n_undecodable} messages can be decoded", where=f"{log.name}: {topic}")
    by_column = _by_column(columns, condition)
    said = by_column if by_column is not None else _by_tree(log, topic, condition)
    if not len(said.said):
        raise DataError("none of its messages can be decoded one by one", where=f"{log.name}: {topic}")
    n, n_unlike = len(said.said), int((said.said == UNLIKE).sum())
    if n_unlike == n or not (said.said != UNSAID).any():
        raise _no_such_field(log, topic, condition, is_unlike=n_unlike > 0)
    notes = [f"{topic}: {count(columns.n_undecodable, 'message')} could not be decoded"] * bool(columns.n_undecodable)
    if n_unlike:
        notes.append(f"{topic}: in {n_unlike} of {n} messages `{condition.text}` can't be compared: taken as not set")
    kept = said.said != UNSAID
    if not kept.all():
        notes.append(f"{topic}: {n - int(kept.sum())} of {n} messages lack the field: the flag is taken as unchanged")
    shift_ns, note = _clock_shift(columns, topic)
    flag = Flag(said.log_time_ns[kept] + shift_ns, said.said[kept] == HOLDS)
    return Flag(flag.time_ns, flag.is_set, (*notes, *note, *_oddities(flag, topic, condition)))


def _oddities(flag: Flag, topic: str, condition: Condition) -> list[str]:
    """Return notes on a flag that never changes, or is set most of the time."""
    n, share = len(flag.is_set), float(flag.is_set.mean())
    if share == 0.0:
        return [f"{topic}: `{condition.text}` holds in none of {count(n, 'message')}: it never warned"]
    if share == 1.0:
        return [f"{topic}: `{condition.text}` holds in all of {count(n, 'message')}: a stuck flag is no warning"]
    notes = []
    if flag.is_set[0]:
        notes.append(f"{topic}: set in its first message: when that warning was raised is not known, it is not judged")
    if share > MOSTLY:
        notes.append(f"{topic}: `{condition.text}` holds in {100 * share:.0f} % of {n} messages: is it a warning?")
    return notes


def _clock_shift(columns: Columns, topic: str) -> tuple[int, list[str]]:
    """Return the shift (ns) of log times to the clock of the stamps, and a note if it is not 0.

    A warning counts from its log time, when others could know it. Where the clock of the recorder is not that of the
    stamps, which all states use, the median difference is removed.
    """
    stamp_ns, has_stamp = stamps(columns)
    if not has_stamp.any():
        return 0, []
    shift_ns = int(np.median(stamp_ns[has_stamp] - columns.log_time_ns[has_stamp]))
    if abs(shift_ns) <= OTHER_CLOCK_S * NS_PER_S:
        return 0, []
    return shift_ns, [
        f"{topic}: its stamps are {shift_ns / NS_PER_S:+.3f} s from its log times: two clocks; its warnings are placed "
        "by the stamps, so a usual delay of them does not show"
    ]


def _by_column(columns: Columns, condition: Condition) -> _Said | None:
    """Evaluate the condition on a column; None where the field is not a column of its own."""
    if not condition.is_plain:
        return None
    found = columns.fields.get(condition.plain_path)
    if isinstance(found, Strings):
        values: list[object] = [*found.values, None]  # the code -1 is the last
        codes: npt.NDArray[np.signedinteger] = found.codes
    elif isinstance(found, np.ndarray) and found.ndim == 1:
        distinct, codes = np.unique(found, return_inverse=True)
        values = distinct.tolist()
    else:
        return None
    answers = np.array([_answer(value, condition) for value in values], np.int8)
    return _Said(columns.log_time_ns, answers[codes])


def _by_tree(log: Log, topic: str, condition: Condition) -> _Said:
    """Evaluate the condition message by message, for fields within lists."""
    log_time_ns: list[int] = []
    answers: list[int] = []
    n_fields = 0
    for at_ns, message in log.trees(topic):
        if isinstance(message, BadMessage):  # counted by the columns
            continue
        value = value_at(message, condition.path)
        n_fields += value is not Missing.FIELD
        log_time_ns.append(at_ns)
        answers.append(_answer(value, condition))
    times, said = np.array(log_time_ns, np.int64), np.array(answers, np.int8)
    if not n_fields:
        said[:] = UNSAID
    order = np.argsort(times, kind="stable")
    return _Said(times[order], said[order])


def _answer(value: object, condition: Condition) -> int:
    if value is Missing.ELEMENT:
        return UNSAID
    met = holds(value, condition)
    return UNLIKE if met is None else int(met)


def _no_such_field(log: Log, topic: str, condition: Condition, *, is_unlike: bool) -> UsageError:
    """Return the error of a condition that fits no message, with the fields that there are."""
    option = f"--topic warning={topic}:{condition.text}"
    known: dict[str, str] = {}
    for _, message in islice(log.trees(topic), MESSAGES_LISTED):
        if not isinstance(message, BadMessage):
            _list_fields(message, "", known)
    shown = tuple(f"{path} ({kind})" for path, kind in list(known.items())[:MAX_LISTED])
    if len(known) > MAX_LISTED:
        shown += (f"and {len(known) - MAX_LISTED} more",)
    what = "what its messages hold there can't be compared so" if is_unlike else "its messages have no such field"
    return UsageError(f"{option}: {what}", where=log.name, found=shown, hint="name one of the fields found")


def _list_fields(value: object, path: str, known: dict[str, str]) -> None:
    """Add the paths of the values in a message: `status[].name`, with their kind, or with an example of a text."""
    if isinstance(value, dict):
        for name, inner in value.items():
            _list_fields(inner, f"{path}.{name}" if path else str(name), known)
    elif isinstance(value, list):
        for inner in value[:MAX_LISTED]:
            _list_fields(inner, f"{path}[]", known)
        if not value:
            known.setdefault(f"{path}[]", "an empty list")
    elif path not in known:
        known[path] = _kind(value)


def _kind(value: object) -> str:
    kinds: list[tuple[type, Callable[[object], str]]] = [
        (bool, lambda _: "true or false"),
        (int, lambda _: "a whole number"),
        (float, lambda _: "a number"),
        (str, lambda text: f"a text such as {str(text)[:20]!r}"),
    ]
    return next((words(value) for kind, words in kinds if isinstance(value, kind)), "nothing")
