"""Warnings as rows over time: each is raised, held at every evaluation while it is active, and cleared."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray, Int64Array, Strings, encode_strings, repeat_string

RAISED, HELD, CLEARED = 1, 2, 3
"""States of a warning, as in `cwcli.v1.Warning`."""


class WarningRow(NamedTuple):
    """The state of a warning at one moment; numbers that are not known are NaN."""

    log_time_ns: int
    stamp_ns: int
    known_ns: int
    event_id: int
    state: int
    other_id: str
    message: str
    time_to_event_s: float = math.nan
    predicted_distance_m: float = math.nan
    ttc_s: float = math.nan
    probability: float = math.nan
    alert_probability: float = math.nan


@dataclass(frozen=True)
class WarningRows:
    """Rows of w states of warnings, by log time, event and state.

    Attributes:
        log_time_ns, stamp_ns: Shape (w,).
        known_ns: Shape (w,): when each could be known, on the clock of the stamps.
        rule: The rule that warned.
        event_id: Shape (w,): number of the warning.
        state: Shape (w,): `RAISED`, `HELD` or `CLEARED`.
        host_id, other_id: Who is warned, and of whom or what.
        time_to_event_s, predicted_distance_m, ttc_s: Shape (w,); NaN where not known.
        probability, alert_probability: Shape (w,): of a collision, and that which the rule compared with its threshold.
        message: Text for the driver.
    """

    log_time_ns: Int64Array
    stamp_ns: Int64Array
    known_ns: Int64Array
    rule: Strings
    event_id: Int64Array
    state: npt.NDArray[np.int32]
    host_id: Strings
    other_id: Strings
    time_to_event_s: FloatArray
    predicted_distance_m: FloatArray
    ttc_s: FloatArray
    probability: FloatArray
    alert_probability: FloatArray
    message: Strings

    def __len__(self) -> int:
        return len(self.log_time_ns)


def build_warning_rows(rows: Sequence[WarningRow], *, rule: str, host_id: str) -> WarningRows:
    """Build the rows of one rule, in order."""
    ordered = sorted(rows, key=lambda row: (row.log_time_ns, row.event_id, row.state))
    columns = dict(zip(WarningRow._fields, zip(*ordered, strict=True), strict=True)) if ordered else {}

    def arrays_by_column(dtype: Any, *names: str) -> dict[str, Any]:
        return {name: np.array(columns.get(name, ()), dtype) for name in names}

    return WarningRows(
        rule=repeat_string(rule, len(ordered)),
        host_id=repeat_string(host_id, len(ordered)),
        other_id=encode_strings(list(columns.get("other_id", ()))),
        message=encode_strings(list(columns.get("message", ()))),
        **arrays_by_column(np.int64, "log_time_ns", "stamp_ns", "known_ns", "event_id"),
        **arrays_by_column(np.int32, "state"),
        **arrays_by_column(
            np.float64, "time_to_event_s", "predicted_distance_m", "ttc_s", "probability", "alert_probability"
        ),
    )
