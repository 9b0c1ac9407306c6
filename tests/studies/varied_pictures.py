"""Labelled road pictures made harder in many kinds, with the labels moved along; for `lane_variants`.

The pictures are grey, 1280 x 720, of a camera taken to be 60 degrees wide and `HEIGHT_M` above the road; its horizon is
where the labels meet. What is drawn on the road or moved along it uses the homography of that flat ground.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np

from cwcli.signals.columns import FloatArray
from cwcli.vision.method import GreyImage

WIDTH_PX, HEIGHT_PX = 1280, 720
FOCAL_PX, HEIGHT_M = 1108.0, 1.48
SCALE = FOCAL_PX * HEIGHT_M
U, V = np.meshgrid(np.arange(WIDTH_PX, dtype=np.float32), np.arange(HEIGHT_PX, dtype=np.float32))
MARK_GREY = 14.0
"""By so much a mark is brighter than both sides."""


@dataclass(frozen=True)
class Picture:
    """A picture and its labels.

    Attributes:
        grey: Shape (720, 1280).
        lanes: Shape (k, h): columns of the labels, negative where there is none.
        rows: Shape (h,).
    """

    grey: GreyImage
    lanes: FloatArray
    rows: FloatArray

    def vanishing(self) -> tuple[float, float]:
        """Column and row where the labels' lower parts meet."""
        lines = []
        for lane in self.lanes:
            ok = lane >= 0.0
            if ok.sum() >= 6:
                near = ok & (self.rows >= np.quantile(self.rows[ok], 0.4))
                lines.append(np.polyfit(self.rows[near], lane[near], 1))
        if len(lines) < 2:
            return 640.0, 300.0
        slope, at = np.array(lines).T
        u, v = np.linalg.lstsq(np.column_stack([np.ones(len(lines)), -slope]), at, rcond=None)[0]
        return float(u), float(v)

    def moved(
        self, grey: GreyImage, place: Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]
    ) -> Picture:
        """Another picture, whose labels are where `place` moves columns and rows."""
        lanes = np.full(self.lanes.shape, -2.0)
        for made, lane in zip(lanes, self.lanes, strict=True):
            ok = lane >= 0.0
            if ok.sum() >= 2:
                u, v = place(lane[ok], self.rows[ok])
                order = np.argsort(v)
                x = np.interp(self.rows, v[order], u[order], left=-2.0, right=-2.0)
                made[:] = np.where((x >= 0.0) & (x < WIDTH_PX), x, -2.0)
        return Picture(grey, lanes, self.rows)


Change = Callable[[Picture, np.random.Generator], Picture]


def _clipped(values: FloatArray) -> GreyImage:
    return np.clip(values, 0, 255).astype(np.uint8)


def mirrored(picture: Picture) -> Picture:
    """Left and right changed."""
    lanes = np.where(picture.lanes >= 0.0, WIDTH_PX - 1.0 - picture.lanes, picture.lanes)
    return Picture(np.ascontiguousarray(picture.grey[:, ::-1]), lanes, picture.rows)


def scaled(by: float, du: float = 0.0, dv: float = 0.0) -> Change:
    """Larger or smaller about a point on the horizon, and moved."""
    matrix = np.array([[by, 0.0, 640.0 * (1.0 - by) + du], [0.0, by, 300.0 * (1.0 - by) + dv]])
    flags = cv2.INTER_AREA if by < 1.0 else cv2.INTER_LINEAR

    def change(picture: Picture, _: np.random.Generator) -> Picture:
        grey = cv2.warpAffine(picture.grey, matrix, (WIDTH_PX, HEIGHT_PX), flags=flags, borderMode=cv2.BORDER_REPLICATE)
        return picture.moved(np.asarray(grey), lambda u, v: (by * u + matrix[0, 2], by * v + matrix[1, 2]))

    return change


def greyed(change: Callable[[FloatArray], FloatArray]) -> Change:
    """Other grey levels."""
    return lambda picture, _: replace(picture, grey=_clipped(change(picture.grey.astype(np.float64))))


def gamma(exponent: float) -> Change:
    """Of the grey levels."""
    return greyed(lambda grey: 255.0 * (grey / 255.0) ** exponent)


def jpeg(quality: int) -> Change:
    """Through a JPEG."""
    return lambda picture, _: replace(
        picture, grey=cv2.imdecode(cv2.imencode(".jpg", picture.grey, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], 0)
    )


def local_contrast(picture: Picture, _: np.random.Generator) -> Picture:
    """Each part of the picture with much contrast."""
    return replace(picture, grey=cv2.createCLAHE(3.0, (8, 8)).apply(picture.grey))


def motion(metres: float) -> Change:
    """Blurred along the road."""

    def change(picture: Picture, _: np.random.Generator) -> Picture:
        u0, v0 = picture.vanishing()
        h = np.maximum(V - v0, 0.0)
        total = np.zeros(h.shape)
        times = np.linspace(0.0, metres, 9)
        for driven in times:
            nearer = np.where(h > 2.0, 1.0 / np.maximum(1.0 + driven * h / SCALE, 0.05), 1.0)
            u, v = (u0 + (U - u0) * nearer).astype(np.float32), (v0 + (V - v0) * nearer).astype(np.float32)
            total += cv2.remap(picture.grey, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return replace(picture, grey=_clipped(total / len(times)))

    return change


def vignette(picture: Picture, _: np.random.Generator) -> Picture:
    """Dark corners."""
    far = ((U - 640.0) ** 2 + (V - 360.0) ** 2) / 640.0**2
    return replace(picture, grey=_clipped(picture.grey / (1.0 + 0.6 * far) ** 2))


def glare(picture: Picture, rng: np.random.Generator) -> Picture:
    """A low sun's band on the road."""
    u0, v0 = picture.vanishing()
    away = (U - u0 - rng.uniform(-250.0, 250.0)) / (60.0 + 0.25 * np.abs(V - v0))
    band = 90.0 * np.exp(-0.5 * away**2) * np.clip((V - v0 + 120.0) / 200.0, 0.0, 1.0)
    return replace(picture, grey=_clipped(0.9 * picture.grey + band))


def bridges(picture: Picture, rng: np.random.Generator) -> Picture:
    """The shadows of two bridges."""
    u0, v0 = picture.vanishing()
    ahead = SCALE / np.maximum(V - v0, 1.0)
    light = np.ones(ahead.shape, np.float32)
    for _ in range(2):
        start, length, slant = rng.uniform(7.0, 40.0), rng.uniform(4.0, 14.0), rng.normal(0.0, 0.15)
        along = ahead * (1.0 - slant * (U - u0) / FOCAL_PX) - start
        soft = (
            1.0
            / (1.0 + np.exp(np.clip(-along / 0.3, -50, 50)))
            / (1.0 + np.exp(np.clip((along - length) / 0.3, -50, 50)))
        )
        light = np.minimum(light, 1.0 - 0.62 * soft * (v0 + 2.0 < V))
    return replace(picture, grey=_clipped(picture.grey * cv2.GaussianBlur(light, (0, 0), 1.0)))


def half_erased(parity: int) -> Change:
    """One in two marks of each line painted over with the road 0.36 m beside it; solid lines in pieces of 3 m."""

    def change(picture: Picture, _: np.random.Generator) -> Picture:
        u0, v0 = picture.vanishing()
        made: FloatArray = picture.grey.astype(np.float64)
        for lane in picture.lanes:
            ok = lane >= 0.0
            if ok.sum() < 4:
                continue
            v = np.arange(int(picture.rows[ok].min()), HEIGHT_PX)
            u = np.interp(v, picture.rows[ok], lane[ok])
            below = v > picture.rows[ok].max()
            u[below] = np.polyval(np.polyfit(picture.rows[ok][-6:], lane[ok][-6:], 1), v[below])
            h = np.maximum(v - v0, 1.0)
            for first, last in _marks(picture.grey, u, v, h)[parity::2]:
                for k in range(max(0, first - 2), min(len(v), last + 3)):
                    _paint_over(picture.grey[v[k]], made[v[k]], u[k], h[k], 1.0 if u[k] < u0 else -1.0)
        return replace(picture, grey=_clipped(made))

    return change


def _marks(grey: GreyImage, u: FloatArray, v: np.ndarray, h: FloatArray) -> list[tuple[int, int]]:
    """First and last of the rows v of each mark along a line."""
    shows = np.array(
        [_contrast(grey[row], at, 0.05 * depth) > MARK_GREY for row, at, depth in zip(v, u, h, strict=True)]
    )
    ahead, pieces, k = SCALE / h, [], 0
    while k < len(v):
        if not shows[k]:
            k += 1
            continue
        last = k
        while last + 1 < len(v) and shows[last + 1 : last + 4].any():
            last += 1
        first = k
        while ahead[first] - ahead[last] > 4.5:
            end = max(first + int(np.argmax(ahead[first] - ahead[first : last + 1] > 3.0)), first + 1)
            pieces.append((first, end))
            first = end
        pieces.append((first, last))
        k = last + 1
    return pieces


def _contrast(row: np.ndarray, at: float, half: float) -> float:
    low, high = max(int(at - 1.5 * half - 1), 0), min(int(at + 1.5 * half + 2), WIDTH_PX)
    left = row[max(0, int(at - 4.5 * half - 2)) : max(1, int(at - 2 * half - 1))]
    right = row[min(WIDTH_PX - 1, int(at + 2 * half + 1)) : min(WIDTH_PX, int(at + 4.5 * half + 3))]
    if high <= low or not len(left) or not len(right):
        return 0.0
    middle = cv2.blur(row[None, low:high], (max(1, int(half)), 1)).max()
    return float(middle) - max(left.mean(), right.mean())


def _paint_over(row: np.ndarray, made: FloatArray, at: float, h: float, inward: float) -> None:
    half, shift = max(2.0, 0.09 * h), inward * max(4.0, 0.24 * h)
    low, high = int(at - half), int(at + half + 1)
    if min(low, low + shift) < 0 or max(high, high + shift) >= WIDTH_PX:
        return
    u = np.arange(low, high)
    share = np.clip((half - np.abs(u - at)) / 1.5, 0.0, 1.0)
    made[low:high] += share * (np.interp(u + shift, np.arange(WIDTH_PX), row) - made[low:high])


def beside(metres: float) -> Change:
    """Of a camera so far to the left, or the right where negative."""
    share = metres / HEIGHT_M

    def change(picture: Picture, _: np.random.Generator) -> Picture:
        v0 = picture.vanishing()[1]
        u = (U - share * np.maximum(V - v0, 0.0)).astype(np.float32)
        grey = cv2.remap(picture.grey, u, V, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return picture.moved(np.asarray(grey), lambda u, v: (u + share * np.maximum(v - v0, 0.0), v))

    return change


def turned(yaw_rad: float, pitch_rad: float) -> Change:
    """Of a camera that is turned."""
    lens = np.array([[FOCAL_PX, 0.0, 640.0], [0.0, FOCAL_PX, 360.0], [0.0, 0.0, 1.0]])
    sine, cosine = np.sin([yaw_rad, pitch_rad]), np.cos([yaw_rad, pitch_rad])
    yaw = np.array([[cosine[0], 0.0, sine[0]], [0.0, 1.0, 0.0], [-sine[0], 0.0, cosine[0]]])
    pitch = np.array([[1.0, 0.0, 0.0], [0.0, cosine[1], -sine[1]], [0.0, sine[1], cosine[1]]])
    matrix = lens @ yaw @ pitch @ np.linalg.inv(lens)

    def place(u: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        x, y, z = matrix @ np.vstack([u, v, np.ones_like(u)])
        return x / z, y / z

    def change(picture: Picture, _: np.random.Generator) -> Picture:
        grey = cv2.warpPerspective(picture.grey, matrix, (WIDTH_PX, HEIGHT_PX), borderMode=cv2.BORDER_REPLICATE)
        return picture.moved(np.asarray(grey), place)

    return change


def three_together(picture: Picture, rng: np.random.Generator) -> Picture:
    """Moved, turned, and three others, each of any strength."""
    share = float(rng.uniform(0.5, 0.9))
    choice: list[Change] = [
        jpeg(int(rng.integers(20, 60))),
        motion(float(rng.uniform(0.2, 0.7))),
        vignette,
        glare,
        bridges,
        half_erased(int(rng.integers(2))),
        gamma(float(rng.uniform(0.5, 2.0))),
        greyed(lambda grey: share * grey + 100.0 * (1.0 - share)),
    ]
    place = beside(float(rng.uniform(-0.37, 0.37))), turned(*rng.uniform(-0.015, 0.015, 2).tolist())
    for change in (*place, *(choice[k] for k in rng.choice(len(choice), 3, replace=False))):
        picture = change(picture, rng)
    return picture
