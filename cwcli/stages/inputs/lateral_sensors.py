"""The ego's speed, yaw rate and steering angle for the observer, from whatever the log holds.

A sensor's own messages come before the states of `cwcli estimate`: the observer fuses them itself, and the errors of a
smoothed state go together over time, which no filter expects.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cwcli.channels.published import EGO_STATE
from cwcli.channels.vehicle_state import read_states
from cwcli.dynamics.samples import Samples
from cwcli.pipeline.result import InputCount
from cwcli.signals.canonical import ImuSignal, SpeedSignal, SteerSignal, VelocitySignal
from cwcli.signals.codec import Role
from cwcli.signals.columns import Columns, FloatArray
from cwcli.signals.rows import rows_by_stamp
from cwcli.signals.vehicle_state import SPEED, YAW_RATE
from cwcli.stages.inputs.sources import Sources

UP = 2


@dataclass(frozen=True)
class Inputs:
    """What the observer is given beside the lanes.

    Attributes:
        speed, yaw_rate, steer: Or None.
        speed_source, yaw_rate_source, steer_source: Their topics, "" where there is none.
        counts: What became of the messages.
        notes: For the user.
    """

    speed: Samples | None = None
    yaw_rate: Samples | None = None
    steer: Samples | None = None
    speed_source: str = ""
    yaw_rate_source: str = ""
    steer_source: str = ""
    counts: tuple[InputCount, ...] = ()
    notes: tuple[str, ...] = ()


def inputs_of(sources: Sources, ego_state: Columns | None, *, use_gyro: bool, use_steer: bool) -> Inputs:
    """Choose among the signals.

    Speed: the speed channel, else the ego state, else the magnitude of the velocity over ground. Yaw rate: the
    gyroscope, else that of the speed channel, else the ego state. Steering angle: its own channel.
    """
    used: set[str] = set()
    counts = list(sources.counts())
    speed, speed_source = _speed(sources)
    yaw_rate, yaw_rate_source = _yaw_rate(sources) if use_gyro else (None, "")
    if ego_state is not None and len(ego_state) and (speed is None or (use_gyro and yaw_rate is None)):
        states = read_states(ego_state)
        rows = rows_by_stamp(states.stamp_ns)
        stamp_ns, state = states.stamp_ns[rows], states.state[rows]
        variance = np.maximum(states.covariance[rows, YAW_RATE, YAW_RATE], 0.0)
        if speed is None:
            speed, speed_source = Samples(stamp_ns, state[:, SPEED]), ego_state.topic
        if use_gyro and yaw_rate is None:
            yaw_rate = Samples(stamp_ns, state[:, YAW_RATE], np.sqrt(variance))
            yaw_rate_source = ego_state.topic
        counts.append(InputCount(ego_state.topic, EGO_STATE.role, len(states), len(states)))
    if speed is None:
        speed, speed_source = _speed_over_ground(sources)
    steer, steer_source = _steer(sources) if use_steer else (None, "")
    used |= {speed_source, yaw_rate_source, steer_source}
    return Inputs(
        speed=speed,
        yaw_rate=yaw_rate,
        steer=steer,
        speed_source=speed_source,
        yaw_rate_source=yaw_rate_source,
        steer_source=steer_source,
        counts=tuple(count for count in counts if count.topic in used),
        notes=sources.notes,
    )


def _speed(sources: Sources) -> tuple[Samples | None, str]:
    for signal in sources.by_role.get(Role.EGO_SPEED, ()):
        if isinstance(signal, SpeedSignal):
            return Samples(signal.stamp_ns, signal.speed_mps), signal.source
    return None, ""


def _speed_over_ground(sources: Sources) -> tuple[Samples | None, str]:
    for signal in sources.by_role.get(Role.EGO_VELOCITY, ()):
        if isinstance(signal, VelocitySignal):
            return Samples(signal.stamp_ns, np.hypot(signal.east_mps, signal.north_mps)), signal.source
    return None, ""


def _yaw_rate(sources: Sources) -> tuple[Samples | None, str]:
    for signal in sources.by_role.get(Role.IMU, ()):
        if isinstance(signal, ImuSignal):
            sigma = _sigma(signal.gyro_variance[:, UP])
            return Samples(signal.stamp_ns, signal.gyro_radps[:, UP], sigma), signal.source
    for signal in sources.by_role.get(Role.EGO_SPEED, ()):
        if isinstance(signal, SpeedSignal) and np.isfinite(signal.yaw_rate_radps).any():
            sigma = _sigma(signal.yaw_rate_variance_rad2ps2)
            return Samples(signal.stamp_ns, signal.yaw_rate_radps, sigma), signal.source
    return None, ""


def _steer(sources: Sources) -> tuple[Samples | None, str]:
    for signal in sources.by_role.get(Role.EGO_STEER, ()):
        if isinstance(signal, SteerSignal):
            return Samples(signal.stamp_ns, signal.steer_rad), signal.source
    return None, ""


def _sigma(variance: FloatArray) -> FloatArray:
    """NaN where the variance is not given."""
    return np.asarray(np.sqrt(np.where(variance > 0.0, variance, np.nan)))
