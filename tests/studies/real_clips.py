"""Clips made of a real video, varied as cameras, weather, roads and recorders vary it.

The lanes of the video are those that were found in it as it is, and looked at. Every clip is made from a seed. Pictures
stay outside of the project.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from cwcli.logs.read.reader import Log
from cwcli.signals.columns import FloatArray
from cwcli.vision.camera import Mounting, default_camera
from cwcli.vision.frames import decode_frames
from cwcli.vision.lane_model import LANE_WIDTH_MEAN_AND_SIGMA_M
from cwcli.vision.lane_tracker import LaneTracker, search_size
from cwcli.vision.method import GreyImage, LaneFrame
from tests.studies.lane_halves import IMAGES, drawn

SHARED = Path(__file__).parents[2].parent / "shared"
VIDEO = SHARED / "logs" / "udacity-solid-white-right.mcap"
RATE_HZ = 25.0
SPEED_MPS = 25.0
SECOND_NS = 1_000_000_000


@dataclass(frozen=True)
class Shot:
    """A frame of a clip.

    Attributes:
        grey: Of the camera's size.
        stamp_ns: Its time.
        lines: Shape (2, height): columns of the true boundaries in every row; NaN where they are not known.
        horizon_px: Its row.
        speed_mps, yaw_rate_radps: As told to the search; NaN: not told.
        is_cut: The scene is another one than in the frame before.
    """

    grey: GreyImage
    stamp_ns: int
    lines: FloatArray
    horizon_px: float
    speed_mps: float = math.nan
    yaw_rate_radps: float = math.nan
    is_cut: bool = False


@dataclass(frozen=True)
class Video:
    """A drive with its lanes: greys of n frames, lines (n, 2, height) and horizons (n,)."""

    greys: list[GreyImage]
    lines: FloatArray
    horizon_px: FloatArray

    def mirrored(self) -> Video:
        """Seen in a mirror."""
        width = self.greys[0].shape[1]
        greys = [np.ascontiguousarray(grey[:, ::-1]) for grey in self.greys]
        return Video(greys, width - 1.0 - self.lines[:, ::-1], self.horizon_px)


def read_video(path: Path = VIDEO, frames: int | None = None) -> Video:
    """The drive, with the lanes that the default method finds in it as it is."""
    greys = []
    with Log.open(path) as log:
        for frame in decode_frames(
            log.frames(IMAGES), wanted_size_of=lambda width, height: (width, height), where=path.name
        ):
            assert frame.image is not None
            greys.append(np.array(frame.image))
            if len(greys) == frames:
                break
    height, width = greys[0].shape
    camera = default_camera(width, height, Mounting()).with_image_size(*search_size(width, height))
    search, rows = LaneTracker(), np.arange(float(height))
    lines, horizons = [], []
    for k, grey in enumerate(greys):
        small = cv2.resize(grey, (camera.width_px, camera.height_px), interpolation=cv2.INTER_AREA)
        fit = search.step(LaneFrame(small, camera, round(k * SECOND_NS / RATE_HZ), k))
        lines.append(drawn(fit, camera, rows, height))
        horizons.append((float(camera.horizon_row_px(np.array(fit.pitch_rad))) + 0.5) * height / camera.height_px - 0.5)
    return Video(greys, np.array(lines), np.array(horizons))


Change = Callable[["Scene"], GreyImage]


@dataclass(frozen=True)
class Scene:
    """What a change of the picture may use.

    Attributes:
        grey: The picture.
        lines: Shape (2, height): its boundaries' columns.
        horizon_px: Its row.
        number: Of the frame in the clip.
        rng: Random numbers of the clip.
        is_aside: The clip is one that was kept aside.
    """

    grey: npt.NDArray[np.float32]
    lines: FloatArray
    horizon_px: float
    number: int
    rng: np.random.Generator
    is_aside: bool

    @property
    def rows(self) -> FloatArray:
        """Shape (height, 1)."""
        return np.arange(float(self.grey.shape[0]))[:, None]

    @property
    def columns(self) -> FloatArray:
        """Shape (1, width)."""
        return np.arange(float(self.grey.shape[1]))[None]

    @property
    def ahead_m(self) -> FloatArray:
        """Shape (height, 1): of the road under the assumed camera; infinite above the horizon."""
        height, width = self.grey.shape
        camera = default_camera(width, height, Mounting())
        h = self.rows - self.horizon_px
        return np.where(h > 1.0, camera.fy * camera.mounting.height_m / np.maximum(h, 1.0), np.inf)


def as_bytes(grey: FloatArray | npt.NDArray[np.float32]) -> GreyImage:
    return np.asarray(np.clip(np.rint(grey), 0, 255), np.uint8)


def _noisy(sigma: float, gain: float = 1.0) -> Change:
    return lambda scene: as_bytes(gain * scene.grey + scene.rng.normal(0.0, sigma, scene.grey.shape).astype(np.float32))


def _gamma(scene: Scene) -> GreyImage:
    return as_bytes(255.0 * (scene.grey / 255.0) ** (2.2 if scene.is_aside else 0.45))


def _jpeg(scene: Scene) -> GreyImage:
    _, data = cv2.imencode(".jpg", as_bytes(scene.grey), [cv2.IMWRITE_JPEG_QUALITY, 30])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE), np.uint8)


def _blurred(scene: Scene) -> GreyImage:
    if scene.is_aside:
        return as_bytes(cv2.blur(scene.grey, (3, 17)))
    return as_bytes(cv2.GaussianBlur(scene.grey, (0, 0), 2.5))


def _erased(scene: Scene, share: float = 1.0, every: int = 75, last: int = 25) -> GreyImage:
    """The dashed line's paint gone for a second, or worn (share below 1): the road beside it is laid over it."""
    if scene.number % every < every - last:
        return as_bytes(scene.grey)
    made = scene.grey.copy()
    per_m = (scene.lines[1] - scene.lines[0]) / LANE_WIDTH_MEAN_AND_SIGMA_M[0]
    side = 0 if not scene.is_aside else 1  # the dashed one
    for row in range(len(made)):
        if np.isfinite(per_m[row]) and row > scene.horizon_px + 3:
            half = max(2, round(0.25 * per_m[row]))
            middle = round(scene.lines[side, row])
            if half <= middle - 2 * half and middle + half < made.shape[1]:
                over = made[row, middle - 3 * half : middle - half]
                place = slice(middle - half, middle - half + len(over))
                made[row, place] += share * (over[: made[row, place].size] - made[row, place])
    return as_bytes(made)


def _bridge(scene: Scene) -> GreyImage:
    """The shadow of a bridge, 10 m long, passed every two seconds."""
    begins_m = 70.0 - (scene.number % 50) * SPEED_MPS / RATE_HZ * 1.6
    ahead = scene.ahead_m
    shade = ((ahead > begins_m) & (ahead < begins_m + 10.0)).astype(np.float32)
    shade = cv2.GaussianBlur(np.repeat(shade, scene.grey.shape[1], axis=1), (0, 0), 1.5)
    return as_bytes(scene.grey * (1.0 - (0.75 if scene.is_aside else 0.6) * shade))


def _glare(scene: Scene) -> GreyImage:
    """The low sun: a bright spot above the horizon, its veil, and a band on the road below it."""
    height, width = scene.grey.shape
    u0 = width * (0.35 if scene.is_aside else 0.55) + 20.0 * math.sin(scene.number / 9.0)
    spot = np.exp(-(((scene.columns - u0) / (0.2 * width)) ** 2) - ((scene.rows - 0.5 * height) / (0.3 * height)) ** 2)
    band = np.exp(-(((scene.columns - u0) / (0.05 * width)) ** 2)) * (scene.rows > scene.horizon_px)
    flicker = 1.0 + 0.2 * math.sin(scene.number / 4.0)
    return as_bytes(60.0 + 0.6 * scene.grey + flicker * (130.0 * spot + 45.0 * band))


def _truck(scene: Scene) -> GreyImage:
    """A grey block with a bright edge that stands over one boundary for half a second."""
    at = scene.number % 60
    if at < 40 or at > 52:
        return as_bytes(scene.grey)
    height, width = scene.grey.shape
    side = 1 if scene.is_aside else 0
    row = min(height - 1, round(scene.horizon_px + 0.75 * (height - scene.horizon_px)))
    middle = round(float(np.nan_to_num(scene.lines[side, row], nan=width / 3)))
    made = scene.grey.copy()
    left, right = max(0, middle - width // 7), min(width, middle + width // 9)
    made[: row + 1, left:right] = 95.0 + 12.0 * scene.rng.standard_normal((row + 1, right - left))
    for edge in (left, right - 5):
        made[: row + 1, edge : edge + 5] = 190.0
    made[row - 6 : row + 1, left:right] = 30.0
    return as_bytes(made)


def _wiper(scene: Scene) -> GreyImage:
    """A dark blade that sweeps through the picture in half a second, every 1.5 s."""
    at = (scene.number % 38) / 12.0
    if at > 1.0:
        return as_bytes(scene.grey)
    height, width = scene.grey.shape
    angle = math.radians(170.0 - 160.0 * at)
    across = abs((scene.columns - 0.5 * width) * math.sin(angle) + (scene.rows - 1.1 * height) * math.cos(angle))
    return as_bytes(np.where(across < 0.025 * width, 25.0, scene.grey))


def _exposure(scene: Scene) -> GreyImage:
    """Into the shade of a bridge and out: half as bright at once, then too bright, then as before."""
    at = scene.number % 60
    gain = 1.0 if at < 30 else 0.35 if at < 38 else 2.2 if at < 42 else 1.4
    return as_bytes(gain * scene.grey)


def _text(scene: Scene) -> GreyImage:
    """The date and the speed that many cameras burn into their frames, and the bonnet below."""
    made = as_bytes(scene.grey)
    height, width = made.shape
    cv2.ellipse(made, (width // 2, round(1.12 * height)), (round(0.55 * width), round(0.2 * height)), 0, 0, 360, 40, -1)
    at = (width // 3 if scene.is_aside else 10, height - 14)
    text = f"2017/05/14 10:{scene.number // 60:02}:{scene.number % 60:02}  90 km/h"
    cv2.putText(made, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.8, 255, 2, cv2.LINE_AA)
    return made


VIDEO_KINDS: dict[str, Change] = {
    "as it is": lambda scene: as_bytes(scene.grey),
    "dim": lambda scene: as_bytes((0.2 if scene.is_aside else 0.3) * scene.grey),
    "noisy": _noisy(15.0),
    "dim and noisy": _noisy(7.0, 0.35),
    "blurred": _blurred,
    "JPEG 30": _jpeg,
    "gamma": _gamma,
    "cropped": lambda scene: as_bytes(scene.grey),
    "half rate": lambda scene: as_bytes(scene.grey),
    "third rate": lambda scene: as_bytes(scene.grey),
    "frames twice": lambda scene: as_bytes(scene.grey),
    "frames dropped": lambda scene: as_bytes(scene.grey),
    "backwards": lambda scene: as_bytes(scene.grey),
    "shaken": lambda scene: as_bytes(scene.grey),
    "cut": lambda scene: as_bytes(scene.grey),
    "dashes gone": _erased,
    "dashes worn": lambda scene: _erased(scene, 0.75, 100, 75),
    "bridges": _bridge,
    "glare": _glare,
    "truck": _truck,
    "wiper": _wiper,
    "exposure": _exposure,
    "text and bonnet": _text,
}
"""What is done to a picture; what is done to the order of the frames, and where they lie, is in `video_clip`."""


def _order(kind: str, n: int, rng: np.random.Generator) -> list[tuple[int, float]]:
    """The numbers of the frames that are shown, and their times in frames."""
    if kind in ("half rate", "third rate"):
        return [(k, float(k)) for k in range(0, n, 2 if kind == "half rate" else 3)]
    if kind == "frames twice":
        return [(k // 2, float(k)) for k in range(n)]
    if kind == "backwards":
        return [(n - 1 - k, float(k)) for k in range(n)]
    if kind == "frames dropped":
        kept, k = [], 0
        while k < n:
            kept.append((k, float(k)))
            k += 1 + (int(rng.integers(1, 9)) if rng.random() < 0.15 else 0)
        return kept
    return [(k, float(k)) for k in range(n)]


def video_clip(video: Video, kind: str, *, is_aside: bool, seed: int = 0) -> Iterator[Shot]:
    """The drive, varied.

    Args:
        video: As it is.
        kind: A key of `VIDEO_KINDS`.
        is_aside: The variant that was kept aside while the method was changed: mirrored, other places and strengths.
        seed: Of the random numbers.
    """
    rng = np.random.default_rng([seed, int(is_aside), list(VIDEO_KINDS).index(kind)])
    shown = video.mirrored() if is_aside else video
    other = video if is_aside else video.mirrored()
    change = VIDEO_KINDS[kind]
    height, width = shown.greys[0].shape
    rows = np.arange(float(height))
    for number, (k, time) in enumerate(_order(kind, len(shown.greys), rng)):
        is_other = kind == "cut" and (number // 60) % 2 == 1
        source = other if is_other else shown
        grey, lines, horizon = source.greys[k], source.lines[k], float(source.horizon_px[k])
        if kind == "shaken":
            down = float(rng.normal(0.0, 0.006 * height))
            shift = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, down]])
            grey = np.asarray(cv2.warpAffine(grey, shift, (width, height), borderMode=cv2.BORDER_REPLICATE))
            lines = np.array([np.interp(rows - down, rows, line, right=np.nan) for line in lines])
            horizon += down
        grey = change(Scene(grey.astype(np.float32), lines, horizon, number, rng, is_aside))
        if kind == "cropped":
            side, top = (80, 40) if is_aside else (40, 0)
            grey = np.ascontiguousarray(grey[top : height - 40 + top, side : width - side])
            lines, horizon = lines[:, top : height - 40 + top] - side, horizon - top
        is_cut = kind == "cut" and number % 60 == 0 and number > 0
        yield Shot(grey, round(time * SECOND_NS / RATE_HZ), lines, horizon, is_cut=is_cut)
