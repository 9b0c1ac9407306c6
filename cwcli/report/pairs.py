"""Tables of the others: how critical each came to be, and every conflict with its warnings."""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Iterable

import numpy as np

from cwcli.digest.drive import Drive
from cwcli.digest.encounters import Conflict, DriveEncounters, rows_of_moving_pair_and_if_always_standing
from cwcli.digest.story import short_vehicle_name
from cwcli.measures.collision_time import TTC
from cwcli.measures.deceleration import DRAC
from cwcli.measures.distances import DISTANCE, GAP
from cwcli.measures.pair import Pair, PairQuantity
from cwcli.report.views import TableView
from cwcli.signals.row_order import Rows
from cwcli.signals.units import NS_PER_S

EXTREME_COLUMN_HEADINGS = ("nearest [m]", "least gap [m]", "least TTC [s]", "most DRAC [m/s²]")
"""Headings of the columns of the table that lists the extreme values of each pair of vehicles."""
MAX_LISTED_PAIRS = 12
"""The greatest number of other vehicles in the table of extremes. Chosen by hand; not fitted."""
MAX_LISTED_CONFLICTS = 200
"""The greatest number of conflicts in the table of conflicts. Chosen by hand; not fitted."""
MIN_HEX_DIGITS_OF_ANCHOR_NAME = 4
"""The least number of hexadecimal digits in an anchor's name. Chosen by hand; not fitted."""


def warning_anchor_names(log: str, drive_encounters: DriveEncounters) -> list[str]:
    """Return an anchor name for each warning that a rerun keeps, such as `warning-3f2a`."""
    return stable_anchor_names(log, "warning", ((each.rule, each.other_id) for each in drive_encounters.encounters))


def conflict_anchor_names(log: str, drive_encounters: DriveEncounters) -> list[str]:
    """Return an anchor name for each conflict that a rerun keeps, such as `conflict-3f2a`."""
    return stable_anchor_names(log, "conflict", ((each.other.id,) for each in drive_encounters.conflicts))


def pair_extremes_table(drive: Drive, drive_encounters: DriveEncounters) -> TableView | None:
    """Build the table of each pair's extremes and their times; None where nobody was near."""
    met = [(other, pair, rows_of_moving_pair_and_if_always_standing(pair)[0]) for other, pair in drive_encounters.pairs]
    near = [(float(pair.distance_m[rows].min()), other, pair, rows) for other, pair, rows in met if len(rows)]
    if not near:
        return None
    table = []
    for _, other, pair, rows in sorted(near, key=lambda each: each[0])[:MAX_LISTED_PAIRS]:
        extremes = [
            text
            for measure, sign in ((DISTANCE, 1.0), (GAP, 1.0), (TTC, 1.0), (DRAC, -1.0))
            for text in _extreme_and_time_cells(drive, pair, rows, measure, sign)
        ]
        n_warnings = sum(each.other is other for each in drive_encounters.encounters)
        n_conflicts = sum(each.other is other for each in drive_encounters.conflicts)
        table.append((short_vehicle_name(other.kind, other.id), *extremes, str(n_warnings), str(n_conflicts)))
    columns = (
        ("other", False),
        *((name, True) for what in EXTREME_COLUMN_HEADINGS for name in (what, "at [s]")),
        ("warnings", True),
        ("conflicts", True),
    )
    hint = "by the estimated tracks, while one of the two moved; nearest: the centres, gap: the outlines"
    if len(near) > len(table):
        hint += f"; the {len(table)} of {len(near)} that came nearest"
    return TableView("How critical each other came to be", columns, tuple(table), hint)


def conflicts_table(drive: Drive, drive_encounters: DriveEncounters, log: str) -> TableView | None:
    """Build the table of all conflicts, warned of or not; None where there was none."""
    found = drive_encounters.conflicts
    if not found:
        return None
    rows = [_conflict_cells(drive, each) for each in found[:MAX_LISTED_CONFLICTS]]
    columns = (
        ("with", False), ("from [s]", True), ("to [s]", True), ("nearest [m]", True), ("at [s]", True),
        ("warned by", False),
    )  # fmt: skip
    hint = f"a conflict: {drive.warning_config.parsed_conflict_definition.conflict_text}"
    if len(found) > len(rows):
        hint += f"; the first {len(rows)} of {len(found)}"
    names = tuple(conflict_anchor_names(log, drive_encounters)[: len(rows)])
    return TableView("Conflicts", columns, tuple(rows), hint, row_marks=names)


def _conflict_cells(drive: Drive, conflict: Conflict) -> tuple[str, ...]:
    met = conflict.conflict
    times = [_seconds_since_start_text(drive, stamp) for stamp in (met.onset_ns, met.end_ns)]
    warned = ", ".join(f"warning {number}" for number in conflict.warning_ids)
    name = short_vehicle_name(conflict.other.kind, conflict.other.id)
    return name, *times, f"{met.closest_m:.2f}", _seconds_since_start_text(drive, met.closest_ns), warned or "nobody"


def _extreme_and_time_cells(
    drive: Drive, pair: Pair, rows: Rows, measure: PairQuantity, sign: float
) -> tuple[str, str]:
    """Return the least (or with -1 the largest) value and its time; `-` where the measure is never defined."""
    values = sign * pair.evaluate_measure(measure)[rows]
    if np.isnan(values).all():
        return "-", "-"
    row = int(np.nanargmin(values))
    value = sign * float(values[row])
    return f"{value:.2f}" if math.isfinite(value) else "contact", _seconds_since_start_text(
        drive, int(pair.stamp_ns[rows[row]])
    )


def _seconds_since_start_text(drive: Drive, stamp_ns: int) -> str:
    """Format a stamp as seconds since the log began."""
    return f"{(stamp_ns - drive.start_ns) / NS_PER_S:.1f}"


def unwarned_conflict_links(drive_encounters: DriveEncounters, log: str) -> list[tuple[str, str]]:
    """Return anchor name and text of each listed conflict without a warning."""
    named = list(zip(conflict_anchor_names(log, drive_encounters), drive_encounters.conflicts, strict=True))[
        :MAX_LISTED_CONFLICTS
    ]
    return [
        (mark, f"conflict with {short_vehicle_name(e.other.kind, e.other.id)}")
        for mark, e in named
        if not e.warning_ids
    ]


def stable_anchor_names(log: str, kind: str, distinguishing_keys: Iterable[tuple[str, ...]]) -> list[str]:
    """Return a name such as `warning-3f2a` for each item that a rerun keeps.

    It is made of the log's name, of whom and by which rule, and of how many such came before it in the log: not of
    times, which another version or option moves by some milliseconds. Names that agree by chance get more digits.

    Args:
        kind: `warning` or `conflict`.
        distinguishing_keys: What tells them apart (rule, other vehicle), in order of time.
    """
    before: Counter[tuple[str, ...]] = Counter()
    digests = []
    for key in distinguishing_keys:
        text = "\0".join((log, kind, *key, str(before[key])))
        before[key] += 1
        digests.append(hashlib.blake2s(text.encode("utf-8", "surrogateescape")).hexdigest())
    short: dict[str, None] = {}  # in their order
    for digest in digests:
        length = next(n for n in range(MIN_HEX_DIGITS_OF_ANCHOR_NAME, len(digest) + 1) if digest[:n] not in short)
        short[digest[:length]] = None
    return [f"{kind}-{name}" for name in short]
