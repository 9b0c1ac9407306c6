"""Sky, haze, glare, rain and the image sensor, drawn into the image."""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt

from cwcli.signals.columns import FloatArray
from cwcli.simulation.road.camera import RoadCamera
from cwcli.simulation.road.geometry import RoadAhead
from cwcli.simulation.road.scene import Light, RoadScene
from cwcli.simulation.road.surface import Float32Array

NIGHT_SKY_GREY = 14.0
"""Grey of the sky at night, 0 to 255. Chosen by hand; not fitted."""
READ_NOISE_GREY = 1.6
"""Standard deviation of the sensor's noise in the dark, grey levels. Chosen by hand; not fitted."""
SHOT_NOISE_VARIANCE_PER_GREY = 0.035
"""Variance of the sensor's noise per grey level, which adds to that in the dark, grey levels. Chosen by hand; not
fitted."""
CORNER_LIGHT_LOSS_SHARE = 0.22
"""Share of light that is lost in the image's corners, 0 to 1. Chosen by hand; not fitted."""


@cache
def _skyline_heights_rad(seed: int) -> Float32Array:
    """Height of hills and woods over the horizon in 4096 directions, shape (4096,), rad."""
    rng = np.random.default_rng([seed, 7])
    freq = np.fft.rfftfreq(4096, 1 / 4096)
    phases = np.exp(2j * np.pi * rng.random(len(freq)))
    hills = np.fft.irfft(phases * (freq > 1) / np.maximum(freq, 1.0) ** 1.1 * np.exp(-freq / 900), 4096)
    return np.asarray(0.012 + 0.006 * hills / hills.std(), np.float32).clip(0.002)


def draw_sky_and_skyline(image: Float32Array, camera: RoadCamera, road: RoadAhead, scene: RoadScene, top: int) -> None:
    """Draw sky and skyline above the road's first row `top`, in place."""
    light = scene.light
    if top <= 0:
        return
    v = np.arange(top, dtype=np.float32)[:, None]
    grey = NIGHT_SKY_GREY if light.night else light.sky
    above = np.clip((top - v) / max(camera.height_px * 0.4, 1.0), 0.0, 1.0)
    image[:top] = grey * (1.0 - 0.18 * above)
    u = np.arange(camera.width_px)
    direction = np.arctan((camera.cx - u) / camera.fx) + road.bearing_rad
    place = (direction / (2 * np.pi) * 4096).astype(np.intp) % 4096
    hills = _skyline_heights_rad(scene.seed % 64)
    for factor, dark, shift in ((1.0, 0.62, 0), (0.55, 0.42, 1700)):
        height = hills[(place + shift) % 4096] * camera.fy * factor
        cover = np.clip(v - (top - height[None, :]) + 0.5, 0.0, 1.0)
        far_grey = grey * (dark if not light.night else 0.5)
        far_grey = far_grey + (light.sky - far_grey) * min(1.0, light.fog_1pm * 60)
        image[:top] += cover * (np.float32(far_grey) - image[:top])


def apply_haze(image: Float32Array, x_m: FloatArray, top: int, light: Light) -> None:
    """Apply haze to the road's rows in place: contrast falls as exp(-k x) to the sky's grey (Koschmieder's law)."""
    k = light.fog_1pm + (0.0 if light.night else 0.0008)
    if k <= 0:
        return
    clear = np.exp(-k * x_m).astype(np.float32)[:, None]
    air = np.float32(NIGHT_SKY_GREY + 20 if light.night else light.sky)
    image[top:] *= clear
    image[top:] += air * (1.0 - clear)


def apply_wet_road_reflection(image: Float32Array, top: int, light: Light) -> None:
    """Mirror what is above the horizon in a wet road, smeared downwards, in place."""
    import cv2

    height, width = image.shape
    n = height - top
    if light.rain <= 0 or top < 4 or n < 4:
        return
    above = image[:top][::-1]
    mirrored = cv2.resize(np.ascontiguousarray(above[: max(2, min(top, n))]), (width, n))
    mirrored = cv2.blur(mirrored, (3, max(3, n // 6 * 2 + 1)))
    share = light.rain * np.linspace(0.42, 0.14, n, dtype=np.float32)[:, None]
    image[top:] += share * (mirrored - image[top:])


def apply_low_sun_glare(image: Float32Array, camera: RoadCamera, top: int, light: Light) -> None:
    """Add a low sun in place: its halo, a veil over the image, and the band that the road mirrors below it."""
    if light.glare <= 0:
        return
    u = np.arange(camera.width_px, dtype=np.float32)[None, :] / camera.width_px
    v = np.arange(camera.height_px, dtype=np.float32)[:, None] / camera.height_px
    sun_v = max(top / camera.height_px - 0.16, 0.03)
    far = np.sqrt((u - light.glare_u) ** 2 + ((v - sun_v) * 0.8) ** 2)
    image += light.glare * (0.18 + 1.6 * np.exp(-far / 0.07) + 0.55 * np.exp(-far / 0.28))
    if top < camera.height_px:
        below = np.linspace(0.0, 1.0, camera.height_px - top, dtype=np.float32)[:, None]
        across = (u - light.glare_u) / (0.05 + 0.10 * below)
        image[top:] += light.glare * 0.62 * np.exp(-0.5 * across**2) * np.exp(-below / 0.42)


def add_rain_streaks_and_drops(image: Float32Array, light: Light, rng: np.random.Generator) -> Float32Array:
    """Add streaks in the air and drops on the windscreen, and return the new image."""
    import cv2

    if light.rain <= 0:
        return image
    height, width = image.shape
    scale = width / 320.0
    streaks = np.zeros((height, width), np.uint8)
    slant = rng.uniform(-0.25, 0.25)
    for _ in range(int(70 * light.rain)):
        u, v = rng.uniform(0, width), rng.uniform(0, height)
        length = rng.uniform(4, 12) * scale
        ends = np.round(np.array([u, v, u + slant * length, v + length]) * 16).astype(int).tolist()
        cv2.line(streaks, (ends[0], ends[1]), (ends[2], ends[3]), (int(rng.integers(30, 80)),), 1, cv2.LINE_AA, 4)
    image = image + cv2.GaussianBlur(streaks, (0, 0), 0.5 * scale) * np.float32(0.10 if light.night else 0.22)
    drops = np.zeros((height, width), np.uint8)
    for _ in range(int(26 * light.rain)):
        radius = rng.gamma(2.0, 1.4) * scale + 0.8
        middle = (int(rng.uniform(0, width) * 16), int(rng.uniform(0, height) * 16))
        axes = (int(radius * 16), int(radius * rng.uniform(1.0, 1.5) * 16))
        cv2.ellipse(drops, middle, axes, 0, 0, 360, (255,), -1, cv2.LINE_AA, 4)
    share = cv2.GaussianBlur(drops, (0, 0), 0.6 * scale).astype(np.float32) / 255.0
    size = int(6 * scale) * 2 + 1
    through_drop = cv2.flip(cv2.blur(image, (size, size)), 0) * 0.35 + cv2.blur(image, (size, size)) * 0.65
    return np.asarray(image + 0.8 * share * (through_drop - image), np.float32)


@cache
def _vignette_factor(height: int, width: int) -> Float32Array:
    """Factor of the vignette on the light, shape (height, width); 1 in the middle."""
    u = (np.arange(width, dtype=np.float32)[None, :] - (width - 1) / 2) / (width / 2)
    v = (np.arange(height, dtype=np.float32)[:, None] - (height - 1) / 2) / (width / 2)
    return np.asarray(1.0 - CORNER_LIGHT_LOSS_SHARE * (u * u + v * v) / 1.5625, np.float32)


def simulate_image_sensor(image: Float32Array, light: Light, rng: np.random.Generator) -> npt.NDArray[np.uint8]:
    """Apply exposure, vignette, lens blur, noise and saturation, and return the image as eight bits."""
    import cv2

    height, width = image.shape
    image = image * (_vignette_factor(height, width) * np.float32(light.exposure))
    sigma = light.blur_px * width / 320.0
    if sigma > 0.2:
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), sigma), np.float32)
    noise = rng.standard_normal((height, width), dtype=np.float32)
    spread = np.sqrt(np.maximum(image, 0.0) * np.float32(SHOT_NOISE_VARIANCE_PER_GREY) + np.float32(READ_NOISE_GREY**2))
    image = image + noise * spread * np.float32(light.noise)
    return np.asarray(cv2.convertScaleAbs(np.clip(image, 0.0, 255.0)))
