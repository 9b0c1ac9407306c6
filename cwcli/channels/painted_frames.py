"""A channel of the camera's frames with drawings on them; the frames are painted while the log is written."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping

import numpy as np
import numpy.typing as npt

from cwcli.errors import UsageError
from cwcli.logs.read.reader import Log
from cwcli.signals.columns import Int64Array, OutputField, Ragged, StreamedChannel, repeat_string
from cwcli.vision.encoded import Image
from cwcli.vision.frames import DecodedFrame
from cwcli.vision.overlay import encode_jpeg

StartImages = Callable[[Callable[[DecodedFrame], object]], Iterator[DecodedFrame]]
ByteArray = npt.NDArray[np.uint8]
RENDERED_FRAME_SCHEMA = "foxglove.CompressedImage"
"""Schema of rendered frames."""
TOPIC_NAME_PATTERN = re.compile(r"(/[^/\s\x00-\x1f\x7f]+)+")
"""Pattern of a topic name: parts that begin with a slash, without spaces and control characters."""


def painted_frames_channel(
    topic: str,
    *,
    stamp_ns: Int64Array,
    log_time_ns: Int64Array,
    frame_id: str,
    images: StartImages,
    row_of: Callable[[DecodedFrame], int],
    paint: Callable[[int, Image], Image],
) -> StreamedChannel:
    """Make a channel of n painted frames as JPEG `foxglove.CompressedImage`.

    Args:
        stamp_ns, log_time_ns: Shape (n,).
        images: Restarts the camera's frames in colour and calls its argument with each frame, in the decoder's thread.
        row_of: Row of a frame, increasing from frame to frame; -1 if the frame has none.
        paint: Row and colour image (height, width, 3) -> the image to publish. Called in several threads.
    """
    painting = _FramePainter(images, row_of, paint)

    def build_fields_of_rows(start: int, stop: int) -> Mapping[str, OutputField]:
        jpeg_files = painting.jpeg_files_of_rows(start, stop)
        n = stop - start
        offsets = np.concatenate([[0], np.cumsum([len(each) for each in jpeg_files])]).astype(np.int64)
        return {
            "timestamp": stamp_ns[start:stop],
            "frame_id": repeat_string(frame_id, n),
            "data": Ragged(np.concatenate(jpeg_files) if jpeg_files else np.zeros(0, np.uint8), offsets),
            "format": repeat_string("jpeg", n),
        }

    return StreamedChannel(topic, "foxglove.CompressedImage", log_time_ns, make_rows=build_fields_of_rows)


class _FramePainter:
    """Decodes and paints the camera's frames as their rows are requested.

    The rows of the last request are kept, because the next request may begin among them; a request that begins earlier
    restarts the frames.
    """

    def __init__(
        self, images: StartImages, row_of: Callable[[DecodedFrame], int], paint: Callable[[int, Image], Image]
    ) -> None:
        self._start_images = images
        self._row_of = row_of
        self._paint = paint
        self._images: Iterator[DecodedFrame] = iter(())
        self._kept: list[ByteArray] = []
        self._kept_from = 0
        self._is_started = False

    def jpeg_files_of_rows(self, start: int, stop: int) -> list[ByteArray]:
        end = self._kept_from + len(self._kept)
        if not self._is_started or not self._kept_from <= start <= end:
            self._images, self._is_started = self._start_images(self._paint_frame), True
            self._kept, self._kept_from, end = [], start, start
        self._kept, self._kept_from = self._kept[start - self._kept_from :], start
        for decoded in self._images if end < stop else ():
            row = self._row_of(decoded)
            if row >= end and isinstance(decoded.prepared, np.ndarray):
                self._kept.append(decoded.prepared)
            if row == stop - 1:
                break
        if len(self._kept) < stop - start:
            raise RuntimeError(f"{len(self._kept)} of {stop - start} frames could be decoded again")
        return self._kept[: stop - start]

    def _paint_frame(self, decoded: DecodedFrame) -> ByteArray | None:
        row = self._row_of(decoded)
        return None if row < 0 or decoded.image is None else encode_jpeg(self._paint(row, decoded.image))


def check_topic_name_if_given(topic: str | None) -> None:
    """Refuse a topic for rendered frames that is not a valid topic name.

    Raises:
        UsageError: It is not valid.
    """
    if topic is not None and not TOPIC_NAME_PATTERN.fullmatch(topic):
        raise UsageError(f"--render {topic!r} is not the name of a topic", hint="for example --render /cwcli/camera")


def check_render_topic_is_free(log: Log, topic: str | None, camera_topic: str) -> None:
    """Refuse a topic for rendered frames that is invalid or that another channel has.

    A channel of compressed images may have it: an earlier run may have written that, and `--replace` removes it.

    Raises:
        UsageError: It is invalid, the camera's own, or of a channel of another schema.
    """
    if topic is None:
        return
    from cwcli.channels.published import schema_name_by_published_topic

    check_topic_name_if_given(topic)
    if topic == camera_topic:
        raise UsageError(f"--render {topic} is the camera's own topic", hint="name another one")
    schema_of_topic = next((each.schema_name for each in log.channels if each.topic == topic), "")
    schema_of_topic = schema_name_by_published_topic().get(topic, schema_of_topic)
    if schema_of_topic not in ("", RENDERED_FRAME_SCHEMA):
        raise UsageError(f"--render {topic} is the topic of {schema_of_topic}", hint="name another one")
