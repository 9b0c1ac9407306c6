"""Paths from the observer: 2 s ahead from v, v_y, gamma and the road's curvature (zhang2011, section 4.2).

Two models. "zhang2011" keeps v, v_y and gamma. "cwcli", the default, keeps the recent acceleration and lets the yaw
rate go over to the one that the road's curvature asks for, since drivers follow roads; the car's place in the lane does
not pull the path back to the middle, so a drift stays a drift. The uncertainty grows from the observer's covariance,
the curvature's sigma and the driver's unrest.
"""

from __future__ import annotations

import math
from bisect import bisect_right

import numpy as np

from cwcli.dynamics.near_lane import MIN_PREVIEW_DISTANCE_M
from cwcli.dynamics.samples import LateralTrack
from cwcli.dynamics.single_track import steady_lateral_speed_per_yaw_rate_m
from cwcli.dynamics.vehicle import Vehicle
from cwcli.errors import UsageError, hint_at_closest_or_all_known_names
from cwcli.lazy_dataclass import dataclass
from cwcli.prediction.paths import Paths
from cwcli.signals.columns import FloatArray
from cwcli.signals.covariances import xx_xy_yy_covariance_in_turned_axes
from cwcli.signals.units import NS_PER_S

MAX_PREDICTION_HORIZON_S = 60.0
"""Longest permitted horizon, s. Chosen by hand."""
MAX_STEPS_OF_LATERAL_PATH = 2000
"""Largest permitted number of steps of a path; it bounds the memory. Chosen by hand."""
LATERAL_PATH_MODELS = ("cwcli", "zhang2011")
"""Names of the path models; the module's text explains both."""
ACCEL_SLOPE_WINDOW_S = 1.0
"""The acceleration is the slope of the speed over this time, s. Chosen by hand; not fitted."""
MIN_FRAMES_TO_COMPUTE_ACCEL = 4
"""Least number of frames in that time from which the acceleration is computed; with fewer it is 0. Chosen by hand; not
fitted."""
MAX_ZEROED_ACCEL_SIGMAS = 2.0
"""Size of the slope of the speed, in its sigmas, up to which it counts as 0. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class LateralPathConfig:
    """Options of the paths from the observer.

    Attributes:
        model: One of `LATERAL_PATH_MODELS`.
        horizon_s, step_s: Length and step of the paths.
        adapt_s: Time constant with which the yaw rate approaches the road's.
        unrest_mps2: Standard deviation of the driver's unwanted lateral acceleration, correlated over `adapt_s`.
        curvature_sigma_1pm: Standard deviation of the road's curvature.
        speed_sigma_mps, accel_sigma_mps2: Standard deviations of the speed and of its change.
        default_sigma: Sigmas of v_y (m/s) and gamma (rad/s) where the observer gives no covariance.
    """

    model: str = "cwcli"
    horizon_s: float = 2.0
    step_s: float = 0.05
    adapt_s: float = 0.7
    unrest_mps2: float = 0.25
    curvature_sigma_1pm: float = 2e-4
    speed_sigma_mps: float = 0.1
    accel_sigma_mps2: float = 0.3
    default_sigma: tuple[float, float] = (0.05, 0.01)

    def __post_init__(self) -> None:
        """Check the options.

        Raises:
            UsageError: Unknown model, or times that are not positive or do not fit.
        """
        if self.model not in LATERAL_PATH_MODELS:
            raise UsageError(
                f"there is no path model '{self.model}'",
                hint=hint_at_closest_or_all_known_names(self.model, LATERAL_PATH_MODELS),
            )
        ok = all(math.isfinite(t) and t > 0.0 for t in (self.horizon_s, self.step_s, self.adapt_s))
        if not ok or self.step_s > self.horizon_s:
            raise UsageError(f"a horizon of {self.horizon_s:g} s in steps of {self.step_s:g} s is not possible")
        if self.horizon_s > MAX_PREDICTION_HORIZON_S or self.horizon_s > MAX_STEPS_OF_LATERAL_PATH * self.step_s:
            raise UsageError(
                f"a horizon of {self.horizon_s:g} s in steps of {self.step_s:g} s is too long from the observer; "
                f"permitted: {MAX_PREDICTION_HORIZON_S:g} s, {MAX_STEPS_OF_LATERAL_PATH} steps"
            )


def predict_paths_from_observer(
    track: LateralTrack, vehicle: Vehicle, config: LateralPathConfig | None = None
) -> Paths:
    """The path of the centre of gravity from each frame, in the body frame of that frame (x forward, y left).

    Args:
        track: From the observer, n frames. A preview point nearer than `MIN_PREVIEW_DISTANCE_M` counts as so far ahead.

    Returns:
        n paths; NaN where the track has no state.
    """
    config = config or LateralPathConfig()
    t = np.arange(round(config.horizon_s / config.step_s) + 1, dtype=np.float64) * config.step_s
    v = np.asarray(track.speed_mps, dtype=np.float64)[:, None]
    if config.model == "cwcli":
        v = np.maximum(v + recent_shrunk_speed_slope_mps2(track)[:, None] * t, 0.0)
    lateral, yaw_rate = track.state[:, 0:1], track.state[:, 1:2]
    reach_m = np.maximum(np.asarray(track.preview_m, np.float64) + vehicle.camera_forward_m, MIN_PREVIEW_DISTANCE_M)
    if config.model == "zhang2011":
        turning = np.broadcast_to(yaw_rate, (len(v), len(t)))
        sideways = np.broadcast_to(lateral, turning.shape)
        forgets = np.zeros_like(t)
    else:
        curvature_here_1pm, ahead = road_curvature_here_and_ahead_1pm(track, reach_m)
        road = v * (
            curvature_here_1pm[:, None]
            + (ahead - curvature_here_1pm)[:, None]
            * np.clip(_running_integral_along_rows(v, config.step_s) / reach_m[:, None], 0.0, 1.0)
        )
        forgets = np.exp(-t / config.adapt_s)
        turning = road + (yaw_rate - road[:, :1]) * forgets
        lever = steady_lateral_speed_per_yaw_rate_m(vehicle, v)
        sideways = lateral + lever * turning - lever[:, :1] * yaw_rate
    known = np.where(np.isfinite(lateral + v[:, :1]), 0.0, np.nan)
    heading = _running_integral_along_rows(turning, config.step_s) + known
    cos, sin = np.cos(heading), np.sin(heading)
    forward = np.broadcast_to(v, heading.shape)
    return Paths(
        time_s=t,
        x_m=_running_integral_along_rows(forward * cos - sideways * sin, config.step_s) + known,
        y_m=_running_integral_along_rows(forward * sin + sideways * cos, config.step_s) + known,
        heading_rad=heading,
        speed_mps=np.hypot(forward, sideways),
        position_covariance_m2=_position_covariance_of_lateral_paths(track, vehicle, t, heading, v, config),
    )


def road_curvature_here_and_ahead_1pm(track: LateralTrack, reach_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The road's curvature beside the car and at the preview point, left bend positive, shape (n,) each.

    Beside the car it is the curvature that earlier frames measured at this place; a newer frame replaces what earlier
    ones measured from its place on. Where no frame has measured it, or after a pause of the track, it is the curvature
    at the preview point.

    Args:
        reach_m: Shape (n,): from the centre of gravity to the preview point.
    """
    ahead = -np.asarray(track.curvature_1pm, dtype=np.float64)
    filled = np.nan_to_num(ahead)
    dt = np.diff(track.stamp_ns, prepend=track.stamp_ns[:1]) / NS_PER_S
    driven_m = np.cumsum(np.nan_to_num(track.speed_mps) * dt)
    curvature_here_1pm = filled.copy()
    places_m: list[float] = []
    curvatures_1pm: list[float] = []
    for i, (at_m, value, far_m) in enumerate(zip(driven_m.tolist(), ahead.tolist(), reach_m.tolist(), strict=True)):
        if not math.isnan(value):
            while places_m and places_m[-1] >= at_m + far_m:
                places_m.pop()
                curvatures_1pm.pop()
            places_m.append(at_m + far_m)
            curvatures_1pm.append(value)
        after = bisect_right(places_m, at_m)
        if 0 < after < len(places_m) and places_m[after] - places_m[after - 1] <= far_m:
            share = (at_m - places_m[after - 1]) / (places_m[after] - places_m[after - 1])
            curvature_here_1pm[i] = curvatures_1pm[after - 1] + share * (
                curvatures_1pm[after] - curvatures_1pm[after - 1]
            )
        elif 0 < after == len(places_m) and at_m - places_m[-1] <= far_m:
            curvature_here_1pm[i] = curvatures_1pm[-1]
    return curvature_here_1pm, filled


def recent_shrunk_speed_slope_mps2(track: LateralTrack) -> FloatArray:
    """Slope of the speed over the last second, m/s^2, shape (n,); 0 where it is not known.

    The slope a is shrunk by its own sigma: a (1 - (2 sigma / a)^2), or 0. Over 2 s the error of an unshrunk slope would
    be as large as all other errors of the path.
    """
    speed = np.asarray(track.speed_mps, np.float64)
    if not len(speed):
        return np.zeros(0)
    time_s = (np.asarray(track.stamp_ns, np.int64) - track.stamp_ns[0]) / NS_PER_S
    known = np.isfinite(speed)
    v = np.where(known, speed - np.nanmean(speed) if known.any() else 0.0, 0.0)
    first = np.searchsorted(time_s, time_s - ACCEL_SLOPE_WINDOW_S - 1e-9)
    last = np.arange(len(speed)) + 1

    def sum_in_windows(values: FloatArray) -> FloatArray:
        sums = np.concatenate([[0.0], np.cumsum(np.where(known, values, 0.0))])
        return np.asarray(sums[last] - sums[first])

    n, t, vt = sum_in_windows(np.ones_like(v)), sum_in_windows(time_s), sum_in_windows(v * time_s)
    count = np.maximum(n, 1.0)
    spread = sum_in_windows(time_s**2) - t * t / count
    enough = (n >= MIN_FRAMES_TO_COMPUTE_ACCEL) & (spread > 1e-6) & known
    spread = np.where(enough, spread, 1.0)
    slope = (vt - t * sum_in_windows(v) / count) / spread
    left = np.maximum(sum_in_windows(v * v) - sum_in_windows(v) ** 2 / count - slope**2 * spread, 0.0)
    variance = left / np.maximum(n - 2.0, 1.0) / spread
    share = 1.0 - MAX_ZEROED_ACCEL_SIGMAS**2 * variance / np.maximum(slope**2, 1e-12)
    return np.where(enough, slope * np.maximum(share, 0.0), 0.0)


def transform_paths_to_map(paths: Paths, x_m: FloatArray, y_m: FloatArray, heading_rad: FloatArray) -> Paths:
    """Transform paths from the body frame to the map, with n poses of shape (n,)."""
    cos, sin = np.cos(heading_rad)[:, None], np.sin(heading_rad)[:, None]
    return Paths(
        time_s=paths.time_s,
        x_m=x_m[:, None] + cos * paths.x_m - sin * paths.y_m,
        y_m=y_m[:, None] + sin * paths.x_m + cos * paths.y_m,
        heading_rad=heading_rad[:, None] + paths.heading_rad,
        speed_mps=paths.speed_mps,
        position_covariance_m2=xx_xy_yy_covariance_in_turned_axes(paths.position_covariance_m2, -heading_rad[:, None]),
    )


def transform_paths_to_body(paths: Paths) -> Paths:
    """Transform published paths to the body frame of their start: first point at 0, first heading along x."""
    cos, sin = np.cos(paths.heading_rad[:, :1]), np.sin(paths.heading_rad[:, :1])
    dx, dy = paths.x_m - paths.x_m[:, :1], paths.y_m - paths.y_m[:, :1]
    return Paths(
        paths.time_s,
        cos * dx + sin * dy,
        -sin * dx + cos * dy,
        paths.heading_rad - paths.heading_rad[:, :1],
        paths.speed_mps,
        xx_xy_yy_covariance_in_turned_axes(paths.position_covariance_m2, paths.heading_rad[:, :1]),
    )


def dead_reckon_x_y_m_and_heading_rad(track: LateralTrack) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Integrate the observed motion to x, y and heading, shape (n,) each, from (0, 0, 0) at the first frame.

    Where there is no state, the car is taken to go straight on.
    """
    dt = np.diff(track.stamp_ns, prepend=track.stamp_ns[:1]) / NS_PER_S
    yaw_rate, lateral = np.nan_to_num(track.state[:, 1]), np.nan_to_num(track.state[:, 0])
    heading = np.cumsum(_mean_with_previous(yaw_rate) * dt)
    v = np.nan_to_num(track.speed_mps)
    cos, sin = np.cos(heading), np.sin(heading)
    x = np.cumsum(_mean_with_previous(v * cos - lateral * sin) * dt)
    y = np.cumsum(_mean_with_previous(v * sin + lateral * cos) * dt)
    return x, y, heading


def _mean_with_previous(values: FloatArray) -> FloatArray:
    """The mean of each value and the one before it, shape (n,)."""
    before = np.concatenate([values[:1], values[:-1]])
    return np.asarray(0.5 * (values + before))


def _running_integral_along_rows(rate: FloatArray, step_s: float) -> FloatArray:
    """Integrate along the rows by the trapezoidal rule, from 0, (n, k)."""
    whole = np.cumsum(0.5 * step_s * (rate[:, 1:] + rate[:, :-1]), axis=1)
    return np.concatenate([np.zeros((len(rate), 1)), whole], axis=1)


def _position_covariance_of_lateral_paths(
    track: LateralTrack,
    vehicle: Vehicle,
    time_s: FloatArray,
    heading_rad: FloatArray,
    speed_mps: FloatArray,
    config: LateralPathConfig,
) -> FloatArray:
    """Position covariance xx, xy, yy, (n, k, 3): v_y, gamma, curvature and driver across the path, speed along it."""
    n = len(speed_mps)
    assumed = np.diag(np.square(config.default_sigma))
    state_covariance = track.covariance[:, :2, :2]
    is_given = np.isfinite(state_covariance).reshape(n, -1).all(axis=1)
    start = np.where(np.asarray(is_given)[:, None, None], state_covariance, assumed)
    lever = steady_lateral_speed_per_yaw_rate_m(vehicle, speed_mps)
    heading_integral_s, curved = _integrals_of_decaying_yaw_rate_error_s_s2(time_s, config)
    to_gamma = speed_mps * curved + lever * (
        heading_integral_s - time_s
    )  # how far gamma's error carries the car sideways
    to_lateral = np.broadcast_to(time_s, to_gamma.shape)
    across = (
        start[:, 0, 0, None] * to_lateral**2
        + 2.0 * start[:, 0, 1, None] * to_lateral * to_gamma
        + start[:, 1, 1, None] * to_gamma**2
    )
    if config.model != "zhang2011":
        across = across + (config.curvature_sigma_1pm * speed_mps**2 * (0.5 * time_s**2 - curved)) ** 2
    # White noise behind the yaw rate: the integral of the squared answer to an impulse.
    swing = _integrals_of_decaying_yaw_rate_error_s_s2(time_s, LateralPathConfig(adapt_s=config.adapt_s))[1]
    grown = np.concatenate([[0.0], np.cumsum(0.5 * config.step_s * (swing[1:] ** 2 + swing[:-1] ** 2))])
    across = across + 2.0 * config.unrest_mps2**2 / config.adapt_s * grown
    along = (config.speed_sigma_mps * time_s) ** 2 + (0.5 * config.accel_sigma_mps2 * time_s**2) ** 2
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    along_rows = np.broadcast_to(along, (n, len(time_s)))
    return np.stack(
        [
            cos**2 * along_rows + sin**2 * across,
            cos * sin * (along_rows - across),
            sin**2 * along_rows + cos**2 * across,
        ],
        axis=-1,
    )


def _integrals_of_decaying_yaw_rate_error_s_s2(
    time_s: FloatArray, config: LateralPathConfig
) -> tuple[FloatArray, FloatArray]:
    """First and second integral over the times t (k,) of a unit yaw rate error that decays with `adapt_s`."""
    if config.model == "zhang2011":
        return time_s, 0.5 * time_s**2
    tau = config.adapt_s
    heading_integral_s = -tau * np.expm1(-time_s / tau)
    return heading_integral_s, tau * (time_s - heading_integral_s)
