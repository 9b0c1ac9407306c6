"""Every lane method on rendered drives: which frames are right, and how long the search takes.

A drive is rendered once and given to all methods. As in the paper a method follows the lane from frame to frame. The
paper calls the first six frames not yet stable (section 1.2.2.1): they are run, timed and reported apart, and the
statistics begin with the seventh.
"""

from __future__ import annotations

import time
from functools import cache
from itertools import islice

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.metrics.lane_scores import BoundaryColumns, visual_standard_score
from cwcli.signals.columns import BoolArray, FloatArray
from cwcli.simulation.road.camera import camera_of_zhang2011
from cwcli.simulation.road.car import YAW_RATE
from cwcli.simulation.road.drive import RoadDrive, iter_set_drives
from cwcli.simulation.road.render import RoadFrame
from cwcli.vision.boundary import Boundary
from cwcli.vision.camera import Camera, Mounting
from cwcli.vision.method import GreyImage, LaneFit, LaneFrame
from cwcli.vision.methods import METHODS, methods_without_model

N_FRAMES_BEFORE_STABLE_PHASE = 6
"""Frames of the first two search phases, which the paper calls not yet stable (section 1.2.2.1)."""
N_JUDGED_FRAMES = 10
"""Frames of each drive that are judged. Chosen by hand; not fitted."""
N_SEARCHED_IMAGE_ROWS_FROM_BOTTOM = 150
"""Rows from the bottom, of 240, that the paper searches (section 1.1); the rows above are not judged."""


@dataclass(frozen=True)
class MethodResults:
    """The results of one method on some drives; arrays of shape (drives, frames).

    Attributes:
        is_correct: Both boundaries within 6 pixels of the painted stripe on 85 % of the visible rows.
        is_correct_by_centre: The same, by the distance from the stripe's centre line.
        search_ms: Processor time of the search: other work on the machine does not count.
        prepare_ms: Likewise of what is computed of a frame before (zhang2011: the block responses).
    """

    is_correct: BoolArray
    is_correct_by_centre: BoolArray
    search_ms: FloatArray
    prepare_ms: FloatArray


def run_methods_on_drives(
    name: str, first: int, last: int, *, methods: tuple[str, ...] | None = None, seed: int = 0
) -> dict[str, MethodResults]:
    """Run methods on the drives `first` to `last` - 1 of a set.

    Args:
        methods: Keys of `METHODS`; None: all that need no model.
        seed: Of the set and of random searches.
    """
    chosen = methods_without_model() if methods is None else methods
    n_frames = N_FRAMES_BEFORE_STABLE_PHASE + N_JUDGED_FRAMES
    shape = (last - first, n_frames)
    found = {
        key: MethodResults(np.zeros(shape, np.bool_), np.zeros(shape, np.bool_), np.zeros(shape), np.zeros(shape))
        for key in chosen
    }
    for row, drive in enumerate(islice(iter_set_drives(name, last, seed=seed, n_frames=n_frames), first, last)):
        frames = list(drive.iter_rendered_frames())
        for key in chosen:
            _run_method_on_drive(key, drive, frames, found[key], row, seed + first + row)
    return found


def _run_method_on_drive(
    key: str, drive: RoadDrive, frames: list[RoadFrame], results: MethodResults, row: int, seed: int
) -> None:
    """Run one method on one drive and fill in its row of the results."""
    method = METHODS[key]
    search = method.make(seed)
    yaw_rates = drive.states_at(drive.time_s)[:, YAW_RATE]
    speeds = drive.speed_at_mps(drive.time_s)
    for k, frame in enumerate(frames):
        height, width = frame.grey.shape
        size = method.search_size(width, height)
        grey = _resize_grey_image(frame.grey, size)
        begin = time.thread_time()
        prepared = None if method.prepare is None else method.prepare(grey)
        middle = time.thread_time()
        lane_frame = LaneFrame(
            grey=grey,
            camera=camera_for_lane_methods(width, height).with_image_size(*size),
            stamp_ns=round(float(drive.time_s[k]) * 1e9),
            number=k,
            speed_mps=float(speeds[k]) if method.uses_motion else np.nan,
            yaw_rate_radps=float(yaw_rates[k]) if method.uses_motion else np.nan,
            prepared=prepared,
        )
        fit = search.step(lane_frame)
        results.search_ms[row, k] = 1e3 * (time.thread_time() - middle)
        results.prepare_ms[row, k] = 1e3 * (middle - begin)
        results.is_correct[row, k] = is_fit_correct(frame, fit, size, by_stripe=True)
        results.is_correct_by_centre[row, k] = is_fit_correct(frame, fit, size, by_stripe=False)


@cache
def camera_for_lane_methods(width_px: int, height_px: int) -> Camera:
    """Return the renderer's paper camera at rest, as lane methods get it."""
    camera = camera_of_zhang2011(width_px, height_px)
    mounting = Mounting(height_m=camera.height_m, pitch_rad=camera.pitch_rad)
    return Camera(width_px, height_px, camera.fx, camera.fy, camera.cx, camera.cy, mounting=mounting)


def _resize_grey_image(grey: GreyImage, size: tuple[int, int]) -> GreyImage:
    """Resize a grey image."""
    if grey.shape[1::-1] == size:
        return grey
    import cv2

    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), np.uint8)


def is_fit_correct(frame: RoadFrame, fit: LaneFit, size: tuple[int, int], *, by_stripe: bool) -> bool:
    """Judge a fit by the paper's visual standard.

    Args:
        frame: With its truth.
        fit: In the pixels of the search image.
        size: (width, height) of that image.
        by_stripe: Measure from the painted stripe instead of its centre line.
    """
    truth = frame.truth
    height, width = frame.grey.shape
    rows = np.arange(height)
    is_searched = rows >= height - round(N_SEARCHED_IMAGE_ROWS_FROM_BOTTOM * height / 240)
    left, right = (boundary_columns_px(each, (width, height), size) for each in (fit.left, fit.right))
    return visual_standard_score(
        BoundaryColumns(
            left,
            truth.left_u_px,
            truth.left_visible & is_searched,
            truth.left_half_width_px if by_stripe else 0.0,
        ),
        BoundaryColumns(
            right,
            truth.right_u_px,
            truth.right_visible & is_searched,
            truth.right_half_width_px if by_stripe else 0.0,
        ),
        width_px=width,
    ).is_correct


def boundary_columns_px(boundary: Boundary, image: tuple[int, int], search: tuple[int, int]) -> FloatArray:
    """Return the boundary's column in every row of the image, shape (image height,), NaN if it was not found."""
    rows = np.arange(image[1])
    if not boundary.found:
        return np.full(len(rows), np.nan)
    v = (rows + 0.5) * search[1] / image[1] - 0.5
    return np.asarray((boundary.x_px(search[1] - v) - 0.5) * image[0] / search[0] - 0.5)
