"""Reference for states of the ego: the truth, or cwcli's states in hindsight where a log has no truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cwcli.channels.published import EGO_ONLINE
from cwcli.channels.vehicle_state import read_states
from cwcli.errors import MissingSignalError
from cwcli.evaluation.knowledge import HINDSIGHT, ONLINE, TRUTH, against
from cwcli.evaluation.subject import Subject
from cwcli.metrics.headline import metric_of
from cwcli.signals.angles import wrap_angle
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.resample import resample
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import HEADING, SPEED, YAW_RATE

MAX_GAP_S = 0.5
"""Longest gap of a motion that is interpolated, s. Chosen by hand; not fitted."""
LATE_S = 1.0
"""Median delay of the online states from which a note reports it, s. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class Motion:
    """Motion of the ego in the map at n times.

    Attributes:
        xy_m: Shape (n, 2).
        heading_rad, speed_mps, yaw_rate_radps: Shape (n,), NaN where unknown.
    """

    xy_m: FloatArray
    heading_rad: FloatArray
    speed_mps: FloatArray
    yaw_rate_radps: FloatArray

    @classmethod
    def of_states(cls, state: FloatArray) -> Motion:
        """Return the motion of states (n, 8)."""
        return cls(state[:, :2], state[:, HEADING], state[:, SPEED], state[:, YAW_RATE])

    def at(self, stamp_ns: Int64Array, at_ns: Int64Array) -> Motion:
        """Interpolate the motion linearly at other times; NaN outside its own and in gaps."""
        xy_m, speed, yaw_rate = (
            resample(stamp_ns, values, at_ns, max_gap_s=MAX_GAP_S)
            for values in (self.xy_m, self.speed_mps, self.yaw_rate_radps)
        )
        heading = resample(stamp_ns, self.heading_rad, at_ns, max_gap_s=MAX_GAP_S, is_angle=True)
        return Motion(xy_m, heading, speed, yaw_rate)


@dataclass(frozen=True)
class Reference:
    """Reference motion of the ego at stamps (n,), and whether it is `truth` or `hindsight`."""

    stamp_ns: Int64Array
    motion: Motion
    states: str


def reference_of(subject: Subject) -> Reference:
    """Return the truth as the reference motion, or cwcli's states where there is none.

    Raises:
        MissingSignalError: The log has neither.
    """
    states, truth = subject.ego.states, subject.ego.truth
    if truth is not None:
        nothing = np.full(len(truth.stamp_ns), np.nan)
        heading, speed, yaw_rate = (
            nothing if each is None else each for each in (truth.heading_rad, truth.speed_mps, truth.yaw_rate_radps)
        )
        return Reference(truth.stamp_ns, Motion(truth.xy, heading, speed, yaw_rate), TRUTH)
    if states is None:
        raise MissingSignalError(
            "another system's state or path of the ego can't be judged: the log holds no states of the ego",
            where=subject.log.name,
            hint="annotate it first: `cwcli run LOG -o annotated.mcap`",
        )
    return Reference(states.stamp_ns, Motion.of_states(states.state), HINDSIGHT)


def add_errors(subject: Subject, prefix: str, found: Motion, real: Motion) -> None:
    """Add errors of position, speed, heading and yaw rate at n times under a prefix of metrics."""
    error_m = found.xy_m - real.xy_m
    distance_m = np.hypot(*error_m.T)
    cosine, sine = np.cos(real.heading_rad), np.sin(real.heading_rad)
    errors = {
        "position_rmse_m": distance_m,
        "along_rmse_m": error_m[:, 0] * cosine + error_m[:, 1] * sine,
        "cross_rmse_m": -error_m[:, 0] * sine + error_m[:, 1] * cosine,
        "position_max_m": distance_m,
        "speed_rmse_mps": found.speed_mps - real.speed_mps,
        "heading_rmse_deg": np.degrees(wrap_angle(found.heading_rad - real.heading_rad)),
        "yaw_rate_rmse_degps": np.degrees(found.yaw_rate_radps - real.yaw_rate_radps),
    }
    for name, values in errors.items():
        assert metric_of(f"{prefix}{name}") is not None
        subject.headline.errors(f"{prefix}{name}", values)


def add_online(subject: Subject) -> None:
    """Add the errors of the online states at their own stamps; nothing if the log has none."""
    if subject.ego.states is None or all(channel.topic != EGO_ONLINE.topic for channel in subject.log.channels):
        return
    online = read_states(subject.log.columns(EGO_ONLINE.topic)).by_stamp()
    reference = reference_of(subject)
    with subject.headline.of(against(ONLINE, reference.states)):
        real = reference.motion.at(reference.stamp_ns, online.stamp_ns)
        add_errors(subject, "ego.online_", Motion.of_states(online.state), real)
    delay_s = (online.log_time_ns - online.stamp_ns) / NS_PER_S
    subject.headline.errors("ego.online_delay_mean_s", delay_s)
    usual_s = float(np.median(delay_s)) if len(delay_s) else 0.0
    if usual_s > LATE_S:
        subject.notes.append(
            f"{EGO_ONLINE.topic}: its states were usually known {usual_s:.1f} s after their time; their errors are "
            "those at their time, so this delay is not in them"
        )
