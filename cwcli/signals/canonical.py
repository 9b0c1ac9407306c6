"""Canonical signals: what the numbers of a log mean, in SI units, radians, int64 ns and named frames.

Frames: `map` is local east-north-up; `body` is x forward, y left, z up (REP-103). Heading is
counter-clockwise from east.
A value that the message does not carry is NaN. Variances that the message does not carry are NaN.
Rows are sorted by `stamp_ns` and finite in their key fields once `signals.clocks` and the builders have run.
Here stand the signals that several builders or stages share; that of one builder may stand beside it.
"""

from __future__ import annotations

from typing import Literal, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray, Int64Array, Strings
from cwcli.signals.direction_of_travel import YawMounting
from cwcli.signals.road_events import RoadEvents

MESSAGE_COUNT_MODULUS = 128
"""The number of values of a sender's count of its messages (SAE J2735, DE_MsgCount)."""


class Signal(Protocol):
    """The protocol of every signal: it comes from messages of one topic."""

    @property
    def source(self) -> str: ...


@runtime_checkable
class TimedSignal(Signal, Protocol):
    """A signal with a time in each row, shape (n,)."""

    @property
    def stamp_ns(self) -> Int64Array: ...
    @property
    def log_time_ns(self) -> Int64Array: ...


@dataclass(frozen=True)
class TimedRows:
    """The rows of messages of one topic.

    Attributes:
        source: Topic.
        stamp_ns, log_time_ns: One value a row: when it was measured, and logged.
    """

    source: str
    stamp_ns: Int64Array
    log_time_ns: Int64Array


@dataclass(frozen=True)
class PositionSignal(TimedRows):
    """GNSS fixes, WGS84.

    Attributes:
        latitude_deg, longitude_deg, altitude_m: Shape (n,).
        covariance_m2: Shape (n, 3): east-east, east-north, north-north.
    """

    latitude_deg: FloatArray
    longitude_deg: FloatArray
    altitude_m: FloatArray
    covariance_m2: FloatArray


@dataclass(frozen=True)
class PoseSignal(TimedRows):
    """Poses in a Cartesian frame of their own (a truth channel, an odometry).

    Attributes:
        frame_id: The frame that the message names.
        x_m, y_m, z_m, yaw_rad: Shape (n,); yaw_rad, of the device's x axis, is NaN where no orientation is given.
        speed_mps, yaw_rate_radps: Shape (n,), horizontal, negative in reverse, and about the vertical; NaN where not
            given.
        covariance_m2: Shape (n, 3): xx, xy, yy.
        latitude_deg, longitude_deg: Shape (n,): the same points, WGS84, where the message has them too; else None.
        accel_mps2: Shape (n,), longitudinal, where the message has it; else None.
        yaw_variance_rad2: Shape (n,), NaN where not given; None where no message of the schema has it.
        is_exact: Made by a simulator: without outliers, and everything in it of the same moment.
        size_m: Length and width of the vehicle, None where not given.
        velocity_mps: Shape (n, 2): horizontal, in the axes of the frame; NaN where not known, None where no message of
            the schema has it.
        heading_rad: Shape (n,): direction of travel, see `direction_of_travel`; None: `yaw_rad` is it.
        mounting: How the device is turned against the direction of travel, None where that is not known.
    """

    frame_id: str
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
    yaw_variance_rad2: FloatArray | None = None
    is_exact: bool = False
    size_m: tuple[float | None, float | None] = (None, None)
    velocity_mps: FloatArray | None = None
    heading_rad: FloatArray | None = None
    mounting: YawMounting | None = None

    @property
    def travel_rad(self) -> FloatArray:
        """Direction of travel, shape (n,): the front of a car that reverses; NaN where not known."""
        return self.yaw_rad if self.heading_rad is None else self.heading_rad


@dataclass(frozen=True)
class VelocitySignal(TimedRows):
    """Velocity over ground in the map frame.

    Attributes:
        east_mps, north_mps: Shape (n,).
        covariance_m2ps2: Shape (n, 3): east-east, east-north, north-north.
    """

    east_mps: FloatArray
    north_mps: FloatArray
    covariance_m2ps2: FloatArray


@dataclass(frozen=True)
class SpeedSignal(TimedRows):
    """Longitudinal speed in the body frame (wheel speed, odometer), with the yaw rate where it is given.

    Attributes:
        speed_mps: Shape (n,), negative in reverse.
        yaw_rate_radps: Shape (n,), counter-clockwise positive.
        speed_variance_m2ps2, yaw_rate_variance_rad2ps2: Shape (n,).
        is_exact: Made by a simulator: without outliers, and everything in it of the same moment.
    """

    speed_mps: FloatArray
    yaw_rate_radps: FloatArray
    speed_variance_m2ps2: FloatArray
    yaw_rate_variance_rad2ps2: FloatArray
    is_exact: bool = False


@dataclass(frozen=True)
class HeadingSignal(TimedRows):
    """Heading in the map frame (dual-antenna GNSS, an AHRS).

    Attributes:
        heading_rad: Shape (n,), counter-clockwise from east.
        variance_rad2: Shape (n,).
    """

    heading_rad: FloatArray
    variance_rad2: FloatArray


@dataclass(frozen=True)
class ImuSignal(TimedRows):
    """Inertial measurements in the body frame as mounted (not levelled).

    Attributes:
        accel_mps2, gyro_radps: Shape (n, 3): forward, left, up. At rest accel reads about +9.8 on up.
        accel_variance, gyro_variance: Shape (n, 3).
    """

    accel_mps2: FloatArray
    gyro_radps: FloatArray
    accel_variance: FloatArray
    gyro_variance: FloatArray


@dataclass(frozen=True)
class SteerSignal(TimedRows):
    """Steering angle of the front wheels.

    Attributes:
        steer_rad: Shape (n,), left positive.
    """

    steer_rad: FloatArray


@dataclass(frozen=True)
class RemoteQuantities:
    """The quantities that V2X messages (BSM, CAM) report about their senders, n rows.

    Attributes:
        latitude_deg, longitude_deg, altitude_m: Shape (n,).
        speed_mps: Shape (n,), negative in reverse.
        heading_rad: Shape (n,), counter-clockwise from east.
        accel_mps2: Shape (n,), longitudinal.
        lateral_accel_mps2: Shape (n,), positive to the left.
        yaw_rate_radps: Shape (n,), counter-clockwise positive.
        length_m, width_m: Shape (n,).
        position_covariance_m2: Shape (n, 3): east-east, east-north, north-north.
        speed_sigma_mps, heading_sigma_rad, accel_sigma_mps2, yaw_rate_sigma_radps: Shape (n,).
        message_count: Shape (n,), the sender's count of its messages modulo `MESSAGE_COUNT_MODULUS`.
    """

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
    message_count: FloatArray


@dataclass(frozen=True)
class RemoteSignal(RemoteQuantities):
    """The reports of other vehicles over V2X, one row a message.

    Attributes:
        source: Topic.
        station: Station id as text, dictionary-coded.
        stamp_ns: Shape (n,): the generation time, made absolute (secMark, generationDeltaTime).
        log_time_ns: Shape (n,): the reception time.
        frame_id: The frame of `x_m` and `y_m`, "" where positions are WGS84.
        x_m, y_m: Shape (n,): Cartesian positions; then latitudes and longitudes are NaN. Else None.
        is_exact: Made by a simulator: without outliers, and everything in it of the same moment.
        is_perceived: Shape (n,): the row is of an object that a station perceived, not of a sender; None: none is.
        events: The events that stations notified; None where there are none.
    """

    source: str
    station: Strings
    stamp_ns: Int64Array
    log_time_ns: Int64Array
    frame_id: str = ""
    x_m: FloatArray | None = None
    y_m: FloatArray | None = None
    is_exact: bool = False
    is_perceived: npt.NDArray[np.bool_] | None = None
    events: RoadEvents | None = None


DetectionKind = Literal["position", "radar", "radar_track"]


@dataclass(frozen=True)
class DetectionSignal(TimedRows):
    """The detections of other road users by one sensor, scan by scan, in the sensor's own axes.

    Unlike the other signals it is checked message by message only: what is wrong with a single detection (not a number,
    a negative range, an impossible rate) is found and counted where detections are used.

    Attributes:
        kind: The contents of a row of `values`. `position`: x, y in m. `radar`: range in m, azimuth in rad
            (counter-clockwise from the sensor's x axis), range rate in m/s (positive: moving away). `radar_track`: x, y
            in m, and velocity relative to the sensor, m/s. What is not measured is NaN.
        frame: The frame that each scan names, s rows, empty scans included.
        offsets: Shape (s + 1,): scan k has the rows `offsets[k]:offsets[k + 1]`.
        values: Shape (n, 2), (n, 3) or (n, 4), by kind.
        covariance: Shape (n, k, k), in the units of `values`; NaN where not given.
    """

    kind: DetectionKind
    frame: Strings
    offsets: Int64Array
    values: FloatArray
    covariance: FloatArray


@dataclass(frozen=True)
class TargetTruthSignal(TimedRows):
    """The true positions of other road users: one row per target and time, by stamp.

    Attributes:
        frame_id: The frame that the messages name, "" when they name none.
        id: Target id, n rows.
        x_m, y_m: Shape (n,), in `frame_id`.
        vx_mps, vy_mps: Shape (n,), over ground, in the axes of `frame_id`; NaN where not given.
        latitude_deg, longitude_deg: Shape (n,), where the messages have them too; else None.
    """

    frame_id: str
    id: Strings
    x_m: FloatArray
    y_m: FloatArray
    vx_mps: FloatArray
    vy_mps: FloatArray
    latitude_deg: FloatArray | None = None
    longitude_deg: FloatArray | None = None


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
