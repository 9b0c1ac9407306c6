"""The options for the camera's mounting on the car, and their permitted ranges."""

from __future__ import annotations

import math
from typing import Annotated

from cwcli.errors import UsageError
from cwcli.lazy_dataclass import dataclass
from cwcli.option import Option
from cwcli.vision.camera import Mounting

CAMERA_HEIGHT_RANGE_M = (0.2, 5.0)
"""Least and greatest height of a camera above the road, in metres; a transform with another height is not relative to
the road. Chosen by hand; not fitted."""
MAX_CAMERA_OFFSET_M = 5.0
"""Greatest distance of a camera from the car's centre line, in metres. Chosen by hand; not fitted."""
MAX_CAMERA_ANGLE_RAD = math.radians(45.0)
"""Greatest pitch, yaw and roll of a camera that looks ahead and stands upright, in radians. Chosen by hand; not
fitted."""
MOUNTING_OPTION_NAMES = {
    "height_m": "--camera-height",
    "pitch_rad": "--camera-pitch",
    "yaw_rad": "--camera-yaw",
    "lateral_offset_m": "--camera-offset",
}
"""Name of the option for each value of the mounting."""


@dataclass(frozen=True)
class MountingChoice:
    """The mounting as the options give it; None where an option is not given.

    Attributes:
        height_m, pitch_rad, yaw_rad, lateral_offset_m: As in `vision.camera.Mounting`.
    """

    height_m: Annotated[
        float | None,
        Option(
            MOUNTING_OPTION_NAMES["height_m"],
            "Height of the camera above the road.",
            metavar="METRES",
            default=f"{Mounting().height_m:g}",
        ),
    ] = None
    pitch_rad: Annotated[
        float | None,
        Option(
            MOUNTING_OPTION_NAMES["pitch_rad"],
            "Pitch of the camera, nose down positive.",
            metavar="DEGREES",
            default="0",
            parse=math.radians,
        ),
    ] = None
    yaw_rad: Annotated[
        float | None,
        Option(
            MOUNTING_OPTION_NAMES["yaw_rad"],
            "Yaw of the camera, to the left positive.",
            metavar="DEGREES",
            default="0",
            parse=math.radians,
        ),
    ] = None
    lateral_offset_m: Annotated[
        float | None,
        Option(
            MOUNTING_OPTION_NAMES["lateral_offset_m"],
            "Offset of the camera from the car's centre line, left positive.",
            metavar="METRES",
            default="0",
        ),
    ] = None

    def given_values_by_option(self) -> dict[str, float]:
        """The given values by name."""
        return {name: value for name in MOUNTING_OPTION_NAMES if (value := getattr(self, name)) is not None}


def check_mounting_ranges(choice: MountingChoice | Mounting) -> None:
    """Require that a mounting lies within the ranges of a camera on a car.

    Raises:
        UsageError: A value is out of its range; names the option.
    """
    degrees = math.degrees(MAX_CAMERA_ANGLE_RAD)
    ranges = {
        "height_m": (*CAMERA_HEIGHT_RANGE_M, 1.0, "m"),
        "pitch_rad": (-degrees, degrees, math.degrees(1.0), "degrees"),
        "yaw_rad": (-degrees, degrees, math.degrees(1.0), "degrees"),
        "lateral_offset_m": (-MAX_CAMERA_OFFSET_M, MAX_CAMERA_OFFSET_M, 1.0, "m"),
    }
    for name, (low, high, scale, unit) in ranges.items():
        value = getattr(choice, name)
        if value is not None and not low <= scale * value <= high:
            raise UsageError(
                f"{MOUNTING_OPTION_NAMES[name]} {scale * value:g} must lie between {low:g} and {high:g} {unit}"
            )
