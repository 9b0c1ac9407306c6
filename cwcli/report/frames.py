"""Small pictures of what the camera saw, with the lane boundaries drawn in."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Sequence
from typing import TypeVar

import numpy as np

from cwcli.channels.lanes import LaneRows
from cwcli.errors import CwcliError
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.frames import Frame
from cwcli.logs.read.reader import Log
from cwcli.signals.columns import FloatArray
from cwcli.vision.encoded import Image
from cwcli.vision.frames import DecodedFrame, decode_frame, decode_frames
from cwcli.vision.overlay import draw_boundaries
from cwcli.vision.video import CODEC_OF_VIDEO_FORMAT

T = TypeVar("T")

THUMBNAIL_WIDTH_PX = 320
"""Width of a thumbnail in pixels. Chosen by hand; not fitted."""
THUMBNAIL_JPEG_QUALITY_PERCENT = 60
"""Quality of the thumbnails' JPEG files, 0 to 100. Chosen by hand; not fitted."""
MAX_FRAME_OFFSET_NS = 500_000_000
"""Greatest difference in ns of a shown frame from the wanted time. Chosen by hand; not fitted."""
MAX_FRAME_LATENCY_NS = 3_000_000_000
"""Greatest difference in ns of a frame's log time from its stamp where a part of a log is read. Chosen by hand."""


@dataclass(frozen=True)
class Thumbnail:
    """A small picture of a camera frame.

    Attributes:
        stamp_ns: Of the frame.
        data_uri: The JPEG file.
        width_px, height_px: Its size.
        n_lines: Lane boundaries drawn in; None where the log has no lanes for the frame.
    """

    stamp_ns: int
    data_uri: str
    width_px: int
    height_px: int
    n_lines: int | None


def make_thumbnails_and_explain_gaps(
    log: Log, topic: str, lanes: LaneRows | None, wanted_ns: Sequence[int], *, is_part: bool = False
) -> tuple[dict[int, Thumbnail], str]:
    """Make thumbnails of the frames that are nearest to the wanted times.

    Args:
        topic: The camera's; "" where the log has none.
        lanes: The lane boundaries to draw in; None where there are none.
        is_part: Read only the chunks around the wanted times; of a video everything before them is needed.

    Returns:
        Wanted time -> picture, for the times that have one; and why some have none, or "".
    """
    if not topic or not wanted_ns:
        return {}, ""
    found: dict[int, Thumbnail] = {}
    rejected = ""
    try:
        for wanted, decoded in _iter_wanted_ns_and_nearest_frame(log, topic, sorted(set(wanted_ns)), is_part):
            if decoded.image is None:
                rejected = f"some camera frames could not be decoded: {decoded.rejection_reason}"
            else:
                found[wanted] = _make_thumbnail(decoded.image, decoded.stamp_ns, lanes)
    except CwcliError as error:
        return found, f"the camera frames can't be shown: {error.what}"
    return found, rejected


def _iter_wanted_ns_and_nearest_frame(
    log: Log, topic: str, wanted_ns: list[int], is_part: bool
) -> Iterator[tuple[int, DecodedFrame]]:
    """Yield each wanted time with its nearest frame, decoded, in one pass; a video is decoded along the way."""
    reach_ns = MAX_FRAME_OFFSET_NS + MAX_FRAME_LATENCY_NS
    frames = log.frames(topic, [(each - reach_ns, each + reach_ns) for each in wanted_ns] if is_part else None)
    first = next(frames, None)
    if first is None:
        return
    if first.format.lower() in CODEC_OF_VIDEO_FORMAT:
        if is_part:
            frames = log.frames(topic)
            first = next(frames)
        decoded = decode_frames(_chain_first_and_rest(first, frames), wanted_size_of=None, where=f"{log.name}: {topic}")
        for wanted, picture in _iter_wanted_ns_and_nearest_item(((each.stamp_ns, each) for each in decoded), wanted_ns):
            yield wanted, picture
        return
    stamped = ((_frame_stamp_ns(each), each) for each in _chain_first_and_rest(first, frames))
    for wanted, frame in _iter_wanted_ns_and_nearest_item(stamped, wanted_ns):
        yield wanted, decode_frame(0, frame, None)


def _chain_first_and_rest(first: Frame, rest: Iterator[Frame]) -> Iterator[Frame]:
    """Yield the first frame, then the rest."""
    yield first
    yield from rest


def _iter_wanted_ns_and_nearest_item(items: Iterator[tuple[int, T]], wanted_ns: list[int]) -> Iterator[tuple[int, T]]:
    """Yield each wanted time with the item of the nearest stamp, if near enough; items come in order of time."""
    waiting = list(wanted_ns)
    before: tuple[int, T] | None = None
    for item in items:
        while waiting and item[0] >= waiting[0]:
            wanted = waiting.pop(0)
            nearer = item if before is None or item[0] - wanted <= wanted - before[0] else before
            if abs(nearer[0] - wanted) <= MAX_FRAME_OFFSET_NS:
                yield wanted, nearer[1]
        before = item
        if not waiting:
            return
    for wanted in waiting:
        if before is not None and abs(before[0] - wanted) <= MAX_FRAME_OFFSET_NS:
            yield wanted, before[1]


def _frame_stamp_ns(frame: Frame) -> int:
    """Return the frame's stamp, its log time if it has none."""
    return frame.log_time_ns if frame.stamp_ns is None else frame.stamp_ns


def _left_and_right_boundary_px(
    lanes: LaneRows | None, stamp_ns: int, size: tuple[int, int]
) -> list[FloatArray] | None:
    """Return the left and the right boundary in the pixels of an image; None if the frame was not searched."""
    if lanes is None:
        return None
    rows = np.flatnonzero(lanes.stamp_ns == stamp_ns)[:1].tolist()
    return next((lanes.boundaries_in_pixels(row, size) for row in rows if (lanes.search_size[row] > 1).all()), None)


def _make_thumbnail(image: Image, stamp_ns: int, lanes: LaneRows | None) -> Thumbnail:
    """Shrink an image, draw its lane boundaries, and encode it as JPEG."""
    import cv2

    height_px = max(1, round(image.shape[0] * THUMBNAIL_WIDTH_PX / image.shape[1]))
    small = np.asarray(cv2.resize(image, (THUMBNAIL_WIDTH_PX, height_px), interpolation=cv2.INTER_AREA), np.uint8)
    if small.ndim == 2:
        small = np.repeat(small[..., None], 3, axis=2)
    lines = _left_and_right_boundary_px(lanes, stamp_ns, (THUMBNAIL_WIDTH_PX, height_px))
    drawn = small if lines is None else draw_boundaries(small, lines)
    done, data = cv2.imencode(".jpg", drawn, [cv2.IMWRITE_JPEG_QUALITY, THUMBNAIL_JPEG_QUALITY_PERCENT])
    if not done:
        raise RuntimeError("OpenCV could not encode a JPEG")
    text = base64.b64encode(data.tobytes()).decode("ascii")
    n_lines = None if lines is None else sum(len(points) > 1 for points in lines)
    return Thumbnail(stamp_ns, f"data:image/jpeg;base64,{text}", THUMBNAIL_WIDTH_PX, height_px, n_lines)
