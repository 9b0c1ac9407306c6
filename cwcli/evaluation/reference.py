"""Reference for states of the ego: the truth, or cwcli's states in hindsight where a log has no truth."""

from __future__ import annotations

import numpy as np

from cwcli.channels.published import EGO_ONLINE
from cwcli.channels.vehicle_state import read_vehicle_states
from cwcli.errors import MissingSignalError
from cwcli.evaluation.evaluation_context import EvaluationContext
from cwcli.evaluation.knowledge import HINDSIGHT, ONLINE, TRUTH, comparison_label
from cwcli.lazy_dataclass import dataclass
from cwcli.metrics.headline import find_metric
from cwcli.signals.angles import wrap_angle
from cwcli.signals.columns import FloatArray, Int64Array, StateRows, median_of_values
from cwcli.signals.resample import interpolate_signal_at_times
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import HEADING, SPEED, YAW_RATE

MAX_INTERPOLATED_MOTION_GAP_S = 0.5
"""Longest gap of a motion that is interpolated, s. Chosen by hand; not fitted."""
MIN_REPORTED_DELAY_S = 1.0
"""Median delay of the online states from which a note reports it, s. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class EgoMotion:
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
    def from_states(cls, state: StateRows) -> EgoMotion:
        """Return the motion of states (n, 8)."""
        return cls(state[:, :2], state[:, HEADING], state[:, SPEED], state[:, YAW_RATE])

    def interpolate_motion(self, stamp_ns: Int64Array, at_ns: Int64Array) -> EgoMotion:
        """Interpolate the motion linearly at other times; NaN outside its own and in gaps."""
        xy_m, speed, yaw_rate = (
            interpolate_signal_at_times(stamp_ns, values, at_ns, max_gap_s=MAX_INTERPOLATED_MOTION_GAP_S)
            for values in (self.xy_m, self.speed_mps, self.yaw_rate_radps)
        )
        heading = interpolate_signal_at_times(
            stamp_ns, self.heading_rad, at_ns, max_gap_s=MAX_INTERPOLATED_MOTION_GAP_S, is_angle=True
        )
        return EgoMotion(xy_m, heading, speed, yaw_rate)


@dataclass(frozen=True)
class ReferenceMotion:
    """Reference motion of the ego at stamps (n,), and whether it is `truth` or `hindsight`."""

    stamp_ns: Int64Array
    motion: EgoMotion
    knowledge: str


def find_reference_motion(context: EvaluationContext) -> ReferenceMotion:
    """Return the truth as the reference motion, or cwcli's states where there is none.

    Raises:
        MissingSignalError: The log has neither.
    """
    states, truth = context.ego.states, context.ego.truth
    if truth is not None:
        nothing = np.full(len(truth.stamp_ns), np.nan)
        heading, speed, yaw_rate = (
            nothing if each is None else each for each in (truth.heading_rad, truth.speed_mps, truth.yaw_rate_radps)
        )
        return ReferenceMotion(truth.stamp_ns, EgoMotion(truth.xy, heading, speed, yaw_rate), TRUTH)
    if states is None:
        raise MissingSignalError(
            "another system's state or path of the ego can't be judged: the log holds no states of the ego",
            where=context.log.name,
            hint="annotate it first: `cwcli run LOG -o annotated.mcap`",
        )
    return ReferenceMotion(states.stamp_ns, EgoMotion.from_states(states.state), HINDSIGHT)


def add_motion_errors(context: EvaluationContext, prefix: str, estimated: EgoMotion, actual: EgoMotion) -> None:
    """Add errors of position, speed, heading and yaw rate at n times under a prefix of metrics."""
    error_m = estimated.xy_m - actual.xy_m
    distance_m = np.hypot(*error_m.T)
    cosine, sine = np.cos(actual.heading_rad), np.sin(actual.heading_rad)
    errors = {
        "position_rmse_m": distance_m,
        "along_rmse_m": error_m[:, 0] * cosine + error_m[:, 1] * sine,
        "cross_rmse_m": -error_m[:, 0] * sine + error_m[:, 1] * cosine,
        "position_max_m": distance_m,
        "speed_rmse_mps": estimated.speed_mps - actual.speed_mps,
        "heading_rmse_deg": np.degrees(wrap_angle(estimated.heading_rad - actual.heading_rad)),
        "yaw_rate_rmse_degps": np.degrees(estimated.yaw_rate_radps - actual.yaw_rate_radps),
    }
    for name, values in errors.items():
        assert find_metric(f"{prefix}{name}") is not None
        context.headline.add_errors(f"{prefix}{name}", values)


def add_online_state_errors(context: EvaluationContext) -> None:
    """Add the errors of the online states at their own stamps; nothing if the log has none."""
    if context.ego.states is None or all(channel.topic != EGO_ONLINE.topic for channel in context.log.channels):
        return
    online = read_vehicle_states(context.log.columns(EGO_ONLINE.topic)).sort_by_stamp_without_repeats()
    reference = find_reference_motion(context)
    with context.headline.label_rows_with_states(comparison_label(ONLINE, reference.knowledge)):
        real = reference.motion.interpolate_motion(reference.stamp_ns, online.stamp_ns)
        add_motion_errors(context, "ego.online_", EgoMotion.from_states(online.state), real)
    delay_s = (online.log_time_ns - online.stamp_ns) / NS_PER_S
    context.headline.add_errors("ego.online_delay_mean_s", delay_s)
    usual_s = median_of_values(delay_s) if len(delay_s) else 0.0
    if usual_s > MIN_REPORTED_DELAY_S:
        context.notes.append(
            f"{EGO_ONLINE.topic}: its states were usually known {usual_s:.1f} s after their time; their errors are "
            "those at their time, so this delay is not in them"
        )
