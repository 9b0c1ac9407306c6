"""A viewer layout that shows every channel of `published.PUBLISHED`, and the log's own fixes, cameras and truth."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from dataclasses import field

from cwcli.channels.binding import ChannelLike, bind_roles
from cwcli.channels.published import (
    CONTROL_STATE,
    CONTROL_STEP,
    EGO_FIX,
    EGO_PATH,
    EGO_STATE,
    LANES,
    OBSERVER,
    OBSERVER_PATH,
    OWN_TOPIC_PREFIX,
    REMOTE_PATH,
    REMOTE_STATE,
    TARGETS,
    WARNING_LOG,
    WARNINGS,
    Channel,
    schema_name_by_published_topic,
)
from cwcli.control.encounter import BRAKING_POLICY_NAMES
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log
from cwcli.report.viewer_panels import (
    MessagePathAndLabel,
    Mosaic,
    PanelCollection,
    Settings,
    message_path,
    place_in_column,
    place_in_row,
    split_in_two,
)
from cwcli.signals.inputs import find_input_for_role
from cwcli.signals.role import Role
from cwcli.signals.vehicle_state import BODY_FRAME, MAP_FRAME

MAP_PANEL_SCHEMAS = frozenset(
    {"sensor_msgs/NavSatFix", "sensor_msgs/msg/NavSatFix", "foxglove.LocationFix", "foxglove.LocationFixes"}
)
"""Schemas of positions that the viewer's map panel draws (documentation of Foxglove's Map panel)."""
SCENE_PANEL_SCHEMAS = frozenset(
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
MEASURED_SPEED_FIELDS = ("longitudinal_velocity", "twist.twist.linear.x", "twist.linear.x", "data")
"""Fields in which messages hold a measured speed; the first that a topic has is plotted."""
MEASURED_YAW_RATE_FIELDS = ("angular_velocity.z",)
"""Fields in which messages hold a measured yaw rate."""
MAX_CAMERAS = 4
"""The greatest number of cameras that the layout shows. Chosen by hand; not fitted."""

MEASURED_FIX_COLOUR = "#ff8c00"
"""Colour of measured fixes on the viewer's map. Chosen by hand; not fitted."""
ESTIMATED_FIX_COLOUR = "#2680ff"
"""Colour of estimated fixes on the viewer's map. Chosen by hand; not fitted."""
SCENE_VIEW_DISTANCE_M = 120.0
"""Distance of the 3D panel's view from above, in m. Chosen by hand; not fitted."""
SCENE_GRID_SIZE_M = 1000.0
"""Size of the 3D panel's grid, in m. Chosen by hand; not fitted."""
TAB_TITLES = ("Drive", "Signals", "Warnings", "Lanes", "Targets", "Control", "Messages")
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
        scene_topics: For the 3D panel.
        truth: Reference states (`cwcli.v1.VehicleState`).
        speed, yaw_rate: Message paths of what the car measured.
    """

    fixes: tuple[str, ...] = ()
    cameras: tuple[CameraTopics, ...] = ()
    scene_topics: tuple[str, ...] = ()
    truth: tuple[str, ...] = ()
    speed: tuple[str, ...] = ()
    yaw_rate: tuple[str, ...] = ()


def find_log_topics(log: Log) -> LogTopics:
    """Find the channels of a log that the layout shows; those that cwcli publishes are not repeated."""
    published = schema_name_by_published_topic()
    others = [channel for channel in log.channels if channel.topic not in published]
    infos = _topics_matching(
        others, lambda channel: find_input_for_role(Role.CAMERA_INFO, channel.schema_name) is not None
    )
    images = _topics_matching(others, lambda channel: find_input_for_role(Role.CAMERA, channel.schema_name) is not None)
    own = [channel for channel in others if not channel.topic.startswith(OWN_TOPIC_PREFIX)]
    return LogTopics(
        fixes=_topics_matching(own, lambda channel: channel.schema_name in MAP_PANEL_SCHEMAS),
        cameras=tuple(
            CameraTopics(topic, _calibration_topic_of_camera(topic, infos)) for topic in images[:MAX_CAMERAS]
        ),
        scene_topics=_topics_matching(own, lambda channel: channel.schema_name in SCENE_PANEL_SCHEMAS),
        truth=_topics_matching(own, lambda channel: channel.schema_name == EGO_STATE.schema),
        speed=_measured_message_paths(own, Role.EGO_SPEED, MEASURED_SPEED_FIELDS),
        yaw_rate=_measured_message_paths(own, Role.IMU, MEASURED_YAW_RATE_FIELDS),
    )


def build_viewer_layout(log: LogTopics | None = None) -> Settings:
    """Build the layout as a JSON-ready document in the form that Foxglove exports.

    Args:
        log: The topics of the log that it is for; None: of any log.
    """
    builder = _LayoutBuilder(log or LogTopics())
    tabs = (
        builder.build_drive_tab(),
        builder.build_signals_tab(),
        builder.build_warnings_tab(),
        builder.build_lanes_tab(),
        builder.build_targets_tab(),
        builder.build_control_tab(),
        builder.build_messages_tab(),
    )
    return builder.panels.layout_document(builder.panels.add_tabs("cwcli", dict(zip(TAB_TITLES, tabs, strict=True))))


@dataclass
class _LayoutBuilder:
    """Builds the layout; each public method builds one tab."""

    log: LogTopics
    panels: PanelCollection = field(default_factory=PanelCollection)

    def build_drive_tab(self) -> Mosaic:
        """Build the tab of all vehicles from above, on the map and in the camera, and of the warnings."""
        below = place_in_row(
            self.panels.add_log_line_panel("log", "Warnings", WARNING_LOG.topic),
            self.panels.add_state_transitions("drive", "Warnings", [_series_of_field(WARNINGS, "state")]),
        )
        map_and_camera = place_in_column(self._add_map_panel(), self._add_image_panel("front", self.log.cameras[:1]))
        return split_in_two("column", split_in_two("row", self._add_scene_panel(), map_and_camera, 55.0), below, 75.0)

    def build_signals_tab(self) -> Mosaic:
        """Build the tab of the states over time: estimated, true and measured."""
        speed = [*self._series_of_state_field("speed_mps"), *((measured, "measured") for measured in self.log.speed)]
        yaw_rate = [
            *self._series_of_state_field("yaw_rate_radps"),
            *((measured, "measured") for measured in self.log.yaw_rate),
        ]
        return place_in_column(
            self.panels.add_plot("speed", "Speed [m/s]", speed),
            self.panels.add_plot("accel", "Acceleration [m/s^2]", self._series_of_state_field("accel_mps2")),
            self.panels.add_plot(
                "heading", "Heading [rad, counter-clockwise from east]", self._series_of_state_field("heading_rad")
            ),
            self.panels.add_plot("yaw-rate", "Yaw rate [rad/s]", yaw_rate),
        )

    def build_warnings_tab(self) -> Mosaic:
        """Build the tab of the warnings, their numbers, and the paths that they were computed from."""
        return place_in_row(
            place_in_column(
                self.panels.add_state_transitions(
                    "warnings",
                    "Events",
                    [_series_of_field(WARNINGS, "state"), (message_path(WARNINGS.topic, "event_id"), "event")],
                ),
                self.panels.add_plot(
                    "distance", "Predicted distance [m]", [_series_of_field(WARNINGS, "predicted_distance_m")]
                ),
                self.panels.add_plot("ttc", "Time [s]", _series_of_fields(WARNINGS, "ttc_s", "time_to_event_s")),
                self.panels.add_plot("probability", "Probability", [_series_of_field(WARNINGS, "probability")]),
            ),
            place_in_column(
                self._add_path_panel("ego-path", "Path of the ego [m]", EGO_PATH.topic),
                self._add_path_panel("observer-path", "Path of the ego from the observer [m]", OBSERVER_PATH.topic),
                self._add_path_panel("remote-path", "Latest path of another vehicle [m]", REMOTE_PATH.topic),
                self.panels.add_raw_messages("warnings", WARNINGS.topic),
            ),
        )

    def build_lanes_tab(self) -> Mosaic:
        """Build the tab of the camera with the boundaries, the lane's geometry and the observer."""
        n = max(len(self.log.cameras), 1)
        images = [self._add_image_panel(f"lanes-{k}", self.log.cameras[k : k + 1]) for k in range(n)]
        found = ("left.probability", "right.probability")
        return place_in_row(
            place_in_column(*images),
            place_in_column(
                self.panels.add_plot(
                    "lane-width", "Lane [m]", _series_of_fields(LANES, "lateral_deviation_m", "lane_width_m")
                ),
                self.panels.add_plot(
                    "lane-heading",
                    "Heading from the lane [rad]",
                    [
                        _series_of_field(LANES, "heading_deviation_rad"),
                        _series_of_field(OBSERVER, "heading_deviation_rad"),
                    ],
                ),
                self.panels.add_plot(
                    "lane-curvature", "Curvature of the lane [1/m]", _series_of_fields(LANES, "curvature_1pm")
                ),
                self.panels.add_plot("lane-found", "Probability of the boundaries", _series_of_fields(LANES, *found)),
                self.panels.add_plot(
                    "observer",
                    "Observer [m/s, rad/s]",
                    _series_of_fields(OBSERVER, "lateral_speed_mps", "yaw_rate_radps"),
                ),
            ),
        )

    def build_targets_tab(self) -> Mosaic:
        """Build the tab of the tracked targets, which the first tab's 3D panel shows too."""
        return place_in_row(
            place_in_column(
                self.panels.add_plot(
                    "target-position", "Position [m]", _series_of_fields(TARGETS, "x_m", "y_m"), points=True
                ),
                self.panels.add_plot(
                    "target-velocity", "Velocity [m/s]", _series_of_fields(TARGETS, "vx_mps", "vy_mps"), points=True
                ),
            ),
            self.panels.add_raw_messages("targets", TARGETS.topic),
        )

    def build_control_tab(self) -> Mosaic:
        """Build the tab of what each control policy makes of a warning."""

        def series_of_policies(kind: Channel, *names: str) -> list[MessagePathAndLabel]:
            return [
                (
                    message_path(kind.with_policy_in_topic(policy).topic, name),
                    f"{policy} {name}" if names[1:] else policy,
                )
                for policy in BRAKING_POLICY_NAMES
                for name in names
            ]

        return place_in_column(
            self.panels.add_plot("control-speed", "Speed [m/s]", series_of_policies(CONTROL_STATE, "speed_mps")),
            self.panels.add_plot(
                "control-gap", "Gap between the outlines [m]", series_of_policies(CONTROL_STEP, "gap_m")
            ),
            self.panels.add_plot(
                "control-pedals", "Pedals", series_of_policies(CONTROL_STEP, "throttle", "brake_pressure_mpa")
            ),
        )

    def build_messages_tab(self) -> Mosaic:
        """Build the tab of raw messages: the ego's states and the channels that no other panel shows."""
        shown = json.dumps(self.panels.settings_by_panel)
        others = [
            topic for topic in schema_name_by_published_topic() if not re.search(rf'"{re.escape(topic)}[".]', shown)
        ]
        return place_in_row(
            self.panels.add_panel("SourceInfo", "source", "Channels"),
            place_in_column(
                self.panels.add_raw_messages("ego", EGO_STATE.topic),
                *(self.panels.add_raw_messages(topic.removeprefix(OWN_TOPIC_PREFIX), topic) for topic in others),
            ),
        )

    def _add_scene_panel(self) -> str:
        """Add the 3D panel."""
        shown = [topic for topic, schema in schema_name_by_published_topic().items() if schema in SCENE_PANEL_SCHEMAS]
        return self.panels.add_panel(
            "3D",
            "scene",
            "From above",
            followTf=BODY_FRAME,
            followMode="follow-position",
            fixedFrame=MAP_FRAME,
            cameraState={"perspective": False, "distance": SCENE_VIEW_DISTANCE_M, "phi": 0, "thetaOffset": 0},
            scene={"transforms": {"enablePreloading": True}},
            transforms={f"frame:{BODY_FRAME}": {"visible": True}},
            topics={topic: {"visible": True} for topic in (*shown, *self.log.scene_topics)},
            layers={
                "grid": {"layerId": "foxglove.Grid", "visible": True, "frameId": MAP_FRAME, "size": SCENE_GRID_SIZE_M}
            },
        )

    def _add_map_panel(self) -> str:
        colors = {EGO_FIX.topic: ESTIMATED_FIX_COLOUR, **dict.fromkeys(self.log.fixes, MEASURED_FIX_COLOUR)}
        return self.panels.add_panel(
            "map",
            "map",
            "Fixes: measured and estimated",
            topicColors=colors,
            followTopic=EGO_FIX.topic,
            disabledTopics=[],
            layer="map",
            zoomLevel=17,
        )

    def _add_image_panel(self, name: str, cameras: Sequence[CameraTopics]) -> str:
        annotations = {
            topic: {"visible": True}
            for topic, schema in schema_name_by_published_topic().items()
            if schema.endswith("Annotations")
        }
        mode: Settings = {"annotations": annotations}
        title = "Camera with lanes"
        for camera in cameras:
            title = camera.images
            mode["imageTopic"] = camera.images
            if camera.calibration is not None:
                mode["calibrationTopic"] = camera.calibration
        return self.panels.add_panel("Image", name, title, imageMode=mode)

    def _add_path_panel(self, name: str, title: str, topic: str) -> str:
        """Add the plot of a path's y over its x."""
        return self.panels.add_array_plot(
            name, title, message_path(topic, "x_m[:]"), (message_path(topic, "y_m[:]"), "path")
        )

    def _series_of_state_field(self, name: str) -> list[MessagePathAndLabel]:
        """Return the series of a state's field: of the ego, the others and the truth."""
        sources = [(EGO_STATE.topic, "ego"), (REMOTE_STATE.topic, "others")]
        sources += [(topic, topic) for topic in self.log.truth]
        return [(message_path(topic, name), label) for topic, label in sources]


def _series_of_field(channel: Channel, name: str) -> MessagePathAndLabel:
    """Return the series of a channel's field."""
    return message_path(channel.topic, name), name


def _series_of_fields(channel: Channel, *names: str) -> list[MessagePathAndLabel]:
    """Return the series of several fields of a channel."""
    return [_series_of_field(channel, name) for name in names]


def _topics_matching(channels: Sequence[ChannelLike], is_one: Callable[[ChannelLike], bool]) -> tuple[str, ...]:
    """Return the topics of the channels that a condition accepts."""
    return tuple(dict.fromkeys(channel.topic for channel in channels if is_one(channel)))


def _calibration_topic_of_camera(topic: str, infos: Sequence[str]) -> str | None:
    """Return the calibration topic in the camera's namespace, else the only one, else None."""
    topics_beside = [info for info in infos if info.rpartition("/")[0] == topic.rpartition("/")[0]]
    return topics_beside[0] if topics_beside else infos[0] if len(infos) == 1 else None


def _measured_message_paths(channels: Sequence[ChannelLike], role: Role, names: Sequence[str]) -> tuple[str, ...]:
    """Return the message path of the first measured value of a role, or ()."""
    bound = bind_roles(channels, {}, required=(), optional=(role,)).channels_of_role(role)
    return tuple(message_path(one.topic, name) for one in bound for name in names if name in one.fields)[:1]
