"""Scale of a speed against the fixes where it is far from 1.

The scale of a speed has a prior (`sensor_model`), and in short logs it is not searched at all. A speed that differs by
more than the prior allows would push the positions off the fixes. So it is divided by the ratio before the estimate,
and the user is told: either the speed is wrong, or the map of the fixes is.

In windows of MAX_DISTANCE_WINDOW_S the way D is integrated from the speed along the heading. The fixes then are c +
A D, with a place c, a rotation and the scale |A| of the window. The scatter of the windows is the sigma of their mean.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

import numpy as np

from cwcli.estimation.correction import Correction, correction_of_all_rows
from cwcli.estimation.hypotheses.base import Hypothesis
from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.passes import SensorSeries
from cwcli.estimation.prepare import PreparedSeries
from cwcli.estimation.sensor_limits import SPEED_SCALE_RANGE
from cwcli.estimation.sensor_model import SPEED_SCALE_PRIOR_SIGMA
from cwcli.estimation.source_checks import MIN_ROWS_OF_COMPARED_SOURCE, MIN_STEPS_OF_ONE_LENGTH, student_99_half_width
from cwcli.estimation.step_motion import covered_step_mask, step_edges_s, trapezoidal_integral
from cwcli.lazy_dataclass import dataclass

MIN_CORRECTED_RATIO_ERROR_IN_SIGMAS = 3.0
"""Least difference of a ratio from 1, in sigmas of the prior of a scale, that is taken off first. Chosen as for other
significance tests."""
MAX_DISTANCE_WINDOW_S = 8.0
"""Longest window, s: a gyroscope's bias hardly bends the way in it. Chosen as the longest of
`source_checks.COMPARED_STEP_LENGTHS_S`; a short log has five shorter ones."""
MIN_FIXES_PER_WINDOW = 5
"""Least number of fixes in a window. Chosen by hand; not fitted."""
MIN_RMS_SPREAD_OF_FIXES_M = 8.0
"""Least root mean square distance of the fixes of a window from their mean, m, as at 28 m in 8 s. Chosen above the
lasting errors of fixes."""


@dataclass(frozen=True)
class DistanceRatio:
    """Ratio of the way by a speed to that between the fixes.

    Attributes:
        value: The mean over the windows.
        half_width: Half of the width of its 99 % interval.
        n: Number of windows.
    """

    value: float
    half_width: float
    n: int

    @property
    def is_beyond_prior(self) -> bool:
        """Whether no usual wheel explains it, though a speedometer may."""
        difference_from_one = abs(self.value - 1.0) - self.half_width
        return (
            difference_from_one > MIN_CORRECTED_RATIO_ERROR_IN_SIGMAS * SPEED_SCALE_PRIOR_SIGMA
            and SPEED_SCALE_RANGE.contains_or_is_nan(self.value)
        )


def correct_and_list_scaled_speeds(
    measurements: Sequence[Measurements], prepared: Sequence[PreparedSeries], trusted: Collection[str]
) -> tuple[list[Measurements], list[Correction]]:
    """Return the measurements with speeds divided by their ratio to the fixes where the prior cannot hold it.

    Args:
        measurements: Measurements.
        prepared: Their series, after what contradicts the others was left out.
        trusted: Sources that are not corrected.
    """
    usable = [p.series for p in prepared if len(p.series) >= MIN_ROWS_OF_COMPARED_SOURCE and not p.series.is_exact]
    fixes = next((s for s in usable if s.kind is Kind.POSITION), None)
    turning = next((s for kind in (Kind.HEADING, Kind.YAW_RATE) for s in usable if s.kind is kind), None)
    speeds = {s.source: s for s in usable if s.kind is Kind.SPEED and s.source not in trusted}
    corrected: list[Measurements] = []
    corrections: list[Correction] = []
    for m in measurements:
        own = speeds.get(m.source) if m.kind is Kind.SPEED else None
        ratio = None if own is None or fixes is None or turning is None else find_distance_ratio(own, turning, fixes)
        if ratio is None or fixes is None or not ratio.is_beyond_prior:
            corrected.append(m)
            continue
        fault = (
            f"reads {ratio.value:.3f} times the way between the fixes, more than worn tyres explain, unless the map of "
            f"{fixes.source} is wrong"
        )
        scale = Hypothesis.of_scalar("scaled", "scale", fault, "divided by it", factor=1.0 / ratio.value)
        corrected.append(scale.correct_measurements(m))
        evidence = f"+- {ratio.half_width:.3f} in {ratio.n} windows"
        corrections.append(correction_of_all_rows(m, scale, evidence))
    return corrected, corrections


def find_distance_ratio(speed: SensorSeries, turning: SensorSeries, fixes: SensorSeries) -> DistanceRatio | None:
    """Return the ratio of the way by a speed to that between the fixes; None with too few windows in motion.

    Args:
        speed: A speed.
        turning: A heading or a yaw rate.
        fixes: Positions.
    """
    angle = np.unwrap(turning.values[:, 0])
    if turning.kind is Kind.YAW_RATE:
        angle = trapezoidal_integral(turning.time_s, turning.values[:, 0])
    velocity = speed.values[:, 0] * np.exp(1j * np.interp(speed.time_s, turning.time_s, angle))
    steps = 0.5 * (velocity[1:] + velocity[:-1]) * np.diff(speed.time_s)
    way = np.interp(fixes.time_s, speed.time_s, np.concatenate(([0.0], np.cumsum(steps))))
    place = fixes.values[:, 0] + 1j * fixes.values[:, 1]
    span_s = float(fixes.time_s[-1] - fixes.time_s[0])
    edges_s = step_edges_s([fixes], min(MAX_DISTANCE_WINDOW_S, span_s / (MIN_STEPS_OF_ONE_LENGTH + 1)))
    known = covered_step_mask(speed.time_s, edges_s) & covered_step_mask(turning.time_s, edges_s)
    begins = np.searchsorted(fixes.time_s, edges_s)
    scales, powers = [], []
    for begin, end in zip(begins[:-1][known].tolist(), begins[1:][known].tolist(), strict=True):
        if end - begin < MIN_FIXES_PER_WINDOW:
            continue
        d, z = way[begin:end] - way[begin:end].mean(), place[begin:end] - place[begin:end].mean()
        power = float((d.real**2 + d.imag**2).sum())  # the noise of fixes would make theirs larger
        shared = abs(complex((z.conj() * d).sum()))
        if shared > (end - begin) * MIN_RMS_SPREAD_OF_FIXES_M**2:
            scales.append(power / shared)
            powers.append(shared)
    if len(scales) < MIN_STEPS_OF_ONE_LENGTH:
        return None
    scale, weight = np.array(scales), np.array(powers) / sum(powers)
    mean = float((weight * scale).sum())
    n_effective = 1.0 / float((weight**2).sum())
    sigma = math.sqrt(float((weight * (scale - mean) ** 2).sum()) / max(n_effective - 1.0, 1.0))
    return DistanceRatio(
        mean, student_99_half_width(max(int(n_effective), MIN_STEPS_OF_ONE_LENGTH)) * sigma, len(scales)
    )
