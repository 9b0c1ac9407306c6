"""The plain twins of `cwcli.kernels.lane_stripes` and `lane_ridge`, written as they are defined."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from cwcli.kernels import lane_stripes
from cwcli.signals.columns import FloatArray
from cwcli.signals.lane_geometry import Pinhole, far_near_bend_spiral_of_parallel_line, image_columns_of_arcs


def mean_between(row: FloatArray, start: float, end: float) -> float:
    """Mean of a row between two places (pixel u covers u to u + 1), as far as they lie in the row."""
    start, end = max(start, 0.0), min(end, float(len(row)))
    if end - start < 0.5:
        return float(row[0] if start < len(row) / 2 else row[-1])
    total = 0.0
    for u in range(len(row)):
        total += row[u] * max(0.0, min(end, u + 1.0) - max(start, float(u)))
    return total / (end - start)


def ridges(
    grey: npt.NDArray[np.uint8],
    rows: npt.NDArray[np.int32],
    horizon: float,
    stripe: lane_stripes.Stripe,
    *,
    is_dark: bool = False,
) -> FloatArray:
    """Evidence of a bright stripe, or of a dark one, centred at each pixel of the rows."""
    inner_h, near_h, wide_h = stripe["inner"], stripe["gap"], stripe["side"]
    floor, relative, rough = stripe["floor_grey"], stripe["relative"], stripe["rough"]
    lopsided, dead, crowded = stripe["lopsided"], stripe["dead"], stripe["crowded"]
    made = np.zeros((len(rows), grey.shape[1]))
    for i, v in enumerate(rows.tolist()):
        h = max(v - horizon, 1.0)
        inner = max(inner_h * h, 1.0)
        near = max(near_h * h, 0.5 * inner + 0.5)
        far = max(near + wide_h * h, near + 1.5)
        reach = 0 if is_dark else int(inner_h * h >= 2.0)
        row = (-1.0 if is_dark else 1.0) * grey[max(v - reach, 0) : v + reach + 1].max(axis=0).astype(float)
        centres = np.arange(len(row)) + 0.5
        middle = np.array([mean_between(row, u - inner / 2, u + inner / 2) for u in centres])
        left = np.array([mean_between(row, u - far, u - near) for u in centres])
        right = np.array([mean_between(row, u + near, u + far) for u in centres])
        brighter, darker = np.maximum(left, right), np.minimum(left, right)
        texture = np.maximum(darker - middle, 0.0).mean()
        contrast = np.maximum(middle - brighter - lopsided * (brighter - darker), 0.0)
        noise = floor + relative * np.abs(brighter) + rough * texture
        evidence = np.maximum(contrast**2 / (contrast**2 + noise**2) - dead, 0.0) / (1.0 - dead)
        made[i] = evidence / (1.0 + (evidence.mean() / crowded) ** 2)
    return made


def with_joints(
    bright: FloatArray, dark: FloatArray, rows: npt.NDArray[np.int32], horizon: float, *, weight: float, reach: float
) -> FloatArray:
    """Evidence of stripes, or `weight` times that of the best joint within `reach` h, if it is more."""
    made = np.array(bright)
    for i, v in enumerate(rows.tolist()):
        near = widened(dark[i : i + 1], math.floor(reach * max(v - horizon, 1.0) + 0.5))[0]
        made[i] = np.maximum(made[i], weight * near)
    return made


def column(lane: FloatArray, place: float, h: float, *, min_h: float, centre: float, focal: float) -> float:
    """A line of a lane h rows below the horizon: a polynomial in gentle bends, else a circle, by Pythagoras, or spiral.

    On the road in units in which x = 1 / h and y = (u - centre) x / focal, to the right.
    """
    slope = (lane[0] - centre) / focal
    curvature = 2.0 * lane[3] / focal / (1.0 + slope**2) ** 1.5
    if abs(curvature) + 3.0 * abs(lane[5]) / focal / (1.0 + slope**2) ** 1.5 / min_h <= 0.2 * min_h:
        return float(lane[0] + place * h + lane[3] / h + lane[5] / h**2)
    if lane[5]:
        road = np.array(
            far_near_bend_spiral_of_parallel_line(lane[0], place, lane[3], lane[5], Pinhole(centre, focal, 1.0))
        )
        return float(image_columns_of_arcs(road, np.array(h), np.array(centre), np.array(focal)))
    x, y0 = 1.0 / h, place / focal
    centre_x = -slope / math.hypot(1.0, slope) / curvature  # of all lines
    radius = abs(1.0 / curvature - y0)
    if max(abs(x - centre_x), abs(centre_x)) >= 0.97 * radius:
        return math.nan
    y = y0 + math.copysign(1.0, curvature) * (
        math.sqrt(radius**2 - centre_x**2) - math.sqrt(radius**2 - (x - centre_x) ** 2)
    )
    return centre + focal * y / x


def objective(
    evidence: npt.NDArray[np.floating],
    broad: npt.NDArray[np.floating],
    rows: npt.NDArray[np.int32],
    lane: FloatArray,
    prior: FloatArray,
    *,
    weight: float,
    min_h: float,
    beside: float,
    half: float,
    segment: int,
    pinhole: tuple[float, float],
) -> float:
    """The objective of one lane (u0, middle, width, k, v0, q)."""
    centre, focal = pinhole
    if (lane < prior[:, 2]).any() or (lane > prior[:, 3]).any():
        return -1e30
    z = ((lane - prior[:, 0]) / prior[:, 1]) ** 2
    z[3] /= 1.0 + z[3] / 9.0
    total = 0.0
    for share, table, scale in ((1.0, evidence, 0.5), (beside, broad, 1.5)):
        for sign in (-1.0, 1.0):
            for start in range(0, len(rows), segment):
                e = 0.0
                for r in range(start, min(start + segment, len(rows))):
                    h = rows[r] - lane[4]
                    if h >= min_h:
                        place = lane[1] + sign * scale * lane[2]
                        e += at(table[r], column(lane, place, h, min_h=min_h, centre=centre, focal=focal))
                total += share * e / (e + half)
    return float(total * segment / len(rows) - weight * z.sum())


def at(row: FloatArray, u: float) -> float:
    """Linear between pixels; nothing outside."""
    if not 0.0 <= u <= len(row) - 1.0:
        return 0.0
    i = min(math.floor(u), len(row) - 2)
    return float(row[i] + (u - i) * (row[i + 1] - row[i]))


def widened(evidence: FloatArray, reach: int) -> FloatArray:
    """The greatest value within `reach` columns."""
    columns = range(evidence.shape[1])
    return np.stack([evidence[:, max(u - reach, 0) : u + reach + 1].max(axis=1) for u in columns], axis=1)


def supports(
    evidence: npt.NDArray[np.floating],
    rows: npt.NDArray[np.int32],
    lane: FloatArray,
    *,
    min_h: float,
    half: float,
    segment: int,
    pinhole: tuple[float, float],
) -> list[float]:
    """How much of each boundary shows paint."""
    made = []
    for place in (lane[1] - 0.5 * lane[2], lane[1] + 0.5 * lane[2]):
        total = weight = 0.0
        for start in range(0, len(rows) // segment * segment, segment):
            h = rows[start : start + segment] - lane[4]
            centre, focal = pinhole
            u = np.array([column(lane, place, each, min_h=min_h, centre=centre, focal=focal) for each in h])
            seen = (h >= min_h) & (u >= 0.0) & (u <= evidence.shape[1] - 1.0)
            e = sum(at(evidence[start + k], u[k]) for k in np.flatnonzero(seen))
            total += e / (e + half) * seen.mean()
            weight += seen.mean()
        made.append(float(total / max(weight, 1.0)))
    return made


def parabola(
    lane: FloatArray, side: int, top_y: float, height: int, width: int, *, min_h: float, centre: float, focal: float
) -> FloatArray:
    """a, b, c with NumPy's least squares."""
    y = 0.5 + (np.arange(16) + 0.5) / 16 * top_y
    h = height - y - lane[4]
    place = lane[1] + (side - 0.5) * lane[2]
    x = np.array([column(lane, place, max(each, 1e-9), min_h=min_h, centre=centre, focal=focal) for each in h]) + 1.0
    below = (h > 0.0) & np.isfinite(x)
    use = below & (x >= 1.0) & (x <= width)
    if use.sum() < 5:
        use = below
    return np.asarray(np.polyfit(y[use], x[use], 2)) if use.sum() > 2 else np.full(3, np.nan)
