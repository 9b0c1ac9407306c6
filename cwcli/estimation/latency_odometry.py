"""Delay of fixes against the way by wheel speed and yaw rate, where the IMU alone shows none.

In windows of ODOMETRY_WINDOW_LENGTH_S the way D is integrated from the speed along the course by the yaw rate. The
fixes then are z(t) = c + A D(t - tau) with a place c and a rotation and scale A of the window, which are free: no bias
of the course, scale of the wheels or slow error of the fixes beyond the window takes part. What the delay adds, -tau A
D'(t), shows where the velocity changes in the window. Each row gives a parabola in tau; the scatter over blocks of the
log is its sigma (`latency_evidence`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cwcli.estimation.latency import MIN_SIGNIFICANT_SIGMAS, Latency, LatencyStatus
from cwcli.estimation.latency_evidence import LatencyEvidence
from cwcli.estimation.measurements import Kind
from cwcli.estimation.median import median_of_finite_values
from cwcli.estimation.passes import SensorSeries
from cwcli.estimation.sensor_limits import UNKNOWN_DELAY_SIGMA_S
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.signals.columns import FloatArray

ODOMETRY_WINDOW_LENGTH_S = 20.0
"""Length of a window, s. Chosen longer than a manoeuvre, and so short that a gyroscope's bias hardly bends the way."""
MIN_ODOMETRY_WINDOWS, MIN_FIXES_PER_ODOMETRY_WINDOW = 6, 8
"""Least number of windows, and least number of fixes in one. Chosen by hand; not fitted."""
MAX_ODOMETRY_ROW_GAP_S = 0.5
"""Greatest time between two rows of speed or yaw rate in a window, s. Chosen by hand; not fitted."""
MAX_SEARCHED_DELAY_S = 1.0
"""Greatest delay that is looked for, s. Chosen as that of a receiver that smooths over a second."""
N_DELAY_ITERATIONS = 5
"""Number of steps towards the likeliest delay. Chosen: the way is nearly straight over a tenth of a second."""


ComplexArray = npt.NDArray[np.complex128]


@dataclass(frozen=True)
class _OdometryPath:
    """Way by odometry from the begin of the log on.

    Attributes:
        time_s: Shape (n,).
        velocity, way: Shape (n,): complex, east + 1j north, m/s and m; but for a rotation.
    """

    time_s: FloatArray
    velocity: ComplexArray
    way: ComplexArray

    def interpolate_position_and_velocity(self, time_s: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """Interpolate way and velocity at times (m,), s."""
        return np.interp(time_s, self.time_s, self.way), np.interp(time_s, self.time_s, self.velocity)


def refine_position_latencies(series: Sequence[SensorSeries], latencies: Sequence[Latency]) -> list[Latency]:
    """Replace the latencies of positions that the search leaves unclear where odometry knows them better.

    Args:
        latencies: Parallel to the series, relative to the reference of the search.
    """
    refined = list(latencies)
    unclear = [
        i
        for i, (s, latency) in enumerate(zip(series, latencies, strict=True))
        if s.kind is Kind.POSITION and latency.status in (LatencyStatus.NOT_OBSERVABLE, LatencyStatus.NOT_SIGNIFICANT)
    ]
    speed, yaw_rate = (_index_of_longest_series(series, kind) for kind in (Kind.SPEED, Kind.YAW_RATE))
    if not unclear or speed is None or yaw_rate is None:
        return refined
    odometry, sigmas_s = [], []
    for i in (speed, yaw_rate):
        is_known = np.isfinite(latencies[i].found_s) and np.isfinite(latencies[i].sigma_s)
        odometry.append(replace(series[i], latency_s=latencies[i].found_s if is_known else 0.0))
        is_reference = latencies[i].status is LatencyStatus.REFERENCE
        sigmas_s.append(0.0 if is_reference else latencies[i].sigma_s if is_known else UNKNOWN_DELAY_SIGMA_S)
    for i in unclear:
        evidence = find_delay_against_odometry(series[i], *odometry)
        if evidence is None:
            continue
        own = latency_from_odometry(evidence, max(sigmas_s))
        if not latencies[i].sigma_s <= own.sigma_s:
            # That of white noise is no bound where fixes have slow errors, which the search models.
            searched_s = latencies[i].bound_s if np.isfinite(latencies[i].bound_s) else own.sigma_s
            refined[i] = replace(own, bound_s=min(searched_s, own.sigma_s))
    return refined


def _index_of_longest_series(series: Sequence[SensorSeries], kind: Kind) -> int | None:
    """Return the index of the series of a kind with the most rows; None without one."""
    found = [i for i, s in enumerate(series) if s.kind is kind and len(s) and not s.is_exact]
    return max(found, key=lambda i: len(series[i]), default=None)


def find_delay_against_odometry(
    position: SensorSeries, speed: SensorSeries, yaw_rate: SensorSeries
) -> LatencyEvidence | None:
    """Return the evidence for the delay of fixes against odometry; None where the rows do not suffice.

    Args:
        position: The fixes, stamps as they are.
        speed, yaw_rate: Stamps corrected by their latencies (`latency_s`).
    """
    if min(len(position), len(speed), len(yaw_rate)) < MIN_ODOMETRY_WINDOWS * MIN_FIXES_PER_ODOMETRY_WINDOW:
        return None
    time_s, place = position.time_s, position.values[:, 0] + 1j * position.values[:, 1]
    windows = _row_slices_of_usable_windows(
        time_s, speed.time_s - speed.latency_s, yaw_rate.time_s - yaw_rate.latency_s
    )
    if len(windows) < MIN_ODOMETRY_WINDOWS:
        return None
    way, delay_s = _integrate_odometry_path(speed, yaw_rate), 0.0
    for _ in range(N_DELAY_ITERATIONS):
        rows = [_residuals_and_delay_derivatives(time_s[w], place[w], way, delay_s) for w in windows]
        residual, push = np.concatenate([r for r, _ in rows]), np.concatenate([p for _, p in rows])
        bend = float((push.real**2 + push.imag**2).sum())
        if not bend > 0.0:
            return None
        move_s = float((residual.real * push.real + residual.imag * push.imag).sum()) / bend
        delay_s += move_s
        if not abs(delay_s) < MAX_SEARCHED_DELAY_S:
            return None
        if abs(move_s) < 1e-3:
            break
    # The median of the squared distance of white noise is 1.386 times its variance on each axis.
    variance = max(median_of_finite_values(residual.real**2 + residual.imag**2) / (2.0 * np.log(2.0)), 1e-8)
    row_s = np.concatenate([time_s[w] for w in windows])
    level = 0.5 * (residual.real**2 + residual.imag**2) / variance
    slope = -(residual.real * push.real + residual.imag * push.imag) / variance
    return LatencyEvidence(row_s, delay_s, level, slope, (push.real**2 + push.imag**2) / variance)


def latency_from_odometry(evidence: LatencyEvidence, other_sigma_s: float) -> Latency:
    """Return the latency that odometry shows.

    It counts as there where it is more than three sigma from zero and predicts each half of the log better than zero
    with what the other half says.

    Args:
        evidence: See `find_delay_against_odometry`.
        other_sigma_s: One sigma of the latency of the odometry itself, s.
    """
    found_s, bound_s = evidence.likeliest_latency_s, evidence.formal_sigma_s
    scatter_s = evidence.block_scatter_sigma_s
    sigma_s = float(np.hypot(scatter_s, other_sigma_s))
    centre_s = evidence.centre_s
    at_zero = float((evidence.level - evidence.slope * centre_s + 0.5 * evidence.bend * centre_s**2).sum())
    gain = at_zero - evidence.cross_validated_neg_log_likelihood()
    least_gain = 0.5 * (MIN_SIGNIFICANT_SIGMAS * scatter_s / bound_s) ** 2
    is_clear = abs(found_s) > MIN_SIGNIFICANT_SIGMAS * sigma_s and gain > least_gain
    status = LatencyStatus.APPLIED if is_clear else LatencyStatus.NOT_SIGNIFICANT
    return Latency(status, found_s, sigma_s, bound_s)


def _integrate_odometry_path(speed: SensorSeries, yaw_rate: SensorSeries) -> _OdometryPath:
    """Integrate speed and yaw rate by the trapezoidal rule on the rows of the speed."""
    turn_s, time_s = yaw_rate.time_s - yaw_rate.latency_s, speed.time_s - speed.latency_s
    step = 0.5 * np.diff(turn_s) * (yaw_rate.values[1:, 0] + yaw_rate.values[:-1, 0])
    course = np.interp(time_s, turn_s, np.concatenate(([0.0], np.cumsum(step))))
    velocity = speed.values[:, 0] * np.exp(1j * course)
    way = np.concatenate(([0.0], np.cumsum(0.5 * np.diff(time_s) * (velocity[1:] + velocity[:-1]))))
    return _OdometryPath(time_s, velocity, way)


def _row_slices_of_usable_windows(time_s: FloatArray, *odometry_s: FloatArray) -> list[slice]:
    """Return the rows of each window with enough fixes and no pause of the odometry."""
    first_s = max(float(time_s[0]), *(float(each[0]) for each in odometry_s)) + MAX_SEARCHED_DELAY_S
    last_s = min(float(time_s[-1]), *(float(each[-1]) for each in odometry_s)) - MAX_SEARCHED_DELAY_S
    edges = np.arange(first_s, last_s, ODOMETRY_WINDOW_LENGTH_S)
    paused = np.concatenate([each[:-1][np.diff(each) > MAX_ODOMETRY_ROW_GAP_S] for each in odometry_s])
    found = []
    for begin_s in edges[:-1].tolist():
        i, j = np.searchsorted(time_s, [begin_s, begin_s + ODOMETRY_WINDOW_LENGTH_S]).tolist()
        if (
            j - i >= MIN_FIXES_PER_ODOMETRY_WINDOW
            and not ((paused > begin_s - 1.0) & (paused < begin_s + ODOMETRY_WINDOW_LENGTH_S)).any()
        ):
            found.append(slice(i, j))
    return found


def _residuals_and_delay_derivatives(
    time_s: FloatArray, fix_positions: ComplexArray, path: _OdometryPath, delay_s: float
) -> tuple[ComplexArray, ComplexArray]:
    """Return what the fixes (n,) leave of c + A D(t - delay), and what a second of delay adds, both complex (n,).

    Both without what another place, rotation or scale of the window would explain.
    """
    passed, velocity = path.interpolate_position_and_velocity(time_s - delay_s)
    centred, target = passed - passed.mean(), fix_positions - fix_positions.mean()
    power = float((centred.real**2 + centred.imag**2).sum())
    if power <= 0.0:
        return np.zeros_like(target), np.zeros_like(target)
    turn = (centred.conj() * target).sum() / power
    push = -turn * (velocity - velocity.mean())
    push = push - centred * ((centred.conj() * push).sum() / power)
    return target - turn * centred, push
