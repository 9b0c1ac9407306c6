"""Where the sensors stand on the car, as far as that is given, and which of its points the published states are of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cwcli.estimation.config import LeverArms
from cwcli.estimation.measurements import Kind
from cwcli.estimation.passes import N_MOTION, Series
from cwcli.estimation.prepare import PreparedSeries
from cwcli.signals.columns import FloatArray
from cwcli.signals.vehicle_state import HEADING


def placed(prepared: Sequence[PreparedSeries], lever_arms: LeverArms) -> list[PreparedSeries]:
    """The series with the given places; one that is not named has none."""
    return [
        replace(p, series=replace(p.series, place_m=lever_arms.get(p.series.source, p.series.place_m)))
        for p in prepared
    ]


def at_antenna(series: Sequence[Series], state: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The motion states and their covariances at the point that the position source measures.

    Where the log shows that an antenna stands ahead of the point p whose course is the heading, the filter's states are
    of p; those that are published are of p + R(heading) (l, 0), whether l was found in a log or not. Where the places
    are given, whoever gave them names p.

    Args:
        series: As the filter used them.
        state: Shape (m, n), of p.
        covariance: Shape (m, n, n).

    Returns:
        Shapes (m, 8) and (m, 8, 8).
    """
    positions = [s for s in series if s.kind is Kind.POSITION and len(s)]
    ahead = next((s.ahead_state for s in positions if s.ahead_state >= 0), -1)
    if ahead < 0 or any(s.place_m is not None for s in positions):
        return np.ascontiguousarray(state[:, :N_MOTION]), covariance[:, :N_MOTION, :N_MOTION]
    c, s = np.cos(state[:, HEADING]), np.sin(state[:, HEADING])
    lever_m = state[:, ahead]
    motion = state[:, :N_MOTION].copy()
    motion[:, 0] += lever_m * c
    motion[:, 1] += lever_m * s
    jacobian = np.zeros((len(state), N_MOTION, state.shape[1]))
    jacobian[:, np.arange(N_MOTION), np.arange(N_MOTION)] = 1.0
    jacobian[:, 0, HEADING], jacobian[:, 1, HEADING] = -lever_m * s, lever_m * c
    jacobian[:, 0, ahead], jacobian[:, 1, ahead] = c, s
    moved = jacobian @ covariance @ jacobian.transpose(0, 2, 1)
    return motion, 0.5 * (moved + moved.transpose(0, 2, 1))
