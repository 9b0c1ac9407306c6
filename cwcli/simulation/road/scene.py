"""The description of a scene, which the renderer draws and the sets of frames draw at random.

Offsets are from the lane's centre, left positive; stations are arc lengths along the road, so that a scene can be
driven through. Grey values are those of an 8-bit camera image of a sunlit road.
"""

from __future__ import annotations

from dataclasses import field

from cwcli.lazy_dataclass import dataclass

ASPHALT_GREY = 95.0
"""Default grey of asphalt in sunlight, 0 to 255. Chosen by hand; not fitted."""
PAINT_GREY = 205.0
"""Default grey of new paint in sunlight, 0 to 255. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class Marking:
    """A painted line along the road.

    Attributes:
        offset_m: Offset of its stripe next to the lane.
        width_m: Width of a stripe.
        dash_m: Painted length and gap; (0, 0) is solid.
        is_double: A second, solid stripe farther from the lane's centre, one width apart.
        grey: Grey of new paint.
        remaining_paint_share: Share of the paint that is left, 0 to 1.
        phase_m: Station where a dash begins.
        painted_stretches_m: First and last station of each stretch on which it is painted; empty: everywhere.
        path_m: Stations and offsets of a marking that is not parallel to the lane, linear between them.
    """

    offset_m: float
    width_m: float = 0.15
    dash_m: tuple[float, float] = (0.0, 0.0)
    is_double: bool = False
    grey: float = PAINT_GREY
    remaining_paint_share: float = 1.0
    phase_m: float = 0.0
    painted_stretches_m: tuple[tuple[float, float], ...] = ()
    path_m: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class Patch:
    """A repaired rectangle of the surface: new asphalt or concrete, with a tar seam around it."""

    station_m: float
    length_m: float
    offset_m: float
    width_m: float
    grey_ratio: float
    """Ratio of the patch's grey to that of the road."""
    seam: bool = True


@dataclass(frozen=True)
class Shadow:
    """A dark band across the road: of a bridge, a pole or a tree's trunk. Positive slant: farther ahead to the left."""

    station_m: float
    length_m: float
    slant: float = 0.0
    left_m: float = 20.0
    right_m: float = -20.0


@dataclass(frozen=True)
class SceneVehicle:
    """A car or lorry, seen from behind, or from the front if it is oncoming.

    Attributes:
        ahead_m: Arc length from the camera to its nearer end.
        offset_m: Offset of its middle.
        grey: Grey of its paint.
    """

    ahead_m: float
    offset_m: float
    length_m: float = 4.5
    width_m: float = 1.8
    height_m: float = 1.45
    grey: float = 120.0
    is_oncoming: bool = False
    is_braking: bool = False


@dataclass(frozen=True)
class Light:
    """Light and weather.

    Attributes:
        exposure: Factor on every grey value.
        dapple: Share of the road under leaves' shadow, 0 to 1.
        shadow_depth: Factor on the light inside a shadow.
        shadows: Shadow bands across the road.
        glare: Brightness of a low sun ahead, grey levels; 0 is none.
        glare_u: Place of the sun across the image, 0 to 1.
        fog_1pm: Attenuation of contrast over distance.
        rain: 0 to 1: wet road, streaks, drops on the windscreen.
        night: The own headlights light the road; others' lights dazzle.
        sky: Grey of the sky.
        noise: Factor on the sensor's noise.
        blur_px: Sigma of the lens, at 320 columns.
    """

    exposure: float = 1.0
    dapple: float = 0.0
    shadow_depth: float = 0.5
    shadows: tuple[Shadow, ...] = ()
    glare: float = 0.0
    glare_u: float = 0.5
    fog_1pm: float = 0.0
    rain: float = 0.0
    night: bool = False
    sky: float = 215.0
    noise: float = 1.0
    blur_px: float = 0.45


@dataclass(frozen=True)
class RoadScene:
    """Everything but the camera and the place on the road.

    Attributes:
        condition: Name of the weather in tables, e.g. `rain`.
        lane_width_m: Width of the own lane and its neighbours.
        left, right: The boundaries of the own lane; `offset_m` is half the lane's width to both sides of `lane_m`.
        others: Further markings.
        left_edge_m, right_edge_m: Offsets at which the pavement ends; posts and trees stand beyond them.
        right_edge_path_m: Stations and offsets at which the pavement ends on the right, instead of `right_edge_m`.
        asphalt: Grey of the road.
        texture: Factor on the surface's grain.
        tracks: Darkening of the wheel tracks, 0 to 1.
        cracks: Share of the surface's cracks and tar seams that show, 0 to 1.
        patches, vehicles: On the road.
        rail_left_m, rail_right_m: Offsets of guard rails; NaN is none.
        light: Light and weather.
        seed: Seed of surface, verge and skyline; a drive keeps it, so that they stay in place.
        lane_m: Offset of the own lane's centre line from the line that describes the road; not 0 once the car has
            changed lanes.
    """

    condition: str
    lane_width_m: float
    left: Marking
    right: Marking
    others: tuple[Marking, ...] = ()
    left_edge_m: float = 5.8
    right_edge_m: float = -4.5
    right_edge_path_m: tuple[tuple[float, float], ...] = ()
    asphalt: float = ASPHALT_GREY
    texture: float = 1.0
    tracks: float = 0.3
    cracks: float = 0.2
    patches: tuple[Patch, ...] = ()
    vehicles: tuple[SceneVehicle, ...] = ()
    rail_left_m: float = float("nan")
    rail_right_m: float = float("nan")
    light: Light = field(default_factory=Light)
    seed: int = 0
    lane_m: float = 0.0
