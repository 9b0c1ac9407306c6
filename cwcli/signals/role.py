"""The roles that input channels can have."""

from __future__ import annotations

from enum import StrEnum


class Role(StrEnum):
    """The role of an input channel: its name in `--topic NAME=/topic`, and its texts for the user.

    The roles of the channels that cwcli itself publishes stand with them (`cwcli.channels.published`).

    Attributes:
        words: The contents of such a channel, in messages to the user.
        signals: The classes of signals that can fill it: `module:Class` of this package. A twist's `frame_id` decides
            between speed and velocity. None: a stage reads the channel itself.
        hint: The hint on what can fill it, for a user without such a channel; or "".
    """

    words: str
    signals: tuple[str, ...]
    hint: str

    def __new__(cls, name: str, words: str, signals: tuple[str, ...] = (), hint: str = "") -> Role:
        """Make a role from its line."""
        role = str.__new__(cls, name)
        role._value_ = name
        role.words, role.signals, role.hint = words, signals, hint
        return role

    EGO_POSITION = (
        "ego_position",
        "the ego position",
        ("canonical:PositionSignal", "canonical:PoseSignal"),
        "a position is a NavSatFix, a LocationFix, an Odometry, or the ego's own V2X messages (--ego-station ID)",
    )
    EGO_VELOCITY = (
        "ego_velocity",
        "the ego velocity over ground",
        ("canonical:VelocitySignal", "canonical:SpeedSignal"),
    )
    EGO_SPEED = (
        "ego_speed",
        "the ego speed",
        ("canonical:SpeedSignal", "canonical:VelocitySignal"),
        "a speed is a TwistStamped, a VelocityReport or the twist of an Odometry",
    )
    EGO_HEADING = "ego_heading", "the ego heading", ("canonical:HeadingSignal",)
    IMU = "imu", "the inertial measurements", ("canonical:ImuSignal",)
    EGO_STEER = "ego_steer", "the ego steering angle", ("canonical:SteerSignal",)
    REMOTE = (
        "remote",
        "the remote vehicles",
        ("canonical:RemoteSignal",),
        "remote vehicles are read from BSM and CAM messages",
    )
    CAMERA = "camera", "the camera"
    CAMERA_INFO = "camera_info", "the camera's calibration", ("canonical:CameraInfoSignal",)
    TRUTH = "truth", "the truth", ("canonical:PositionSignal", "canonical:PoseSignal")
    DETECTIONS = (
        "detections",
        "detections of other road users",
        ("canonical:DetectionSignal",),
        "detections are a RadarScan, RadarTracks, a Detection3DArray, a SceneUpdate with cubes, or JSON "
        "(docs/detections.md)",
    )
    TARGET_TRUTH = "target_truth", "the targets' truth", ("canonical:TargetTruthSignal",)
    PLANNED_PATH = (
        "planned_path",
        "another system's path of the ego",
        ("builders.path:PathSignal",),
        "such a path is a Trajectory of Autoware or a nav_msgs/Path; `cwcli evaluate --topic ego_path=` judges it",
    )
    LATERAL_TRUTH = "lateral_truth", "the truth of the lateral motion"
