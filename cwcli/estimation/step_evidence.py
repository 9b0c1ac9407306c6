"""Log-likelihood of the motion by one source, given that by the others, step by step.

Residuals of a step follow Student's t distribution, so that a wrong step of a reference costs little. Its scale is
that of the hypothesis with the least scatter, but not below the floors here: noise of a step cannot decide.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cwcli.estimation.measurements import Kind
from cwcli.estimation.median import median_of_finite_values
from cwcli.estimation.step_motion import StepMotion
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.angles import wrap_angle
from cwcli.signals.columns import FloatArray
from cwcli.signals.normal_distribution import SIGMA_PER_MEDIAN_ABSOLUTE_DEVIATION

RESIDUAL_STUDENT_DEGREES_OF_FREEDOM = 4.0
"""Degrees of freedom of Student's t: tails as heavy as those of fixes in a town. Chosen by hand; not fitted."""
(
    MIN_STEP_DISTANCE_SIGMA_M,
    MIN_TURN_SIGMA_RAD,
    MIN_COURSE_SIGMA_RAD,
    MIN_SPEED_CHANGE_SIGMA_MPS,
    MIN_LATERAL_SIGMA_MPS2,
) = (
    0.5,
    0.05,
    0.05,
    0.3,
    0.4,
)
"""Least scales of a step's way (m), turn (rad), course (rad), change of speed (m/s) and lateral acceleration (m/s^2).
Chosen by hand: 2 % of a way of 25 m; 3 degrees for turn and course; for the others what a slope, a latency or a banked
road changes in 2 s."""
MIN_COMPARED_STEPS = 4
"""Least number of steps that are compared. Chosen by hand: three agree by chance."""
RESIDUAL_WITHOUT_MOTION_IN_SCALES = 6.0
"""Residual, in scales, of a step in which one hypothesis has motion and another none. Chosen: clearly an outlier."""
MIN_COURSE_SPEED_MPS = 4.0
"""Least speed in m/s at which courses are compared, as in `source_checks`; a slower car may drive backwards for
long."""
FIX_KINDS = (Kind.POSITION, Kind.VELOCITY)
"""Kinds that come from fixes."""


@dataclass(frozen=True)
class StepResiduals:
    """Residuals of the steps of one pair in one quantity.

    Attributes:
        values: Shape (n,), NaN where the pair cannot be compared.
        floor: Least scale, in the same unit.
    """

    values: FloatArray
    floor: float


def log_likelihood_gains_of_candidates(
    uncorrected_residuals: Sequence[StepResiduals], residuals_by_candidate: Sequence[Sequence[StepResiduals]]
) -> list[float]:
    """Return the log-likelihood of each candidate minus that without a correction, summed over pairs and steps."""
    gains = [0.0] * len(residuals_by_candidate)
    for k, own in enumerate(uncorrected_residuals):
        columns = [own.values, *(each[k].values for each in residuals_by_candidate)]
        known = np.isfinite(columns).any(axis=0)
        if int(known.sum()) < MIN_COMPARED_STEPS:
            continue
        columns = [column[known] for column in columns]
        counts = [int(np.isfinite(column).sum()) for column in columns]
        scatter = min(
            median_of_finite_values(np.abs(column[np.isfinite(column)]))
            for column, count in zip(columns, counts, strict=True)
            if 2 * count >= max(counts)
        )
        scale = max(own.floor, SIGMA_PER_MEDIAN_ABSOLUTE_DEVIATION * scatter)
        values = [_log_likelihood_of_residuals(column, scale) for column in columns]
        for i in range(len(residuals_by_candidate)):
            gains[i] += values[i + 1] - values[0]
    return gains


def step_residuals_of_pair(one: StepMotion, other: StepMotion) -> list[StepResiduals]:
    """Return the residuals of a pair in all quantities, in a fixed order; NaN where the pair has no such quantity."""
    kinds = {one.kind, other.kind}
    found = []
    if kinds <= {*FIX_KINDS, Kind.SPEED} and kinds != {Kind.POSITION}:
        found.append(StepResiduals(one.distance_m - other.distance_m, MIN_STEP_DISTANCE_SIGMA_M))
    found.append(StepResiduals(wrap_angle(one.turn_rad - other.turn_rad), MIN_TURN_SIGMA_RAD))
    fixes = [m for m in (one, other) if m.kind in FIX_KINDS]
    if fixes and one.has_zero_angle and other.has_zero_angle:
        with np.errstate(invalid="ignore"):
            rows = np.abs(fixes[0].speed_mps) > MIN_COURSE_SPEED_MPS
        difference = np.where(rows, wrap_angle(one.angle_rad - other.angle_rad), np.nan)
        found.append(StepResiduals(difference, MIN_COURSE_SIGMA_RAD))
    if Kind.ACCEL in kinds and len(kinds) == 2:
        change = one.speed_change_to_next_step_mps - other.speed_change_to_next_step_mps
        known = change[np.isfinite(change)]
        found.append(
            StepResiduals(change - (median_of_finite_values(known) if len(known) else 0.0), MIN_SPEED_CHANGE_SIGMA_MPS)
        )
    return found


def _log_likelihood_of_residuals(residuals: FloatArray, scale: float) -> float:
    """Return the log-likelihood of residuals (n,) up to a constant; NaN counts as RESIDUAL_WITHOUT_MOTION_IN_SCALES."""
    in_scales = np.where(np.isfinite(residuals), residuals / scale, RESIDUAL_WITHOUT_MOTION_IN_SCALES)
    nu = RESIDUAL_STUDENT_DEGREES_OF_FREEDOM
    return -0.5 * (nu + 1.0) * float(np.log1p(np.square(in_scales) / nu).sum())
