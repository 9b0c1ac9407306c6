"""A first guess of a latency: changes of speed and course against the IMU's integrals, over a grid of shifts.

The guess only has to be near enough (a few tenths of a second) for the filter's own estimate, which takes over.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cwcli.estimation.measurements import Kind
from cwcli.estimation.passes import Series
from cwcli.signals.angles import wrap_angle
from cwcli.signals.columns import FloatArray

GRID_S = np.arange(-0.5, 2.01, 0.1)
SPAN_S = 1.0  # changes are taken over about this time
MAX_SPAN_S = 2.5  # longer changes smear
MOVING_MPS = 2.0
CLIP = 3.0  # residuals beyond so many sigmas count no more


def coarse_latency(target: Series, others: Sequence[Series]) -> float:
    """Return the shift of `GRID_S` at which the target agrees best with the reference, or 0 where that is not clear.

    Args:
        target: POSITION, VELOCITY, SPEED or HEADING.
        others: All series; the first ACCEL (else SPEED) and YAW_RATE with a bias state, or any, are the reference.
    """
    changes = _changes(target)
    cost = np.zeros(len(GRID_S))
    n_used = 0
    for kind, times, all_changes in changes:
        reference = _reference(others, kind, target)
        known = np.isfinite(all_changes) & (np.diff(times) < MAX_SPAN_S)
        if reference is None or known.sum() < 10:
            continue
        time, integral = reference
        first, last, change = times[:-1][known], times[1:][known], all_changes[known]
        shifted = [np.interp(last - tau, time, integral) - np.interp(first - tau, time, integral) for tau in GRID_S]
        span = last - first
        residuals = np.array([change - s for s in shifted])
        # The reference's bias is a constant rate.
        residuals -= np.median(residuals / span, axis=1)[:, None] * span
        scale = np.median(np.abs(residuals), axis=1).min() / 0.6745 + 1e-9
        cost += np.minimum((residuals / scale) ** 2, CLIP**2).sum(axis=1)
        n_used += len(change)
    if not n_used:
        return 0.0
    best = int(cost.argmin())
    zero = int(np.abs(GRID_S).argmin())
    # A guess away from zero has to be clearly better than zero.
    if cost[zero] - cost[best] < 9.0:
        return 0.0
    if 0 < best < len(GRID_S) - 1:
        left, middle, right = cost[best - 1 : best + 2]
        bend = left - 2.0 * middle + right
        if bend > 0:
            return float(GRID_S[best] + 0.05 * (left - right) / bend)
    return float(GRID_S[best])


def _changes(s: Series) -> list[tuple[Kind, FloatArray, FloatArray]]:
    """Return (what the change integrates, times (k + 1,), changes between them (k,))."""
    stride = max(1, round(SPAN_S / max(float(np.median(np.diff(s.time_s))), 1e-3))) if len(s) > 2 else 1
    time, values = s.time_s[::stride], s.values[::stride]
    if len(time) < 5:
        return []
    if s.kind is Kind.SPEED:
        return [(Kind.ACCEL, time, np.diff(values[:, 0]))]
    if s.kind is Kind.HEADING:
        return [(Kind.YAW_RATE, time, wrap_angle(np.diff(values[:, 0])))]
    if s.kind is Kind.POSITION:
        span = np.maximum(np.diff(time), 1e-3)
        values = np.diff(values, axis=0) / span[:, None]
        time = 0.5 * (time[1:] + time[:-1])
    elif s.kind is not Kind.VELOCITY:
        return []
    speed = np.hypot(values[:, 0], values[:, 1])
    course = np.arctan2(values[:, 1], values[:, 0])
    moving = (speed[1:] > MOVING_MPS) & (speed[:-1] > MOVING_MPS)
    turned = np.where(moving, wrap_angle(np.diff(course)), np.nan)
    return [(Kind.ACCEL, time, np.diff(speed)), (Kind.YAW_RATE, time, turned)]


def _reference(others: Sequence[Series], kind: Kind, target: Series) -> tuple[FloatArray, FloatArray] | None:
    """Return times and the integral of the reference's rate (for ACCEL also a speed itself)."""
    for s in others:
        if s.kind is kind and s.latency_state < 0 and len(s) > 10 and s is not target:
            step = np.diff(s.time_s)
            area = 0.5 * (s.values[1:, 0] + s.values[:-1, 0]) * step
            return s.time_s, np.concatenate(([0.0], np.cumsum(area)))
    if kind is Kind.ACCEL:
        for s in others:
            if s.kind is Kind.SPEED and s.latency_state < 0 and len(s) > 10 and s is not target:
                return s.time_s, s.values[:, 0]
    return None
