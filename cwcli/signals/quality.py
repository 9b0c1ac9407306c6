"""Counts of a channel's messages: read, used, rejected by reason, repaired by reason.

Nothing is dropped uncounted: `read == used + rejected + set aside` holds for every channel.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import field

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import BoolArray, Columns, Int64Array
from cwcli.signals.units import S_PER_NS


@dataclass(frozen=True)
class Gap:
    """A stretch without messages: from the last one before it to the first one after it (or the log's end)."""

    start_ns: int
    end_ns: int

    @property
    def duration_s(self) -> float:
        """Length in seconds."""
        return (self.end_ns - self.start_ns) * S_PER_NS


@dataclass
class Quality:
    """Counts for one channel in one role.

    Attributes:
        source: Topic.
        role: Role value (`ego_position`).
        read: Messages in the channel, the undecodable ones included.
        used: Rows in the signal.
        rejected: Reason -> messages left out because they break their contract.
        repaired: Reason -> messages kept with a changed time or a field taken away. A message can be in several.
        set_aside: Reason -> sound messages that belong to another role (the ego's own messages, a roadside unit).
        first_fault_ns: Reason (of `rejected` and `repaired`) -> log time of the first message concerned.
        notes: One line each, for the user.
        delay_s: Median of log time minus stamp over the used rows, NaN when there are none.
        gaps: Stretches without used rows, see `signals.clocks.find_stamp_gaps`.
        objects: The counts of the objects in its messages; None where they hold none.
    """

    source: str
    role: str
    read: int = 0
    used: int = 0
    rejected: dict[str, int] = field(default_factory=dict)
    repaired: dict[str, int] = field(default_factory=dict)
    set_aside: dict[str, int] = field(default_factory=dict)
    first_fault_ns: dict[str, int] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    delay_s: float = float("nan")
    gaps: tuple[Gap, ...] = ()
    objects: Quality | None = None

    @property
    def n_rows(self) -> int:
        """The number of the signal's rows, those of objects in the messages included."""
        return self.used + (self.objects.n_rows if self.objects is not None else 0)

    def combine_with(self, other: Quality) -> Quality:
        """Return these counts and others of the same channel added up."""

        def add_counts(one: dict[str, int], two: dict[str, int]) -> dict[str, int]:
            return {reason: one.get(reason, 0) + two.get(reason, 0) for reason in (*one, *two)}

        return Quality(
            source=self.source,
            role=self.role,
            read=self.read + other.read,
            used=self.used + other.used,
            rejected=add_counts(self.rejected, other.rejected),
            repaired=add_counts(self.repaired, other.repaired),
            set_aside=add_counts(self.set_aside, other.set_aside),
            first_fault_ns={**other.first_fault_ns, **self.first_fault_ns},
        )

    def count_rejected_before_build(self, reason: str, log_time_ns: Int64Array) -> None:
        """Count messages (by their log times, in order) that were left out before the signal was built."""
        if len(log_time_ns):
            self.read += len(log_time_ns)
            self.rejected[reason] = len(log_time_ns)
            self.first_fault_ns[reason] = int(log_time_ns[0])


class RowLedger:
    """Keeps the rows of one channel and counts why rows leave or change.

    A row is rejected once, for the first reason given; repairs are counted on rows that are still kept.
    """

    def __init__(self, columns: Columns, role: str) -> None:
        self.columns = columns
        self.keep: BoolArray = np.ones(len(columns), dtype=np.bool_)
        self.quality = Quality(source=columns.topic, role=role, read=len(columns) + columns.n_undecodable)
        if columns.n_undecodable:
            self.quality.rejected["undecodable"] = columns.n_undecodable

    @property
    def kept_rows(self) -> npt.NDArray[np.intp]:
        """The indices of the rows that are still kept, in file order."""
        return np.flatnonzero(self.keep)

    def reject(self, is_faulty: BoolArray, reason: str) -> None:
        """Leave out the rows where `is_faulty` (shape (n,)) holds and that are still kept."""
        self.reject_rows(np.flatnonzero(self.keep & is_faulty), reason)

    def reject_rows(self, rows: npt.NDArray[np.intp], reason: str) -> None:
        """Leave out these rows (indices of kept rows)."""
        self._count_rows(self.quality.rejected, rows, reason)
        self.keep[rows] = False

    def count_repaired(self, is_repaired: BoolArray, reason: str) -> None:
        """Count the kept rows where `is_repaired` (shape (n,)) holds."""
        self.count_repaired_rows(np.flatnonzero(self.keep & is_repaired), reason)

    def count_repaired_rows(self, rows: npt.NDArray[np.intp], reason: str) -> None:
        """Count these rows (indices of kept rows) as repaired."""
        self._count_rows(self.quality.repaired, rows, reason)

    def set_aside(self, is_other: BoolArray, reason: str) -> None:
        """Leave out sound rows that belong to another role."""
        rows = np.flatnonzero(self.keep & is_other)
        if len(rows):
            self.quality.set_aside[reason] = self.quality.set_aside.get(reason, 0) + len(rows)
        self.keep[rows] = False

    def add_note(self, text: str) -> None:
        """Add a note to the user about the whole channel."""
        self.quality.notes.append(text)

    @contextmanager
    def ledger_of_rows(self, rows: npt.NDArray[np.intp], columns: Columns) -> Iterator[RowLedger]:
        """Give a ledger of some rows, with columns of their own; afterwards its counts are added here."""
        inner = RowLedger(columns, self.quality.role)
        inner.keep = self.keep[rows]
        yield inner
        self.keep[rows] = inner.keep
        for mine, theirs in (
            (self.quality.rejected, inner.quality.rejected),
            (self.quality.repaired, inner.quality.repaired),
            (self.quality.set_aside, inner.quality.set_aside),
        ):
            for reason, count in theirs.items():
                mine[reason] = mine.get(reason, 0) + count
        for reason, first_ns in inner.quality.first_fault_ns.items():
            self.quality.first_fault_ns[reason] = min(first_ns, self.quality.first_fault_ns.get(reason, first_ns))
        self.quality.notes += inner.quality.notes

    def _count_rows(self, counts: dict[str, int], rows: npt.NDArray[np.intp], reason: str) -> None:
        if not len(rows):
            return
        counts[reason] = counts.get(reason, 0) + len(rows)
        first_ns = int(self.columns.log_time_ns[rows.min()])
        self.quality.first_fault_ns[reason] = min(first_ns, self.quality.first_fault_ns.get(reason, first_ns))
