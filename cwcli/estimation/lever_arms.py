"""Lever arms of the sensors, as far as they are given, and the point of the car that the published states describe."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cwcli.estimation.config import LeverArms
from cwcli.estimation.measurements import Kind
from cwcli.estimation.passes import N_MOTION_STATES, SensorSeries
from cwcli.estimation.prepare import PreparedSeries
from cwcli.lazy_dataclass import replace
from cwcli.signals.columns import FloatArray
from cwcli.signals.vehicle_state import HEADING


def set_lever_arms_of_user(prepared: Sequence[PreparedSeries], lever_arms: LeverArms) -> list[PreparedSeries]:
    """Return the series with the lever arms that the user gave; the others keep theirs."""
    return [
        replace(p, series=replace(p.series, place_m=lever_arms.get(p.series.source, p.series.place_m)))
        for p in prepared
    ]


def move_states_and_covariances_to_antenna(
    series: Sequence[SensorSeries], state: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return motion states and covariances at the point that the position source measures.

    Where the log shows that an antenna stands ahead of the point p whose course is the heading, the filter estimates p;
    the published states are those of p + R(heading) (l, 0), with the lever arm l. Where the lever arms are given, they
    define p, and the states stay at p.

    Args:
        state: Shape (m, n): states at p.
        covariance: Shape (m, n, n).

    Returns:
        Shapes (m, 8) and (m, 8, 8).
    """
    positions = [s for s in series if s.kind is Kind.POSITION and len(s)]
    ahead = next((s.ahead_state for s in positions if s.ahead_state >= 0), -1)
    if ahead < 0 or any(s.place_m is not None for s in positions):
        return np.ascontiguousarray(state[:, :N_MOTION_STATES]), covariance[:, :N_MOTION_STATES, :N_MOTION_STATES]
    c, s = np.cos(state[:, HEADING]), np.sin(state[:, HEADING])
    lever_m = state[:, ahead]
    motion = state[:, :N_MOTION_STATES].copy()
    motion[:, 0] += lever_m * c
    motion[:, 1] += lever_m * s
    jacobian = np.zeros((len(state), N_MOTION_STATES, state.shape[1]))
    jacobian[:, np.arange(N_MOTION_STATES), np.arange(N_MOTION_STATES)] = 1.0
    jacobian[:, 0, HEADING], jacobian[:, 1, HEADING] = -lever_m * s, lever_m * c
    jacobian[:, 0, ahead], jacobian[:, 1, ahead] = c, s
    moved_covariance = jacobian @ covariance @ jacobian.transpose(0, 2, 1)
    return motion, 0.5 * (moved_covariance + moved_covariance.transpose(0, 2, 1))
