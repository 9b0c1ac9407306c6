"""Simple road images for tests: two bright boundaries on a grey road with noise."""

from __future__ import annotations

import numpy as np

ROAD_GREY, MARKING_GREY, NOISE_GREY = 80, 100, 4


def road_image(left, right, *, seed=0, half_width_px=4.0):
    """320 x 240, with boundaries x = a y^2 + b y + c (pixels from 1 at the bottom left)."""
    v, u = np.mgrid[0:240, 0:320]
    x, y = u + 1, 240 - v
    grey = np.full((240, 320), float(ROAD_GREY))
    for a, b, c in (left, right):
        reach = half_width_px * (1 - y / 170) + 1
        grey += np.where((np.abs(x - (a * y + b) * y - c) < reach) & (y < 150), MARKING_GREY, 0)
    grey += np.random.default_rng(seed).normal(0, NOISE_GREY, grey.shape)
    return np.clip(grey, 0, 255).astype(np.uint8)


LEFT, RIGHT = (-0.0008, 0.75, 20.0), (0.0004, -0.85, 300.0)
