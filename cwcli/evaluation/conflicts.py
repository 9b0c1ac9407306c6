"""Real conflicts, by the definition in the configuration, and verdicts on the warnings of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cwcli.lazy_dataclass import dataclass, replace
from cwcli.measures.pair import Pair
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.row_order import first_and_last_rows_of_runs
from cwcli.signals.units import NS_PER_S
from cwcli.warning.types import WarningConfig

VERDICT_TRUE, VERDICT_FALSE, VERDICT_LATE, VERDICT_UNDECIDED = "true", "false", "late", "undecided"
"""The verdicts on a warning: `WarningVerdict.kind` explains each."""
OUTCOME_MISSED = "missed"
"""Outcome of a conflict without a warning."""


@dataclass(frozen=True)
class RealConflict:
    """A span of time in which the definition of a conflict held.

    Attributes:
        onset_ns, end_ns: When it began and ended, linear between the samples of the measure.
        closest_ns: When the centres were nearest, and `closest_m` how near.
        part_text: What held from `onset_ns` to `end_ns`, in words: `the two touched`.
    """

    onset_ns: int
    end_ns: int
    closest_ns: int
    closest_m: float
    part_text: str = ""


@dataclass(frozen=True)
class WarningVerdict:
    """Verdict on a warning.

    Attributes:
        kind: "true": raised before a conflict; "late": raised during one; "false": no conflict followed;
            "undecided": none followed, but the tracks don't cover the time in which one could have.
        conflict_index: Index of the conflict, or -1.
        lead_time_s: Onset minus the time of the warning; NaN without a conflict.
        closest_ns, closest_m: Nearest approach of the centres within `max_lead_s` after the warning; -1, NaN:
            unknown.
    """

    kind: str
    conflict_index: int
    lead_time_s: float
    closest_ns: int
    closest_m: float


def find_real_conflicts(pair: Pair, config: WarningConfig) -> list[RealConflict]:
    """Find the conflicts of a pair; two that are less than the hold-off apart are joined.

    Of a definition with several parts an earlier one goes first: what a later one finds within the hold-off of its
    conflicts is the same conflict.
    """
    found: list[RealConflict] = []
    hold_off_ns = config.hold_off_s * NS_PER_S
    for part in config.parsed_conflict_definition.parts:
        more = _find_conflicts_by_margin(pair, part.margin_negative_in_conflict(pair), config)
        found += [
            replace(each, part_text=part.conflict_text)
            for each in more
            if not any(_are_conflicts_nearer_than(each, known, hold_off_ns) for known in found)
        ]
    return sorted(found, key=lambda each: each.onset_ns)


def _are_conflicts_nearer_than(first: RealConflict, second: RealConflict, gap_ns: float) -> bool:
    """Whether less than a gap (ns) lies between two conflicts."""
    return first.onset_ns - second.end_ns < gap_ns and second.onset_ns - first.end_ns < gap_ns


def _find_conflicts_by_margin(pair: Pair, margin: FloatArray, config: WarningConfig) -> list[RealConflict]:
    """Find the conflicts of one part of a definition, whose margin (n,) is negative during a conflict."""
    stamp = pair.stamp_ns
    inside = np.nan_to_num(margin, nan=1.0, posinf=1.0) < 0.0
    stretches: list[tuple[int, int, int, int]] = []
    for first, last in first_and_last_rows_of_runs(inside):
        onset = _zero_crossing_ns(stamp, margin, first - 1, first, config.max_gap_s)
        end = _zero_crossing_ns(stamp, margin, last + 1, last, config.max_gap_s)
        if stretches and onset - stretches[-1][1] < config.hold_off_s * NS_PER_S:
            earlier = stretches.pop()
            stretches.append((earlier[0], end, earlier[2], last))
        else:
            stretches.append((onset, end, first, last))
    out = []
    for onset, end, first, last in stretches:
        nearest = first + int(np.nanargmin(pair.distance_m[first : last + 1]))
        out.append(RealConflict(onset, end, int(stamp[nearest]), float(pair.distance_m[nearest])))
    return out


def _zero_crossing_ns(
    stamp_ns: Int64Array, margin: FloatArray, outside_row: int, inside_row: int, max_gap_s: float
) -> int:
    """Return when the measure crossed 0 between two neighbouring samples; the inner one's stamp if that is unknown."""
    at = int(stamp_ns[inside_row])
    if not 0 <= outside_row < len(stamp_ns):
        return at
    apart_ns = int(stamp_ns[outside_row]) - at
    if (
        not np.isfinite(margin[outside_row])
        or not np.isfinite(margin[inside_row])
        or abs(apart_ns) > max_gap_s * NS_PER_S
    ):
        return at
    share = margin[inside_row] / (margin[inside_row] - margin[outside_row])
    return at + round(float(share) * apart_ns)


def judge_warning(
    raised_ns: int, last_ns: int, conflicts: Sequence[RealConflict], pair: Pair, config: WarningConfig
) -> WarningVerdict:
    """Judge a warning that was raised at `raised_ns` and held until `last_ns`."""
    max_lead_ns = round(config.max_lead_s * NS_PER_S)
    closest_ns, closest_m = _stamp_and_distance_of_closest_approach(pair, raised_ns, raised_ns + max_lead_ns)
    for index, conflict in enumerate(conflicts):
        if conflict.end_ns < raised_ns:
            continue
        lead_ns = conflict.onset_ns - raised_ns
        if lead_ns <= max_lead_ns or conflict.onset_ns <= last_ns:
            kind = VERDICT_TRUE if lead_ns >= 0 else VERDICT_LATE
            return WarningVerdict(kind, index, lead_ns / NS_PER_S, conflict.closest_ns, conflict.closest_m)
    decided = _is_distance_known_between(
        pair, raised_ns, raised_ns + round(config.horizon_s * NS_PER_S), config.max_gap_s
    )
    return WarningVerdict(VERDICT_FALSE if decided else VERDICT_UNDECIDED, -1, float("nan"), closest_ns, closest_m)


def _stamp_and_distance_of_closest_approach(pair: Pair, begin_ns: int, end_ns: int) -> tuple[int, float]:
    rows = np.flatnonzero((pair.stamp_ns >= begin_ns) & (pair.stamp_ns <= end_ns) & np.isfinite(pair.distance_m))
    if not len(rows):
        return -1, float("nan")
    nearest = rows[pair.distance_m[rows].argmin()]
    return int(pair.stamp_ns[nearest]), float(pair.distance_m[nearest])


def _is_distance_known_between(pair: Pair, begin_ns: int, end_ns: int, max_gap_s: float) -> bool:
    """Whether the distance is known from begin to end without a gap."""
    known = pair.stamp_ns[np.isfinite(pair.distance_m)]
    inside = known[(known >= begin_ns) & (known <= end_ns)]
    edges = np.concatenate([[begin_ns], inside, [end_ns]])
    return bool(np.diff(edges).max() <= max_gap_s * NS_PER_S)
