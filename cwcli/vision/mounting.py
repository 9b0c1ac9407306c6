"""What the user says of how the camera stands on the car, and what no camera on a car has."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from cwcli.errors import UsageError
from cwcli.option import Option
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
