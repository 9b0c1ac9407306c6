"""Replayed encounters as channels: for each policy the host's state and pose, and the steps of the replay."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cwcli.channels.published import CONTROL_POSE, CONTROL_STATE, CONTROL_STEP
from cwcli.channels.states import N_STATES
from cwcli.channels.states_and_paths import EGO_ID, constant_strings, pose_channel, vehicle_states
from cwcli.control.encounter import POLICIES
from cwcli.signals.columns import Field, FloatArray, Int64Array, OutputChannel, OutputField, Strings
from cwcli.signals.geodesy import LocalMap

SERIES = (
    "since_warning_s",
    "distance_m",
    "gap_m",
    "speed_difference_mps",
    "throttle",
    "brake_pressure_mpa",
    "is_extrapolated",
)
"""Columns of `cwcli.v1.ControlStep` that differ from step to step."""


@dataclass(frozen=True)
class ReplayedSteps:
    """The steps of one replayed warning that are published, k rows.

    Attributes:
        event_id: Number of the warning.
        other_id: The vehicle of which the host was warned.
        stamp_ns: Shape (k,).
        states: Shape (k, 8), one for each of `POLICIES`: the host's.
        series: Names of `SERIES` -> shape (k,), one for each of `POLICIES`.
    """

    event_id: int
    other_id: str
    stamp_ns: Int64Array
    states: tuple[FloatArray, ...]
    series: tuple[Mapping[str, Field], ...]


def control_channels(
    replays: Sequence[ReplayedSteps], *, host_size_m: tuple[float | None, float | None], local_map: LocalMap | None
) -> tuple[OutputChannel, ...]:
    """Three channels a policy.

    Args:
        replays: At least one, in order of time; none begins before the last step of the one before.
        host_size_m: Length and width of the host, None where unknown.
        local_map: For latitude and longitude; None leaves them unknown.
    """
    channels: list[OutputChannel] = []
    stamp_ns = np.concatenate([one.stamp_ns for one in replays])
    for policy, name in enumerate(POLICIES):
        state = np.concatenate([one.states[policy] for one in replays])
        channels += [
            _states(name, stamp_ns, state, host_size_m, local_map),
            _steps(policy, stamp_ns, replays),
            pose_channel(CONTROL_POSE.of(name).topic, stamp_ns, state),
        ]
    return tuple(channels)


def _states(
    policy: str,
    stamp_ns: Int64Array,
    state: FloatArray,
    host_size_m: tuple[float | None, float | None],
    local_map: LocalMap | None,
) -> OutputChannel:
    n = len(stamp_ns)
    unknown = np.full(n, np.nan)
    latitude_deg, longitude_deg = unknown, unknown
    if local_map is not None:
        latitude_deg, longitude_deg, _ = local_map.wgs84_from_map(state[:, 0], state[:, 1], np.zeros(n))
    length_m, width_m = (np.full(n, np.nan if size is None else size) for size in host_size_m)
    return vehicle_states(
        CONTROL_STATE.of(policy).topic,
        ids=constant_strings(EGO_ID, n),
        stamp_ns=stamp_ns,
        log_time_ns=stamp_ns,
        state=state,
        covariance=np.full((n, N_STATES, N_STATES), np.nan),
        latitude_deg=latitude_deg,
        longitude_deg=longitude_deg,
        length_m=length_m,
        width_m=width_m,
    )


def _steps(policy: int, stamp_ns: Int64Array, replays: Sequence[ReplayedSteps]) -> OutputChannel:
    counts = [len(one.stamp_ns) for one in replays]
    fields: dict[str, OutputField] = {
        "stamp_ns": stamp_ns,
        "policy": constant_strings(POLICIES[policy], len(stamp_ns)),
        "event_id": np.repeat([one.event_id for one in replays], counts),
        "other_id": Strings(
            np.repeat(np.arange(len(replays)), counts).astype(np.int32), tuple(one.other_id for one in replays)
        ),
    }
    for name in SERIES:
        fields[name] = np.concatenate([np.asarray(one.series[policy][name]) for one in replays])
    step = CONTROL_STEP.of(POLICIES[policy])
    return OutputChannel(step.topic, step.schema, stamp_ns, fields)
