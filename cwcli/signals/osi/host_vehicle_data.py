"""`osi3.HostVehicleData`: the host vehicle's own position and motion.

`vehicle_localization` and `location` (up to OSI 3.4) are about the centre of the box, in the axes of the world;
`vehicle_motion` is about the middle of the rear axle: its velocity is in the axes of the vehicle, and its position only
counts where there is no other. A place on the globe alone (`vehicle_localization.geodetic_position`) is a fix.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from cwcli.signals.angles import wrap_angle
from cwcli.signals.builders.base import Reading
from cwcli.signals.builders.position import reject_invalid_positions
from cwcli.signals.canonical import PoseSignal, PositionSignal, SpeedSignal
from cwcli.signals.clocks import build_signal_and_quality, repair_and_order_times
from cwcli.signals.columns import Columns, FloatArray
from cwcli.signals.covariances import usable_variances_or_nan
from cwcli.signals.leaf_fields import read_numbers
from cwcli.signals.limits import (
    MAX_ALTITUDE_M,
    MAX_ANGLE_RAD,
    MAX_COORDINATE_M,
    MAX_SPEED_MPS,
    MAX_TURN_RATE_RADPS,
    nan_beyond_limit,
    reject_rows_beyond_limit,
)
from cwcli.signals.osi.world import OSI_FRAME, read_world_stamps_ns_and_is_given
from cwcli.signals.quality import Quality, RowLedger

GEODETIC_POSITION_PATH = "vehicle_localization.geodetic_position"
"""The path of the vehicle's WGS84 position."""
MESSAGE_PARTS_THAT_CAN_HOLD_POSE = ("vehicle_localization", "location", "vehicle_motion")
"""The parts of the message that can hold the pose, best first."""


def build_pose(columns: Columns, reading: Reading) -> tuple[PoseSignal | PositionSignal, Quality]:
    """Build the host's poses from the first part that holds one, else fixes from its WGS84 position."""
    ledger = RowLedger(columns, reading.role)
    part = next(
        (
            part
            for part in MESSAGE_PARTS_THAT_CAN_HOLD_POSE
            if np.isfinite(read_numbers(columns, f"{part}.position.x")).any()
        ),
        None,
    )
    if part is None and np.isfinite(read_numbers(columns, f"{GEODETIC_POSITION_PATH}.latitude")).any():
        return _build_geodetic_position(columns, reading, ledger)
    part = part or MESSAGE_PARTS_THAT_CAN_HOLD_POSE[0]
    place = np.stack([read_numbers(columns, f"{part}.position.{axis}") for axis in "xy"], axis=1)
    if part == "vehicle_motion":
        ledger.add_note(
            "the position is the middle of the rear axle, not of the vehicle: outlines are shifted accordingly"
        )
    reject_rows_beyond_limit(ledger, place, MAX_COORDINATE_M)
    yaw_rad = wrap_angle(
        nan_beyond_limit(ledger, read_numbers(columns, f"{part}.orientation.yaw"), MAX_ANGLE_RAD, "yaw")
    )
    nothing = np.full(len(columns), np.nan)
    variances = [nothing, nothing, nothing]
    if part == "location":
        leaves = ("position.x", "position.y", "orientation.yaw")
        variances = [_variances_from_rmse(ledger, read_numbers(columns, f"location_rmse.{leaf}")) for leaf in leaves]
    timeline = repair_and_order_times(
        ledger, *read_world_stamps_ns_and_is_given(columns), reading.clock, [place, yaw_rad]
    )
    return build_signal_and_quality(
        partial(PoseSignal, frame_id=OSI_FRAME),
        ledger,
        timeline,
        x_m=place[:, 0],
        y_m=place[:, 1],
        z_m=np.zeros(len(columns)),
        yaw_rad=yaw_rad,
        speed_mps=nothing,
        yaw_rate_radps=nothing,
        covariance_m2=np.stack([variances[0], np.where(np.isnan(variances[0]), np.nan, 0.0), variances[1]], 1),
        yaw_variance_rad2=variances[2],
    )


def _build_geodetic_position(columns: Columns, reading: Reading, ledger: RowLedger) -> tuple[PositionSignal, Quality]:
    latitude_deg, longitude_deg = (
        read_numbers(columns, f"{GEODETIC_POSITION_PATH}.{name}") for name in ("latitude", "longitude")
    )
    reject_invalid_positions(ledger, latitude_deg, longitude_deg)
    altitude_m = nan_beyond_limit(
        ledger, read_numbers(columns, f"{GEODETIC_POSITION_PATH}.altitude"), MAX_ALTITUDE_M, "altitude"
    )
    timeline = repair_and_order_times(
        ledger, *read_world_stamps_ns_and_is_given(columns), reading.clock, [latitude_deg, longitude_deg]
    )
    return build_signal_and_quality(
        PositionSignal,
        ledger,
        timeline,
        latitude_deg=latitude_deg,
        longitude_deg=longitude_deg,
        altitude_m=altitude_m,
        covariance_m2=np.full((len(columns), 3), np.nan),
    )


def build_speed(columns: Columns, reading: Reading) -> tuple[SpeedSignal, Quality]:
    """Build the host's speed and yaw rate from `vehicle_motion`, else the velocity of `location` along its yaw."""
    ledger = RowLedger(columns, reading.role)
    speed_mps, yaw_rate = read_numbers(columns, "vehicle_motion.velocity.x"), "vehicle_motion.orientation_rate.yaw"
    if not np.isfinite(speed_mps).any():
        yaw_rad, yaw_rate = read_numbers(columns, "location.orientation.yaw"), "location.orientation_rate.yaw"
        velocity = [read_numbers(columns, f"location.velocity.{axis}") for axis in "xy"]
        with np.errstate(invalid="ignore", over="ignore"):
            speed_mps = velocity[0] * np.cos(yaw_rad) + velocity[1] * np.sin(yaw_rad)
    reject_rows_beyond_limit(ledger, speed_mps[:, None], MAX_SPEED_MPS)
    yaw_rate_radps = nan_beyond_limit(ledger, read_numbers(columns, yaw_rate), MAX_TURN_RATE_RADPS, "yaw rate")
    timeline = repair_and_order_times(
        ledger, *read_world_stamps_ns_and_is_given(columns), reading.clock, [speed_mps, yaw_rate_radps]
    )
    nothing = np.full(len(columns), np.nan)
    return build_signal_and_quality(
        SpeedSignal,
        ledger,
        timeline,
        speed_mps=speed_mps,
        yaw_rate_radps=yaw_rate_radps,
        speed_variance_m2ps2=nothing,
        yaw_rate_variance_rad2ps2=nothing,
    )


def _variances_from_rmse(ledger: RowLedger, rmse: FloatArray) -> FloatArray:
    """Squares of root mean squared errors (n,); NaN where not given (0), and where unusable, which is counted."""
    with np.errstate(invalid="ignore", over="ignore"):
        return usable_variances_or_nan(ledger, np.where((rmse < 0.0) | (rmse > MAX_COORDINATE_M), np.inf, rmse * rmse))
