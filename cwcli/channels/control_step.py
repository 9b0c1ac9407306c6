"""`cwcli.v1.ControlStep`: replayed encounters; for each policy its steps, and the ego's state and pose under it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cwcli.channels.ego_viewers import make_pose_channel
from cwcli.channels.output import make_output_channel
from cwcli.channels.published import CONTROL_POSE, CONTROL_STATE, CONTROL_STEP
from cwcli.channels.vehicle_state import VehicleStates, make_vehicle_state_channel
from cwcli.control.encounter import BRAKING_POLICY_NAMES
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import Field, FloatArray, Int64Array, OutputChannel, Strings, repeat_string
from cwcli.signals.geodesy import LocalMap

CONTROL_STEP_FIELDS_THAT_VARY_BY_STEP = (
    "since_warning_s",
    "distance_m",
    "gap_m",
    "speed_difference_mps",
    "throttle",
    "brake_pressure_mpa",
    "is_extrapolated",
)
"""Fields of `cwcli.v1.ControlStep` that differ from step to step."""


@dataclass(frozen=True)
class ReplayedSteps:
    """The steps of one replayed warning that are published, k rows.

    Attributes:
        event_id: Number of the warning.
        other_id: The vehicle of which the host was warned.
        stamp_ns: Shape (k,).
        states: Shape (k, 8), one for each of `BRAKING_POLICY_NAMES`: the host's.
        series: Names of `CONTROL_STEP_FIELDS_THAT_VARY_BY_STEP` -> shape (k,), one for each of `BRAKING_POLICY_NAMES`.
    """

    event_id: int
    other_id: str
    stamp_ns: Int64Array
    states: tuple[FloatArray, ...]
    series: tuple[Mapping[str, Field], ...]


def make_replay_channels(
    replays: Sequence[ReplayedSteps], *, host_size_m: tuple[float | None, float | None], local_map: LocalMap | None
) -> tuple[OutputChannel, ...]:
    """Make the state, step and pose channels of every policy.

    Args:
        replays: At least one, in order of time; none begins before the last step of the one before.
        host_size_m: Length and width of the host, None where unknown.
        local_map: For latitude and longitude; None leaves them unknown.
    """
    channels: list[OutputChannel] = []
    stamp_ns = np.concatenate([one.stamp_ns for one in replays])
    for policy, name in enumerate(BRAKING_POLICY_NAMES):
        state = np.concatenate([one.states[policy] for one in replays])
        host = VehicleStates.from_ego_states(stamp_ns, state, size_m=host_size_m)
        channels += [
            make_vehicle_state_channel(CONTROL_STATE.with_policy_in_topic(name), host, local_map, has_covariance=False),
            _control_step_channel_of_policy(policy, stamp_ns, replays),
            make_pose_channel(CONTROL_POSE.with_policy_in_topic(name), stamp_ns, state),
        ]
    return tuple(channels)


def _control_step_channel_of_policy(
    policy: int, stamp_ns: Int64Array, replays: Sequence[ReplayedSteps]
) -> OutputChannel:
    counts = [len(one.stamp_ns) for one in replays]
    fields: dict[str, Field] = {
        "stamp_ns": stamp_ns,
        "policy": repeat_string(BRAKING_POLICY_NAMES[policy], len(stamp_ns)),
        "event_id": np.repeat([one.event_id for one in replays], counts),
        "other_id": Strings(
            np.repeat(np.arange(len(replays)), counts).astype(np.int32), tuple(one.other_id for one in replays)
        ),
    }
    for name in CONTROL_STEP_FIELDS_THAT_VARY_BY_STEP:
        fields[name] = np.concatenate([np.asarray(one.series[policy][name]) for one in replays])
    return make_output_channel(CONTROL_STEP.with_policy_in_topic(BRAKING_POLICY_NAMES[policy]), stamp_ns, fields)
