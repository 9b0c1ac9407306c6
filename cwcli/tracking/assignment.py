"""Global nearest neighbour: the assignment of detections to tracks that is best for all together.

The assignment problem is solved by `lap` (Jonker and Volgenant's algorithm; imports in 20 ms beside NumPy, SciPy's
takes 450 ms). It is split into groups of tracks that compete for the same detections, so that the matrices stay small.
"""

from __future__ import annotations

import numpy as np

from cwcli.signals.columns import FloatArray, Int64Array, sort_distinct_values

MAX_CANDIDATES_PER_TRACK = 32
"""Number of best detections of each track that are considered; it bounds the memory. Chosen by hand."""
MAX_TRACK_DETECTION_PAIRS_KEPT_PER_GROUP = 2000
"""Number of pairs that a group with more detections than this keeps, about; it bounds the memory. Chosen by hand."""
_FORBIDDEN_PAIR_COST = 1.0e9
"""Cost of a forbidden pair in the assignment: larger than any sum of gains."""


def rows_and_columns_of_best_pairs(gain: FloatArray) -> tuple[Int64Array, Int64Array]:
    """Find the pairs (row, column) that maximise the summed gain; pairs without a positive gain are left out.

    Args:
        gain: Shape (m, n); -inf forbids a pair.
    """
    import lap

    m, n = gain.shape
    if m == 0 or n == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    if m == 1 or n == 1:
        k = int(np.argmax(gain))
        if not gain.flat[k] > 0.0:
            return np.zeros(0, np.int64), np.zeros(0, np.int64)
        return np.array([k // n]), np.array([k % n])
    useful = gain > 0.0
    # One spare column a row and one spare row a column, at cost 0, make it square: leaving out is always possible.
    cost = np.full((m + n, m + n), _FORBIDDEN_PAIR_COST)
    cost[:m, :n][useful] = -gain[useful]
    cost[np.arange(m), n + np.arange(m)] = 0.0
    cost[m + np.arange(n), np.arange(n)] = 0.0
    cost[m:, n:] = 0.0
    _, columns, _ = lap.lapjv(cost)
    columns = np.asarray(columns[:m], np.int64)
    rows = np.flatnonzero(columns < n)
    good = useful[rows, columns[rows]]
    return rows[good], columns[rows][good]


def _keep_best_of_each_row(gain: FloatArray, k: int) -> FloatArray:
    """Set the gain to -inf in all but the k best columns of each row."""
    if gain.shape[1] <= k:
        return gain
    best = np.argpartition(-gain, k - 1, axis=1)[:, :k]
    out = np.full_like(gain, -np.inf)
    np.put_along_axis(out, best, np.take_along_axis(gain, best, axis=1), axis=1)
    return out


def _group_rows_by_shared_columns(useful: np.ndarray) -> list[Int64Array]:
    """Group rows that share useful columns (m, n), directly or through others."""
    m = useful.shape[0]
    label = np.arange(m)
    while True:
        lowest = np.where(useful, label[:, None], m).min(axis=0)
        new = np.minimum(label, np.where(useful, lowest[None, :], m).min(axis=1))
        new = new[new]
        if (new == label).all():
            break
        label = new
    return [np.flatnonzero(label == k) for k in sort_distinct_values(label)]


def rows_and_columns_assigned_in_groups(gain: FloatArray) -> tuple[Int64Array, Int64Array]:
    """Find the pairs of `solve` group by group, with at most the `MAX_CANDIDATES_PER_TRACK` best pairs of each row.

    Args:
        gain: Shape (tracks, detections): log-likelihood ratio of the pair against leaving both alone.
    """
    with np.errstate(invalid="ignore"):
        rows = np.flatnonzero((gain > 0.0).any(axis=1))
    if not len(rows):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    small = _keep_best_of_each_row(gain[rows], MAX_CANDIDATES_PER_TRACK)
    columns = np.flatnonzero((small > 0.0).any(axis=0))
    small = small[:, columns]
    useful = small > 0.0
    is_only_choice = (useful.sum(axis=1) == 1) & (useful[:, useful.sum(axis=0) == 1].any(axis=1))
    a, b = (
        [rows[is_only_choice]],
        [columns[np.argmax(useful[is_only_choice], axis=1)]] if is_only_choice.any() else [np.zeros(0, np.int64)],
    )
    rest = np.flatnonzero(~is_only_choice)
    for group in _group_rows_by_shared_columns(useful[rest]) if len(rest) else []:
        members = rest[group]
        mine = np.flatnonzero(useful[members].any(axis=0))
        if len(mine) > MAX_TRACK_DETECTION_PAIRS_KEPT_PER_GROUP:
            small[members] = _keep_best_of_each_row(
                small[members], max(2, MAX_TRACK_DETECTION_PAIRS_KEPT_PER_GROUP // len(members))
            )
            mine = np.flatnonzero((small[members] > 0.0).any(axis=0))
        i, j = rows_and_columns_of_best_pairs(small[np.ix_(members, mine)])
        a.append(rows[members[i]])
        b.append(columns[mine[j]])
    return np.concatenate(a), np.concatenate(b)
