"""Lateral speed and yaw rate from the lane that a camera sees: the registered methods."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from cwcli.dynamics.blended import observe_blended
from cwcli.dynamics.config import ObserverConfig
from cwcli.dynamics.filter import observe_filter
from cwcli.dynamics.samples import LaneSamples, LateralTrack, Samples
from cwcli.dynamics.steering import RATES
from cwcli.dynamics.vehicle import Vehicle
from cwcli.errors import DataError, UsageError, names_hint


class Observer(Protocol):
    """An observer: it takes frames and sensors and returns the state at each frame."""

    def __call__(
        self,
        lanes: LaneSamples,
        speed: Samples,
        vehicle: Vehicle,
        config: ObserverConfig,
        *,
        yaw_rate: Samples | None = None,
        steer: Samples | None = None,
    ) -> LateralTrack: ...


METHODS: dict[str, Observer] = {"cwcli": observe_filter, "zhang2011": observe_blended}
"""The registered observers by the name that `--method` takes."""
DEFAULT_METHOD = "cwcli"
"""Name of the observer that runs if none is named."""


def observe(
    lanes: LaneSamples,
    speed: Samples,
    vehicle: Vehicle,
    config: ObserverConfig | None = None,
    *,
    yaw_rate: Samples | None = None,
    steer: Samples | None = None,
) -> LateralTrack:
    """Observe v_y, gamma, y_L and e_L at every frame (zhang2011, section 3).

    Args:
        lanes: Frames; NaN where a boundary was not found.
        speed: Forward speed, on times of its own.
        vehicle: The car.
        config: Options; None: the defaults.
        yaw_rate: Measured yaw rate, left positive; fused by "cwcli".
        steer: Measured angle of the front wheels, left positive.

    Raises:
        UsageError: Unknown method or steering rate.
        MissingSignalError: There is no speed at all.
        DataError: Stamps decrease.
    """
    config = config or ObserverConfig()
    if config.method not in METHODS:
        raise UsageError(f"there is no observer '{config.method}'", hint=names_hint(config.method, METHODS))
    if config.steer_rate not in RATES:
        raise UsageError(f"there is no steering rate '{config.steer_rate}'", hint=names_hint(config.steer_rate, RATES))
    stamps = {"lanes": lanes.stamp_ns, "speed": speed.stamp_ns}
    stamps |= {} if yaw_rate is None else {"yaw rate": yaw_rate.stamp_ns}
    stamps |= {} if steer is None else {"steering angle": steer.stamp_ns}
    for name, stamp_ns in stamps.items():
        if np.any(stamp_ns[1:] < stamp_ns[:-1]):
            raise DataError(f"the stamps of the {name} decrease", hint="sort the rows by their stamp first")
    return METHODS[config.method](lanes, speed, vehicle, config, yaw_rate=yaw_rate, steer=steer)
