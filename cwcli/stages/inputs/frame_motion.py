"""The ego's speed and yaw rate at the time of a frame, from whatever the log holds."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cwcli.channels.binding import bind_roles
from cwcli.channels.published import EGO_STATE
from cwcli.channels.vehicle_state import read_vehicle_states
from cwcli.estimation.calibration import Calibration
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log
from cwcli.pipeline.call import Selection
from cwcli.pipeline.result import InputMessageCount
from cwcli.signals.canonical import ImuSignal, SpeedSignal
from cwcli.signals.resample import Series
from cwcli.signals.role import Role
from cwcli.signals.row_order import rows_by_stamp_without_repeats
from cwcli.signals.vehicle_state import SPEED, YAW_RATE
from cwcli.stages.inputs.calibrated import apply_calibration_to_sources
from cwcli.stages.inputs.sources import UP_AXIS_COLUMN_OF_GYRO, read_sensor_signals

EMPTY_MEASUREMENT_SERIES = Series(np.zeros(0, np.int64), np.zeros(0))
"""The series of a quantity that the log does not hold."""


@dataclass(frozen=True)
class MotionSeries:
    """Speed and yaw rate over time, with the counts of the messages that they come from."""

    speed_mps: Series = EMPTY_MEASUREMENT_SERIES
    yaw_rate_radps: Series = EMPTY_MEASUREMENT_SERIES
    counts: tuple[InputMessageCount, ...] = ()
    notes: tuple[str, ...] = ()


def read_ego_motion(log: Log, topics: Mapping[str, str], calibration: Calibration | None = None) -> MotionSeries:
    """Read speed and yaw rate from the states of `cwcli estimate`, or else from the speed channel and the gyroscope."""
    bound = bind_roles(log.channels, topics, required=(), optional=(EGO_STATE.role,), where=log.name)
    topic = bound.first_topic_of_role(EGO_STATE.role)
    if topic is not None:
        states = read_vehicle_states(log.columns(topic))
        count = InputMessageCount(topic, EGO_STATE.role, len(states), len(states))
        rows = rows_by_stamp_without_repeats(states.stamp_ns)
        stamp_ns, state = states.stamp_ns[rows], states.state[rows]
        return MotionSeries(Series(stamp_ns, state[:, SPEED]), Series(stamp_ns, state[:, YAW_RATE]), (count,))
    sources = read_sensor_signals(log, Selection(topics=topics), command="lanes", optional=(Role.EGO_SPEED, Role.IMU))
    sources = apply_calibration_to_sources(sources, calibration)
    speed, yaw_rate = EMPTY_MEASUREMENT_SERIES, EMPTY_MEASUREMENT_SERIES
    for signal in sources.by_role.get(Role.EGO_SPEED, ()):
        if isinstance(signal, SpeedSignal):
            speed = Series(signal.stamp_ns, signal.speed_mps)
            if np.isfinite(signal.yaw_rate_radps).all():
                yaw_rate = Series(signal.stamp_ns, signal.yaw_rate_radps)
    for signal in sources.by_role.get(Role.IMU, ()):
        if isinstance(signal, ImuSignal):
            yaw_rate = Series(signal.stamp_ns, signal.gyro_radps[:, UP_AXIS_COLUMN_OF_GYRO])
    return MotionSeries(speed, yaw_rate, sources.input_message_counts(), sources.notes)
