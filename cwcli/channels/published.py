"""Every channel that cwcli publishes, one line each: topic, schema, the stage that writes it, what it is, its role.

The module of each message in this package writes and reads its channel. Everything else that needs a topic (binding,
channel reference, viewer layout, report) imports it from here. Importing this module does not import numpy.
"""

from __future__ import annotations

from typing import NamedTuple

POLICY_PLACEHOLDER = "<policy>"
"""Placeholder for the name of a policy in a topic."""


class Channel(NamedTuple):
    """A published channel.

    Attributes:
        topic: Its name; `<policy>` stands for each of `cwcli.control.encounter.BRAKING_POLICY_NAMES`.
        schema: Full name of the protobuf message.
        stage: The command that writes it.
        what: What it holds, in a few words.
        role: Name under which later stages find it, "" for what only viewers read.
        source: Role of the input from which it is computed.
    """

    topic: str
    schema: str
    stage: str
    what: str
    role: str = ""
    source: str = ""

    def with_policy_in_topic(self, policy: str) -> Channel:
        """The channel of one policy, with the policy's name in its topic."""
        return self._replace(topic=self.topic.replace(POLICY_PLACEHOLDER, policy))


OWN_TOPIC_PREFIX = "/cwcli/"
"""Beginning of the topics of all channels that cwcli publishes."""
_STATE_SCHEMA, _PATH_SCHEMA = "cwcli.v1.VehicleState", "cwcli.v1.PredictedPath"
"""Schemas of vehicle states and predicted paths."""
_SCENE_SCHEMA, _POSE_SCHEMA, _ANNOTATIONS_SCHEMA = (
    "foxglove.SceneUpdate",
    "foxglove.PoseInFrame",
    "foxglove.ImageAnnotations",
)
"""Schemas of drawings for viewers."""
_LANE_PATH_STAGE = "predict-lane"
"""Stage that predicts the ego's path from the lateral observer."""

EGO_STATE = Channel("/cwcli/ego/state", _STATE_SCHEMA, "estimate", "the ego state", "ego_state", "ego_position")
REMOTE_STATE = Channel(
    "/cwcli/remote/state", _STATE_SCHEMA, "estimate", "the remote vehicles' states", "remote_state", "remote"
)
EGO_ONLINE = Channel(
    "/cwcli/ego/online",
    _STATE_SCHEMA,
    "estimate",
    "the ego state as it could have been known",
    "ego_online",
    "ego_position",
)
REMOTE_ONLINE = Channel(
    "/cwcli/remote/online",
    _STATE_SCHEMA,
    "estimate",
    "the remote vehicles' states as they could have been known",
    "remote_online",
    "remote",
)
REMOTE_EVENTS = Channel(
    "/cwcli/remote/events",
    "cwcli.v1.RoadEvent",
    "estimate",
    "what remote vehicles notify: hard braking, the events of DENMs",
    "remote_events",
    "remote",
)
EGO_FIX = Channel("/cwcli/ego/fix", "foxglove.LocationFix", "estimate", "the ego on the globe")
EGO_POSE = Channel("/cwcli/ego/pose", _POSE_SCHEMA, "estimate", "the ego in `map`")
TRANSFORMS = Channel("/cwcli/tf", "foxglove.FrameTransform", "estimate", "`base_link` in `map`")
REJECTED = Channel("/cwcli/rejected", "cwcli.v1.Rejected", "estimate", "the measurements that were gated")
TARGETS = Channel("/cwcli/targets", "cwcli.v1.Target", "track", "the tracked targets", "targets", "detections")
TARGETS_ONLINE = Channel(
    "/cwcli/targets/online",
    "cwcli.v1.Target",
    "track",
    "the tracked targets as they could have been known",
    "targets_online",
    "detections",
)
TARGET_SCENE = Channel("/cwcli/targets/scene", _SCENE_SCHEMA, "track", "the targets, with velocity and id")
EGO_PATH = Channel("/cwcli/ego/path", _PATH_SCHEMA, "predict", "the ego path", "ego_path", "ego_state")
REMOTE_PATH = Channel(
    "/cwcli/remote/path", _PATH_SCHEMA, "predict", "the remote vehicles' paths", "remote_path", "remote_state"
)
PATH_SCENE = Channel("/cwcli/paths/scene", _SCENE_SCHEMA, "predict", "the predicted paths as lines in `map`")
WARNINGS = Channel("/cwcli/warnings", "cwcli.v1.Warning", "warn", "the warnings")
WARNING_LOG = Channel("/cwcli/log", "foxglove.Log", "warn", "the warnings, in words")
PAIR_MEASURES = Channel("/cwcli/measures", "cwcli.v1.Measures", "measure", "how critical each pair is")
CONTROL_STATE = Channel("/cwcli/control/<policy>/state", _STATE_SCHEMA, "control", "what the ego would have done")
CONTROL_POSE = Channel(
    "/cwcli/control/<policy>/pose", _POSE_SCHEMA, "control", "where the ego would have been in `map`"
)
CONTROL_STEP = Channel("/cwcli/control/<policy>/step", "cwcli.v1.ControlStep", "control", "the steps of the replay")
LANES = Channel("/cwcli/lanes", "cwcli.v1.Lanes", "lanes", "the lane boundaries", "lanes", "camera")
LANE_LINES = Channel(
    "/cwcli/lanes/annotations", _ANNOTATIONS_SCHEMA, "lanes", "the lane boundaries in the camera's image"
)
OBSERVER = Channel(
    "/cwcli/observer", "cwcli.v1.LateralState", "observe", "the observed lateral motion", "observer", "lanes"
)
OBSERVER_PATH = Channel(
    "/cwcli/observer/path", _PATH_SCHEMA, _LANE_PATH_STAGE, "the path from the observer", "observer_path", "observer"
)
OBSERVER_PATH_LINES = Channel(
    "/cwcli/observer/path/annotations",
    _ANNOTATIONS_SCHEMA,
    _LANE_PATH_STAGE,
    "that path in the camera's image, with the car's width and the 90 % band",
)

PUBLISHED_CHANNELS = tuple(each for each in tuple(globals().values()) if isinstance(each, Channel))
"""All published channels, in the order in which the stages run."""
CHANNEL_OF_ROLE = {channel.role: channel for channel in PUBLISHED_CHANNELS if channel.role}
"""Role -> the channel that fills it."""
ONLINE_CHANNEL_OF_ROLE = {EGO_STATE.role: EGO_ONLINE, REMOTE_STATE.role: REMOTE_ONLINE, TARGETS.role: TARGETS_ONLINE}
"""Role of smoothed states -> the channel of the same states computed online."""


def schema_name_by_published_topic() -> dict[str, str]:
    """Topic -> schema of every channel, with the policies' names filled in."""
    from cwcli.control.encounter import BRAKING_POLICY_NAMES

    return {
        channel.with_policy_in_topic(policy).topic: channel.schema
        for channel in PUBLISHED_CHANNELS
        for policy in (BRAKING_POLICY_NAMES if POLICY_PLACEHOLDER in channel.topic else ("",))
    }
