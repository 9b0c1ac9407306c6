"""What the observers are given and what they give back, as plain arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from cwcli.signals.columns import FloatArray, Int64Array

STATE_NAMES = ("lateral_speed_mps", "yaw_rate_radps", "lateral_deviation_m", "heading_deviation_rad")
"""Columns of `LateralTrack.state`."""
PREVIEW_M = 33.5
"""D_L of zhang2011."""
STEEPEST_RAD = 1.4


class FrameStatus(IntEnum):
    """What stands behind the state of a frame."""

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
        yaw_sigma_rad: What the camera's yaw contributes to the sigmas. It is the same in all frames, so a filter that
            estimates it must not take it for noise.
        lines: Shape (n, 2, 3): the left and the right boundary beside the camera in the body frame, as `signals.arcs`
            tells curves; NaN where there is none, or its method tells no curve. None: not told.
        curvature_change_1pm2: Shape (n,): of theirs, right positive; see `arcs.arc_places_m`. None: not told.
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


def for_small_angles(lanes: LaneSamples) -> LaneSamples:
    """What a camera has seen, as the observers' linear model has it: e_L the lane's slope, K_L the second derivative.

    In gentle bends that is the same. In tight ones the preview point lies where the lane's direction is far from the
    car's; there these two still change as eq. 8 and 9 say, and what the linear model leaves out counts as noise.
    """
    slope = np.tan(np.clip(lanes.heading_deviation_rad, -STEEPEST_RAD, STEEPEST_RAD))

    def widened(sigma: FloatArray | None, by: FloatArray) -> FloatArray | None:
        return None if sigma is None else np.hypot(sigma, np.nan_to_num(by))

    return replace(
        lanes,
        heading_deviation_rad=slope,
        curvature_1pm=lanes.curvature_1pm * (1.0 + slope**2) ** 1.5,
        lateral_sigma_m=widened(lanes.lateral_sigma_m, 0.5 * lanes.lateral_deviation_m * slope**2),
        heading_sigma_rad=widened(lanes.heading_sigma_rad, slope**3),
    )


@dataclass(frozen=True)
class Samples:
    """A scalar signal with its own times: speed (m/s), yaw rate (rad/s) or steering angle (rad), left positive.

    Attributes:
        stamp_ns: Shape (n,), non-decreasing.
        values: Shape (n,).
        sigma: Shape (n,), or one number for all, or None: the observer's default.
    """

    stamp_ns: Int64Array
    values: FloatArray
    sigma: FloatArray | float | None = None

    def sigmas(self, default: float) -> FloatArray:
        """Shape (n,): sigma where it is known and positive, else the default."""
        given = np.broadcast_to(np.nan if self.sigma is None else np.asarray(self.sigma, np.float64), self.values.shape)
        return np.where(np.isfinite(given) & (given > 0.0), given, default)


@dataclass(frozen=True)
class LateralTrack:
    """The observed state at each frame.

    Attributes:
        stamp_ns: Shape (n,): as the frames'.
        state: Shape (n, 4): v_y (m/s, left positive), gamma (rad/s, counter-clockwise), y_L (m), e_L (rad), NaN where
            there is none.
        preview_m: Shape (n,): from the camera to the preview point of y_L, e_L and the curvature.
        covariance: Shape (n, 4, 4); NaN where the method gives none.
        speed_mps: Shape (n,).
        steer_rad: Shape (n,), left positive.
        curvature_1pm: Shape (n,): of the road at the preview point, right bend positive.
        mass_kg: Shape (n,): the load as estimated, or as assumed.
        mass_sigma_kg: Shape (n,): of the estimate; NaN where it is assumed.
        status: Shape (n,), values of `FrameStatus`.
        counts: Name of a status -> frames.
        notes: One line each, for people.
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


def count_statuses(status: npt.NDArray[np.int8]) -> dict[str, int]:
    """How many frames have each status, by its name in small letters."""
    return {each.name.lower(): int(np.count_nonzero(status == each)) for each in FrameStatus}
