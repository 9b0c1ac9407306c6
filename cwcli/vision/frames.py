"""Frames of a log as images: decoded in threads, in order, a few at a time.

A grey image for a search is decoded at half, a quarter or an eighth of its size where the search needs no more. What
can't be decoded comes out as a rejected frame with its reason. The size is read from the header before a decoder is let
at the data, so a file of some bytes that declares a gigantic image costs nothing.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from itertools import groupby

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.clocks import INVALID_LOG_TIME_REASON, MAX_STAMP_NS, MIN_STAMP_NS
from cwcli.vision.camera import WidthHeightPx
from cwcli.vision.depth_images import COMPRESSED_DEPTH_HEADER as DEPTH_HEADER
from cwcli.vision.depth_images import DepthImageError, decode_compressed_depth_as_grey, is_compressed_depth
from cwcli.vision.encoded import FrameLike, Image
from cwcli.vision.image_header import (
    ImageHeader,
    excess_data_reason_or_empty,
    has_image_end,
    read_image_header,
)
from cwcli.vision.opencv_versions import print_fatal_errors_only
from cwcli.vision.ordered_threads import run_jobs_in_order
from cwcli.vision.raw_images import GREY_ENCODINGS, RawImageError, decode_raw_as_colour, decode_raw_as_grey
from cwcli.vision.search_clock import SearchClock
from cwcli.vision.video import CODEC_OF_VIDEO_FORMAT, UNSUPPORTED_CODECS, decode_video

MIN_IMAGE_SIDE_PX = 32
"""Least width and height of an image in pixels; smaller ones are rejected. Chosen by hand; not fitted."""
MAX_IMAGE_PIXELS = 50_000_000
"""Greatest number of pixels of an image; larger ones are rejected so that a damaged log can't exhaust the memory.
Chosen by hand; not fitted."""
MAX_VIDEO_PIXELS = 12_582_912
"""Greatest number of pixels of a picture of compressed video, 4096 by 3072: its decoder holds 17 of them, with 1.5
bytes a pixel. Chosen by hand, so that it takes less than 500 MB; not fitted."""
MAX_ASPECT_RATIO = 10
"""Greatest ratio of an image's longer to its shorter side; others are rejected. Chosen by hand; not fitted."""
JPEG_REDUCTION_FACTORS = (8, 4, 2)
"""Factors by which OpenCV can reduce a JPEG while it decodes it, greatest first."""
MAX_DECODING_THREADS = 4
"""Greatest number of decoding threads unless the caller names one. Chosen by hand; not fitted."""
MAX_SHOWN_FORMAT_NAME_CHARACTERS = 20
"""Number of letters of a format's name that a message shows."""
MAX_FRAMES_PER_BATCH = 4
"""Greatest number of grey frames that a thread gets at a time: handing over a small frame costs as much as a search.
Chosen by hand; not fitted."""
MAX_BATCH_BYTES = 400_000
"""Greatest size of several frames that a thread gets at a time, in encoded bytes. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class DecodedFrame:
    """A decoded frame, or the reason why there is no image.

    Attributes:
        index: 0, 1, 2, ... of the frame in its channel.
        log_time_ns, stamp_ns: As recorded; the stamp is the log time where the message has none that is a time.
        width_px, height_px: Size of the camera's image, whatever the size of `image`; 0 where rejected.
        image: Grey (height, width) or colour (height, width, 3), uint8; None where rejected.
        rejection_reason: The reason, else "".
        has_stamp: The message has a stamp that is a time.
        prepared: The result of `prepare` for the frame.
        colour: Of some frames of a camera in colour, beside the grey image and of its size: shape (height, width, 3),
            blue, green, red; else None.
        is_skipped: It was not decoded because it is not searched (`SearchClock`); there is no image.
    """

    index: int
    log_time_ns: int
    stamp_ns: int
    width_px: int
    height_px: int
    image: Image | None
    rejection_reason: str = ""
    prepared: object = None
    has_stamp: bool = True
    colour: Image | None = None
    is_skipped: bool = False


SizeOf = Callable[[int, int], tuple[int, int]]


@dataclass(frozen=True)
class DecodingJob:
    """The rest of a frame's decoding, and the bytes that it holds in memory until then."""

    n_bytes: int
    decode: Callable[[], DecodedFrame]


def decode_frames(
    frames: Iterable[FrameLike],
    *,
    wanted_size_of: SizeOf | None,
    prepare: Callable[[DecodedFrame], object] | None = None,
    n_threads: int | None = None,
    colour_every_ns: int | None = None,
    search_clock: SearchClock | None = None,
    where: str = "",
) -> Iterator[DecodedFrame]:
    """Decode frames in threads; they come out in the order in which they went in.

    Args:
        wanted_size_of: (width_px, height_px) of a frame -> size of the wanted grey image; None: colour, full size.
        prepare: Called with each frame that has an image, in its thread; the result comes with the frame.
        n_threads: Number of decoding threads, the calling one included; None: one for each processor, at most 4.
        colour_every_ns: Log time between frames that also come in colour (`DecodedFrame.colour`); None: none does.
        search_clock: Chooses the frames that are decoded; the others come as skipped ones. None: all are decoded.
        where: File and topic, for messages.

    Raises:
        InputError: The frames are compressed video that can't be decoded.
    """
    import cv2

    n = n_threads or min(os.cpu_count() or 1, MAX_DECODING_THREADS)
    cv2.setNumThreads(1)  # the threads are ours: one frame each
    print_fatal_errors_only()

    jobs = _iter_decoding_jobs(frames, wanted_size_of, _ColourClock(colour_every_ns), search_clock, where)
    batches = (
        partial(_decode_and_prepare_batch, batch, prepare)
        for batch in _iter_job_batches(jobs, MAX_FRAMES_PER_BATCH if wanted_size_of else 1)
    )
    for decoded in run_jobs_in_order(batches, n):
        yield from decoded


def _iter_job_batches(jobs: Iterable[DecodingJob], n_most: int) -> Iterator[list[DecodingJob]]:
    """Jobs grouped into batches of at most `n_most` jobs, and of limited size if there is more than one."""
    batch: list[DecodingJob] = []
    n_bytes = 0
    for job in jobs:
        if batch and (len(batch) == n_most or n_bytes + job.n_bytes > MAX_BATCH_BYTES):
            yield batch
            batch, n_bytes = [], 0
        batch.append(job)
        n_bytes += job.n_bytes
    if batch:
        yield batch


def _decode_and_prepare_batch(
    jobs: list[DecodingJob], prepare: Callable[[DecodedFrame], object] | None
) -> list[DecodedFrame]:
    """Decode the frames of a batch, and prepare those that have an image."""
    decoded = [job.decode() for job in jobs]
    if prepare is None:
        return decoded
    return [each if each.image is None else replace(each, prepared=prepare(each)) for each in decoded]


class _ColourClock:
    """Decides which frames are decoded in colour: the first, then one in each interval."""

    def __init__(self, every_ns: int | None) -> None:
        self._every_ns = every_ns
        self._last_ns: int | None = None

    def is_colour_due(self, time_ns: int) -> bool:
        """Whether the next frame is decoded in colour."""
        if self._every_ns is None:
            return False
        if self._last_ns is not None and 0 <= time_ns - self._last_ns < self._every_ns:
            return False
        self._last_ns = time_ns
        return True


def _iter_decoding_jobs(
    frames: Iterable[FrameLike],
    wanted_size_of: SizeOf | None,
    colour: _ColourClock,
    search_clock: SearchClock | None,
    where: str,
) -> Iterator[DecodingJob]:
    """One job for each frame. Video is decoded here, in order, because a picture is made from earlier ones."""
    index = 0
    for video_format, group in groupby(frames, key=_video_format_name_or_empty):
        if not video_format:
            for frame in group:
                skipped = (
                    None
                    if search_clock is None
                    else _frame_without_image_unless_search_is_due(index, frame, search_clock)
                )
                if skipped is not None:
                    yield DecodingJob(0, partial(_return_frame_unchanged, skipped))
                    index += 1
                    continue
                in_colour = colour.is_colour_due(frame.log_time_ns)
                yield DecodingJob(
                    len(frame.data), partial(decode_frame, index, frame, wanted_size_of, in_colour=in_colour)
                )
                index += 1
            continue
        decoded = decode_video(group, video_format, max_pixels=MAX_VIDEO_PIXELS, where=where)
        for frame, image, size in decoded:
            n_bytes = 0 if image is None else image.nbytes
            is_picture = image is not None and not _size_rejection_reason_or_empty(*size)
            stamp_ns = _stamp_or_log_time_ns(frame)
            if search_clock is not None and is_picture and not search_clock.is_search_due(stamp_ns, size):
                yield DecodingJob(0, partial(_return_frame_unchanged, _frame_without_image(index, frame, size)))
                index += 1
                continue
            in_colour = colour.is_colour_due(frame.log_time_ns)
            work = partial(_decoded_frame_from_video, index, frame, image, size, wanted_size_of, in_colour=in_colour)
            yield DecodingJob(n_bytes, work)
            index += 1


def _frame_without_image_unless_search_is_due(
    index: int, frame: FrameLike, search_clock: SearchClock
) -> DecodedFrame | None:
    """The skipped frame of an image that is not searched; None where it is searched, or what it is can't be told from
    its first bytes."""
    if frame.encoding:
        size = frame.width, frame.height
    else:
        header = read_image_header(frame.data)
        if header is None or not has_image_end(frame.data, header.kind):
            return None
        size = header.width_px, header.height_px
    if _size_rejection_reason_or_empty(*size) or not 0 <= frame.log_time_ns <= MAX_STAMP_NS:
        return None
    if search_clock.is_search_due(_stamp_or_log_time_ns(frame), size):
        return None
    return _frame_without_image(index, frame, size)


def _frame_without_image(index: int, frame: FrameLike, size: WidthHeightPx) -> DecodedFrame:
    """A skipped frame of a known size."""
    stamp_ns, has_stamp = _stamp_or_log_time_ns(frame), _is_plausible_time(frame.stamp_ns)
    return DecodedFrame(index, frame.log_time_ns, stamp_ns, *size, None, has_stamp=has_stamp, is_skipped=True)


def _return_frame_unchanged(frame: DecodedFrame) -> DecodedFrame:
    """The frame itself: the job of a frame that needs no decoding."""
    return frame


def _video_format_name_or_empty(frame: FrameLike) -> str:
    """The format of a video frame; empty for other frames."""
    name = frame.format.lower()
    return name if name in CODEC_OF_VIDEO_FORMAT else ""


def decode_frame(
    index: int, frame: FrameLike, wanted_size_of: SizeOf | None, *, in_colour: bool = False
) -> DecodedFrame:
    """Decode one frame; `wanted_size_of` as in `decode_frames`. Never raises for what the data holds.

    Args:
        in_colour: In colour too, beside grey, if the camera has colour.
    """
    import cv2

    if not 0 <= frame.log_time_ns <= MAX_STAMP_NS:
        return _rejected_frame(index, frame, INVALID_LOG_TIME_REASON)
    is_depth = not frame.encoding and is_compressed_depth(frame.format)
    if frame.encoding:
        width_px, height_px = frame.width, frame.height
        header = None
    else:
        header = read_image_header(frame.data[DEPTH_HEADER.size :] if is_depth else frame.data)
        if header is None:
            return _rejected_frame(index, frame, _unreadable_data_reason(frame))
        width_px, height_px = header.width_px, header.height_px
    reason = _size_rejection_reason_or_empty(width_px, height_px)
    if not reason and header is not None and not has_image_end(frame.data, header.kind):
        reason = "cut short"
    if not reason and header is not None and not is_depth:
        reason = excess_data_reason_or_empty(frame.data, header)
    if reason:
        return _rejected_frame(index, frame, reason)
    wanted_size = wanted_size_of(width_px, height_px) if wanted_size_of else None
    try:
        if header is None:
            image = decode_raw_as_grey(frame) if wanted_size_of else decode_raw_as_colour(frame)
        elif is_depth:
            image = decode_compressed_depth_as_grey(frame.format, frame.data)
            if wanted_size_of is None:
                image = np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), np.uint8)
        else:
            image = _decode_still_image(frame.data, header, wanted_size)
    except (RawImageError, DepthImageError) as error:
        return _rejected_frame(index, frame, str(error))
    decoded = _decoded_frame_at_size(index, frame, image, (width_px, height_px), wanted_size)
    return (
        replace(decoded, colour=_decode_colour_image(frame, header, decoded)) if in_colour and not is_depth else decoded
    )


def _decode_colour_image(frame: FrameLike, header: ImageHeader | None, decoded: DecodedFrame) -> Image | None:
    """The picture in colour, as large as the grey one; None where there is none."""
    if decoded.image is None:
        return None
    height_px, width_px = decoded.image.shape
    if frame.encoding.lower() in GREY_ENCODINGS if header is None else header.is_grey:
        return None
    try:
        if header is None:
            return _resize_image(decode_raw_as_colour(frame), (width_px, height_px))
        return _resize_image(
            _decode_still_image(frame.data, header, (width_px, height_px), in_colour=True), (width_px, height_px)
        )
    except RawImageError:
        return None


def _unreadable_data_reason(frame: FrameLike) -> str:
    """The reason why data without an image's signature can't be read."""
    if not frame.is_video:
        return "neither JPEG, PNG nor WebP"
    known = ", ".join(name for name, codec in CODEC_OF_VIDEO_FORMAT.items() if codec not in UNSUPPORTED_CODECS)
    return f"the video format {frame.format[:MAX_SHOWN_FORMAT_NAME_CHARACTERS]!r} is not known (known: {known})"


def _decode_still_image(
    data: bytes | memoryview, header: ImageHeader, wanted_size: WidthHeightPx | None, *, in_colour: bool = False
) -> Image:
    """Decode a JPEG, PNG or WebP image, reduced as far as the wanted size allows; raises RawImageError where it is
    damaged."""
    import cv2

    flags = cv2.IMREAD_IGNORE_ORIENTATION
    if wanted_size is None:
        flags |= cv2.IMREAD_COLOR
    else:
        flags |= _reduced_decoding_flag(header, wanted_size, "COLOR" if in_colour else "GRAYSCALE")
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error as error:
        raise RawImageError("damaged") from error
    if image is None:
        raise RawImageError("damaged")
    return np.asarray(image, np.uint8)


def _reduced_decoding_flag(header: ImageHeader, wanted_size: WidthHeightPx, kind: str) -> int:
    """The flag of the strongest reduction that leaves at least the wanted size; only JPEG decodes faster by it."""
    import cv2

    if header.kind == "jpeg":
        for factor in JPEG_REDUCTION_FACTORS:
            if header.width_px >= factor * wanted_size[0] and header.height_px >= factor * wanted_size[1]:
                return int(getattr(cv2, f"IMREAD_REDUCED_{kind}_{factor}"))
    return int(getattr(cv2, f"IMREAD_{kind}"))


def _decoded_frame_from_video(
    index: int,
    frame: FrameLike,
    image: Image | None,
    size: WidthHeightPx,
    wanted_size_of: SizeOf | None,
    *,
    in_colour: bool,
) -> DecodedFrame:
    """The decoded frame of a video message: its picture in grey or colour, or the reason why there is none."""
    import cv2

    reason = (
        _size_rejection_reason_or_empty(*size, MAX_VIDEO_PIXELS) if any(size) else "no picture comes out of the video"
    )
    reason = reason if 0 <= frame.log_time_ns <= MAX_STAMP_NS else INVALID_LOG_TIME_REASON
    if reason or image is None:
        return _rejected_frame(index, frame, reason)
    if wanted_size_of is None:
        return _decoded_frame_at_size(index, frame, image, size, None)
    wanted_size = wanted_size_of(*size)
    decoded = _decoded_frame_at_size(
        index, frame, np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8), size, wanted_size
    )
    return replace(decoded, colour=_resize_image(image, wanted_size)) if in_colour else decoded


def _decoded_frame_at_size(
    index: int, frame: FrameLike, image: Image, size: WidthHeightPx, wanted_size: WidthHeightPx | None
) -> DecodedFrame:
    """The decoded frame with its image scaled to the wanted size."""
    if wanted_size is not None:
        image = _resize_image(image, wanted_size)
    return DecodedFrame(
        index,
        frame.log_time_ns,
        _stamp_or_log_time_ns(frame),
        *size,
        image,
        has_stamp=_is_plausible_time(frame.stamp_ns),
    )


def _resize_image(image: Image, wanted_size: WidthHeightPx) -> Image:
    """The image at another size; where it shrinks, each pixel is the mean of those that it covers."""
    if image.shape[1::-1] == wanted_size:
        return image
    import cv2

    shrinks = image.shape[1] >= wanted_size[0] and image.shape[0] >= wanted_size[1]
    scaled = cv2.resize(image, wanted_size, interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)
    return np.asarray(scaled, np.uint8)


def _size_rejection_reason_or_empty(width_px: int, height_px: int, max_pixels: int = MAX_IMAGE_PIXELS) -> str:
    """The reason why an image of this size is rejected; empty where it is not."""
    if width_px * height_px > max_pixels:
        return f"more than {max_pixels // 1_000_000} megapixels"
    if width_px < MIN_IMAGE_SIDE_PX or height_px < MIN_IMAGE_SIDE_PX:
        return f"smaller than {MIN_IMAGE_SIDE_PX} x {MIN_IMAGE_SIDE_PX} pixels"
    if max(width_px, height_px) > MAX_ASPECT_RATIO * min(width_px, height_px):
        return f"one side more than {MAX_ASPECT_RATIO} times as long as the other"
    return ""


def _rejected_frame(index: int, frame: FrameLike, reason: str) -> DecodedFrame:
    """A frame without an image, with the reason."""
    return DecodedFrame(index, frame.log_time_ns, _stamp_or_log_time_ns(frame), 0, 0, None, reason)


def _stamp_or_log_time_ns(frame: FrameLike) -> int:
    """The frame's stamp, or its log time where the stamp is no time."""
    return frame.stamp_ns if frame.stamp_ns is not None and _is_plausible_time(frame.stamp_ns) else frame.log_time_ns


def _is_plausible_time(time_ns: int | None) -> bool:
    """Whether a stamp is a time."""
    return time_ns is not None and MIN_STAMP_NS <= time_ns <= MAX_STAMP_NS
