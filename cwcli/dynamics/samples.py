"""The inputs and outputs of the observers, as plain arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, replace
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from cwcli.errors import MissingSignalError
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.resample import interpolate_signal_at_times

STATE_NAMES = ("lateral_speed_mps", "yaw_rate_radps", "lateral_deviation_m", "heading_deviation_rad")
"""Names of the columns of `LateralTrack.state`: v_y, gamma, y_L and e_L, with their units."""
DEFAULT_PREVIEW_POINT_DISTANCE_M = 33.5
"""Distance of the preview point ahead of the camera, m: D_L of zhang2011."""
MAX_HEADING_DEVIATION_RAD = 1.4
"""Largest heading deviation whose tangent is taken, rad; larger ones are clipped. Chosen by hand; not fitted."""


class FrameStatus(IntEnum):
    """How the state of a frame was obtained, or why there is none."""

    OBSERVED = 0
    """The frame's boundaries were used."""
    REJECTED = 1
    """Some of the frame's values did not fit and were left out."""
    PREDICTED = 2
    """No boundaries; the state is carried on by the model and the other sensors."""
    STARTED = 3
    """The observer began, or began anew, at this frame."""
    LOST = 4
    """No state: no boundaries yet, or none for too long."""
    NO_SPEED = 5
    """No state: the speed is not known."""
    TOO_SLOW = 6
    """No state: slower than the slowest of the paper's observers."""


@dataclass(frozen=True)
class LaneSamples:
    """The lane at the preview point, one row a frame, in the paper's signs (see `dynamics.single_track`).

    Attributes:
        stamp_ns: Shape (n,), non-decreasing.
        lateral_deviation_m, heading_deviation_rad, curvature_1pm: Shape (n,): y_L, e_L, K_L; NaN where not found.
        lateral_sigma_m, heading_sigma_rad, curvature_sigma_1pm: Shape (n,), or None: the observer's default.
        yaw_sigma_rad: Share of the camera's yaw in the sigmas. It is the same in all frames, so a filter that estimates
            it must not take it for noise.
        lines: Shape (n, 2, 3): the left and the right boundary beside the camera in the body frame, as curves of
            `signals.lane_geometry`; NaN where there is none, or the lane method gives no curve. None: not known.
        curvature_change_1pm2: Shape (n,): change of the boundaries' curvature per metre, right positive; see
            `arcs.lateral_positions_of_arcs_m`. None: not known.
    """

    stamp_ns: Int64Array
    lateral_deviation_m: FloatArray
    heading_deviation_rad: FloatArray
    curvature_1pm: FloatArray
    lateral_sigma_m: FloatArray | None = None
    heading_sigma_rad: FloatArray | None = None
    curvature_sigma_1pm: FloatArray | None = None
    yaw_sigma_rad: float = 0.0
    lines: FloatArray | None = None
    curvature_change_1pm2: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.stamp_ns)


def linearise_lanes(lanes: LaneSamples) -> LaneSamples:
    """Convert lanes for the observers' linear model: e_L becomes the lane's slope, K_L the second derivative.

    In gentle bends they are the same. In tight bends the lane's direction at the preview point is far from the car's.
    There the slope and the second derivative still change as eq. 8 and 9 say; the rest is added to the sigmas.
    """
    slope = np.tan(np.clip(lanes.heading_deviation_rad, -MAX_HEADING_DEVIATION_RAD, MAX_HEADING_DEVIATION_RAD))

    def widen_sigma_by_linearisation_error(sigma: FloatArray | None, error: FloatArray) -> FloatArray | None:
        return None if sigma is None else np.hypot(sigma, np.nan_to_num(error))

    return replace(
        lanes,
        heading_deviation_rad=slope,
        curvature_1pm=lanes.curvature_1pm * (1.0 + slope**2) ** 1.5,
        lateral_sigma_m=widen_sigma_by_linearisation_error(
            lanes.lateral_sigma_m, 0.5 * lanes.lateral_deviation_m * slope**2
        ),
        heading_sigma_rad=widen_sigma_by_linearisation_error(lanes.heading_sigma_rad, slope**3),
    )


@dataclass(frozen=True)
class ScalarSamples:
    """A scalar signal with its own times: speed (m/s), yaw rate (rad/s) or steering angle (rad), left positive.

    Attributes:
        stamp_ns: Shape (n,), non-decreasing.
        values: Shape (n,).
        sigma: Shape (n,), or one number for all, or None: the observer's default.
    """

    stamp_ns: Int64Array
    values: FloatArray
    sigma: FloatArray | float | None = None

    def sigmas_or_default(self, default: float) -> FloatArray:
        """The sigma of each sample, shape (n,): its own where it is finite and positive, else the default."""
        stated_sigma = np.broadcast_to(
            np.nan if self.sigma is None else np.asarray(self.sigma, np.float64), self.values.shape
        )
        return np.where(np.isfinite(stated_sigma) & (stated_sigma > 0.0), stated_sigma, default)


@dataclass(frozen=True)
class LateralTrack:
    """The observed state at each frame.

    Attributes:
        stamp_ns: Shape (n,): as the frames'.
        state: Shape (n, 4): v_y (m/s, left positive), gamma (rad/s, counter-clockwise), y_L (m), e_L (rad), NaN where
            there is none.
        preview_m: Shape (n,): distance from the camera to the preview point of y_L, e_L and the curvature.
        covariance: Shape (n, 4, 4); NaN where the method gives none.
        speed_mps: Shape (n,).
        steer_rad: Shape (n,), left positive.
        curvature_1pm: Shape (n,): of the road at the preview point, right bend positive.
        mass_kg: Shape (n,): the load as estimated, or as assumed.
        mass_sigma_kg: Shape (n,): of the estimate; NaN where it is assumed.
        status: Shape (n,), values of `FrameStatus`.
        counts: Name of a status -> frames.
        notes: One line each, for the user.
    """

    stamp_ns: Int64Array
    state: FloatArray
    preview_m: FloatArray
    covariance: FloatArray
    speed_mps: FloatArray
    steer_rad: FloatArray
    curvature_1pm: FloatArray
    mass_kg: FloatArray
    mass_sigma_kg: FloatArray
    status: npt.NDArray[np.int8]
    counts: Mapping[str, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.stamp_ns)


def count_frame_statuses(status: npt.NDArray[np.int8]) -> dict[str, int]:
    """How many frames have each status, by its name in small letters."""
    return {each.name.lower(): int(np.count_nonzero(status == each)) for each in FrameStatus}


def speed_at_times_mps(speed: ScalarSamples, at_ns: Int64Array, max_gap_s: float) -> FloatArray:
    """Speed at the given times, shape (m,), m/s.

    It is linear between samples and that of the nearest one outside of them; NaN where they are farther than
    `max_gap_s`.

    Raises:
        MissingSignalError: There is no finite sample at all.
    """
    if not np.isfinite(speed.values).any():
        raise MissingSignalError(
            "no speed: the observer's model needs it", hint="bind a speed channel with `--topic ego_speed=/name`"
        )
    between = interpolate_signal_at_times(speed.stamp_ns, speed.values, at_ns, max_gap_s=max_gap_s)
    resampled = interpolate_signal_at_times(speed.stamp_ns, speed.values, at_ns, max_gap_s=max_gap_s, method="nearest")
    return np.where(np.isfinite(between), between, resampled)
