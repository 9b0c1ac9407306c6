"""Fewer points that look the same: what is drawn of a long signal.

Nothing is averaged. A line keeps the smallest and the largest sample of each of its pieces, so that no spike is lost; a
band covers every sample's band; dots that would fall onto the same spot are drawn once; a track keeps each point within
a stated distance.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.signals.columns import FloatArray
from cwcli.signals.row_order import first_and_last_rows_of_runs

Rows = npt.NDArray[np.intp]


def min_max_row_indices(values: FloatArray, n_pieces: int) -> Rows:
    """Rows of the least and the largest value of each of `n_pieces` pieces of equal numbers of rows, in order.

    All rows where there are not more than twice as many; the first and the last row always.

    Args:
        values: Shape (n,); NaN rows are kept only as the place of a gap, one a piece.
        n_pieces: Positive.
    """
    n = len(values)
    if n <= 2 * n_pieces:
        return np.arange(n)
    edges = np.linspace(0, n, n_pieces + 1).astype(np.intp)
    known = np.isfinite(values)
    starts = edges[:-1]
    piece = np.repeat(np.arange(n_pieces), np.diff(edges))
    low, high = np.where(known, values, np.inf), np.where(known, values, -np.inf)
    least, most = np.minimum.reduceat(low, starts), np.maximum.reduceat(high, starts)
    rows = np.arange(n)
    first_least = np.minimum.reduceat(np.where(low == least[piece], rows, n), starts)
    first_most = np.minimum.reduceat(np.where(high == most[piece], rows, n), starts)
    first_gap = np.minimum.reduceat(np.where(known, n, rows), starts)
    chosen = np.concatenate([[0, n - 1], first_least, first_most, first_gap])
    return np.unique(chosen[chosen < n])


def reduce_band_to_rows_and_bounds(
    lower: FloatArray, upper: FloatArray, n_pieces: int
) -> tuple[Rows, FloatArray, FloatArray]:
    """Reduce a band to one pair of values per piece that covers every sample's band.

    Args:
        lower, upper: Shape (n,).

    Returns:
        The row that each piece stands at (its middle one), its least `lower`, its largest `upper`.
    """
    n = len(lower)
    if n <= n_pieces:
        return np.arange(n), lower, upper
    edges = np.linspace(0, n, n_pieces + 1).astype(np.intp)
    rows = (edges[:-1] + edges[1:]) // 2
    return rows, np.fmin.reduceat(lower, edges[:-1]), np.fmax.reduceat(upper, edges[:-1])


def first_row_per_grid_cell(x: FloatArray, y: FloatArray, n_columns: int, n_grid_rows: int) -> Rows:
    """The first row that falls into each cell of a grid over the finite points, in order."""
    known = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    if len(known) <= 1:
        return known
    cells = []
    for values, n_cells in ((x[known], n_columns), (y[known], n_grid_rows)):
        span = float(np.ptp(values)) or 1.0
        cells.append(np.minimum(((values - values.min()) / span * n_cells).astype(np.int64), n_cells - 1))
    _, first = np.unique(cells[0] * n_grid_rows + cells[1], return_index=True)
    return known[np.sort(first)]


def simplified_track_row_indices(xy: FloatArray, tolerance: float) -> Rows:
    """Rows of a line's points such that no left-out one is further than `tolerance` from the line that remains.

    Douglas and Peucker's method. A row with NaN is kept: the line is broken there.

    Args:
        xy: Shape (n, 2).
        tolerance: In the unit of `xy`.
    """
    n = len(xy)
    known: npt.NDArray[np.bool_] = np.asarray(np.isfinite(xy).all(axis=1), np.bool_)
    keep: npt.NDArray[np.bool_] = np.logical_not(known)
    pending = first_and_last_rows_of_runs(known)
    for first, last in pending:
        keep[[first, last]] = True
    while pending:
        first, last = pending.pop()
        if last - first < 2:
            continue
        inner = xy[first + 1 : last] - xy[first]
        chord = xy[last] - xy[first]
        length = float(np.hypot(*chord))
        if length > 0.0:
            along = np.clip(inner @ chord / length**2, 0.0, 1.0)
            distance = np.hypot(*(inner - along[:, None] * chord).T)
        else:
            distance = np.hypot(*inner.T)
        worst = int(distance.argmax())
        if distance[worst] > tolerance:
            middle = first + 1 + worst
            keep[middle] = True
            pending += [(first, middle), (middle, last)]
    return np.flatnonzero(keep[:n])
