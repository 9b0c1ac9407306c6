"""Trees: a few shapes with ragged crowns, made once and scaled to their size in the image."""

from __future__ import annotations

from functools import cache

import numpy as np

from cwcli.signals.columns import FloatArray
from cwcli.simulation.road.surface import Float32Array

N_TREE_SHAPES = 12
"""Number of different tree shapes. Chosen by hand; not fitted."""
TREE_IMAGE_SIZE_PX = 96
"""Height and width at which tree shapes are made, px. Chosen by hand; not fitted."""


@cache
def _make_tree_shape_cover_and_light(shape_number: int) -> tuple[Float32Array, Float32Array]:
    """Make a tree shape: its cover and its light, 0 to 1, (96, 96) each."""
    rng = np.random.default_rng([11, shape_number])
    v, u = np.mgrid[0:TREE_IMAGE_SIZE_PX, 0:TREE_IMAGE_SIZE_PX] / (TREE_IMAGE_SIZE_PX - 1.0)
    freq = np.fft.fftfreq(TREE_IMAGE_SIZE_PX)
    radius = np.hypot(freq[:, None], freq[None, :])

    def smoothed_unit_noise(sigma_px: float) -> FloatArray:
        filtered = np.fft.ifft2(
            np.fft.fft2(rng.standard_normal(u.shape)) * np.exp(-2 * (np.pi * radius * sigma_px) ** 2)
        )
        return np.asarray(filtered.real / filtered.real.std())

    top, low = 0.02, rng.uniform(0.7, 0.95)  # of the crown; the rest is trunk
    middle, half = (top + low) / 2, (low - top) / 2
    power = rng.uniform(1.6, 2.6)
    inside = 1.0 - np.abs((u - 0.5) / 0.42) ** power - np.abs((v - middle) / half) ** power
    field = inside + 0.22 * smoothed_unit_noise(9.0) + 0.14 * smoothed_unit_noise(3.0)
    crown = np.clip(field * 8.0 + 0.5, 0.0, 1.0) * np.clip(0.85 + 0.25 * smoothed_unit_noise(1.2), 0.0, 1.0)
    trunk = (np.abs(u - 0.5 - 0.02 * smoothed_unit_noise(12.0)) < 0.025) & (v > middle)
    cover = np.maximum(crown, trunk)
    light = 0.5 + 0.35 * (middle - v) / half + 0.12 * smoothed_unit_noise(2.5) + 0.10 * smoothed_unit_noise(7.0)
    light = np.where(trunk & (crown < 0.5), 0.25, light)
    return np.asarray(cover, np.float32), np.clip(light, 0.0, 1.0).astype(np.float32)


def draw_tree(image: Float32Array, box: FloatArray, number: int, dark: float, light: float) -> None:
    """Draw a tree into a box, in place.

    Args:
        box: Shape (2, 2): top left and bottom right corner (u, v).
        number: Number of the tree shape, 0 to 11.
        dark, light: Greys of its shadow and light sides.
    """
    import cv2

    if not np.isfinite(box).all():
        return
    u0, v0 = np.floor(box.min(axis=0)).astype(int)
    u1, v1 = np.ceil(box.max(axis=0)).astype(int)
    height, width = image.shape
    if u1 - u0 < 2 or v1 - v0 < 2 or max(u1 - u0, v1 - v0) > 8 * max(width, height):
        return
    left, top, right, bottom = max(u0, 0), max(v0, 0), min(u1, width), min(v1, height)
    if left >= right or top >= bottom:
        return
    size = (int(u1 - u0), int(v1 - v0))
    how = cv2.INTER_AREA if size[0] < TREE_IMAGE_SIZE_PX else cv2.INTER_LINEAR
    inside = (slice(top - v0, bottom - v0), slice(left - u0, right - u0))
    cover, shine = (
        cv2.resize(layer, size, interpolation=how)[inside] for layer in _make_tree_shape_cover_and_light(number)
    )
    part = image[top:bottom, left:right]
    part += cover * (dark + (light - dark) * shine - part)
