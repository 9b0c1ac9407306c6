"""The ego's speed and yaw rate at the time of a frame, from whatever the log holds."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cwcli.channels.binding import bind
from cwcli.channels.published import EGO_STATE
from cwcli.channels.vehicle_state import read_states
from cwcli.estimation.calibration import Calibration
from cwcli.logs.read.reader import Log
from cwcli.pipeline.call import Selection
from cwcli.pipeline.result import InputCount
from cwcli.signals.canonical import ImuSignal, SpeedSignal
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.role import Role
from cwcli.signals.row_order import rows_by_stamp
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import SPEED, YAW_RATE
from cwcli.stages.inputs.calibrated import calibrated_sources
from cwcli.stages.inputs.sources import read_sources

MAX_AGE_S = 0.5
UP = 2


@dataclass(frozen=True)
class Series:
    """Values at increasing stamps; empty where the log tells nothing."""

    stamp_ns: Int64Array
    values: FloatArray

    def at(self, stamp_ns: int) -> float:
        """The value at a time, linear between two samples that are both near; NaN elsewhere."""
        if not len(self.stamp_ns):
            return float("nan")
        i = bisect_left(self.stamp_ns, stamp_ns)  # not NumPy's, which waits for the decoding threads each time
        if i < len(self.stamp_ns) and self.stamp_ns[i] == stamp_ns:
            return float(self.values[i])
        if i == 0 or i == len(self.stamp_ns):
            return float("nan")
        before, after = int(self.stamp_ns[i - 1]), int(self.stamp_ns[i])
        if max(stamp_ns - before, after - stamp_ns) > MAX_AGE_S * NS_PER_S:
            return float("nan")
        part = (stamp_ns - before) / (after - before)
        return float((1.0 - part) * self.values[i - 1] + part * self.values[i])


NOTHING = Series(np.zeros(0, np.int64), np.zeros(0))


@dataclass(frozen=True)
class Motion:
    """Speed and yaw rate over time, with what became of the messages that they come from."""

    speed_mps: Series = NOTHING
    yaw_rate_radps: Series = NOTHING
    counts: tuple[InputCount, ...] = ()
    notes: tuple[str, ...] = ()


def read_motion(log: Log, topics: Mapping[str, str], calibration: Calibration | None = None) -> Motion:
    """The estimated state if `cwcli estimate` has run; else the speed channel and the gyroscope, as far as there are
    any."""
    bound = bind(log.channels, topics, required=(), optional=(EGO_STATE.role,), where=log.name)
    topic = bound.topic(EGO_STATE.role)
    if topic is not None:
        states = read_states(log.columns(topic))
        count = InputCount(topic, EGO_STATE.role, len(states), len(states))
        rows = rows_by_stamp(states.stamp_ns)
        stamp_ns, state = states.stamp_ns[rows], states.state[rows]
        return Motion(Series(stamp_ns, state[:, SPEED]), Series(stamp_ns, state[:, YAW_RATE]), (count,))
    sources = read_sources(log, Selection(topics=topics), command="lanes", optional=(Role.EGO_SPEED, Role.IMU))
    sources = calibrated_sources(sources, calibration)
    speed, yaw_rate = NOTHING, NOTHING
    for signal in sources.by_role.get(Role.EGO_SPEED, ()):
        if isinstance(signal, SpeedSignal):
            speed = Series(signal.stamp_ns, signal.speed_mps)
            if np.isfinite(signal.yaw_rate_radps).all():
                yaw_rate = Series(signal.stamp_ns, signal.yaw_rate_radps)
    for signal in sources.by_role.get(Role.IMU, ()):
        if isinstance(signal, ImuSignal):
            yaw_rate = Series(signal.stamp_ns, signal.gyro_radps[:, UP])
    return Motion(speed, yaw_rate, sources.counts(), sources.notes)
