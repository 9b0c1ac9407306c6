"""Plain twin of `cwcli.kernels.contact`: one line and one step at a time, with matrices written out."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
Size = tuple[float, float]

OUTSIDE, ACROSS = 4.5, 0.02


def contact_probability(
    x: FloatArray,
    y: FloatArray,
    headings: tuple[FloatArray, FloatArray],
    covariances: tuple[FloatArray, FloatArray],
    sizes: tuple[Size, Size],
    *,
    lines: Sequence[FloatArray],
    enough_below: Sequence[float],
    end: int,
    far_sigmas: float,
    least_m2: float,
) -> float:
    """The probability of contact within the first `end` steps of one pair of paths of q points."""
    q = len(x)
    roots = [np.array([_root(np.add(each, [least_m2, 0.0, least_m2])) for each in own]) for own in covariances]
    steps = []
    for k in range(q - 1):
        turn = [0.5 * (own[k] + own[k + 1]) for own in headings]
        start, stop = np.array([x[k], y[k]]), np.array([x[k + 1], y[k + 1]])
        begin = np.hstack([-roots[0][k], roots[1][k]])  # (2, 4): errors to places
        finish = np.hstack([-roots[0][k + 1], roots[1][k + 1]])
        step = (0.5 * (start + stop), stop - start, 0.5 * (begin + finish), finish - begin)
        slabs = [(normal, _reach(normal, turn, sizes)) for normal in _normals(turn, stop - start)]
        far = max(
            (abs(n @ step[0]) - reach - 0.5 * abs(n @ step[1])) / np.linalg.norm(n @ step[2]) for n, reach in slabs
        )
        if far < far_sigmas:
            steps.append((far, k, step, slabs))
    if not steps:
        return 0.0
    _, k, (_, _, nearest, _), _ = min(steps, key=lambda each: each[0])
    heading = 0.5 * (headings[0][k] + headings[0][k + 1])
    axes = np.array([[math.cos(heading), -math.sin(heading)], [math.sin(heading), math.cos(heading)]])
    basis = nearest.T @ np.linalg.inv(_sqrt(nearest @ nearest.T))
    host, other = np.linalg.inv(-nearest[:, :2]), np.linalg.inv(nearest[:, 2:])
    rest = np.vstack([host, other]) @ np.linalg.inv(_sqrt(host @ host + other @ other))
    shares = [
        math.exp(-0.5 * max(far, 0.0) ** 2) * ((n @ step[2] @ rest) ** 2).sum() / ((n @ step[2]) ** 2).sum()
        for far, _, step, slabs in steps
        for n, _ in slabs
    ]
    used = lines[sum(max(shares) >= bound for bound in enough_below)]
    total = 0.0
    for cosine, sine, one, two in used:
        along, aside = basis @ axes @ [cosine, sine], rest @ axes @ [one, two]
        hits = [
            _interval(along, aside, step, slabs, [0.5 * (own[k] + own[k + 1]) for own in headings], sizes)
            for _, k, step, slabs in steps
            if k < end
        ]
        total += _share([_extended(*each) for each in hits if max(each[0], -OUTSIDE) <= min(each[1], OUTSIDE)])
    return total / len(used)


def straight_points(
    x: FloatArray,
    y: FloatArray,
    headings: tuple[FloatArray, FloatArray],
    covariances: tuple[FloatArray, FloatArray],
    sizes: tuple[Size, Size],
    *,
    ends: Sequence[int],
    least_m2: float,
    sigmas: float,
) -> list[int]:
    """The points between which all is straight: as far as it goes, halved until it is, then twice as far again."""
    roots = [np.array([_root(np.add(each, [least_m2, 0.0, least_m2])) for each in own]) for own in covariances]
    places = np.stack([x, y], axis=1)

    def off(values: FloatArray, a: int, b: int, at: int) -> float:
        share = (at - a) / (b - a)
        return float(np.linalg.norm(values[at] - (1.0 - share) * values[a] - share * values[b]))

    def gap(a: int, b: int, at: int, turned: float) -> float:
        angle = headings[0][at] + turned
        normal = np.array([math.cos(angle), math.sin(angle)])
        one, two = places[a] @ normal, places[b] @ normal
        least = 0.0 if one * two <= 0.0 else min(abs(one), abs(two))
        reach = _reach(normal, [own[at] for own in headings], sizes)
        return max(least - reach, 0.0) / float(np.linalg.norm(np.hstack([root[at] for root in roots]).T @ normal))

    def is_straight(a: int, b: int, at: int) -> bool:
        both = sum(root[at] @ root[at] for root in roots)
        bound = sigmas * math.sqrt(np.linalg.det(both) / np.trace(both))
        corners = sum(
            0.5 * math.hypot(*size) * abs(own[at] - 0.5 * (own[a] + own[b]))
            for own, size in zip(headings, sizes, strict=True)
        )
        bent = math.hypot(*(off(root, a, b, at) for root in roots))
        grown = math.hypot(*(float(np.linalg.norm(root[b] - root[a])) for root in roots))
        far = min(max(gap(a, b, at, 0.0), gap(a, b, at, 0.5 * math.pi)), 3.0)
        most = max(off(places, a, b, at), corners / 2.0, bent / 0.5, grown / 20.0)
        return most <= bound * math.exp(0.5 * far * far)

    points, length = [0], len(x)
    for last in (*ends, len(x) - 1):
        while points[-1] < last:
            a = points[-1]
            b = min(a + length, last)
            while b > a + 1 and not all(
                is_straight(a, b, at) for at in (a + max((b - a) // 4, 1), b - max((b - a) // 4, 1))
            ):
                b = a + (b - a + 1) // 2
            length = 2 * (b - a)
            points.append(b)
    return points


def _normals(turn: Sequence[float], way: FloatArray) -> list[FloatArray]:
    normals = [np.array([-way[1], way[0]]) / np.linalg.norm(way)] if np.linalg.norm(way) > 1e-9 else []
    for angle in turn:
        normals += [np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])]
    return normals


def _reach(normal: FloatArray, turn: Sequence[float], sizes: tuple[Size, Size]) -> float:
    total = 0.0
    for angle, (length, width) in zip(turn, sizes, strict=True):
        ahead, left = np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])
        total += 0.5 * (length * abs(normal @ ahead) + width * abs(normal @ left))
    return total


def _extended(low: float, high: float) -> tuple[float, float]:
    """An interval whose ends outside are without an end."""
    return -math.inf if low < -OUTSIDE else low, math.inf if high > OUTSIDE else high


def _interval(
    along: FloatArray,
    aside: FloatArray,
    step: tuple[FloatArray, ...],
    slabs: Sequence[tuple[FloatArray, float]],
    turn: Sequence[float],
    sizes: tuple[Size, Size],
) -> tuple[float, float]:
    """Where on the line `along r + aside` the step is touched."""
    middle, way, places, change = step
    centre, slope = middle + places @ aside, places @ along
    moved, turned = 0.5 * (way + change @ aside), 0.5 * change @ along

    def bounds(n: FloatArray, reach: float) -> tuple[float, float]:
        """The least and the greatest r within reach along a direction, at the step's begin or at its end."""
        turning = 0.0 if abs(n @ turned) >= abs(n @ slope) else n @ turned
        found = [
            sorted(
                ((side * reach - n @ centre - at * (n @ moved)) / (n @ slope + at * turning)) for side in (-1.0, 1.0)
            )
            for at in (-1.0, 1.0)
        ]
        return float(min(low for low, _ in found)), float(max(high for _, high in found))

    def cut(interval: tuple[float, float], n: FloatArray, reach: float) -> tuple[float, float]:
        low, high = bounds(n, reach)
        return max(interval[0], low), min(interval[1], high)

    interval = (-math.inf, math.inf)
    for n, reach in slabs:
        interval = cut(interval, n, reach)
    for at in interval:
        if interval[0] > interval[1] or abs(at) > OUTSIDE:
            continue
        way_there = moved + at * turned
        length = float(np.linalg.norm(way_there))
        if length < 1e-9 or abs(slabs[0][0] @ way_there) <= ACROSS * length:
            continue
        across = np.array([-way_there[1], way_there[0]]) / length
        interval = cut(interval, across, _reach(across, turn, sizes))
    return interval


def _share(intervals: Sequence[tuple[float, float]]) -> float:
    """Share of a line in the union of intervals."""
    total, reached = 0.0, -math.inf
    for low, high in sorted(intervals):
        if high > reached:
            total += _below(high) - _below(max(low, reached))
            reached = high
    return total


def _below(r: float) -> float:
    half = 0.5 * math.exp(-0.5 * r * r) if math.isfinite(r) else 0.0
    return half if r < 0.0 else 1.0 - half


def _root(covariance: FloatArray) -> FloatArray:
    return _sqrt(np.array([[covariance[0], covariance[1]], [covariance[1], covariance[2]]]))


def _sqrt(matrix: FloatArray) -> FloatArray:
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T)
