"""Canonical signals: what the numbers of a log mean, in SI units, radians, int64 ns and named frames.

Frames: `map` is local east-north-up; `body` is x forward, y left, z up (REP-103). Heading is
counter-clockwise from east.
A value that the message does not carry is NaN. Variances that the message does not carry are NaN.
Rows are sorted by `stamp_ns` and finite in their key fields once `signals.clocks` and the builders have run.
"""

from __future__ import annotations

from dataclasses import dataclass

from cwcli.signals.columns import FloatArray, Int64Array, Strings


@dataclass(frozen=True)
class PositionSignal:
    """GNSS fixes, WGS84.

    Attributes:
        source: Topic.
        stamp_ns, log_time_ns: Shape (n,).
        latitude_deg, longitude_deg, altitude_m: Shape (n,).
        covariance_m2: Shape (n, 3): east-east, east-north, north-north.
    """

    source: str
    stamp_ns: Int64Array
    log_time_ns: Int64Array
    latitude_deg: FloatArray
    longitude_deg: FloatArray
    altitude_m: FloatArray
    covariance_m2: FloatArray


@dataclass(frozen=True)
class PoseSignal:
    """Poses in a Cartesian frame of their own (a truth channel, an odometry).

    Attributes:
        source: Topic.
        frame_id: The frame that the message names.
        stamp_ns, log_time_ns: Shape (n,).
        x_m, y_m, z_m, yaw_rad: Shape (n,); yaw_rad is NaN where no orientation is given.
        speed_mps, yaw_rate_radps: Shape (n,), NaN where not given.
        covariance_m2: Shape (n, 3): xx, xy, yy.
        latitude_deg, longitude_deg: Shape (n,): the same points, WGS84, where the message has them too; else None.
        accel_mps2: Shape (n,), longitudinal, where the message has it; else None.
    """

    source: str
    frame_id: str
    stamp_ns: Int64Array
    log_time_ns: Int64Array
    x_m: FloatArray
    y_m: FloatArray
    z_m: FloatArray
    yaw_rad: FloatArray
    speed_mps: FloatArray
    yaw_rate_radps: FloatArray
    covariance_m2: FloatArray
    latitude_deg: FloatArray | None = None
    longitude_deg: FloatArray | None = None
    accel_mps2: FloatArray | None = None


@dataclass(frozen=True)
class VelocitySignal:
    """Velocity over ground in the map frame.

    Attributes:
        source: Topic.
        stamp_ns, log_time_ns: Shape (n,).
        east_mps, north_mps: Shape (n,).
        covariance_m2ps2: Shape (n, 3): east-east, east-north, north-north.
    """

    source: str
    stamp_ns: Int64Array
    log_time_ns: Int64Array
    east_mps: FloatArray
    north_mps: FloatArray
    covariance_m2ps2: FloatArray


@dataclass(frozen=True)
class SpeedSignal:
    """Longitudinal speed in the body frame (wheel speed, odometer), with the yaw rate where it is given.

    Attributes:
        source: Topic.
        stamp_ns, log_time_ns: Shape (n,).
        speed_mps: Shape (n,), negative in reverse.
        yaw_rate_radps: Shape (n,), counter-clockwise positive.
        speed_variance_m2ps2, yaw_rate_variance_rad2ps2: Shape (n,).
    """

    source: str
    stamp_ns: Int64Array
    log_time_ns: Int64Array
    speed_mps: FloatArray
    yaw_rate_radps: FloatArray
    speed_variance_m2ps2: FloatArray
    yaw_rate_variance_rad2ps2: FloatArray


@dataclass(frozen=True)
class HeadingSignal:
    """Heading in the map frame (dual-antenna GNSS, an AHRS).

    Attributes:
        source: Topic.
        stamp_ns, log_time_ns: Shape (n,).
        heading_rad: Shape (n,), counter-clockwise from east.
        variance_rad2: Shape (n,).
    """

    source: str
    stamp_ns: Int64Array
    log_time_ns: Int64Array
    heading_rad: FloatArray
    variance_rad2: FloatArray


@dataclass(frozen=True)
class ImuSignal:
    """Inertial measurements in the body frame as mounted (not levelled).

    Attributes:
        source: Topic.
        stamp_ns, log_time_ns: Shape (n,).
        accel_mps2, gyro_radps: Shape (n, 3): forward, left, up. At rest accel reads about +9.8 on up.
        accel_variance, gyro_variance: Shape (n, 3).
    """

    source: str
    stamp_ns: Int64Array
    log_time_ns: Int64Array
    accel_mps2: FloatArray
    gyro_radps: FloatArray
    accel_variance: FloatArray
    gyro_variance: FloatArray


@dataclass(frozen=True)
class RemoteSignal:
    """What other vehicles say of themselves over V2X (BSM, CAM), one row a message.

    Attributes:
        source: Topic.
        station: Station id as text, dictionary-coded.
        stamp_ns: Shape (n,): the generation time, made absolute (secMark, generationDeltaTime).
        log_time_ns: Shape (n,): the reception time.
        latitude_deg, longitude_deg, altitude_m: Shape (n,).
        speed_mps: Shape (n,), negative in reverse.
        heading_rad: Shape (n,), counter-clockwise from east.
        accel_mps2: Shape (n,), longitudinal.
        lateral_accel_mps2: Shape (n,), positive to the left.
        yaw_rate_radps: Shape (n,), counter-clockwise positive.
        length_m, width_m: Shape (n,).
        position_covariance_m2: Shape (n, 3): east-east, east-north, north-north.
        speed_sigma_mps, heading_sigma_rad, accel_sigma_mps2, yaw_rate_sigma_radps: Shape (n,).
    """

    source: str
    station: Strings
    stamp_ns: Int64Array
    log_time_ns: Int64Array
    latitude_deg: FloatArray
    longitude_deg: FloatArray
    altitude_m: FloatArray
    speed_mps: FloatArray
    heading_rad: FloatArray
    accel_mps2: FloatArray
    lateral_accel_mps2: FloatArray
    yaw_rate_radps: FloatArray
    length_m: FloatArray
    width_m: FloatArray
    position_covariance_m2: FloatArray
    speed_sigma_mps: FloatArray
    heading_sigma_rad: FloatArray
    accel_sigma_mps2: FloatArray
    yaw_rate_sigma_radps: FloatArray


@dataclass(frozen=True)
class CameraInfoSignal:
    """A camera's calibration, as the first message of its channel gives it (pinhole, image axes x right, y down).

    Attributes:
        source: Topic.
        frame_id: The camera's optical frame.
        width_px, height_px: Image size that the calibration is for.
        distortion_model: Name as in the message (`plumb_bob`, `equidistant`), "" for none.
        distortion: Shape (k,), the model's coefficients.
        intrinsic: Shape (3, 3), K, pixels.
        rectification: Shape (3, 3), R.
        projection: Shape (3, 4), P, pixels.
    """

    source: str
    frame_id: str
    width_px: int
    height_px: int
    distortion_model: str
    distortion: FloatArray
    intrinsic: FloatArray
    rectification: FloatArray
    projection: FloatArray


TimedSignal = PositionSignal | PoseSignal | VelocitySignal | SpeedSignal | HeadingSignal | ImuSignal | RemoteSignal
Signal = TimedSignal | CameraInfoSignal
