"""Replayed encounters as channels: for each policy the host's state and pose, and the steps of the replay."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cwcli.channels.states import N_STATES
from cwcli.channels.states_and_paths import EGO_ID, constant_strings, pose_channel, vehicle_states
from cwcli.control.encounter import POLICIES
from cwcli.signals.columns import FloatArray, Int64Array, OutputChannel, OutputField, Strings
from cwcli.signals.geodesy import LocalMap
from cwcli.stages.summaries.control import Replayed
from cwcli.warning.types import VehicleTrack


def state_topic(policy: str) -> str:
    """Where the host's states under a policy are published."""
    return f"/cwcli/control/{policy}/state"


def control_channels(
    replayed: Sequence[Replayed], host: VehicleTrack, local_map: LocalMap | None
) -> tuple[OutputChannel, ...]:
    """Three channels a policy. The replays do not overlap in time but for the seconds before a warning, which only the
    first one tells.

    Args:
        replayed: At least one, in order of time.
        host: For its outline.
        local_map: For latitude and longitude; None leaves them unknown.
    """
    channels: list[OutputChannel] = []
    rows_of = _rows(replayed)
    stamp_ns = np.concatenate([one.stamps_ns[rows] for one, rows in zip(replayed, rows_of, strict=True)])
    for policy, name in enumerate(POLICIES):
        state = np.concatenate([one.states(policy)[rows] for one, rows in zip(replayed, rows_of, strict=True)])
        channels += [
            _states(name, stamp_ns, state, host, local_map),
            _steps(policy, stamp_ns, replayed, rows_of),
            pose_channel(f"/cwcli/control/{name}/pose", stamp_ns, state),
        ]
    return tuple(channels)


def _rows(replayed: Sequence[Replayed]) -> list[Int64Array]:
    """Of each replay the published steps that are later than all of the one before."""
    last_ns, chosen = -1, []
    for one in replayed:
        rows = one.published_rows
        rows = rows[one.stamps_ns[rows] > last_ns]
        last_ns = int(one.stamps_ns[rows[-1]])
        chosen.append(rows)
    return chosen


def _states(
    policy: str, stamp_ns: Int64Array, state: FloatArray, host: VehicleTrack, local_map: LocalMap | None
) -> OutputChannel:
    n = len(stamp_ns)
    unknown = np.full(n, np.nan)
    latitude_deg, longitude_deg = unknown, unknown
    if local_map is not None:
        latitude_deg, longitude_deg, _ = local_map.wgs84_from_map(state[:, 0], state[:, 1], np.zeros(n))
    return vehicle_states(
        state_topic(policy),
        ids=constant_strings(EGO_ID, n),
        stamp_ns=stamp_ns,
        log_time_ns=stamp_ns,
        state=state,
        covariance=np.full((n, N_STATES, N_STATES), np.nan),
        latitude_deg=latitude_deg,
        longitude_deg=longitude_deg,
        length_m=_size(host.length_m, n),
        width_m=_size(host.width_m, n),
    )


def _size(value_m: float | None, n: int) -> FloatArray:
    return np.full(n, np.nan if value_m is None else value_m)


def _steps(
    policy: int, stamp_ns: Int64Array, replayed: Sequence[Replayed], rows_of: Sequence[Int64Array]
) -> OutputChannel:
    parts = [one.series(policy, rows) for one, rows in zip(replayed, rows_of, strict=True)]
    counts = [len(rows) for rows in rows_of]
    fields: dict[str, OutputField] = {
        "stamp_ns": stamp_ns,
        "policy": constant_strings(POLICIES[policy], len(stamp_ns)),
        "event_id": np.repeat([one.event_id for one in replayed], counts),
        "other_id": Strings(
            np.repeat(np.arange(len(replayed)), counts).astype(np.int32), tuple(one.other.id for one in replayed)
        ),
    }
    names = (
        "since_warning_s",
        "distance_m",
        "gap_m",
        "speed_difference_mps",
        "throttle",
        "brake_pressure_mpa",
        "is_extrapolated",
    )
    fields |= {name: np.concatenate([part[name] for part in parts]) for name in names}
    return OutputChannel(f"/cwcli/control/{POLICIES[policy]}/step", "cwcli.v1.ControlStep", stamp_ns, fields)
