"""Weather and light, drawn at random: one function per condition. Registered in `DRAW_FUNCTION_BY_WEATHER`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from cwcli.simulation.road.scene import Light, RoadScene, Shadow


def with_random_clear_light(scene: RoadScene, rng: np.random.Generator) -> RoadScene:
    """Draw daylight without shadows on the road."""
    return replace(scene, light=Light(exposure=rng.uniform(0.92, 1.12), sky=rng.uniform(195, 235)))


def with_random_overcast_light(scene: RoadScene, rng: np.random.Generator) -> RoadScene:
    """Draw flat, dimmer light with less contrast between paint and road."""
    light = Light(exposure=rng.uniform(0.80, 0.98), sky=rng.uniform(170, 205), fog_1pm=rng.uniform(0.0, 0.003))
    return replace(scene, light=light)


def draw_shadow_band(rng: np.random.Generator, first_m: float, last_m: float) -> Shadow:
    """Draw the shadow of a pole, a trunk, a gantry or a bridge somewhere between two stations."""
    length_m = rng.choice([0.35, 0.5, 1.0, 7.0], p=[0.35, 0.3, 0.25, 0.1])
    return Shadow(rng.uniform(first_m, last_m), length_m, slant=rng.normal(0.0, 0.7))


def with_random_sun_and_shadows(scene: RoadScene, rng: np.random.Generator) -> RoadScene:
    """Draw sun behind leaves, poles and bridges: hard shadows over road and paint."""
    bands = [draw_shadow_band(rng, 6.0, 60.0) for _ in range(int(rng.integers(1, 5)))]
    light = Light(
        exposure=rng.uniform(1.0, 1.2),
        sky=rng.uniform(205, 240),
        dapple=rng.choice([0.0, 0.5, 0.8, 1.0], p=[0.25, 0.25, 0.3, 0.2]),
        shadow_depth=rng.uniform(0.38, 0.6),
        shadows=tuple(bands),
    )
    return replace(scene, light=light)


def with_random_low_sun_glare(scene: RoadScene, rng: np.random.Generator) -> RoadScene:
    """Draw a low sun ahead that dazzles the camera."""
    light = Light(
        exposure=rng.uniform(0.85, 1.0),
        sky=rng.uniform(205, 235),
        glare=rng.uniform(70, 140),
        glare_u=rng.uniform(0.2, 0.8),
    )
    return replace(scene, light=light)


def with_random_rain(scene: RoadScene, rng: np.random.Generator) -> RoadScene:
    """Draw rain: a wet, mirroring road, streaks, drops on the windscreen, haze."""
    light = Light(
        exposure=rng.uniform(0.82, 1.0),
        sky=rng.uniform(150, 190),
        rain=rng.uniform(0.5, 1.0),
        fog_1pm=rng.uniform(0.003, 0.009),
        noise=1.3,
        blur_px=rng.uniform(0.5, 0.8),
    )
    return replace(scene, light=light)


def with_random_night(scene: RoadScene, rng: np.random.Generator) -> RoadScene:
    """Draw night: light comes from the own low beams and the lamps of others."""
    light = Light(exposure=rng.uniform(0.95, 1.25), sky=60.0, night=True, noise=rng.uniform(1.5, 2.2))
    return replace(scene, light=light)


def with_random_rainy_night(scene: RoadScene, rng: np.random.Generator) -> RoadScene:
    """Draw a night with rain, the hardest condition."""
    return replace(
        scene,
        light=replace(
            with_random_night(scene, rng).light, rain=rng.uniform(0.4, 0.8), fog_1pm=rng.uniform(0.002, 0.006)
        ),
    )


def with_random_fog(scene: RoadScene, rng: np.random.Generator) -> RoadScene:
    """Draw fog with a sight of 80 to 200 m, where contrast falls to 5 %."""
    light = Light(exposure=rng.uniform(0.9, 1.05), sky=rng.uniform(170, 205), fog_1pm=3.0 / rng.uniform(80, 200))
    return replace(scene, light=light)


DrawCondition = Callable[[RoadScene, np.random.Generator], RoadScene]
"""A function that draws the light and weather of a scene."""

DRAW_FUNCTION_BY_WEATHER: dict[str, DrawCondition] = {
    "clear": with_random_clear_light,
    "overcast": with_random_overcast_light,
    "shadow": with_random_sun_and_shadows,
    "glare": with_random_low_sun_glare,
    "rain": with_random_rain,
    "night": with_random_night,
    "night-rain": with_random_rainy_night,
    "fog": with_random_fog,
}
"""The functions that draw weather and light for a scene, by the name that `--weather` takes."""
