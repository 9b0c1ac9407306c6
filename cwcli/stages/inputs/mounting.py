"""How the camera stands on the car: what the user says, else the log's transforms, else the stated default."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated

from cwcli.channels.binding import is_truth_topic
from cwcli.channels.published import OWN_PREFIX
from cwcli.errors import UsageError
from cwcli.logs.read.reader import Log
from cwcli.option import Option
from cwcli.pipeline.result import InputCount
from cwcli.signals.transforms import BODY_FRAMES, CameraPose, Transform, body_from_frame, camera_pose
from cwcli.vision.camera import Mounting

HEIGHTS_M = (0.2, 5.0)
"""Of a camera above the road; another height in a transform is not one above the road."""
MAX_OFFSET_M = 5.0
"""Of a camera from the car's centre line."""
MAX_TURN_RAD = math.radians(45.0)
"""Pitch, yaw and roll of a camera that looks ahead and stands upright."""
OPTIONS = {
    "height_m": "--camera-height",
    "pitch_rad": "--camera-pitch",
    "yaw_rad": "--camera-yaw",
    "lateral_offset_m": "--camera-offset",
}


@dataclass(frozen=True)
class MountingChoice:
    """What the user says of the mounting; None: nothing.

    Attributes:
        height_m, pitch_rad, yaw_rad, lateral_offset_m: As in `vision.camera.Mounting`.
    """

    height_m: Annotated[
        float | None,
        Option(OPTIONS["height_m"], "Above the road.", metavar="METRES", default=f"{Mounting().height_m:g}"),
    ] = None
    pitch_rad: Annotated[
        float | None,
        Option(OPTIONS["pitch_rad"], "Nose down positive.", metavar="DEGREES", default="0", parse=math.radians),
    ] = None
    yaw_rad: Annotated[
        float | None,
        Option(OPTIONS["yaw_rad"], "To the left positive.", metavar="DEGREES", default="0", parse=math.radians),
    ] = None
    lateral_offset_m: Annotated[
        float | None,
        Option(OPTIONS["lateral_offset_m"], "Left of the car's centre line positive.", metavar="METRES", default="0"),
    ] = None

    def given(self) -> dict[str, float]:
        """Name -> value of what is given."""
        return {name: value for name in OPTIONS if (value := getattr(self, name)) is not None}


@dataclass(frozen=True)
class MountingSource:
    """The mounting and where it comes from.

    Attributes:
        mounting: To be used.
        is_pitch_known: Given by the user or by the log.
        counts: What became of the transforms' messages.
        notes: For the user.
    """

    mounting: Mounting
    is_pitch_known: bool
    counts: tuple[InputCount, ...] = ()
    notes: tuple[str, ...] = ()


def check_mounting(choice: MountingChoice | Mounting) -> None:
    """Refuse what no camera on a car has.

    Raises:
        UsageError: A value is out of its range; names the option.
    """
    degrees = math.degrees(MAX_TURN_RAD)
    ranges = {
        "height_m": (*HEIGHTS_M, 1.0, "m"),
        "pitch_rad": (-degrees, degrees, math.degrees(1.0), "degrees"),
        "yaw_rad": (-degrees, degrees, math.degrees(1.0), "degrees"),
        "lateral_offset_m": (-MAX_OFFSET_M, MAX_OFFSET_M, 1.0, "m"),
    }
    for name, (low, high, scale, unit) in ranges.items():
        value = getattr(choice, name)
        if value is not None and not low <= scale * value <= high:
            raise UsageError(f"{OPTIONS[name]} {scale * value:g} must lie between {low:g} and {high:g} {unit}")


def mounting_source(log: Log, frame_id: str, choice: MountingChoice | Mounting) -> MountingSource:
    """Find out how a camera is mounted.

    Each value that the user gives counts before that of the transforms, and that before the default. The transforms are
    those of the log's own channels (`/tf_static`, `/tf`); the first of each frame of reference is taken.

    Args:
        log: The log.
        frame_id: Of the camera's images.
        choice: The user's; a whole `Mounting` leaves nothing open.
    """
    if isinstance(choice, Mounting):
        return MountingSource(choice, is_pitch_known=choice.pitch_rad != 0.0)
    given = choice.given()
    if len(given) == len(OPTIONS):
        return MountingSource(Mounting(**given), is_pitch_known=True)
    pose, counts, notes = _from_transforms(log, frame_id.lstrip("/"))
    if pose is None:
        made = Mounting(**given)
        note = (
            f"the camera's mounting is not known: {made.height_m:g} m above the road, level, straight ahead and in the "
            f"middle of the car are assumed ({', '.join(OPTIONS.values())})"
        )
        notes = notes if given else (*notes, note)
        return MountingSource(made, "pitch_rad" in given, counts, notes)
    made = Mounting(pose.height_m, pose.pitch_rad, pose.yaw_rad, pose.roll_rad, pose.lateral_m)
    if given:
        notes = (*notes, f"{', '.join(OPTIONS[name] for name in given)} counts before the transform")
    return MountingSource(replace(made, **given), True, counts, notes)


def _from_transforms(log: Log, frame_id: str) -> tuple[CameraPose | None, tuple[InputCount, ...], tuple[str, ...]]:
    topics = sorted(
        {channel.topic for channel in log.transform_channels() if not _is_left_out(channel.topic)},
        key=lambda topic: ("static" not in topic, topic),
    )
    if not topics or not frame_id:
        return None, (), ()
    tree: dict[str, Transform] = {}
    counts = []
    for topic in topics:
        counts.append(_read(log, topic, tree, frame_id))
        if body_from_frame(tree, frame_id) is not None:
            break
    found = body_from_frame(tree, frame_id)
    if found is None:
        note = f"no transform leads from {frame_id} to {' or '.join(BODY_FRAMES)}: {', '.join(topics)} not used"
        return None, tuple(counts), (note,)
    body, matrix = found
    pose = camera_pose(matrix)
    fault = _fault(pose, frame_id, body)
    if pose is None or fault:
        return None, tuple(counts), (f"{fault}: the transforms are not used",)
    degrees = [math.degrees(angle) for angle in (pose.pitch_rad, pose.yaw_rad, pose.roll_rad)]
    note = (
        f"the camera's mounting is that of {frame_id} in {body}: height {pose.height_m:.2f} m, offset "
        f"{pose.lateral_m:.2f} m, pitch {degrees[0]:.2f}, yaw {degrees[1]:.2f}, roll {degrees[2]:.2f} degrees"
    )
    if body != BODY_FRAMES[0]:
        note += f" ({body} is taken to lie on the road)"
    return pose, tuple(counts), (note,)


def _fault(pose: CameraPose | None, frame_id: str, body: str) -> str:
    """Why a pose is not that of a camera that looks ahead from a car, else ""."""
    if pose is None:
        return f"{frame_id} does not look ahead from {body}"
    if not HEIGHTS_M[0] <= pose.height_m <= HEIGHTS_M[1]:
        return f"{frame_id} is {pose.height_m:.3g} m above {body}, no height above the road"
    if abs(pose.lateral_m) > MAX_OFFSET_M:
        return f"{frame_id} is {pose.lateral_m:.3g} m beside {body}, not on the car"
    if abs(pose.roll_rad) > MAX_TURN_RAD:
        return f"{frame_id} is rolled by {math.degrees(pose.roll_rad):.0f} degrees in {body}, not upright"
    return ""


def _read(log: Log, topic: str, tree: dict[str, Transform], frame_id: str) -> InputCount:
    """Fill the tree from one topic until it leads from the camera to the road below the car."""
    read, used, unreadable = 0, 0, 0
    for transforms in log.transforms(topic):
        read += 1
        if transforms is None:
            unreadable += 1
            continue
        new = [each for each in transforms if each.child not in tree]
        for each in new:
            tree.setdefault(each.child, each)
        used += bool(new)
        found = body_from_frame(tree, frame_id) if new else None
        if found is not None and found[0] == BODY_FRAMES[0]:
            break
    rejected = {"not a transform": unreadable} if unreadable else {}
    aside = read - used - unreadable
    return InputCount(topic, "transform", read, used, rejected, {}, {"a frame known already": aside} if aside else {})


def _is_left_out(topic: str) -> bool:
    return topic.startswith(OWN_PREFIX) or is_truth_topic(topic)
