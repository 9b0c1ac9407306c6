"""Pictures of a straight road, with lines where they are told."""

from __future__ import annotations

import numpy as np

from cwcli.vision.camera import Camera, Mounting

WIDTH_M = 3.5
PAINT_M, FAR_M = 0.15, 80.0
CAMERA = Camera(480, 270, 416.0, 416.0, 239.5, 134.5, mounting=Mounting(height_m=1.4, pitch_rad=0.02))
HORIZON_PX = float(CAMERA.horizon_row_px())


def picture(lines_m: list[float], yaw_rad: float, seed: int) -> np.ndarray:
    """White lines on asphalt under a grey sky, with grain: `lines_m` beside the camera, left positive."""
    grey = np.full((CAMERA.height_px, CAMERA.width_px), 85.0)
    grey[: int(HORIZON_PX)] = 180.0
    u = np.arange(CAMERA.width_px)
    for v in range(int(HORIZON_PX) + 2, CAMERA.height_px):
        x_m = CAMERA.fy * CAMERA.mounting.height_m / (v - HORIZON_PX)
        for y_m in lines_m if x_m <= FAR_M else []:
            centre = CAMERA.cx - CAMERA.fx * (y_m / x_m - np.tan(yaw_rad))
            half = max(0.5 * PAINT_M * CAMERA.fx / x_m, 0.35)
            share = np.clip(half + 0.5 - np.abs(u - centre), 0.0, 1.0)
            grey[v] = grey[v] * (1.0 - share) + 220.0 * share
    grain = np.random.default_rng(seed).normal(0.0, 3.0, grey.shape)
    return np.asarray(np.clip(grey + grain, 0, 255).astype(np.uint8))
