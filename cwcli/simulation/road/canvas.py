"""Polygons with smooth edges on an image of floats."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import BoolArray, FloatArray
from cwcli.simulation.road.surface import Float32Array

FINE_SUBSAMPLES, COARSE_SUBSAMPLES = 4, 2
"""Sub-samples per pixel in each direction, for small and for large objects. Chosen by hand; not fitted."""
MIN_AREA_FOR_COARSE_SUBSAMPLES_PX = 12000
"""Area of the drawn part of the image from which coarse sub-samples are used, px. Chosen by hand; not fitted."""
CORNER_FRACTION_BITS = 4
"""Number of fraction bits of the polygons' corners. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class FilledShape:
    """A filled polygon with corners (n, 2) as (u, v), px, or an ellipse in the box of two corners; grey 0 to 255."""

    corners: FloatArray
    grey: float
    is_ellipse: bool = False


def draw_shapes(
    image: Float32Array, shapes: Sequence[FilledShape], *, opacity: float = 1.0, hidden: BoolArray | None = None
) -> None:
    """Draw shapes over each other, then their union over the image, in place.

    Args:
        shapes: Shapes in drawing order; those with a corner that is not finite are left out.
        opacity: Opacity of the union, 0 to 1.
        hidden: Shape (height, width), if given: pixels that are covered by half or more become True.
    """
    import cv2

    shapes = [shape for shape in shapes if np.isfinite(shape.corners).all()]
    if not shapes:
        return
    height, width = image.shape
    low = np.floor(np.min([shape.corners.min(axis=0) for shape in shapes], axis=0)) - 1
    high = np.ceil(np.max([shape.corners.max(axis=0) for shape in shapes], axis=0)) + 2
    u0, v0 = (int(value) for value in np.clip(low, 0, (width, height)))
    u1, v1 = (int(value) for value in np.clip(high, 0, (width, height)))
    if u1 <= u0 or v1 <= v0:
        return
    scale = COARSE_SUBSAMPLES if (u1 - u0) * (v1 - v0) > MIN_AREA_FOR_COARSE_SUBSAMPLES_PX else FINE_SUBSAMPLES
    grey = np.zeros(((v1 - v0) * scale, (u1 - u0) * scale), np.uint8)
    mask = np.zeros_like(grey)
    for shape in shapes:
        corners = np.clip((shape.corners - (u0, v0) + 0.5) * scale - 0.5, -20000, 20000)
        fixed = np.round(corners * (1 << CORNER_FRACTION_BITS)).astype(np.int32)
        value = float(np.clip(shape.grey, 0, 255))
        if shape.is_ellipse:
            middle, axes = fixed.mean(axis=0).astype(int), (np.abs(fixed[1] - fixed[0]) // 2).astype(int)
            for layer, paint in ((grey, value), (mask, 255.0)):
                cv2.ellipse(
                    layer,
                    (int(middle[0]), int(middle[1])),
                    (int(axes[0]), int(axes[1])),
                    0, 0, 360, (paint,), -1, cv2.LINE_8, CORNER_FRACTION_BITS,
                )  # fmt: skip
        else:
            cv2.fillPoly(grey, [fixed], (value,), cv2.LINE_8, CORNER_FRACTION_BITS)
            cv2.fillPoly(mask, [fixed], (255.0,), cv2.LINE_8, CORNER_FRACTION_BITS)
    size = (u1 - u0, v1 - v0)
    share = cv2.resize(mask, size, interpolation=cv2.INTER_AREA).astype(np.float32) / 255.0
    value_px = cv2.resize(grey, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    part = image[v0:v1, u0:u1]
    part *= 1.0 - opacity * share
    part += opacity * value_px
    if hidden is not None and opacity == 1.0:
        hidden[v0:v1, u0:u1] |= share >= 0.5
