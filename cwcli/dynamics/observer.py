"""Lateral speed and yaw rate from the lane that a camera sees: the registered methods."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from cwcli.dynamics.blended import observe_with_blended_bank
from cwcli.dynamics.config import ObserverConfig
from cwcli.dynamics.filter import observe_with_kalman_filter
from cwcli.dynamics.samples import LaneSamples, LateralTrack, ScalarSamples
from cwcli.dynamics.steering import HEADING_RATE_METHODS
from cwcli.dynamics.vehicle import Vehicle
from cwcli.errors import DataError, UsageError, hint_at_closest_or_all_known_names


class ObserverMethod(Protocol):
    """An observer: it takes frames and sensors and returns the state at each frame."""

    def __call__(
        self,
        lanes: LaneSamples,
        speed: ScalarSamples,
        vehicle: Vehicle,
        config: ObserverConfig,
        *,
        yaw_rate: ScalarSamples | None = None,
        steer: ScalarSamples | None = None,
    ) -> LateralTrack: ...


OBSERVER_METHODS: dict[str, ObserverMethod] = {
    "cwcli": observe_with_kalman_filter,
    "zhang2011": observe_with_blended_bank,
}
"""The registered observers by the name that `--method` takes."""
DEFAULT_OBSERVER_METHOD = "cwcli"
"""Name of the observer that runs if none is named."""


def observe_lateral_motion(
    lanes: LaneSamples,
    speed: ScalarSamples,
    vehicle: Vehicle,
    config: ObserverConfig | None = None,
    *,
    yaw_rate: ScalarSamples | None = None,
    steer: ScalarSamples | None = None,
) -> LateralTrack:
    """Observe v_y, gamma, y_L and e_L at every frame (zhang2011, section 3).

    Args:
        lanes: Frames; NaN where a boundary was not found.
        speed: Forward speed, on times of its own.
        yaw_rate: Measured yaw rate, left positive; fused by "cwcli".
        steer: Measured angle of the front wheels, left positive.

    Raises:
        UsageError: Unknown method or steering rate.
        MissingSignalError: There is no speed at all.
        DataError: Stamps decrease.
    """
    config = config or ObserverConfig()
    if config.method not in OBSERVER_METHODS:
        raise UsageError(
            f"there is no observer '{config.method}'",
            hint=hint_at_closest_or_all_known_names(config.method, OBSERVER_METHODS),
        )
    if config.steer_rate not in HEADING_RATE_METHODS:
        raise UsageError(
            f"there is no steering rate '{config.steer_rate}'",
            hint=hint_at_closest_or_all_known_names(config.steer_rate, HEADING_RATE_METHODS),
        )
    stamps = {"lanes": lanes.stamp_ns, "speed": speed.stamp_ns}
    stamps |= {} if yaw_rate is None else {"yaw rate": yaw_rate.stamp_ns}
    stamps |= {} if steer is None else {"steering angle": steer.stamp_ns}
    for name, stamp_ns in stamps.items():
        if np.any(stamp_ns[1:] < stamp_ns[:-1]):
            raise DataError(f"the stamps of the {name} decrease", hint="sort the rows by their stamp first")
    return OBSERVER_METHODS[config.method](lanes, speed, vehicle, config, yaw_rate=yaw_rate, steer=steer)
