"""The observer's channel: `cwcli.v1.LateralState` rows out of a track, and back."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from cwcli.channels.published import OBSERVER
from cwcli.channels.states_and_paths import in_log_order
from cwcli.dynamics.samples import PREVIEW_M, LateralTrack, Status, count_statuses
from cwcli.dynamics.vehicle import Vehicle, load_vehicle
from cwcli.errors import DataError
from cwcli.signals.columns import Columns, Field, FloatArray, Int64Array, OutputChannel
from cwcli.signals.leaves import matrix, numbers, whole_numbers

SCHEMA = "cwcli.v1.LateralState"
RECORD = "cwcli.run.observe"
VEHICLE_ENTRY = "vehicle"

STATE_NAMES = ("lateral_speed_mps", "yaw_rate_radps", "lateral_deviation_m", "heading_deviation_rad")
N_STATES = len(STATE_NAMES)
READ = ("stamp_ns", *STATE_NAMES, "steer_rad", "speed_mps", "curvature_1pm", "status", "covariance", "mass_kg")
FIRST_STATUS = 1
"""`Status` counts from 0, the message from 1: 0 is unspecified."""


@dataclass(frozen=True)
class Observed:
    """A read observer channel, in the order of its stamps.

    Attributes:
        log_time_ns: Shape (n,).
        track: n frames.
        preview_m: Of the preview point ahead of the camera.
    """

    log_time_ns: Int64Array
    track: LateralTrack
    preview_m: float

    def __len__(self) -> int:
        return len(self.track)


def observer_channel(track: LateralTrack, log_time_ns: Int64Array, preview_m: float) -> OutputChannel:
    """`cwcli.v1.LateralState`, one message a frame."""
    n = len(track)
    fields: dict[str, Field] = {
        "stamp_ns": track.stamp_ns,
        **{name: track.state[:, k] for k, name in enumerate(STATE_NAMES)},
        "steer_rad": track.steer_rad,
        "speed_mps": track.speed_mps,
        "curvature_1pm": track.curvature_1pm,
        "status": track.status.astype(np.int32) + FIRST_STATUS,
        "covariance": track.covariance.reshape(n, N_STATES**2),
        "mass_kg": track.mass_kg,
        "mass_sigma_kg": track.mass_sigma_kg,
        "preview_distance_m": np.full(n, preview_m),
    }
    return in_log_order(OutputChannel(OBSERVER.topic, SCHEMA, log_time_ns, fields))


def read_observer(columns: Columns) -> Observed:
    """Take the columns of an observer channel as a track.

    Raises:
        DataError: A field is missing: another version wrote it.
    """
    missing = [name for name in READ if name not in columns.fields]
    if missing:
        raise DataError(
            f"the channel has no field `{missing[0]}`",
            where=columns.topic,
            hint="observe again with this version of cwcli (`--replace`)",
        )
    stamp_ns, _ = whole_numbers(columns, "stamp_ns")
    order = np.argsort(stamp_ns, kind="stable")
    n = len(order)

    def column(name: str) -> FloatArray:
        return numbers(columns, name)[order]

    number = column("status").astype(np.int64) - FIRST_STATUS
    if n and not np.isin(number, [status.value for status in Status]).all():
        raise DataError("a frame has an unknown status", where=columns.topic, hint="observe again (`--replace`)")
    status = number.astype(np.int8)
    preview_m = column("preview_distance_m")
    track = LateralTrack(
        stamp_ns=stamp_ns[order],
        state=np.column_stack([column(name) for name in STATE_NAMES]).reshape(n, N_STATES),
        covariance=matrix(columns, "covariance", N_STATES**2).reshape(n, N_STATES, N_STATES)[order],
        speed_mps=column("speed_mps"),
        steer_rad=column("steer_rad"),
        curvature_1pm=column("curvature_1pm"),
        mass_kg=column("mass_kg"),
        mass_sigma_kg=column("mass_sigma_kg"),
        status=status,
        counts=count_statuses(status),
    )
    return Observed(columns.log_time_ns[order], track, float(preview_m[0]) if n else PREVIEW_M)


def vehicle_entry(vehicle: Vehicle) -> str:
    """The car as an entry of the metadata record."""
    return json.dumps(dataclasses.asdict(vehicle), sort_keys=True)


def recorded_vehicle(metadata: Iterable[tuple[str, Mapping[str, str]]]) -> tuple[Vehicle, tuple[str, ...]]:
    """The car with which the log was observed; the shipped example, and a note, if the log does not tell."""
    entry = None
    for name, record in metadata:
        if name == RECORD:
            entry = record.get(VEHICLE_ENTRY, entry)
    if entry is None:
        vehicle = load_vehicle()
        note = f"the log does not tell the car (no record {RECORD}): that of {vehicle.name} is assumed"
        return vehicle, (note,)
    try:
        return Vehicle(**json.loads(entry)), ()
    except (TypeError, ValueError) as error:
        raise DataError(f"the car in the record {RECORD} can't be read: {error}", hint="observe again") from None
