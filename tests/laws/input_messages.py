"""One message of every schema that fills a role, as a dictionary, and what it means.

Values differ from message to message, so that rows can't be mixed up.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import cos, hypot, pi, sin
from typing import Any

from cwcli.signals.columns import Ragged
from cwcli.signals.etsi import CAM_PATHS, CAM_TS_PATHS, VAM_PATHS
from cwcli.signals.j2735 import CARMA_PRESENCE_MASKS, JSON_ODE_PATHS, ROS_PATHS, STANDARD_JSON_PATHS_BY_QUANTITY
from cwcli.signals.role import Role
from tests.laws.perceived_messages import PERCEIVED_SAMPLES
from tests.laws.receiver_messages import RECEIVER_SAMPLES
from tests.unit.signals.signal_columns import T0_NS
from tests.unit.signals.v2x_messages import CAM, CARMA_BSM, ODE_BSM, RAW_BSM, ROS_BSM, packed_bsm, packed_cam, ros_paths

Message = dict[str, Any]
Sample = tuple[Message, dict[Role, dict[str, Any]]]
"""A message, and for each role what the signal's columns hold of it."""

N = 3
STEP_NS = 100_000_000
DELAY_NS = 20_000_000
FRAME = "some_frame"


def stamp_of(k: int) -> int:
    """When message k was made; it was logged 20 ms later."""
    return T0_NS + 80_000_000 + k * STEP_NS


def ros(k: int, message: Message, frame: str = FRAME) -> Message:
    """A ROS message with its header."""
    sec, nanosec = divmod(stamp_of(k), 10**9)
    return {"header": {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": frame}, **message}


def foxglove(k: int, message: Message) -> Message:
    """A foxglove message with its time and frame, as JSON and CDR have it."""
    sec, nanosec = divmod(stamp_of(k), 10**9)
    return {"timestamp": {"sec": sec, "nanosec": nanosec, "nsec": nanosec}, "frame_id": FRAME, **message}


def xyz(*values: float) -> dict[str, float]:
    return dict(zip("xyz", values, strict=True))


def turn(yaw_rad: float) -> dict[str, float]:
    return {**xyz(0.0, 0.0, sin(yaw_rad / 2.0)), "w": cos(yaw_rad / 2.0)}


def square(n: int, **entries: float) -> list[float]:
    """A covariance, row-major; `_01=2.0` is the one of row 0, column 1, and that of row 1, column 0."""
    made = [0.0] * (n * n)
    for name, value in entries.items():
        row, column = int(name[1]), int(name[2])
        made[row * n + column] = made[column * n + row] = value
    return made


def _fix(k: int) -> Sample:
    message = {"latitude": 50.1 + 1e-5 * k, "longitude": 8.2, "altitude": 120.5, "position_covariance_type": 3}
    message["position_covariance"] = square(3, _00=4.0, _01=1.0, _11=9.0, _22=16.0)  # type: ignore[assignment]
    means = {
        "latitude_deg": 50.1 + 1e-5 * k,
        "longitude_deg": 8.2,
        "altitude_m": 120.5,
        "covariance_m2": [4.0, 1.0, 9.0],
    }
    return message, {Role.EGO_POSITION: means, Role.TRUTH: means}


def _nav_sat_fix(k: int) -> Sample:
    message, means = _fix(k)
    return ros(k, {"status": {"status": 0}, **message}), means


def _location_fix(k: int) -> Sample:
    message, means = _fix(k)
    return foxglove(k, message), means


def _imu(k: int) -> Sample:
    accel, gyro, yaw = [0.1 * k, -0.2, 9.8], [0.01, 0.02, 0.3 + k], 0.5 + 0.1 * k
    message = {
        "orientation": turn(yaw),
        "orientation_covariance": square(3, _00=0.1, _11=0.1, _22=0.04),
        "angular_velocity": xyz(*gyro),
        "angular_velocity_covariance": square(3, _00=0.01, _11=0.02, _22=0.03),
        "linear_acceleration": xyz(*accel),
        "linear_acceleration_covariance": square(3, _00=0.4, _11=0.5, _22=0.6),
    }
    imu = {
        "accel_mps2": accel,
        "gyro_radps": gyro,
        "gyro_variance": [0.01, 0.02, 0.03],
        "accel_variance": [0.4, 0.5, 0.6],
    }
    return ros(k, message), {Role.IMU: imu, Role.EGO_HEADING: {"heading_rad": yaw, "variance_rad2": 0.04}}


def _twist_stamped(k: int) -> Sample:
    return ros(k, {"twist": _twist(k)}), _twist_means(k)


def _twist_with_covariance(k: int) -> Sample:
    message = {"twist": _twist(k), "covariance": square(6, _00=0.2, _01=0.05, _11=0.3, _55=0.01)}
    means = _twist_means(k)
    means[Role.EGO_VELOCITY]["covariance_m2ps2"] = [0.2, 0.05, 0.3]
    means[Role.EGO_SPEED] |= {"speed_variance_m2ps2": 0.2, "yaw_rate_variance_rad2ps2": 0.01}
    return ros(k, {"twist": message}), means


def _twist(k: int) -> Message:
    return {"linear": xyz(3.0 + k, -4.0, 0.0), "angular": xyz(0.0, 0.0, 0.2)}


def _twist_means(k: int) -> dict[Role, dict[str, Any]]:
    over_ground, in_body = {"east_mps": 3.0 + k, "north_mps": -4.0}, {"speed_mps": 3.0 + k, "yaw_rate_radps": 0.2}
    return {Role.EGO_VELOCITY: over_ground, Role.EGO_SPEED: in_body}


def _plain(k: int, message: Message, **means: Any) -> Sample:
    """Of a message without a header: its time is the log's."""
    return message, {Role.EGO_SPEED: {"speed_mps": 3.0 + k, "stamp_ns": stamp_of(k) + DELAY_NS, **means}}


def _plain_twist(k: int) -> Sample:
    return _plain(k, _twist(k), yaw_rate_radps=0.2)


def _plain_twist_with_covariance(k: int) -> Sample:
    message = {"twist": _twist(k), "covariance": square(6, _00=0.2, _55=0.01)}
    return _plain(k, message, yaw_rate_radps=0.2, speed_variance_m2ps2=0.2, yaw_rate_variance_rad2ps2=0.01)


def _float(k: int) -> Sample:
    return _plain(k, {"data": 3.0 + k})


def _quaternion(k: int) -> Sample:
    return ros(k, {"quaternion": turn(-3.0 + k)}), {Role.EGO_HEADING: {"heading_rad": -3.0 + k}}


def _pose(k: int) -> Message:
    return {"position": xyz(10.0 + k, -20.0, 1.5), "orientation": turn(1.0 + 0.1 * k)}


def _pose_means(k: int, **more: Any) -> dict[Role, dict[str, Any]]:
    means = {"x_m": 10.0 + k, "y_m": -20.0, "z_m": 1.5, "yaw_rad": 1.0 + 0.1 * k, **more}
    target = {"x_m": 10.0 + k, "y_m": -20.0}
    return {Role.EGO_POSITION: means, Role.TRUTH: means, Role.TARGET_TRUTH: target}


def _pose_stamped(k: int) -> Sample:
    return ros(k, {"pose": _pose(k)}), _pose_means(k)


def _pose_with_covariance(k: int) -> Sample:
    message = {"pose": {"pose": _pose(k), "covariance": square(6, _00=0.5, _01=0.1, _11=0.7, _55=0.01)}}
    return ros(k, message), _pose_means(k, covariance_m2=[0.5, 0.1, 0.7], yaw_variance_rad2=0.01)


def _pose_in_frame(k: int) -> Sample:
    return foxglove(k, {"pose": _pose(k)}), _pose_means(k)


def _odometry(k: int) -> Sample:
    message = {
        "child_frame_id": "base_link",
        "pose": {"pose": _pose(k), "covariance": square(6, _00=0.5, _01=0.1, _11=0.7)},
        "twist": {"twist": _twist(k), "covariance": square(6, _00=0.2, _55=0.01)},
    }
    ahead, left, yaw_rad = 3.0 + k, -4.0, 1.0 + 0.1 * k
    speed_mps = hypot(ahead, left)
    means = _pose_means(k, speed_mps=speed_mps, yaw_rate_radps=0.2, covariance_m2=[0.5, 0.1, 0.7])
    means[Role.TARGET_TRUTH] |= {
        "vx_mps": ahead * cos(yaw_rad) - left * sin(yaw_rad),
        "vy_mps": ahead * sin(yaw_rad) + left * cos(yaw_rad),
    }
    along = {"speed_variance_m2ps2": 0.2 * (ahead / speed_mps) ** 2}
    means[Role.EGO_SPEED] = {"speed_mps": speed_mps, "yaw_rate_radps": 0.2, **along}
    return ros(k, message), means


def _kinematic_state(k: int) -> Sample:
    """The heading's parts are w and z of a quaternion."""
    half_rad = 0.5 * (1.0 + 0.1 * k)
    message = {
        "state": {
            **{"x": 3.5 + k, "y": -2.25, "heading": {"real": cos(half_rad), "imag": sin(half_rad)}},
            **{"longitudinal_velocity_mps": 12.5 + k, "lateral_velocity_mps": 0.0, "heading_rate_rps": -0.125},
        }
    }
    place = {"x_m": 3.5 + k, "y_m": -2.25, "yaw_rad": 1.0 + 0.1 * k}
    return ros(k, message), {
        Role.EGO_POSITION: place,
        Role.EGO_SPEED: {"speed_mps": 12.5 + k, "yaw_rate_radps": -0.125},
    }


def _velocity_report(k: int) -> Sample:
    message = {"longitudinal_velocity": 12.5 + k, "lateral_velocity": 0.25, "heading_rate": -0.125}
    return ros(k, message), {Role.EGO_SPEED: {"speed_mps": 12.5 + k, "yaw_rate_radps": -0.125}}


def _steering_report(k: int) -> Sample:
    return (
        {"stamp": ros(k, {})["header"]["stamp"], "steering_tire_angle": 0.05 * (k + 1)},
        {Role.EGO_STEER: {"steer_rad": 0.05 * (k + 1)}},
    )


def _ackermann(k: int) -> Sample:
    return ros(k, {"drive": {"steering_angle": -0.05 * k}}), {Role.EGO_STEER: {"steer_rad": -0.05 * k}}


K = [500.0, 0.0, 319.5, 0.0, 510.0, 239.5, 0.0, 0.0, 1.0]
P = [*K[:3], 0.0, *K[3:6], 0.0, *K[6:], 0.0]
D = [-0.3, 0.1, 0.001, -0.002, 0.0]
LENS: dict[str, Any] = {
    "width_px": 640,
    "height_px": 480,
    "distortion_model": "plumb_bob",
    "distortion": D,
    "intrinsic": [K[:3], K[3:6], K[6:]],
    "projection": [P[:4], P[4:8], P[8:]],
}


def _camera_info(k: int) -> Sample:
    message = {"height": 480, "width": 640, "distortion_model": "plumb_bob", "d": D, "k": K, "r": square(3), "p": P}
    return ros(k, message), {Role.CAMERA_INFO: LENS}


def _calibration(k: int) -> Sample:
    message = {"height": 480, "width": 640, "distortion_model": "plumb_bob", "D": D, "K": K, "R": square(3), "P": P}
    return foxglove(k, message), {Role.CAMERA_INFO: LENS}


def _radar_scan(k: int) -> Sample:
    seen = [(10.0 + k, 0.1, -1.0), (20.0, -0.2, 2.0)]
    names = ("range", "azimuth", "doppler_velocity")
    returns = [{**dict(zip(names, each, strict=True)), "elevation": 0.0} for each in seen]
    return ros(k, {"returns": returns}), {Role.DETECTIONS: {"values": seen}}


def _radar_tracks(k: int) -> Sample:
    seen = [(10.0 + k, 1.0, -1.0, 0.5), (20.0, -2.0, 2.0, 0.25)]
    triangle = [0.5, 0.1, 0.0, 0.6, 0.0, 0.7]
    tracks = [
        {
            "position": xyz(x, y, 0.0),
            "velocity": xyz(vx, vy, 0.0),
            "position_covariance": triangle,
            "velocity_covariance": triangle,
        }
        for x, y, vx, vy in seen
    ]
    plane = [[0.5, 0.1, 0.0, 0.0], [0.1, 0.6, 0.0, 0.0], [0.0, 0.0, 0.5, 0.1], [0.0, 0.0, 0.1, 0.6]]
    return ros(k, {"tracks": tracks}), {Role.DETECTIONS: {"values": seen, "covariance": [plane, plane]}}


def _boxes(k: int) -> Sample:
    seen = [(10.0 + k, 1.0), (20.0, -2.0)]
    boxes = [
        {
            "bbox": {"center": {"position": xyz(x, y, 0.5)}},
            "results": [
                {"pose": {"pose": {"position": xyz(0.0, 0.0, 0.0)}, "covariance": square(6, _00=0.5, _01=0.1, _11=0.6)}}
            ],
        }
        for x, y in seen
    ]
    plane = [[0.5, 0.1], [0.1, 0.6]]
    return ros(k, {"detections": boxes}), {Role.DETECTIONS: {"values": seen, "covariance": [plane, plane]}}


def _objects(pose: str, **more: Any) -> Callable[[int], Sample]:
    def sample(k: int) -> Sample:
        seen = [(10.0 + k, 1.0), (20.0, -2.0)]
        objects = [
            {
                "existence_probability": 0.5,
                "kinematics": {
                    pose: {
                        "pose": {"position": xyz(x, y, 0.5), "orientation": turn(0.5)},
                        "covariance": square(6, _00=0.5, _01=0.1, _11=0.6),
                    },
                    **more,
                },
            }
            for x, y in seen
        ]
        plane = [[0.5, 0.1], [0.1, 0.6]]
        return ros(k, {"objects": objects}), {Role.DETECTIONS: {"values": seen, "covariance": [plane, plane]}}

    return sample


def _scene(k: int) -> Sample:
    seen = [(10.0 + k, 1.0), (20.0, -2.0)]
    timestamp = foxglove(k, {})["timestamp"]
    entities = [
        {"timestamp": timestamp, "frame_id": FRAME, "cubes": [{"pose": {"position": xyz(x, y, 0.5)}}]} for x, y in seen
    ]
    return {"entities": entities}, {Role.DETECTIONS: {"values": seen}}


def _detections(k: int) -> Sample:
    seen = [(10.0 + k, 1.0), (20.0, -2.0)]
    named = [
        {"x_m": x, "y_m": y, "covariance_xx_m2": 0.5, "covariance_xy_m2": 0.1, "covariance_yy_m2": 0.6} for x, y in seen
    ]
    plane = [[0.5, 0.1], [0.1, 0.6]]
    return foxglove(k, {"detections": named}), {Role.DETECTIONS: {"values": seen, "covariance": [plane, plane]}}


def _target(k: int) -> Sample:
    means = {"x_m": 1.0 + k, "y_m": -2.0, "vx_mps": 3.0, "vy_mps": -4.0}
    return {"stamp_ns": stamp_of(k), "id": "7", "frame_id": "map", **means}, {Role.TARGET_TRUTH: means}


def _vehicle_state(k: int) -> Sample:
    message = {
        "stamp_ns": stamp_of(k),
        "id": "7",
        **{
            "x_m": 1.0 + k,
            "y_m": -2.0,
            "speed_mps": 5.0,
            "heading_rad": 0.5,
            "accel_mps2": -1.0,
            "yaw_rate_radps": 0.25,
        },
        **{"latitude_deg": 50.0, "longitude_deg": 8.0},
    }
    pose = {"x_m": 1.0 + k, "y_m": -2.0, "yaw_rad": 0.5, "speed_mps": 5.0, "yaw_rate_radps": 0.25, "accel_mps2": -1.0}
    target = {"x_m": 1.0 + k, "y_m": -2.0, "vx_mps": 5.0 * cos(0.5), "vy_mps": 5.0 * sin(0.5)}
    return message, {Role.TRUTH: pose | {"latitude_deg": 50.0}, Role.TARGET_TRUTH: target | {"longitude_deg": 8.0}}


def _v2x(paths: Mapping[str, str], values: Mapping[str, Any], prefix: str = "", **more: Any) -> Callable[[int], Sample]:
    """A V2X message made of a table of paths: the same car in each, due west; later messages are farther on in time."""
    time_name = "generation_delta_time" if "generation_delta_time" in values else "dsecond_ms"

    def sample(k: int) -> Sample:
        message: Message = {}
        leaves = {f"{prefix}{paths[name]}": value for name, value in values.items()} | more
        leaves[f"{prefix}{paths[time_name]}"] += 100 * k
        for path, value in leaves.items():
            place = message
            *parents, leaf = path.split(".")
            for parent in parents:
                place = place.setdefault(parent, {})
            place[leaf] = value.values.tolist() if isinstance(value, Ragged) else value
        car = {
            "latitude_deg": 40.8646987,
            "longitude_deg": -77.8304602,
            "altitude_m": 335.6,
            "speed_mps": 10.0,
            "heading_rad": pi,
            "accel_mps2": -3.5,
            "lateral_accel_mps2": 1.0,
            "yaw_rate_radps": pi / 18.0,
            "length_m": 4.5,
            "width_m": 1.8,
        }
        own = {
            Role.EGO_POSITION: {name: car[name] for name in ("latitude_deg", "longitude_deg", "altitude_m")},
            Role.EGO_SPEED: {name: car[name] for name in ("speed_mps", "yaw_rate_radps")},
            Role.EGO_HEADING: {"heading_rad": pi},
        }
        return message, {Role.REMOTE: car, **own}

    return sample


VAM = {name: value for name, value in CAM.items() if name in ros_paths(VAM_PATHS)} | {"has_yaw_rate_degps": True}


def _without_size(sample_of_car: Callable[[int], Sample]) -> Callable[[int], Sample]:
    """A message that does not tell how large its sender is."""

    def sample(k: int) -> Sample:
        message, means = sample_of_car(k)
        nothing = {"length_m": float("nan"), "width_m": float("nan")}
        return message, {**means, Role.REMOTE: {**means[Role.REMOTE], **nothing}}

    return sample


def _radio(pack: Callable[[int], bytes], field: str) -> Callable[[int], Sample]:
    """A V2X message as a radio hands it over."""

    def sample(k: int) -> Sample:
        _, means = _v2x(ros_paths(CAM_PATHS), CAM)(k)
        return ros(k, {field: [*pack(k)]}), means

    return sample


def _seen(sample_at: Callable[[int, int], Sample]) -> Callable[[int], Sample]:
    """A message that tells of others."""
    return lambda k: sample_at(k, stamp_of(k))


def _trajectory(k: int) -> Sample:
    points = [
        {
            "time_from_start": {"sec": j, "nanosec": 250_000_000},
            "pose": {"position": xyz(1.0 + k, 2.0 + 3.0 * j, 0.0)},
            "longitudinal_velocity_mps": 3.0 + j,
        }
        for j in range(2 + k)
    ]
    means = {
        "time_s": [j + 0.25 for j in range(2 + k)],
        "x_m": [1.0 + k] * (2 + k),
        "y_m": [2.0 + 3.0 * j for j in range(2 + k)],
        "speed_mps": [3.0 + j for j in range(2 + k)],
    }
    return ros(k, {"points": points}), {Role.PLANNED_PATH: means}


def _nav_path(k: int) -> Sample:
    def pose(j: int) -> Message:
        sec, nanosec = divmod(stamp_of(k) + 500_000_000 * j, 10**9)
        stamp = {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": FRAME}
        return {"header": stamp, "pose": {"position": xyz(1.0 + k, 2.0 + 3.0 * j, 0.0)}}

    means = {
        "time_s": [0.5 * j for j in range(2 + k)],
        "x_m": [1.0 + k] * (2 + k),
        "y_m": [2.0 + 3.0 * j for j in range(2 + k)],
        "speed_mps": [float("nan")] * (2 + k),
    }
    return ros(k, {"poses": [pose(j) for j in range(2 + k)]}), {Role.PLANNED_PATH: means}


FLAGS: dict[str, Any] = {}
for _, _path, _bit in CARMA_PRESENCE_MASKS:
    FLAGS[_path] = FLAGS.get(_path, 0) | _bit

IN_FRAME = "value.BasicSafetyMessage."


SAMPLES: dict[str, Callable[[int], Sample]] = {
    **RECEIVER_SAMPLES,
    **{schema: _seen(sample) for schema, sample in PERCEIVED_SAMPLES.items()},
    "autoware_planning_msgs/Trajectory": _trajectory,
    "nav_msgs/Path": _nav_path,
    "sensor_msgs/NavSatFix": _nav_sat_fix,
    "foxglove.LocationFix": _location_fix,
    "sensor_msgs/Imu": _imu,
    "geometry_msgs/TwistStamped": _twist_stamped,
    "geometry_msgs/TwistWithCovarianceStamped": _twist_with_covariance,
    "geometry_msgs/QuaternionStamped": _quaternion,
    "geometry_msgs/PoseStamped": _pose_stamped,
    "nav_msgs/Odometry": _odometry,
    "geometry_msgs/PoseWithCovarianceStamped": _pose_with_covariance,
    "geometry_msgs/Twist": _plain_twist,
    "geometry_msgs/TwistWithCovariance": _plain_twist_with_covariance,
    "std_msgs/Float32": _float,
    "std_msgs/Float64": _float,
    "foxglove.PoseInFrame": _pose_in_frame,
    "autoware_vehicle_msgs/VelocityReport": _velocity_report,
    "autoware_vehicle_msgs/SteeringReport": _steering_report,
    "autoware_vehicle_msgs/VehicleKinematicState": _kinematic_state,
    "autoware_auto_msgs/VehicleKinematicState": _kinematic_state,
    "ackermann_msgs/AckermannDriveStamped": _ackermann,
    "sensor_msgs/CameraInfo": _camera_info,
    "foxglove.CameraCalibration": _calibration,
    "etsi_its_cam_msgs/CAM": _v2x(ros_paths(CAM_PATHS), CAM),
    "etsi_its_cam_ts_msgs/CAM": _v2x(ros_paths(CAM_TS_PATHS), CAM),
    "etsi_its_vam_ts_msgs/VAM": _without_size(_v2x(ros_paths(VAM_PATHS), VAM)),
    "j2735_v2x_msgs/BSM": _v2x(ROS_PATHS, ROS_BSM),
    "carma_v2x_msgs/BSM": _v2x(ROS_PATHS, CARMA_BSM, **FLAGS),
    "BasicSafetyMessage": _v2x(STANDARD_JSON_PATHS_BY_QUANTITY, RAW_BSM),
    "MessageFrame": _v2x(STANDARD_JSON_PATHS_BY_QUANTITY, RAW_BSM, IN_FRAME),
    "OdeBsmData": _v2x(JSON_ODE_PATHS, ODE_BSM, "payload.data."),
    "OdeBsmJson": _v2x(JSON_ODE_PATHS, ODE_BSM, "payload.data."),
    "OdeMessageFrameData": _v2x(STANDARD_JSON_PATHS_BY_QUANTITY, RAW_BSM, f"payload.data.{IN_FRAME}"),
    "carma_driver_msgs/ByteArray": _radio(packed_bsm, "content"),
    "cwcli_radio/J2735": _radio(packed_bsm, "payload"),
    "udp_msgs/UdpPacket": _radio(lambda k: b"\x07\xd1\x00\x00" + packed_cam(k), "data"),
    "cwcli_radio/Btp": _radio(lambda k: b"\x07\xd1\x00\x00" + packed_cam(k), "msg"),
    "cwcli_radio/Its": _radio(packed_cam, "message"),
    "radar_msgs/RadarScan": _radar_scan,
    "radar_msgs/RadarTracks": _radar_tracks,
    "vision_msgs/Detection3DArray": _boxes,
    "autoware_perception_msgs/DetectedObjects": _objects("pose_with_covariance", has_position_covariance=True),
    "autoware_perception_msgs/TrackedObjects": _objects("pose_with_covariance"),
    "autoware_perception_msgs/PredictedObjects": _objects("initial_pose_with_covariance"),
    "foxglove.SceneUpdate": _scene,
    "cwcli.Detections": _detections,
    "cwcli.v1.Target": _target,
    "cwcli.v1.VehicleState": _vehicle_state,
}
SAME = {
    "autoware_auto_planning_msgs/": "autoware_planning_msgs/",
    "foxglove_msgs/": "foxglove.",
    "autoware_auto_perception_msgs/": "autoware_perception_msgs/",
    "autoware_auto_vehicle_msgs/": "autoware_vehicle_msgs/",
}


def sample_of(schema: str, role: str = "") -> Callable[[int], Sample]:
    """The sample of a schema, which may be that of one with the same fields, or of this role alone."""
    if f"{schema} {role}" in SAMPLES:
        return SAMPLES[f"{schema} {role}"]
    for alias, name in SAME.items():
        if schema.startswith(alias):
            schema = schema.replace(alias, name)
    return SAMPLES[schema]
