"""What the observer takes: the lane at the preview point and its shape, the ego's speed, yaw rate and steering angle.

A sensor's own messages come before the states of `cwcli estimate`: the observer fuses them itself, and the errors of a
smoothed state go together over time, which no filter expects.
"""

from __future__ import annotations

import math

import numpy as np

from cwcli.channels.lanes import PREVIEW_POINT_FIELDS, read_lanes
from cwcli.channels.published import EGO_STATE, LANES
from cwcli.channels.vehicle_state import read_vehicle_states
from cwcli.dynamics.samples import LaneSamples, ScalarSamples, linearise_lanes
from cwcli.errors import DataError, MissingSignalError
from cwcli.lazy_dataclass import dataclass
from cwcli.pipeline.result import InputMessageCount
from cwcli.signals.canonical import ImuSignal, SpeedSignal, SteerSignal, VelocitySignal
from cwcli.signals.clocks import MAX_STAMP_NS, MIN_STAMP_NS
from cwcli.signals.columns import Columns, FloatArray, Int64Array, sort_distinct_values
from cwcli.signals.role import Role
from cwcli.signals.row_order import rows_by_stamp_without_repeats
from cwcli.signals.vehicle_state import SPEED, YAW_RATE
from cwcli.stages.inputs.sources import UP_AXIS_COLUMN_OF_GYRO, SensorSignals
from cwcli.vision.method import LaneState

MAX_PREVIEW_OFFSET_M_HEADING_RAD_CURVATURE_1PM = np.array([1e3, math.pi / 2.0, 1.0])
"""Greatest magnitudes of the values at the preview point (m, rad, 1/m); larger ones are left out. Chosen by hand."""
MAX_BELIEVED_PREVIEW_SIGMA = 1e3
"""Greatest sigma of a preview value (m, rad or 1/m) that is believed; chosen by hand."""
PREVIEW_DISTANCE_RANGE_M = (0.1, 1e3)
"""Least and greatest distance of the preview point that is accepted [m]; chosen by hand."""

REPEATED_STAMP_REASON = "stamp repeated"
"""The reason for rejecting a frame whose stamp an earlier frame has."""
NAME_OF_REPAIR_OF_VALUES_OUT_OF_RANGE = "value out of range, left out"
"""The name of the repair that drops preview values beyond `MAX_PREVIEW_OFFSET_M_HEADING_RAD_CURVATURE_1PM`."""
NO_STAMP_REASON = "no usable stamp"
"""The reason for rejecting a frame whose stamp is missing or no time."""
NO_BOUNDARY_REASON = "no boundary found"
"""The reason for setting a frame aside in which no boundary was found."""


@dataclass(frozen=True)
class LaneSamplesWithCounts:
    """The lane samples of a channel, with the counts of its messages.

    Attributes:
        samples: Samples of n frames.
        log_time_ns: Log times of the frames, shape (n,).
        preview_m: Distance of the preview point ahead of the camera.
        count: Counts of the messages.
    """

    samples: LaneSamples
    log_time_ns: Int64Array
    preview_m: float
    count: InputMessageCount


def lane_samples_at_preview(columns: Columns, *, where: str, with_shape: bool = True) -> LaneSamplesWithCounts:
    """Read the lane at the preview point in each frame.

    Args:
        columns: The channel; its fields `FIELDS_FOR_OBSERVER` are enough.
        with_shape: The observer takes the boundaries' shape too: a frame needs no value at the preview point.

    Raises:
        DataError: A field is missing, no stamp is usable, or the preview distance changes or makes no sense.
        MissingSignalError: There is no message.
    """
    place = f"{where}: {columns.topic}" if where else columns.topic
    if not len(columns):
        raise MissingSignalError("no frame is in the log, or none between --start and --end", where=place)
    lanes = read_lanes(columns, required=("stamp_ns", *PREVIEW_POINT_FIELDS, "preview_distance_m"))
    stamp_ns = lanes.stamp_ns
    usable = np.flatnonzero((stamp_ns >= MIN_STAMP_NS) & (stamp_ns <= MAX_STAMP_NS))
    if not len(usable):
        raise DataError("no frame has a usable stamp", where=place)
    rows = usable[rows_by_stamp_without_repeats(stamp_ns[usable])]
    values, sigma = lanes.preview[rows], lanes.preview_sigma[rows]
    with np.errstate(invalid="ignore"):
        is_beyond = np.abs(values) > MAX_PREVIEW_OFFSET_M_HEADING_RAD_CURVATURE_1PM
        sigma = np.where(
            (sigma > 0.0) & (sigma <= MAX_BELIEVED_PREVIEW_SIGMA), sigma, np.nan
        )  # the observer then takes its own
    is_held = np.isin(lanes.state[rows], (LaneState.HELD, LaneState.CARRIED))  # what no frame shows is no measurement
    values = np.where(is_beyond | is_held[:, None], np.nan, values)
    lines = np.where(is_held[:, None, None], np.nan, lanes.curved_offset_slope_curvature_of_boundaries()[rows])
    is_empty = ~np.isfinite(values).any(axis=1) & ~is_held
    has_shape = np.asarray(np.isfinite(lines).any(axis=(1, 2)), np.bool_)
    reasons = {
        NO_BOUNDARY_REASON: ~has_shape,
        "the lane turns back before the preview point": has_shape & (not with_shape),
    }
    set_aside = {reason: int(np.count_nonzero(is_empty & which)) for reason, which in reasons.items()}
    set_aside["the lane is only carried on, left out"] = int(np.count_nonzero(is_held))
    rejected = {NO_STAMP_REASON: len(columns) - len(usable), REPEATED_STAMP_REASON: len(usable) - len(rows)}
    repaired = {
        "stamp out of order, sorted": int(np.count_nonzero(np.diff(stamp_ns[usable]) < 0)),
        NAME_OF_REPAIR_OF_VALUES_OUT_OF_RANGE: int(np.count_nonzero(is_beyond.any(axis=1))),
    }
    samples = LaneSamples(
        *(stamp_ns[rows], values[:, 0], values[:, 1], values[:, 2], sigma[:, 0], sigma[:, 1], sigma[:, 2]),
        yaw_sigma_rad=lanes.least_camera_yaw_sigma_rad_or_zero(),
        lines=lines,
        curvature_change_1pm2=lanes.curvature_change_1pm2[rows],
    )
    count = InputMessageCount(
        columns.topic,
        LANES.role,
        len(columns),
        len(rows) - sum(set_aside.values()),
        rejected={reason: n for reason, n in rejected.items() if n},
        repaired={reason: n for reason, n in repaired.items() if n},
        set_aside={reason: n for reason, n in set_aside.items() if n},
    )
    return LaneSamplesWithCounts(
        linearise_lanes(samples),
        columns.log_time_ns[rows],
        _common_preview_distance_m(lanes.preview_m[rows], place),
        count,
    )


def _common_preview_distance_m(previews_m: FloatArray, where: str) -> float:
    """Return the preview distance that all frames share [m]; raise `DataError` if they share none."""
    distinct = sort_distinct_values(previews_m)
    low, high = PREVIEW_DISTANCE_RANGE_M
    if len(distinct) > 1:
        distances_text = f"{distinct[0]:g} and {distinct[1]:g} m"
        raise DataError(f"the preview distance changes within the channel: {distances_text}", where=where)
    if not low <= distinct[0] <= high:
        raise DataError(f"a preview distance of {distinct[0]:g} m is not between {low:g} and {high:g} m", where=where)
    return float(distinct[0])


@dataclass(frozen=True)
class ObserverInputs:
    """The inputs of the observer in addition to the lanes.

    Attributes:
        speed, yaw_rate, steer: Samples, or None.
        speed_source, yaw_rate_source, steer_source: Their topics, "" where there is none.
        counts: Counts of the messages.
        notes: Notes for the user.
    """

    speed: ScalarSamples | None = None
    yaw_rate: ScalarSamples | None = None
    steer: ScalarSamples | None = None
    speed_source: str = ""
    yaw_rate_source: str = ""
    steer_source: str = ""
    counts: tuple[InputMessageCount, ...] = ()
    notes: tuple[str, ...] = ()


def choose_observer_inputs(
    sources: SensorSignals, ego_state: Columns | None, *, use_gyro: bool, use_steer: bool
) -> ObserverInputs:
    """Choose among the signals.

    Speed: the speed channel, else the ego state, else the magnitude of the velocity over ground. Yaw rate: the
    gyroscope, else that of the speed channel, else the ego state. Steering angle: its own channel.
    """
    used: set[str] = set()
    counts = list(sources.input_message_counts())
    speed, speed_source = _choose_speed_and_topic(sources)
    yaw_rate, yaw_rate_source = _choose_yaw_rate_and_topic(sources) if use_gyro else (None, "")
    if ego_state is not None and len(ego_state) and (speed is None or (use_gyro and yaw_rate is None)):
        states = read_vehicle_states(ego_state)
        rows = rows_by_stamp_without_repeats(states.stamp_ns)
        stamp_ns, state = states.stamp_ns[rows], states.state[rows]
        variance = np.maximum(states.covariance[rows, YAW_RATE, YAW_RATE], 0.0)
        if speed is None:
            speed, speed_source = ScalarSamples(stamp_ns, state[:, SPEED]), ego_state.topic
        if use_gyro and yaw_rate is None:
            yaw_rate = ScalarSamples(stamp_ns, state[:, YAW_RATE], np.sqrt(variance))
            yaw_rate_source = ego_state.topic
        counts.append(InputMessageCount(ego_state.topic, EGO_STATE.role, len(states), len(states)))
    if speed is None:
        speed, speed_source = _speed_and_topic_from_velocity(sources)
    steer, steer_source = _choose_steering_and_topic(sources) if use_steer else (None, "")
    used |= {speed_source, yaw_rate_source, steer_source}
    return ObserverInputs(
        speed=speed,
        yaw_rate=yaw_rate,
        steer=steer,
        speed_source=speed_source,
        yaw_rate_source=yaw_rate_source,
        steer_source=steer_source,
        counts=tuple(count for count in counts if count.topic in used),
        notes=sources.notes,
    )


def _choose_speed_and_topic(sources: SensorSignals) -> tuple[ScalarSamples | None, str]:
    """Return the samples of the speed channel and its topic; None and "" without one."""
    for signal in sources.by_role.get(Role.EGO_SPEED, ()):
        if isinstance(signal, SpeedSignal):
            return ScalarSamples(signal.stamp_ns, signal.speed_mps), signal.source
    return None, ""


def _speed_and_topic_from_velocity(sources: SensorSignals) -> tuple[ScalarSamples | None, str]:
    """Return the magnitude of the velocity over ground and its topic; None and "" without one."""
    for signal in sources.by_role.get(Role.EGO_VELOCITY, ()):
        if isinstance(signal, VelocitySignal):
            return ScalarSamples(signal.stamp_ns, np.hypot(signal.east_mps, signal.north_mps)), signal.source
    return None, ""


def _choose_yaw_rate_and_topic(sources: SensorSignals) -> tuple[ScalarSamples | None, str]:
    """Return the yaw rate of the gyroscope, else that of the speed channel, and its topic."""
    for signal in sources.by_role.get(Role.IMU, ()):
        if isinstance(signal, ImuSignal):
            sigma = _sigma_from_variance(signal.gyro_variance[:, UP_AXIS_COLUMN_OF_GYRO])
            return ScalarSamples(signal.stamp_ns, signal.gyro_radps[:, UP_AXIS_COLUMN_OF_GYRO], sigma), signal.source
    for signal in sources.by_role.get(Role.EGO_SPEED, ()):
        if isinstance(signal, SpeedSignal) and np.isfinite(signal.yaw_rate_radps).any():
            sigma = _sigma_from_variance(signal.yaw_rate_variance_rad2ps2)
            return ScalarSamples(signal.stamp_ns, signal.yaw_rate_radps, sigma), signal.source
    return None, ""


def _choose_steering_and_topic(sources: SensorSignals) -> tuple[ScalarSamples | None, str]:
    """Return the samples of the steering angle and their topic; None and "" without any."""
    for signal in sources.by_role.get(Role.EGO_STEER, ()):
        if isinstance(signal, SteerSignal):
            return ScalarSamples(signal.stamp_ns, signal.steer_rad), signal.source
    return None, ""


def _sigma_from_variance(variance: FloatArray) -> FloatArray:
    """Return the sigma of each value; NaN where the variance is not given."""
    return np.asarray(np.sqrt(np.where(variance > 0.0, variance, np.nan)))
