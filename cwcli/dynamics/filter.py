"""The default observer: one Kalman filter with the times of frames and sensors as they are.

In addition to the paper's four states it estimates the steering angle and the road's curvature (which the paper takes
as exact inputs), the bias of the gyroscope, the yaw of the camera's mounting and, if asked, the load as nominal mass /
mass, in which the model is linear. Each frame counts with its own sigmas. A y_L that does not fit (another lane) starts
y_L anew and nothing else; other values that do not fit are left out, and several such frames in a row start the filter
anew.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from cwcli.dynamics.config import FilterNoise, ObserverConfig
from cwcli.dynamics.near_lane import (
    MIN_SPEED_OF_PREVIEW_SCALING_MPS,
    TUNING_DRIVE_SPEED_MPS,
    convert_sine_states_to_angles,
    move_lanes_to_nearer_preview,
    reference_to_actual_speed_ratio,
)
from cwcli.dynamics.samples import (
    FrameStatus,
    LaneSamples,
    LateralTrack,
    ScalarSamples,
    count_frame_statuses,
    speed_at_times_mps,
)
from cwcli.dynamics.signs import is_sign_opposite, opposite_sign_note, yaw_rate_from_vision_radps
from cwcli.dynamics.single_track import MIN_MODEL_SPEED_MPS, understeer_gradient_rad_per_mps2
from cwcli.dynamics.vehicle import Vehicle
from cwcli.kernels import observer as kernel
from cwcli.kernels.observer import ETA, KL, STEER, Begin, EventKind, EventStatus
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.units import NS_PER_S

MAX_PREDICTION_STEP_S = 0.1
"""Longest time that the model is predicted in one step, s. Chosen by hand; not fitted."""
NOMINAL_TO_ACTUAL_MASS_RATIO_RANGE = (0.5, 2.0)
"""Lowest and highest permitted estimate of nominal mass / mass. Chosen by hand; not fitted."""
MAX_AGE_OF_MEASURED_YAW_RATE_S = 0.2
"""Age up to which an accepted yaw rate counts as measured, s: frames that do not fit then restart the lane's states
alone. Chosen by hand; not fitted."""
MAX_STANDSTILL_SPEED_MPS = 0.1
"""Speed below which the car is taken to stand, m/s: lateral speed and yaw rate are zero there. Chosen by hand; not
fitted."""
MIN_MEASUREMENT_SIGMA = 1e-9
"""Smallest sigma of a measurement, in its own unit; it keeps the innovation covariance invertible."""


def build_kernel_model(vehicle: Vehicle, config: ObserverConfig) -> kernel.Model:
    """Build the kernel's parameters from the car, the camera and the noise."""
    m, inertia = vehicle.mass_kg, vehicle.yaw_inertia_kgm2
    kf, kr = vehicle.front_stiffness_nprad, vehicle.rear_stiffness_nprad
    lf, lr = vehicle.front_axle_m, vehicle.rear_axle_m
    moment = lr * kr - lf * kf
    noise = config.noise
    return {
        "side_force": (kf + kr) / m,
        "moment_force": moment / m,
        "front_force": kf / m,
        "moment": moment / inertia,
        "yaw_damping": (lf**2 * kf + lr**2 * kr) / inertia,
        "front_moment": lf * kf / inertia,
        "camera_forward_m": vehicle.camera_forward_m,
        "wheelbase_m": vehicle.wheelbase_m,
        "rear_axle_m": lr,
        "slip": m * lf / (kr * vehicle.wheelbase_m),
        "understeer": understeer_gradient_rad_per_mps2(vehicle),
        "min_speed": MIN_MODEL_SPEED_MPS,
        "still_mps": MAX_STANDSTILL_SPEED_MPS,
        "max_step_s": MAX_PREDICTION_STEP_S,
        "eta_low": NOMINAL_TO_ACTUAL_MASS_RATIO_RANGE[0],
        "eta_high": NOMINAL_TO_ACTUAL_MASS_RATIO_RANGE[1],
        "gate_sigmas": noise.gate,
        "restart_after": noise.restart_after,
        "gyro_recent_s": MAX_AGE_OF_MEASURED_YAW_RATE_S,
        "chosen_mps": TUNING_DRIVE_SPEED_MPS,
        "slowest_mps": MIN_SPEED_OF_PREVIEW_SCALING_MPS,
        "walk_noise": _walk_noise_intensities(noise, config.estimate_load),
        "start_sigma": _start_sigmas(noise, config.estimate_load),
    }


def _walk_noise_intensities(noise: FilterNoise, with_load: bool) -> list[float]:
    """Noise intensities (squared walks) of the nine states, in the kernel's order."""
    walks = [
        noise.lateral_speed_walk_mps,
        noise.yaw_rate_walk_radps,
        0.0,
        0.0,
        noise.steer_walk_rad,
        noise.curvature_walk_1pm,
        noise.load_walk if with_load else 0.0,
        noise.gyro_bias_walk_radps,
        noise.camera_yaw_walk_rad,
    ]
    return [walk**2 for walk in walks]


def _start_sigmas(noise: FilterNoise, with_load: bool) -> list[float]:
    """Standard deviations of the nine states at the start, in the kernel's order."""
    return [
        noise.start_lateral_speed_mps,
        noise.start_yaw_rate_radps,
        0.0,
        0.0,
        noise.start_steer_rad,
        noise.start_curvature_1pm,
        noise.load_sigma if with_load else 0.0,
        noise.gyro_bias_radps,
        noise.camera_yaw_rad,
    ]


def observe_with_kalman_filter(
    lanes: LaneSamples,
    speed: ScalarSamples,
    vehicle: Vehicle,
    config: ObserverConfig,
    *,
    yaw_rate: ScalarSamples | None = None,
    steer: ScalarSamples | None = None,
) -> LateralTrack:
    """Filter frames, yaw rate and steering angle in the order of their stamps, and return the state at each frame."""
    stamp_ns = np.asarray(lanes.stamp_ns, dtype=np.int64)
    if lanes.yaw_sigma_rad > config.noise.camera_yaw_rad:
        config = replace(config, noise=replace(config.noise, camera_yaw_rad=lanes.yaw_sigma_rad))
    noise = config.noise
    n = len(stamp_ns)
    notes: list[str] = []
    frame_speed = speed_at_times_mps(speed, stamp_ns, config.max_speed_gap_s)
    lanes, preview_m, change_1pm2 = move_lanes_to_nearer_preview(
        lanes, frame_speed, config.preview_m, vehicle.camera_forward_m
    )
    quick = reference_to_actual_speed_ratio(frame_speed)
    parts = [(stamp_ns, EventKind.LANE, *_lane_values_and_sigmas(lanes, preview_m, quick, config))]
    vision = yaw_rate_from_vision_radps(lanes, frame_speed)
    for name, samples, kind, default in (
        ("yaw rate", yaw_rate, EventKind.YAW_RATE, noise.yaw_rate_sigma_radps),
        ("steering angle", steer, EventKind.STEERING_ANGLE, noise.steer_sigma_rad),
    ):
        if samples is None or not len(samples.values):
            continue
        if is_sign_opposite(samples, stamp_ns, vision):
            notes.append(opposite_sign_note(name))
            continue
        parts.append((np.asarray(samples.stamp_ns, np.int64), kind, *_scalar_values_and_sigmas(samples, default)))
    stamps = np.concatenate([part[0] for part in parts])
    order = np.argsort(stamps, kind="stable")
    stamps = stamps[order]
    kinds = np.concatenate([np.full(len(part[0]), part[1], np.int8) for part in parts])[order]
    values = np.ascontiguousarray(np.concatenate([part[2] for part in parts])[order])
    sigmas = np.ascontiguousarray(np.concatenate([part[3] for part in parts])[order])
    dt_s = np.diff(stamps, prepend=stamps[:1]) / NS_PER_S
    at = speed_at_times_mps(speed, stamps, config.max_speed_gap_s)
    before = np.concatenate([at[:1], at[:-1]])
    between = np.where(np.isfinite(before), 0.5 * (at + before), at)
    begin = np.where(dt_s > config.max_gap_s, Begin.ANEW, Begin.GO_ON)
    events = kernel.Events(
        dt_s=np.ascontiguousarray(dt_s),
        speed_mps=np.nan_to_num(between),
        kind=kinds,
        begin=np.where(np.isfinite(at), begin, Begin.STOP).astype(np.int8),
        values=values,
        sigmas=sigmas,
        preview_m=_spread_frame_values_to_events(preview_m, order),
        change_1pm2=_spread_frame_values_to_events(change_1pm2, order),
    )
    x, p, outcome, at_m = kernel.observe(events, build_kernel_model(vehicle, config))
    frames = kinds == EventKind.LANE
    status = _frame_statuses(stamps, kinds, outcome, values, frame_speed, config)
    x, p = x[frames], p[frames]
    is_known = np.isin(status, (FrameStatus.OBSERVED, FrameStatus.REJECTED, FrameStatus.PREDICTED, FrameStatus.STARTED))
    x[~is_known] = np.nan
    p[~is_known] = np.nan
    state, covariance = x[:, :4], p[:, :4, :4] + _lasting_error_covariance(noise, quick)
    if lanes.lines is not None and np.isfinite(lanes.lines).any():
        state, covariance = convert_sine_states_to_angles(state, covariance)
    return LateralTrack(
        stamp_ns=stamp_ns,
        state=state,
        preview_m=np.where(is_known, at_m[frames], config.preview_m),
        covariance=covariance,
        speed_mps=frame_speed,
        steer_rad=x[:, STEER],
        curvature_1pm=x[:, KL],
        mass_kg=vehicle.mass_kg / x[:, ETA] if n else np.zeros(0),
        mass_sigma_kg=_mass_sigma_kg(x, p, vehicle, config),
        status=status,
        counts=count_frame_statuses(status),
        notes=tuple(notes),
    )


def _lasting_error_covariance(noise: FilterNoise, ratio: FloatArray) -> FloatArray:
    """Covariance (n, 4, 4) of the lane errors that many frames share, which averaging does not reduce."""
    lasting = np.zeros((len(ratio), 4, 4))
    lasting[:, 2, 2] = noise.lateral_floor_m**2
    lasting[:, 3, 3] = (noise.heading_floor_rad * ratio**1.5) ** 2
    return lasting


def _mass_sigma_kg(x: FloatArray, p: FloatArray, vehicle: Vehicle, config: ObserverConfig) -> FloatArray:
    """Sigma of the estimated mass at each frame, shape (n,), kg, to first order; NaN where it is not estimated."""
    if not config.estimate_load:
        return np.full(len(x), np.nan)
    return np.asarray(vehicle.mass_kg / x[:, ETA] ** 2 * np.sqrt(p[:, ETA, ETA]))


def _spread_frame_values_to_events(values: FloatArray, order: npt.NDArray[np.intp]) -> FloatArray:
    """Spread one value per frame over all events in time order; events that are no frame get 0."""
    return np.concatenate([values, np.zeros(len(order) - len(values))])[order]


def _lane_values_and_sigmas(
    lanes: LaneSamples, preview_m: FloatArray, ratio: FloatArray, config: ObserverConfig
) -> tuple[FloatArray, FloatArray]:
    """y_L, e_L, K_L of the frames and their sigmas, shape (n, 3) each.

    Frames state their sigmas at the farthest preview point, so at a nearer point the sigmas are at most the default
    ones. On roads for slow traffic the default sigma of the curvature grows with the cube of the slowness, that of the
    direction with its 1.5th power, and that of the place does not grow.

    Args:
        lanes, preview_m: The lane at the nearer preview point, and that point's distance, shape (n,).
        ratio: The slowness ratio of the car at each frame, shape (n,).
    """
    noise, is_nearer = config.noise, preview_m < config.preview_m
    values = np.column_stack([lanes.lateral_deviation_m, lanes.heading_deviation_rad, lanes.curvature_1pm])
    stated_sigmas = (lanes.lateral_sigma_m, lanes.heading_sigma_rad, lanes.curvature_sigma_1pm)
    defaults: tuple[FloatArray | float, ...] = (
        noise.lateral_sigma_m,
        noise.heading_sigma_rad * ratio**1.5,
        noise.curvature_sigma_1pm * ratio**3,
    )
    lasting = (noise.lateral_floor_m, noise.heading_floor_rad * ratio**1.5, noise.curvature_floor_1pm * ratio**3)
    floors = [noise.floor_share * each for each in lasting]
    yaw_shares = (config.preview_m * lanes.yaw_sigma_rad, lanes.yaw_sigma_rad, 0.0)
    columns = []
    for sigma, default, floor, share in zip(stated_sigmas, defaults, floors, yaw_shares, strict=True):
        raw = np.full(len(lanes), np.nan) if sigma is None else np.asarray(sigma, dtype=np.float64)
        raw = np.where(raw > share, np.sqrt(np.maximum(raw**2 - share**2, 0.0)), raw)
        own = np.where(np.isfinite(raw) & (raw > 0.0), np.hypot(np.maximum(raw, MIN_MEASUREMENT_SIGMA), floor), default)
        columns.append(np.where(is_nearer, np.minimum(own, default), own))
    finite = np.where(np.isfinite(values), values, np.nan).reshape(-1, 3)
    columns[2] = np.hypot(columns[2], noise.curvature_share * np.nan_to_num(np.abs(finite[:, 2])))
    return finite, np.column_stack(columns).reshape(-1, 3)


def _scalar_values_and_sigmas(samples: ScalarSamples, default: float) -> tuple[FloatArray, FloatArray]:
    """A sensor's samples in the kernel's form: values and sigmas, (n, 3) each, of which the first column is used."""
    n = len(samples.values)
    values, sigmas = np.full((n, 3), np.nan), np.ones((n, 3))
    values[:, 0] = np.where(np.isfinite(samples.values), samples.values, np.nan)
    sigmas[:, 0] = samples.sigmas_or_default(default)
    return values, sigmas


def _frame_statuses(
    stamps: Int64Array,
    kinds: npt.NDArray[np.int8],
    outcome: npt.NDArray[np.int8],
    values: FloatArray,
    frame_speed: FloatArray,
    config: ObserverConfig,
) -> npt.NDArray[np.int8]:
    """The frames' statuses from the kernel's outcomes; a state that was predicted for too long is lost."""
    frames = kinds == EventKind.LANE
    result = np.full(np.count_nonzero(frames), FrameStatus.LOST, dtype=np.int8)
    own = outcome[frames]
    for code, status in (
        (EventStatus.USED, FrameStatus.OBSERVED),
        (EventStatus.GATED, FrameStatus.REJECTED),
        (EventStatus.PREDICTED, FrameStatus.PREDICTED),
        (EventStatus.STARTED, FrameStatus.STARTED),
    ):
        result[own == code] = status
    supported = np.isin(outcome, (EventStatus.USED, EventStatus.STARTED)) & (frames | (kinds == EventKind.YAW_RATE))
    last = np.maximum.accumulate(np.where(supported, np.arange(len(stamps)), 0))
    age_s = ((stamps - stamps[last]) / NS_PER_S)[frames]
    result[(age_s > config.max_coast_s) & (result != FrameStatus.STARTED)] = FrameStatus.LOST
    result[~np.isfinite(frame_speed)] = FrameStatus.NO_SPEED
    return result
