"""Bad weather laid over labelled road pictures; for `lane_variants`. Severe and made up: it ranks methods, no more.

Each kind draws its strength and its places from the random numbers that it gets. The ground is that of
`varied_pictures`.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from cwcli.signals.columns import FloatArray
from tests.studies.varied_pictures import FOCAL_PX, HEIGHT_PX, SCALE, U, V, WIDTH_PX, Change, Picture, _clipped

Float32 = np.float32


def _ground(picture: Picture) -> tuple[float, float, FloatArray]:
    """The vanishing point, and the distance ahead of each pixel in metres; 999 at and above the horizon."""
    u0, v0 = picture.vanishing()
    return u0, v0, np.where(v0 + 1.0 < V, SCALE / np.maximum(V - v0, 1.0), 999.0)


def night(picture: Picture, rng: np.random.Generator) -> Picture:
    """Headlights on the road, darkness elsewhere, lamps of oncoming cars, and a sensor's noise."""
    u0, v0, ahead = _ground(picture)
    right_m = (U - u0) * ahead / FOCAL_PX
    beam = 1.1 / (1.0 + (ahead / rng.uniform(14.0, 24.0)) ** 2) * np.exp(-0.5 * (right_m / (2.0 + 0.12 * ahead)) ** 2)
    grey = picture.grey * (0.06 + beam * (v0 < V))
    for _ in range(int(rng.integers(1, 4))):
        at_u, at_v, size = u0 + rng.uniform(-350.0, 350.0), v0 + rng.uniform(-10.0, 25.0), rng.uniform(6.0, 22.0)
        away = np.hypot(U - at_u, V - at_v)
        grey = grey + 220.0 * np.exp(-0.5 * (away / size) ** 2) + 30.0 * np.exp(-away / (5.0 * size))
    return replace(picture, grey=_clipped(grey + _grain(rng, rng.uniform(3.0, 6.0))))


def rain(picture: Picture, rng: np.random.Generator) -> Picture:
    """Streaks, drops on the windscreen, a wet road that mirrors the sky, little contrast."""
    _, v0, _ = _ground(picture)
    blurred = cv2.GaussianBlur(picture.grey, (0, 0), 1.2).astype(Float32)
    mirror = cv2.GaussianBlur(np.ascontiguousarray(picture.grey[::-1]), (0, 0), 12.0).astype(Float32)
    wet = np.clip((V - v0) / 60.0, 0.0, 1.0) * rng.uniform(0.2, 0.4)
    grey = (1.0 - wet) * blurred * 0.75 + wet * mirror + 18.0
    streaks = (rng.random((HEIGHT_PX, WIDTH_PX)) < 0.0004).astype(Float32) * 255.0
    kernel = np.zeros((31, 31), Float32)
    lean = int(rng.integers(-6, 7))
    cv2.line(kernel, (15 - lean, 0), (15 + lean, 30), 1.0, 1)
    grey = grey + 1.5 * cv2.filter2D(streaks, -1, kernel / kernel.sum() * 6.0)
    for _ in range(40):
        at, size = (int(rng.integers(WIDTH_PX)), int(rng.integers(HEIGHT_PX))), int(rng.integers(4, 16))
        drop = np.zeros_like(grey)
        cv2.circle(drop, at, size, 1.0, -1)
        share = cv2.GaussianBlur(drop, (0, 0), 2.0) * 0.6
        grey = (1.0 - share) * grey + share * float(grey[at[1], at[0]] * 0.6 + 60.0)
    return replace(picture, grey=_clipped(grey + _grain(rng, 2.0)))


def veiling_glare(picture: Picture, rng: np.random.Generator) -> Picture:
    """A low sun: a veil over everything, and its mirror image on the road."""
    u0, v0, _ = _ground(picture)
    at = u0 + rng.uniform(-250.0, 250.0)
    away = np.hypot(U - at, 1.4 * (V - v0 + 80.0))
    veil = rng.uniform(90.0, 130.0) * np.exp(-away / 420.0) + 25.0
    band = 110.0 * np.exp(-0.5 * ((U - at) / (40.0 + 0.2 * np.abs(V - v0))) ** 2) * (v0 < V)
    return replace(picture, grey=_clipped(0.6 * picture.grey + veil + band))


def shadow_stripes(picture: Picture, rng: np.random.Generator) -> Picture:
    """Shadows of trees, posts and railings across the road and along it, and bright spots between leaves."""
    u0, v0, ahead = _ground(picture)
    right_m = (U - u0) * ahead / FOCAL_PX
    slant = rng.normal(0.0, 1.2)
    along = ahead + slant * right_m
    period, part = rng.uniform(1.5, 5.0), rng.uniform(0.3, 0.6)
    stripes = ((along / period + rng.random()) % 1.0 < part).astype(Float32)
    cells = cv2.resize(rng.random((64, 64)).astype(Float32), (512, 512), interpolation=cv2.INTER_CUBIC)
    x = ((right_m * 24.0) % 512).astype(Float32)
    y = ((ahead * 12.0) % 512).astype(Float32)
    leaves = cv2.remap(cells, x, y, cv2.INTER_LINEAR) > 0.55
    shade = np.where(right_m < rng.uniform(-2.0, 2.0), stripes, leaves.astype(Float32)) * (v0 + 3.0 < V) * (ahead < 70)
    shade = cv2.GaussianBlur(shade.astype(Float32), (0, 0), 1.2)
    return replace(picture, grey=_clipped(picture.grey * (1.0 - rng.uniform(0.45, 0.65) * shade)))


def shaken_blur(picture: Picture, rng: np.random.Generator) -> Picture:
    """Moved while the shutter was open, in any direction."""
    length, angle = rng.uniform(9.0, 19.0), rng.uniform(0.0, np.pi)
    kernel = np.zeros((25, 25), Float32)
    du, dv = 0.5 * length * np.cos(angle), 0.5 * length * np.sin(angle)
    cv2.line(kernel, (round(12 - du), round(12 - dv)), (round(12 + du), round(12 + dv)), 1.0, 1, cv2.LINE_AA)
    return replace(picture, grey=np.asarray(cv2.filter2D(picture.grey, -1, kernel / kernel.sum())))


def haze(picture: Picture, rng: np.random.Generator) -> Picture:
    """Fog: the farther away, the less contrast."""
    _, _, ahead = _ground(picture)
    left = np.exp(-np.minimum(ahead, 300.0) / rng.uniform(18.0, 35.0))
    return replace(picture, grey=_clipped(picture.grey * 0.8 * left + 165.0 * (1.0 - left) + _grain(rng, 1.5)))


def dark_and_noisy(picture: Picture, rng: np.random.Generator) -> Picture:
    """Dusk without lamps."""
    return replace(picture, grey=_clipped(picture.grey * rng.uniform(0.15, 0.3) + _grain(rng, rng.uniform(4.0, 7.0))))


def _grain(rng: np.random.Generator, sigma: float) -> FloatArray:
    return rng.normal(0.0, sigma, (HEIGHT_PX, WIDTH_PX))


WEATHER: dict[str, Change] = {
    "night": night,
    "rain": rain,
    "sun": veiling_glare,
    "shadow stripes": shadow_stripes,
    "shaken": shaken_blur,
    "fog": haze,
    "dark and noisy": dark_and_noisy,
}
"""Kinds of weather; a seed of its own draws each picture's strength and places."""
