"""Every channel that cwcli publishes: its topic, its schema, who writes it.

The channel reference (docs/channels.md) and the viewer layout are made from this list. A new channel is a line here.
"""

from __future__ import annotations

from dataclasses import dataclass

from cwcli.control.encounter import POLICIES

POLICY = "<policy>"


@dataclass(frozen=True)
class Published:
    """A channel.

    Attributes:
        topic: Its name; `<policy>` stands for each of `POLICIES`.
        schema: Full name of the protobuf message.
        stage: The command that writes it.
        what: For viewers' channels (`foxglove.*`), in a few words.
    """

    topic: str
    schema: str
    stage: str
    what: str = ""


PUBLISHED = (
    Published("/cwcli/ego/state", "cwcli.v1.VehicleState", "estimate"),
    Published("/cwcli/remote/state", "cwcli.v1.VehicleState", "estimate"),
    Published("/cwcli/ego/fix", "foxglove.LocationFix", "estimate", "the ego on the globe"),
    Published("/cwcli/ego/pose", "foxglove.PoseInFrame", "estimate", "the ego in `map`"),
    Published("/cwcli/tf", "foxglove.FrameTransform", "estimate", "`base_link` in `map`"),
    Published("/cwcli/targets", "cwcli.v1.Target", "track"),
    Published("/cwcli/targets/scene", "foxglove.SceneUpdate", "track", "the targets, with velocity and id"),
    Published("/cwcli/ego/path", "cwcli.v1.PredictedPath", "predict"),
    Published("/cwcli/remote/path", "cwcli.v1.PredictedPath", "predict"),
    Published("/cwcli/paths/scene", "foxglove.SceneUpdate", "predict", "the predicted paths as lines in `map`"),
    Published("/cwcli/warnings", "cwcli.v1.Warning", "warn"),
    Published("/cwcli/log", "foxglove.Log", "warn", "the warnings, in words"),
    Published("/cwcli/control/<policy>/state", "cwcli.v1.VehicleState", "control"),
    Published(
        "/cwcli/control/<policy>/pose",
        "foxglove.PoseInFrame",
        "control",
        "where the ego would have been in `map`, for each policy",
    ),
    Published("/cwcli/control/<policy>/step", "cwcli.v1.ControlStep", "control"),
    Published("/cwcli/lanes", "cwcli.v1.Lanes", "lanes"),
    Published(
        "/cwcli/lanes/annotations", "foxglove.ImageAnnotations", "lanes", "the lane boundaries in the camera's image"
    ),
    Published("/cwcli/observer", "cwcli.v1.LateralState", "observe"),
    Published("/cwcli/observer/path", "cwcli.v1.PredictedPath", "predict --from observer"),
    Published(
        "/cwcli/observer/path/annotations",
        "foxglove.ImageAnnotations",
        "predict --from observer",
        "that path in the camera's image, with the car's width and the 90 % band",
    ),
)
"""In the order in which the stages run."""


def topics() -> dict[str, str]:
    """Topic -> schema of every channel, with the policies' names filled in."""
    return {
        entry.topic.replace(POLICY, policy): entry.schema
        for entry in PUBLISHED
        for policy in (POLICIES if POLICY in entry.topic else ("",))
    }
