"""zhang2011's observer (eq. 14-22): gains computed beforehand at multiples of 10 km/h, two neighbours blended.

What the paper leaves open, and how it is read here (the reasons are in docs/papers/zhang2011-motion.md):
- Both neighbours start each period from the blended state, so that neither drifts away with the other's speed.
- R1 is the noise intensity of the continuous model and is discretised with it.
- Below 10 km/h there is no state. Above 160 km/h the observer of 160 km/h is used alone.
- A period is predicted with the inputs of the frame that ends it: eq. 10's steering angle is that period's mean.
- A frame without boundaries is predicted with the inputs of the frame before.
- f(v) is that of half load; the observers' mass is that of the chosen load.
"""

from __future__ import annotations

from functools import lru_cache
from math import isnan

import numpy as np
import numpy.typing as npt

from cwcli.dynamics.config import ObserverConfig
from cwcli.dynamics.matrix_exponential import discretise_noise_covariance, transition_and_input_matrices
from cwcli.dynamics.riccati import steady_kalman_gain
from cwcli.dynamics.samples import (
    FrameStatus,
    LaneSamples,
    LateralTrack,
    ScalarSamples,
    count_frame_statuses,
    speed_at_times_mps,
)
from cwcli.dynamics.signs import is_sign_opposite, opposite_sign_note, yaw_rate_from_vision_radps
from cwcli.dynamics.single_track import preview_state_matrices
from cwcli.dynamics.steering import dynamic_to_kinematic_steering_ratio, steering_angle_from_vision_rad
from cwcli.dynamics.vehicle import Vehicle
from cwcli.kernels import observer as kernel
from cwcli.kernels.observer import Begin
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray, median_of_values
from cwcli.signals.resample import interpolate_signal_at_times
from cwcli.signals.units import MPS_PER_KMH, NS_PER_S

OBSERVER_SPEED_STEP_KMH = 10.0
"""Distance between the speeds of neighbouring observers, km/h; zhang2011, section 3."""
OBSERVER_SPEEDS_KMH = np.arange(10.0, 161.0, OBSERVER_SPEED_STEP_KMH)
"""Speeds for which an observer is computed, km/h, shape (16,); zhang2011 uses multiples of 10 km/h."""
DEFAULT_FRAME_PERIOD_S = 0.1
"""Sampling period of the observers when the log has fewer than two frames, s; that of the paper's camera (10 Hz)."""
MIN_FRAME_PERIOD_S = 0.001
"""Shortest sampling period that is taken from the frames' stamps, s. Chosen by hand; not fitted."""
MAX_PERIODS_BETWEEN_FRAMES = 1_000_000
"""Largest number of sampling periods between two frames that is computed. Chosen by hand: the observer starts anew
after a pause that long."""
OBSERVER_OUTPUT_MATRIX = np.eye(4)[2:]
"""Matrix C of zhang2011's eq. 21, shape (2, 4): y_L and e_L are measured."""


@dataclass(frozen=True)
class ObserverBank:
    """The discretised models and steady Kalman gains of the observers of all speeds.

    Attributes:
        phi: State transition matrices, shape (16, 4, 4).
        gamma: Input matrices, shape (16, 4, 2).
        gain: Kalman gains, shape (16, 4, 2).
    """

    phi: FloatArray
    gamma: FloatArray
    gain: FloatArray


def design_observer_bank(vehicle: Vehicle, config: ObserverConfig, period_s: float) -> ObserverBank:
    """Discretise eq. 21 (corrected) at each speed and compute its steady Kalman gain (eq. 16, 17, 19)."""
    key = (
        *(vehicle.front_axle_m, vehicle.rear_axle_m, vehicle.front_stiffness_nprad, vehicle.rear_stiffness_nprad),
        *(vehicle.yaw_inertia_kgm2, vehicle.mass_kg, config.preview_m + vehicle.camera_forward_m),
        *(config.process_noise, config.lane_noise, period_s),
    )
    return _design_bank_cached(key, config.noise_reading == "continuous")


@lru_cache(maxsize=8)
def _design_bank_cached(key: tuple[float, ...], is_continuous: bool) -> ObserverBank:
    """Compute the bank from the numbers it depends on, so that it can be cached."""
    lf, lr, kf, kr, inertia, mass, preview_m, r1, r2, period_s = key
    vehicle = Vehicle("", lf, lr, kf, kr, inertia, mass, mass)
    designs = []
    for kmh in OBSERVER_SPEEDS_KMH:
        a, b = preview_state_matrices(vehicle, kmh * MPS_PER_KMH, preview_m)
        phi, gamma = transition_and_input_matrices(a, b, period_s)
        noise = discretise_noise_covariance(a, r1 * np.eye(4), period_s) if is_continuous else r1 * np.eye(4)
        designs.append((phi, gamma, steady_kalman_gain(phi, OBSERVER_OUTPUT_MATRIX, noise, r2 * np.eye(2))))
    return ObserverBank(*(np.ascontiguousarray(np.stack(each)) for each in zip(*designs, strict=True)))


def lower_speed_index_and_upper_weight(speed_mps: FloatArray) -> tuple[npt.NDArray[np.int32], FloatArray]:
    """Index of the observer below each speed (n,), and weight (v - v_1) / 10 of the one above, eq. 22 (corrected)."""
    kmh = np.clip(np.nan_to_num(speed_mps / MPS_PER_KMH), OBSERVER_SPEEDS_KMH[0], OBSERVER_SPEEDS_KMH[-1])
    low = np.minimum((kmh - OBSERVER_SPEEDS_KMH[0]) // OBSERVER_SPEED_STEP_KMH, len(OBSERVER_SPEEDS_KMH) - 2).astype(
        np.int32
    )
    return low, (kmh - OBSERVER_SPEEDS_KMH[low]) / OBSERVER_SPEED_STEP_KMH


def observe_with_blended_bank(
    lanes: LaneSamples,
    speed: ScalarSamples,
    vehicle: Vehicle,
    config: ObserverConfig,
    *,
    yaw_rate: ScalarSamples | None = None,
    steer: ScalarSamples | None = None,
) -> LateralTrack:
    """Run zhang2011's observers over all frames.

    A measured steering angle replaces the one from vision. A measured yaw rate is not used.
    """
    stamp_ns = np.asarray(lanes.stamp_ns, dtype=np.int64)
    n = len(stamp_ns)
    v = speed_at_times_mps(speed, stamp_ns, config.max_speed_gap_s)
    dt_s = np.diff(stamp_ns, prepend=stamp_ns[:1]) / NS_PER_S
    period_s = config.period_s or _median_frame_period_s(dt_s)
    bank = design_observer_bank(vehicle, config, period_s)
    measured = (
        np.column_stack([lanes.lateral_deviation_m, lanes.heading_deviation_rad]).astype(np.float64).reshape(n, 2)
    )
    has_lane = np.asarray(np.isfinite(measured).all(axis=1), dtype=np.bool_)
    notes = [] if yaw_rate is None else ["the measured yaw rate is not used by zhang2011's observers"]
    if steer is not None and is_sign_opposite(steer, stamp_ns, yaw_rate_from_vision_radps(lanes, v)):
        notes.append(opposite_sign_note("steering angle"))
        steer = None
    steer_rad = _measured_or_vision_steering_rad(lanes, vehicle, v, config, steer)
    inputs = np.column_stack([_hold_last_known_value(steer_rad), _hold_last_known_value(lanes.curvature_1pm)]).reshape(
        n, 2
    )
    begin, status = _starts_and_statuses_of_frames(dt_s, v, has_lane, config)
    low, weight = lower_speed_index_and_upper_weight(v)
    periods = np.clip(np.rint(dt_s / period_s), 1, MAX_PERIODS_BETWEEN_FRAMES).astype(np.int32)
    state = kernel.blend(
        bank.phi,
        bank.gamma,
        bank.gain,
        low=low,
        weight=np.ascontiguousarray(weight),
        begin=begin,
        periods=periods,
        inputs=np.ascontiguousarray(inputs),
        measured=np.ascontiguousarray(measured),
    )
    return LateralTrack(
        stamp_ns=stamp_ns,
        state=state,
        preview_m=np.full(n, config.preview_m),
        covariance=np.full((n, 4, 4), np.nan),
        speed_mps=v,
        steer_rad=np.where(np.isfinite(state[:, 0]), inputs[:, 0], np.nan),
        curvature_1pm=np.asarray(lanes.curvature_1pm, dtype=np.float64),
        mass_kg=np.full(n, vehicle.mass_kg),
        mass_sigma_kg=np.full(n, np.nan),
        status=status,
        counts=count_frame_statuses(status),
        notes=tuple(notes),
    )


def _median_frame_period_s(dt_s: FloatArray) -> float:
    """The median time between frames, s; the default if there are fewer than two."""
    steps = dt_s[1:][dt_s[1:] > 0.0]
    return max(median_of_values(steps), MIN_FRAME_PERIOD_S) if len(steps) else DEFAULT_FRAME_PERIOD_S


def _measured_or_vision_steering_rad(
    lanes: LaneSamples, vehicle: Vehicle, speed_mps: FloatArray, config: ObserverConfig, steer: ScalarSamples | None
) -> FloatArray:
    """The steering angle delta_D at each frame, shape (n,), rad: measured, or from vision by eq. 10 and 13."""
    if steer is not None:
        return interpolate_signal_at_times(
            steer.stamp_ns, steer.values, lanes.stamp_ns, max_gap_s=config.max_speed_gap_s
        )
    kinematic = steering_angle_from_vision_rad(
        vehicle,
        np.asarray(lanes.stamp_ns, dtype=np.int64),
        np.asarray(lanes.heading_deviation_rad, dtype=np.float64),
        np.asarray(lanes.curvature_1pm, dtype=np.float64),
        speed_mps,
        rate=config.steer_rate,
    )
    return kinematic * dynamic_to_kinematic_steering_ratio(vehicle, speed_mps)


def _hold_last_known_value(values: FloatArray) -> FloatArray:
    """Replace each NaN by the last finite value before it, or by 0 before the first; shape (n,)."""
    known = np.isfinite(values)
    last = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
    return np.where(last >= 0, np.asarray(values)[np.maximum(last, 0)], 0.0)


def _starts_and_statuses_of_frames(
    dt_s: FloatArray, speed_mps: FloatArray, has_lane: npt.NDArray[np.bool_], config: ObserverConfig
) -> tuple[npt.NDArray[np.int8], npt.NDArray[np.int8]]:
    """Whether the observer starts, stops or goes on at each frame (`Begin`), and its status; shape (n,) each."""
    n = len(speed_mps)
    begin = np.full(n, Begin.GO_ON, dtype=np.int8)
    status = np.full(n, FrameStatus.LOST, dtype=np.int8)
    slowest = OBSERVER_SPEEDS_KMH[0] * MPS_PER_KMH * (1.0 - 1e-9)
    running, unseen_s = False, 0.0
    for i, (dt, speed, is_seen) in enumerate(zip(dt_s.tolist(), speed_mps.tolist(), has_lane.tolist(), strict=True)):
        unseen_s += dt
        is_driving = speed >= slowest  # false for NaN
        if not is_driving or dt > config.max_gap_s or (unseen_s > config.max_coast_s and not is_seen):
            running = False
            begin[i] = Begin.STOP
        if not is_driving:
            status[i] = FrameStatus.NO_SPEED if isnan(speed) else FrameStatus.TOO_SLOW
        elif is_seen:
            status[i] = FrameStatus.OBSERVED if running else FrameStatus.STARTED
            if not running:
                begin[i] = Begin.ANEW
            running, unseen_s = True, 0.0
        elif running:
            status[i] = FrameStatus.PREDICTED
    return begin, status
