"""The interface of a lane method: the frames that it gets, the fits that it returns, and its registration.

A method is registered in `cwcli.vision.methods.METHODS`. Its search keeps state between the frames of one camera; a
change of the image size, or a jump of the time, starts a new search.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from math import nan
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray
from cwcli.vision.boundary import Boundary
from cwcli.vision.camera import Camera, WidthHeightPx
from cwcli.vision.encoded import Image
from cwcli.vision.frames import DecodedFrame
from cwcli.vision.rectify import Rectifier

GreyImage = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class PreparedFrame:
    """A prepared frame: the image to be searched, what the method computed of it, and the image in colour."""

    grey: Image
    method_result: object = None
    colour: Image | None = None


@dataclass(frozen=True)
class LaneFrame:
    """One frame for the search.

    Attributes:
        grey: Shape (height, width), uint8, of the size that the method's `search_size` asked for, rectified if the
            method wants that. May be read-only.
        camera: The camera in the pixels of `grey`.
        stamp_ns: Time of the frame.
        number: 0, 1, 2, ... over the frames that could be decoded; seeds of random searches derive from it.
        speed_mps, yaw_rate_radps: The ego's motion at that time, NaN where the log does not hold it.
        prepared: The result of the method's `prepare` for `grey`; None if it was not called.
        colour: Shape (height, width, 3), blue, green, red, of some frames of a camera in colour, for a method that
            wants them (`Method.uses_colour`), else None.
    """

    grey: GreyImage
    camera: Camera
    stamp_ns: int
    number: int
    speed_mps: float = nan
    yaw_rate_radps: float = nan
    prepared: object = None
    colour: Image | None = None


class LaneState(IntEnum):
    """Whether the frame shows the lane: `cwcli.v1.Lanes.State`."""

    UNTOLD = 0
    FOUND = 1
    HELD = 2
    LOST = 3
    CARRIED = 4


@dataclass(frozen=True)
class LaneFit:
    """Both boundaries of one frame.

    Attributes:
        left, right: The boundaries in the pixels of the search image.
        pitch_rad: The camera's pitch as the method estimates it from the frames, nose down positive; NaN: keep the
            mounting's.
        yaw_rad: The camera's yaw as the method estimates it, counter-clockwise positive; NaN: keep the mounting's.
        roads: Shape (2, 4), left and right: far (px), near, bend (px^2), spiral (px^3) of
            x = far + near h + bend / h + spiral / h^2, h rows below the horizon that belongs to `pitch_rad`: what
            touches the boundary, a circle or a spiral on the ground (`arcs`), beside the camera, where that is the
            method's model and the parabolas the best ones for it. None: the method has parabolas alone.
        state: Whether this frame shows the lane, or it is carried on.
        steady_s: Time for which the lane has been followed without a jump; NaN: unknown, or lost.
        covariance: Shape (7, 7): of a, b, c of the left and of the right boundary and `pitch_rad` together; None: the
            boundaries' own, if there are any.
        lane_change: 1 where the camera has come into the next lane to the left, -1 to the right, else 0.
    """

    left: Boundary
    right: Boundary
    pitch_rad: float = nan
    yaw_rad: float = nan
    roads: FloatArray | None = None
    state: LaneState = LaneState.UNTOLD
    steady_s: float = nan
    lane_change: int = 0
    covariance: FloatArray | None = None


class LaneSearch(Protocol):
    """A search over the frames of one camera, in order; holds the state between them."""

    def step(self, frame: LaneFrame) -> LaneFit:
        """Find both boundaries in the next frame."""


@dataclass(frozen=True)
class Method:
    """A lane method as it is registered.

    Attributes:
        summary: One line for `--help`.
        search_size: (width_px, height_px) of the camera's image -> the size that the search wants.
        make: Seed -> a new search.
        prepare: What can be computed of a grey image alone; called in the decoding threads, its result is
            `LaneFrame.prepared`. None: nothing.
        uses_motion: Whether the search wants the ego's speed and yaw rate.
        is_rectified: Whether the search wants frames without the lens's distortion and the mounting's roll
            (`vision.rectify`); False: as the camera made them.
        uses_colour: Whether the search wants a frame in colour now and then.
        carry: (search, stamp_ns, speed_mps, yaw_rate_radps) -> the fit of a frame that is not searched because the
            camera is faster than the road needs (`vision.search_clock`): the lane of the last searched frame, moved as
            the car moves; speed and yaw rate as in `LaneFrame`. None: every frame is searched.
        with_model: The file that `--model` names -> the method with it; None: it takes none. One that takes a model
            can't be used without.
    """

    summary: str
    search_size: Callable[[int, int], tuple[int, int]]
    make: Callable[[int], LaneSearch]
    prepare: Callable[[GreyImage], object] | None = None
    uses_motion: bool = False
    is_rectified: bool = False
    uses_colour: bool = False
    with_model: Callable[[Path], Method] | None = None
    carry: Callable[[Any, int, float, float], LaneFit] | None = None


def check_search_size(size: WidthHeightPx, *camera: int) -> WidthHeightPx:
    """Require that a plug-in's search size is a pair of positive whole numbers, and return it.

    Raises:
        ValueError: The size is not two positive whole numbers.
    """
    if not (isinstance(size, tuple) and len(size) == 2 and all(isinstance(side, int) and side > 0 for side in size)):
        raise ValueError(f"{size!r} is no (width_px, height_px)")
    return size


def check_lane_fit(fit: LaneFit, frame: LaneFrame) -> LaneFit:
    """Require that a plug-in's search returned a fit of two boundaries, and return it.

    Raises:
        TypeError: The result is no fit of two boundaries.
    """
    if not (isinstance(fit, LaneFit) and isinstance(fit.left, Boundary) and isinstance(fit.right, Boundary)):
        raise TypeError(f"{fit!r} is no LaneFit of two boundaries")
    return fit


def make_frame_preparer(method: Method, rectifier: Rectifier | None) -> Callable[[DecodedFrame], object] | None:
    """A function that prepares each decoded frame for a method (`PreparedFrame`); None where there is nothing to do."""
    if method.prepare is None and rectifier is None:
        return None

    def rectify_and_scale_frame(decoded: DecodedFrame) -> PreparedFrame:
        assert decoded.image is not None
        grey, colour = decoded.image, decoded.colour
        if rectifier is not None:
            size = decoded.width_px, decoded.height_px
            grey = rectifier.rectify_image(grey, size)
            colour = None if colour is None else rectifier.rectify_image(colour, size)
        return PreparedFrame(grey, None if method.prepare is None else method.prepare(grey), colour)

    return rectify_and_scale_frame
