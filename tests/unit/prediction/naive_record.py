"""Slow twins of `cwcli.kernels.record` and of the stream's quantiles in `cwcli.kernels.paths`: one row at a time."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.signals.columns import FloatArray, Int64Array

Index = npt.NDArray[np.intp]


def changes(
    age_s: FloatArray, value: FloatArray, first: Index, look_back_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """How much (2, n) changed over the time before each row, (n, 2, k), and over what time, (n, k)."""
    change = np.empty((len(age_s), 2, len(look_back_s)))
    passed = np.empty((len(age_s), len(look_back_s)))
    for i in range(len(age_s)):
        own = slice(first[i], i + 1)
        for k, back_s in enumerate(look_back_s):
            then = max(age_s[i] - back_s, 0.0)
            passed[i, k] = age_s[i] - then
            for axis in (0, 1):
                change[i, axis, k] = value[axis, i] - np.interp(then, age_s[own], value[axis, own])
    return change, passed


def gains(
    parts: FloatArray,
    promised: FloatArray,
    followed: FloatArray,
    *,
    step_s: FloatArray,
    knots_s: FloatArray,
    track: Index,
    known_row: Index,
    known_ns: Int64Array,
    now_ns: Int64Array,
    prior: FloatArray,
    error_m: FloatArray,
    carried: FloatArray,
    prior_outcomes: FloatArray,
) -> FloatArray:
    """The gains (n, 2, k, 3): the fleet's, then by the other vehicles, then by the own outcomes known at the row."""
    out = np.empty_like(parts)
    for i in range(len(parts)):
        for axis in (0, 1):
            for k, knot_s in enumerate(knots_s):
                x, y = promised[:, axis, k, None] * parts[:, axis, k], followed[:, axis, k]
                left = np.minimum(np.abs(y - x @ prior[axis, k]), np.abs(y))
                weight = step_s / knot_s / (1.0 + left / error_m[axis, k])
                by_row, by_time = known_row[:, k] <= i, known_ns[:, k] <= now_ns[i]
                gain = prior[axis, k]
                if k:
                    ratio = carried[axis, k]
                    gain = np.where(np.isnan(ratio), gain, np.clip(out[i, axis, k - 1] * ratio, 0.0, 1.0))
                others, own = by_time & (track != track[i]), by_row & (track == track[i])
                for is_known in (others, own) if track.max() > 0 else (own,):
                    rows = np.flatnonzero(is_known & np.isfinite(y))
                    gain = _posterior(x[rows], y[rows], weight[rows], gain, error_m[axis, k], prior_outcomes)
                out[i, axis, k] = gain
    return out


def _posterior(
    x: FloatArray, y: FloatArray, weight: FloatArray, prior: FloatArray, error_m: float, prior_outcomes: FloatArray
) -> FloatArray:
    ridge = np.diag(prior_outcomes * error_m**2)
    normal = (weight[:, None] * x).T @ x + ridge
    gain = np.linalg.solve(normal, (weight[:, None] * x).T @ y + ridge @ prior)
    doubt = error_m * np.sqrt(np.linalg.inv(normal)[0, 0] / (2.0 * np.pi))
    gain[0] = max(gain[0] - doubt, min(gain[0], prior[0]))
    return np.asarray(np.clip(gain, 0.0, 1.0))


def stream_quantiles(
    cell: Index,
    weight: FloatArray,
    track: Index,
    n_known: Index,
    asking: Index,
    prior: FloatArray,
    levels: FloatArray,
) -> FloatArray:
    """Quantiles (m, l) of the prior's mass and of the others' outcomes, in cells."""
    out = np.empty((len(n_known), len(levels)))
    for i, (count, own) in enumerate(zip(n_known, asking, strict=True)):
        rows = np.flatnonzero(track[:count] != own)
        mass = prior + np.bincount(cell[rows], weight[rows], minlength=len(prior))
        share = np.concatenate([[0.0], np.cumsum(mass)]) / mass.sum()
        out[i] = np.interp(levels, share, np.arange(len(share)))
    return out
