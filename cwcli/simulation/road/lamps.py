"""The lamps of other vehicles: a core and a halo."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.simulation.road.surface import Float32Array

HALO_TO_LAMP_RADIUS_RATIO = 9.0
"""Radius of the halo in radii of the lamp. Chosen by hand; not fitted."""
DAY_TO_NIGHT_LAMP_STRENGTH_RATIO = 0.25
"""Strength of a lamp by day relative to night. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class Lamp:
    """A lamp in the image: place and radius in pixels; strength 1 for a headlight."""

    u_px: float
    v_px: float
    radius_px: float
    strength: float


def draw_lamps(image: Float32Array, lamps: Sequence[Lamp], *, at_night: bool) -> None:
    """Draw lamps into the image, in place."""
    height, width = image.shape
    for lamp in lamps:
        reach = int(min(lamp.radius_px * HALO_TO_LAMP_RADIUS_RATIO, width / 5)) + 2
        u0, u1 = max(int(lamp.u_px) - reach, 0), min(int(lamp.u_px) + reach + 1, width)
        v0, v1 = max(int(lamp.v_px) - reach, 0), min(int(lamp.v_px) + reach + 1, height)
        if u0 >= u1 or v0 >= v1:
            continue
        du = np.arange(u0, u1, dtype=np.float32)[None, :] - np.float32(lamp.u_px)
        dv = np.arange(v0, v1, dtype=np.float32)[:, None] - np.float32(lamp.v_px)
        far = np.sqrt(du * du + dv * dv)
        edge = np.clip(1.0 - far / reach, 0.0, 1.0)
        far /= np.float32(lamp.radius_px)
        strength = lamp.strength * (1.0 if at_night else DAY_TO_NIGHT_LAMP_STRENGTH_RATIO)
        image[v0:v1, u0:u1] += strength * edge * (230.0 * np.exp(-(far**2)) + 120.0 * np.exp(-far / 1.8))
