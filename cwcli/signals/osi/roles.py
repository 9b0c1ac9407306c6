"""Building signals from an OSI GroundTruth; `prefix` is its path in the message, with its dot."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.signals.builders.base import Reading
from cwcli.signals.canonical import PoseSignal, RemoteSignal, SpeedSignal, TargetTruthSignal
from cwcli.signals.clocks import Timeline, repair_and_order_times
from cwcli.signals.columns import Columns, FloatArray, median_of_finite
from cwcli.signals.osi.world import (
    NO_HOST_REASON,
    OSI_FRAME,
    MovingObjects,
    encode_station_names,
    read_moving_objects,
    read_world_stamps_ns_and_is_given,
)
from cwcli.signals.quality import Quality, RowLedger

SIMULATED_POSITION_SIGMA_M = 0.01
"""The assumed error (one sigma) of a simulated position, in metres. A GroundTruth gives no errors; these five allow for
one step of the simulator, which moves with the velocity of either end, and for a velocity of the rear axle. Chosen by
hand."""
SIMULATED_SPEED_SIGMA_MPS = 0.005
"""The assumed error (one sigma) of a simulated speed, in m/s; chosen by hand."""
SIMULATED_HEADING_SIGMA_RAD = 0.002
"""The assumed error (one sigma) of a simulated heading, in rad; chosen by hand."""
SIMULATED_ACCEL_SIGMA_MPS2 = 0.1
"""The assumed error (one sigma) of a simulated acceleration, in m/s^2; chosen by hand."""
SIMULATED_YAW_RATE_SIGMA_RADPS = 0.005
"""The assumed error (one sigma) of a simulated yaw rate, in rad/s; chosen by hand."""


def build_pose(prefix: str, columns: Columns, reading: Reading) -> tuple[PoseSignal, Quality]:
    """Build the host vehicle's poses: the centre of its box, in the axes of the world."""
    ledger = RowLedger(columns, reading.role)
    world, at, timeline = _read_objects_and_host_rows(columns, reading, ledger, prefix)
    n = len(at)
    signal = PoseSignal(
        source=columns.topic,
        frame_id=OSI_FRAME,
        stamp_ns=timeline.stamp_ns,
        log_time_ns=columns.log_time_ns[timeline.rows],
        x_m=world.x_m[at],
        y_m=world.y_m[at],
        z_m=np.zeros(n),
        yaw_rad=world.heading_rad[at],
        speed_mps=world.speed_mps[at],
        yaw_rate_radps=world.yaw_rate_radps[at],
        covariance_m2=_isotropic_position_covariances(n),
        accel_mps2=world.accel_mps2[at],
        yaw_variance_rad2=np.full(n, SIMULATED_HEADING_SIGMA_RAD**2),
        is_exact=True,
        size_m=(median_of_finite(world.length_m[at]), median_of_finite(world.width_m[at])),
    )
    return signal, ledger.quality


def build_speed(prefix: str, columns: Columns, reading: Reading) -> tuple[SpeedSignal, Quality]:
    """Build the host vehicle's speed along its heading, and its yaw rate."""
    ledger = RowLedger(columns, reading.role)
    world, at, timeline = _read_objects_and_host_rows(columns, reading, ledger, prefix)
    n = len(at)
    signal = SpeedSignal(
        source=columns.topic,
        stamp_ns=timeline.stamp_ns,
        log_time_ns=columns.log_time_ns[timeline.rows],
        speed_mps=world.speed_mps[at],
        yaw_rate_radps=world.yaw_rate_radps[at],
        speed_variance_m2ps2=np.full(n, SIMULATED_SPEED_SIGMA_MPS**2),
        yaw_rate_variance_rad2ps2=np.full(n, SIMULATED_YAW_RATE_SIGMA_RADPS**2),
        is_exact=True,
    )
    return signal, ledger.quality


def build_remote(prefix: str, columns: Columns, reading: Reading) -> tuple[RemoteSignal, Quality]:
    """Build remote vehicles from all objects but the host, as if each reported itself by radio under its id."""
    ledger = RowLedger(columns, reading.role)
    world, at, row, timeline = _objects_other_rows_timeline_rows_and_times(columns, reading, ledger, prefix)
    n = len(at)
    nothing = np.full(n, np.nan)
    signal = RemoteSignal(
        source=columns.topic,
        station=encode_station_names(world.id[at]),
        stamp_ns=timeline.stamp_ns[row],
        log_time_ns=columns.log_time_ns[timeline.rows][row],
        latitude_deg=nothing,
        longitude_deg=nothing,
        altitude_m=nothing,
        speed_mps=world.speed_mps[at],
        heading_rad=world.heading_rad[at],
        accel_mps2=world.accel_mps2[at],
        lateral_accel_mps2=world.lateral_accel_mps2[at],
        yaw_rate_radps=world.yaw_rate_radps[at],
        length_m=world.length_m[at],
        width_m=world.width_m[at],
        position_covariance_m2=_isotropic_position_covariances(n),
        speed_sigma_mps=np.full(n, SIMULATED_SPEED_SIGMA_MPS),
        heading_sigma_rad=np.full(n, SIMULATED_HEADING_SIGMA_RAD),
        accel_sigma_mps2=np.full(n, SIMULATED_ACCEL_SIGMA_MPS2),
        yaw_rate_sigma_radps=np.full(n, SIMULATED_YAW_RATE_SIGMA_RADPS),
        message_count=nothing,
        frame_id=OSI_FRAME,
        x_m=world.x_m[at],
        y_m=world.y_m[at],
        is_exact=True,
    )
    return signal, ledger.quality


def build_target_truth(prefix: str, columns: Columns, reading: Reading) -> tuple[TargetTruthSignal, Quality]:
    """Build the truth of all objects but the host."""
    ledger = RowLedger(columns, reading.role)
    world, at, row, timeline = _objects_other_rows_timeline_rows_and_times(columns, reading, ledger, prefix)
    signal = TargetTruthSignal(
        source=columns.topic,
        frame_id="",
        id=encode_station_names(world.id[at]),
        stamp_ns=timeline.stamp_ns[row],
        log_time_ns=columns.log_time_ns[timeline.rows][row],
        x_m=world.x_m[at],
        y_m=world.y_m[at],
        vx_mps=world.vx_mps[at],
        vy_mps=world.vy_mps[at],
    )
    return signal, ledger.quality


def _read_objects_and_host_rows(
    columns: Columns, reading: Reading, ledger: RowLedger, prefix: str
) -> tuple[MovingObjects, npt.NDArray[np.intp], Timeline]:
    """Return the objects, the host's rows of them by stamp, and their times."""
    world = read_moving_objects(columns, reading, ledger, prefix)
    of_message = np.full(len(columns), -1, np.intp)
    rows = np.flatnonzero(world.is_host_mask)
    of_message[world.message[rows]] = rows
    ledger.set_aside(of_message < 0, NO_HOST_REASON)
    pose = np.full((len(columns), 3), np.nan)
    pose[world.message[rows]] = np.stack([world.x_m[rows], world.y_m[rows], world.heading_rad[rows]], axis=1)
    timeline = repair_and_order_times(
        ledger, *read_world_stamps_ns_and_is_given(columns, prefix), reading.clock, [pose]
    )
    return world, of_message[timeline.rows], timeline


def _objects_other_rows_timeline_rows_and_times(
    columns: Columns, reading: Reading, ledger: RowLedger, prefix: str
) -> tuple[MovingObjects, npt.NDArray[np.intp], npt.NDArray[np.intp], Timeline]:
    """Return the objects, the rows of all but the host by stamp, the timeline's row of each, and the times."""
    world = read_moving_objects(columns, reading, ledger, prefix)
    others = np.flatnonzero(~world.is_host_mask)
    marks = [
        np.bincount(world.message[others], weights=each[others], minlength=len(columns)).astype(np.float64)
        for each in (np.ones(len(world.id)), world.x_m, world.y_m)
    ]
    ledger.set_aside(marks[0] == 0.0, "without another road user")
    timeline = repair_and_order_times(ledger, *read_world_stamps_ns_and_is_given(columns, prefix), reading.clock, marks)
    place = np.full(len(columns), -1, np.intp)
    place[timeline.rows] = np.arange(len(timeline.rows))
    row = place[world.message[others]]
    order = np.argsort(row, kind="stable")
    order = order[row[order] >= 0]
    return world, others[order], row[order], timeline


def _isotropic_position_covariances(n: int) -> FloatArray:
    """Return n position covariances xx, xy, yy, (n, 3), the same in all directions."""
    return np.tile([SIMULATED_POSITION_SIGMA_M**2, 0.0, SIMULATED_POSITION_SIGMA_M**2], (n, 1))
