"""Video: the frames as JPEG, with the times of one source that the user names.

`--times pts` takes those in the container, which count from its start (and from `--start`, where given); `--times FILE`
a file with one a line; `--times 30Hz` a rate.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from cwcli.errors import DataError, InputError
from cwcli.importing.readers.base import FileHead, ImportKind, WrittenChannel
from cwcli.importing.readers.trajectory import find_stamps_of_rows
from cwcli.importing.tables import Answers, Guess, Question
from cwcli.importing.times import parse_start_ns
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.write.writer import LogWriter
from cwcli.signals.columns import Int64Array, OutputField, Ragged, StreamedChannel, Strings

CAMERA_TOPIC, CAMERA_SCHEMA = "/camera/image", "foxglove.CompressedImage"
"""Topic and schema of the frames."""
FRAME_JPEG_QUALITY_PERCENT = 90
"""Quality of the frames, 0 to 100; chosen by hand."""


def _accepts_video_file(head: FileHead) -> bool:
    is_mp4 = head.data[4:8] == b"ftyp"
    is_other = head.data.startswith((b"\x1a\x45\xdf\xa3",)) or (head.data[:4] == b"RIFF" and head.data[8:12] == b"AVI ")
    return is_mp4 or is_other


def _read_video_file(path: str, answers: Answers) -> Sequence[Video]:
    if not answers.frame_times:
        raise Question(
            path,
            "the times of a video's frames are not those of other sensors",
            "--times pts (those in the video), --times FILE with one a line, or --times 30Hz",
        ).as_error()
    pts_ns = _container_times_ns(path)
    if answers.frame_times == "pts":
        stamps, why = pts_ns, "times in the container"
    else:
        stamps, why = find_stamps_of_rows(path, answers, len(pts_ns))
    if (np.diff(stamps) <= 0).any():
        raise DataError("the times of the frames do not advance", where=path, hint="--times FILE or --times 30Hz")
    start_ns = parse_start_ns(answers.start) if answers.start else 0
    return [Video(path, stamps + start_ns, why)]


def _container_times_ns(path: str) -> Int64Array:
    """Return the time of each frame in the container, ns.

    Raises:
        InputError: It can't be decoded.
    """
    times = [pts_ms for pts_ms, _ in _iter_frames(path, decode=False)]
    if not times:
        raise InputError("no frame can be decoded", where=path, hint="OpenCV decodes H.264, H.265, VP9 and MJPEG")
    return np.rint(np.array(times) * 1e6).astype(np.int64)


def _iter_frames(path: str, *, decode: bool) -> Iterator[tuple[float, Any]]:
    """Yield time in ms and image of each frame; the image is None unless it is asked for."""
    import cv2

    video = cv2.VideoCapture(path)
    try:
        while video.grab():
            pts_ms = float(video.get(cv2.CAP_PROP_POS_MSEC))
            image = None
            if decode:
                is_good, image = video.retrieve()
                if not is_good:
                    continue
            yield pts_ms, image
    finally:
        video.release()


@dataclass(frozen=True)
class Video:
    """The frames of a video, decoded when they are written.

    Attributes:
        name: The file.
        stamp_ns: Shape (n,).
        why: Where the times come from.
    """

    name: str
    stamp_ns: Int64Array
    why: str

    @property
    def guesses(self) -> Sequence[Guess]:
        """The times were named."""
        return (Guess("time", "frames", "", "given", self.why),)

    @property
    def topics(self) -> Sequence[WrittenChannel]:
        """One channel of images."""
        return [WrittenChannel(CAMERA_TOPIC, CAMERA_SCHEMA, len(self.stamp_ns))]

    def write(self, log: LogWriter) -> None:
        """Write the frames one after the other."""
        frames = _JpegRows(self.name)

        def rows(start: int, stop: int) -> Mapping[str, OutputField]:
            images = frames.encoded_frames_of_rows(start, stop)
            n = len(images)
            offsets = np.concatenate([[0], np.cumsum([len(image) for image in images])]).astype(np.int64)
            return {
                "timestamp": self.stamp_ns[start:stop],
                "frame_id": Strings(np.zeros(n, np.int32), ("camera",)),
                "format": Strings(np.zeros(n, np.int32), ("jpeg",)),
                "data": Ragged(np.concatenate(images), offsets),
            }

        log.write_columns(StreamedChannel(CAMERA_TOPIC, CAMERA_SCHEMA, self.stamp_ns, make_rows=rows))


class _JpegRows:
    """The JPEG images of a video's frames, read in spans that move forward."""

    def __init__(self, path: str) -> None:
        self._path = path
        self._start = 0
        self._kept: list[Any] = []
        self._frames = _iter_frames(path, decode=True)

    def encoded_frames_of_rows(self, start: int, stop: int) -> list[Any]:
        """Return the frames `start` to `stop` as bytes in arrays."""
        import cv2

        if start < self._start:  # after the first look
            self._start, self._kept, self._frames = 0, [], _iter_frames(self._path, decode=True)
        while self._start + len(self._kept) < stop:
            found = next(self._frames, None)
            if found is None:
                raise DataError("a frame can't be decoded", where=self._path)
            _, data = cv2.imencode(".jpg", found[1], [cv2.IMWRITE_JPEG_QUALITY, FRAME_JPEG_QUALITY_PERCENT])
            self._kept.append(np.asarray(data).reshape(-1))
            if self._start + len(self._kept) <= start:
                self._start += len(self._kept)
                self._kept = []
        first = start - self._start
        self._start, self._kept = start, self._kept[first:]
        return self._kept[: stop - start]


KIND = ImportKind(
    "video (mp4, mkv, avi), with the times of its frames",
    (".mp4", ".mkv", ".avi"),
    _accepts_video_file,
    _read_video_file,
)
"""How video files are recognised and read, for the table of import formats."""
