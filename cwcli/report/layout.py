"""A viewer layout that shows every channel of `published.PUBLISHED`, and the log's own fixes, cameras and truth."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from cwcli.channels.binding import ChannelLike, bind
from cwcli.channels.published import (
    CONTROL_STATE,
    CONTROL_STEP,
    EGO_FIX,
    EGO_PATH,
    EGO_STATE,
    LANES,
    OBSERVER,
    OBSERVER_PATH,
    OWN_PREFIX,
    REMOTE_PATH,
    REMOTE_STATE,
    TARGETS,
    WARNING_LOG,
    WARNINGS,
    Channel,
    topics,
)
from cwcli.control.encounter import POLICIES
from cwcli.logs.read.reader import Log
from cwcli.report.layout_panels import Mosaic, Panels, Series, Settings, column, path, row, split
from cwcli.signals.inputs import input_for
from cwcli.signals.role import Role
from cwcli.signals.vehicle_state import BODY_FRAME, MAP_FRAME

FIX_SCHEMAS = frozenset(
    {"sensor_msgs/NavSatFix", "sensor_msgs/msg/NavSatFix", "foxglove.LocationFix", "foxglove.LocationFixes"}
)
"""Schemas of positions that the viewer's map panel draws (documentation of Foxglove's Map panel)."""
DRAWN_SCHEMAS = frozenset(
    {
        "foxglove.SceneUpdate",
        "foxglove.PoseInFrame",
        "foxglove.PosesInFrame",
        "foxglove.PointCloud",
        "foxglove.LaserScan",
        "sensor_msgs/msg/PointCloud2",
        "sensor_msgs/msg/LaserScan",
        "visualization_msgs/msg/MarkerArray",
    }
)
"""Schemas that the viewer's 3D panel draws and that drive logs hold (Foxglove's 3D panel)."""
MEASURED_SPEED = ("longitudinal_velocity", "twist.twist.linear.x", "twist.linear.x", "data")
"""Fields in which messages hold a measured speed; the first that a topic has is plotted."""
MEASURED_YAW_RATE = ("angular_velocity.z",)
"""Fields in which messages hold a measured yaw rate."""
MAX_CAMERAS = 4
"""The greatest number of cameras that the layout shows. Chosen by hand; not fitted."""

RAW_COLOR = "#ff8c00"
"""Colour of measured fixes on the viewer's map. Chosen by hand; not fitted."""
ESTIMATED_COLOR = "#2680ff"
"""Colour of estimated fixes on the viewer's map. Chosen by hand; not fitted."""
VIEW_HEIGHT_M = 120.0
"""Distance of the 3D panel's view from above, in m. Chosen by hand; not fitted."""
GRID_M = 1000.0
"""Size of the 3D panel's grid, in m. Chosen by hand; not fitted."""
STAGE_TABS = ("Drive", "Signals", "Warnings", "Lanes", "Targets", "Control", "Messages")
"""Titles of the layout's tabs, in order."""


@dataclass(frozen=True)
class CameraTopics:
    """The topics of a camera: its images, and its calibration or None."""

    images: str
    calibration: str | None


@dataclass(frozen=True)
class LogTopics:
    """A log's own topics that the layout shows besides cwcli's; all empty without a log.

    Attributes:
        fixes: Positions on the globe.
        cameras: Cameras, the first is in front.
        drawn: For the 3D panel.
        truth: Reference states (`cwcli.v1.VehicleState`).
        speed, yaw_rate: Message paths of what the car measured.
    """

    fixes: tuple[str, ...] = ()
    cameras: tuple[CameraTopics, ...] = ()
    drawn: tuple[str, ...] = ()
    truth: tuple[str, ...] = ()
    speed: tuple[str, ...] = ()
    yaw_rate: tuple[str, ...] = ()


def log_topics(log: Log) -> LogTopics:
    """Find the channels of a log that the layout shows; those that cwcli publishes are not repeated."""
    published = topics()
    others = [channel for channel in log.channels if channel.topic not in published]
    infos = _named(others, lambda channel: input_for(Role.CAMERA_INFO, channel.schema_name) is not None)
    images = _named(others, lambda channel: input_for(Role.CAMERA, channel.schema_name) is not None)
    own = [channel for channel in others if not channel.topic.startswith(OWN_PREFIX)]
    return LogTopics(
        fixes=_named(own, lambda channel: channel.schema_name in FIX_SCHEMAS),
        cameras=tuple(CameraTopics(topic, _calibration(topic, infos)) for topic in images[:MAX_CAMERAS]),
        drawn=_named(own, lambda channel: channel.schema_name in DRAWN_SCHEMAS),
        truth=_named(own, lambda channel: channel.schema_name == EGO_STATE.schema),
        speed=_measured(own, Role.EGO_SPEED, MEASURED_SPEED),
        yaw_rate=_measured(own, Role.IMU, MEASURED_YAW_RATE),
    )


def layout(log: LogTopics | None = None) -> Settings:
    """Build the layout as a JSON-ready document in the form that Foxglove exports.

    Args:
        log: The topics of the log that it is for; None: of any log.
    """
    builder = _Layout(log or LogTopics())
    tabs = (
        builder.drive(),
        builder.signals(),
        builder.warnings(),
        builder.lanes(),
        builder.targets(),
        builder.control(),
        builder.messages(),
    )
    return builder.panels.layout(builder.panels.tabs("cwcli", dict(zip(STAGE_TABS, tabs, strict=True))))


@dataclass
class _Layout:
    """Builds the layout; each public method builds one tab."""

    log: LogTopics
    panels: Panels = field(default_factory=Panels)

    def drive(self) -> Mosaic:
        """Build the tab of all vehicles from above, on the map and in the camera, and of the warnings."""
        below = row(
            self.panels.log("log", "Warnings", WARNING_LOG.topic),
            self.panels.states("drive", "Warnings", [_of(WARNINGS, "state")]),
        )
        beside = column(self._map(), self._image("front", self.log.cameras[:1]))
        return split("column", split("row", self._scene(), beside, 55.0), below, 75.0)

    def signals(self) -> Mosaic:
        """Build the tab of the states over time: estimated, true and measured."""
        speed = [*self._of_states("speed_mps"), *((measured, "measured") for measured in self.log.speed)]
        yaw_rate = [*self._of_states("yaw_rate_radps"), *((measured, "measured") for measured in self.log.yaw_rate)]
        return column(
            self.panels.plot("speed", "Speed [m/s]", speed),
            self.panels.plot("accel", "Acceleration [m/s^2]", self._of_states("accel_mps2")),
            self.panels.plot("heading", "Heading [rad, counter-clockwise from east]", self._of_states("heading_rad")),
            self.panels.plot("yaw-rate", "Yaw rate [rad/s]", yaw_rate),
        )

    def warnings(self) -> Mosaic:
        """Build the tab of the warnings, their numbers, and the paths that they were computed from."""
        return row(
            column(
                self.panels.states(
                    "warnings", "Events", [_of(WARNINGS, "state"), (path(WARNINGS.topic, "event_id"), "event")]
                ),
                self.panels.plot("distance", "Predicted distance [m]", [_of(WARNINGS, "predicted_distance_m")]),
                self.panels.plot("ttc", "Time [s]", _each(WARNINGS, "ttc_s", "time_to_event_s")),
                self.panels.plot("probability", "Probability", [_of(WARNINGS, "probability")]),
            ),
            column(
                self._path("ego-path", "Path of the ego [m]", EGO_PATH.topic),
                self._path("observer-path", "Path of the ego from the observer [m]", OBSERVER_PATH.topic),
                self._path("remote-path", "Latest path of another vehicle [m]", REMOTE_PATH.topic),
                self.panels.raw("warnings", WARNINGS.topic),
            ),
        )

    def lanes(self) -> Mosaic:
        """Build the tab of the camera with the boundaries, the lane's geometry and the observer."""
        n = max(len(self.log.cameras), 1)
        images = [self._image(f"lanes-{k}", self.log.cameras[k : k + 1]) for k in range(n)]
        found = ("left.probability", "right.probability")
        return row(
            column(*images),
            column(
                self.panels.plot("lane-width", "Lane [m]", _each(LANES, "lateral_deviation_m", "lane_width_m")),
                self.panels.plot(
                    "lane-heading",
                    "Heading from the lane [rad]",
                    [_of(LANES, "heading_deviation_rad"), _of(OBSERVER, "heading_deviation_rad")],
                ),
                self.panels.plot("lane-curvature", "Curvature of the lane [1/m]", _each(LANES, "curvature_1pm")),
                self.panels.plot("lane-found", "Probability of the boundaries", _each(LANES, *found)),
                self.panels.plot(
                    "observer",
                    "Observer [m/s, rad/s]",
                    _each(OBSERVER, "lateral_speed_mps", "yaw_rate_radps"),
                ),
            ),
        )

    def targets(self) -> Mosaic:
        """Build the tab of the tracked targets, which the first tab's 3D panel shows too."""
        return row(
            column(
                self.panels.plot("target-position", "Position [m]", _each(TARGETS, "x_m", "y_m"), points=True),
                self.panels.plot("target-velocity", "Velocity [m/s]", _each(TARGETS, "vx_mps", "vy_mps"), points=True),
            ),
            self.panels.raw("targets", TARGETS.topic),
        )

    def control(self) -> Mosaic:
        """Build the tab of what each control policy makes of a warning."""

        def series_of_policies(kind: Channel, *names: str) -> list[Series]:
            return [
                (path(kind.of(policy).topic, name), f"{policy} {name}" if names[1:] else policy)
                for policy in POLICIES
                for name in names
            ]

        return column(
            self.panels.plot("control-speed", "Speed [m/s]", series_of_policies(CONTROL_STATE, "speed_mps")),
            self.panels.plot("control-gap", "Gap between the outlines [m]", series_of_policies(CONTROL_STEP, "gap_m")),
            self.panels.plot(
                "control-pedals", "Pedals", series_of_policies(CONTROL_STEP, "throttle", "brake_pressure_mpa")
            ),
        )

    def messages(self) -> Mosaic:
        """Build the tab of raw messages: the ego's states and the channels that no other panel shows."""
        shown = json.dumps(self.panels.settings)
        others = [topic for topic in topics() if not re.search(rf'"{re.escape(topic)}[".]', shown)]
        return row(
            self.panels.add("SourceInfo", "source", "Channels"),
            column(
                self.panels.raw("ego", EGO_STATE.topic),
                *(self.panels.raw(topic.removeprefix(OWN_PREFIX), topic) for topic in others),
            ),
        )

    def _scene(self) -> str:
        """Add the 3D panel."""
        shown = [topic for topic, schema in topics().items() if schema in DRAWN_SCHEMAS]
        return self.panels.add(
            "3D",
            "scene",
            "From above",
            followTf=BODY_FRAME,
            followMode="follow-position",
            fixedFrame=MAP_FRAME,
            cameraState={"perspective": False, "distance": VIEW_HEIGHT_M, "phi": 0, "thetaOffset": 0},
            scene={"transforms": {"enablePreloading": True}},
            transforms={f"frame:{BODY_FRAME}": {"visible": True}},
            topics={topic: {"visible": True} for topic in (*shown, *self.log.drawn)},
            layers={"grid": {"layerId": "foxglove.Grid", "visible": True, "frameId": MAP_FRAME, "size": GRID_M}},
        )

    def _map(self) -> str:
        """Add the map panel."""
        colors = {EGO_FIX.topic: ESTIMATED_COLOR, **dict.fromkeys(self.log.fixes, RAW_COLOR)}
        return self.panels.add(
            "map",
            "map",
            "Fixes: measured and estimated",
            topicColors=colors,
            followTopic=EGO_FIX.topic,
            disabledTopics=[],
            layer="map",
            zoomLevel=17,
        )

    def _image(self, name: str, cameras: Sequence[CameraTopics]) -> str:
        """Add an image panel."""
        annotations = {topic: {"visible": True} for topic, schema in topics().items() if schema.endswith("Annotations")}
        mode: Settings = {"annotations": annotations}
        title = "Camera with lanes"
        for camera in cameras:
            title = camera.images
            mode["imageTopic"] = camera.images
            if camera.calibration is not None:
                mode["calibrationTopic"] = camera.calibration
        return self.panels.add("Image", name, title, imageMode=mode)

    def _path(self, name: str, title: str, topic: str) -> str:
        """Add the plot of a path's y over its x."""
        return self.panels.map_plot(name, title, path(topic, "x_m[:]"), (path(topic, "y_m[:]"), "path"))

    def _of_states(self, name: str) -> list[Series]:
        """Return the series of a state's field: of the ego, the others and the truth."""
        sources = [(EGO_STATE.topic, "ego"), (REMOTE_STATE.topic, "others")]
        sources += [(topic, topic) for topic in self.log.truth]
        return [(path(topic, name), label) for topic, label in sources]


def _of(channel: Channel, name: str) -> Series:
    """Return the series of a channel's field."""
    return path(channel.topic, name), name


def _each(channel: Channel, *names: str) -> list[Series]:
    """Return the series of several fields of a channel."""
    return [_of(channel, name) for name in names]


def _named(channels: Sequence[ChannelLike], is_one: Callable[[ChannelLike], bool]) -> tuple[str, ...]:
    """Return the topics of the channels that a condition accepts."""
    return tuple(dict.fromkeys(channel.topic for channel in channels if is_one(channel)))


def _calibration(topic: str, infos: Sequence[str]) -> str | None:
    """Return the calibration topic in the camera's namespace, else the only one, else None."""
    beside = [info for info in infos if info.rpartition("/")[0] == topic.rpartition("/")[0]]
    return beside[0] if beside else infos[0] if len(infos) == 1 else None


def _measured(channels: Sequence[ChannelLike], role: Role, names: Sequence[str]) -> tuple[str, ...]:
    """Return the message path of the first measured value of a role, or ()."""
    bound = bind(channels, {}, required=(), optional=(role,)).of(role)
    return tuple(path(one.topic, name) for one in bound for name in names if name in one.fields)[:1]
