"""Cars, guard rails, posts and trees: boxes and bands in the body frame, drawn from far to near."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from itertools import pairwise

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import BoolArray, FloatArray
from cwcli.simulation.road.camera import RoadCamera
from cwcli.simulation.road.geometry import RoadAhead
from cwcli.simulation.road.scene import Light, RoadScene, SceneVehicle
from cwcli.simulation.road.surface import Float32Array

MIN_PROJECTED_DISTANCE_M = 0.5
"""Smallest distance ahead at which points are projected, m; nearer ones are moved there. Chosen by hand; not fitted."""
UNIT_CIRCLE_POINTS = [(math.cos(angle), math.sin(angle)) for angle in np.arange(14) * (2 * math.pi / 14)]
"""Points of the unit circle with which wheels are drawn, 14 pairs."""
DAYLIGHT_FAR_HAZE_GREY = 200.0
"""Grey of far haze by day, 0 to 255. Chosen by hand; not fitted."""
NIGHT_GREY_FACTOR = 0.16
"""Factor on the grey of objects at night, without headlights. Chosen by hand; not fitted."""
GUIDE_POST_SPACING_M = 50.0
"""Distance between guide posts along the road, m. Chosen by hand; not fitted."""
TREE_SPACING_M = 14.0
"""Mean distance between trees along the road, m. Chosen by hand; not fitted."""
RAIL_BAND_LOW_M_HIGH_M_GREY = ((0.5, 0.78, 150.0), (0.62, 0.66, 105.0))
"""Bands of a guard rail and of the groove in it: lower and upper edge above the road (m), grey. Chosen by hand; not
fitted."""
DISTANCES_AHEAD_OF_GUARD_RAIL_PIECE_EDGES_M = (150.0, 60.0, 30.0, 15.0, 7.0, 2.0)
"""Distances ahead at which a guard rail is divided into pieces of even haze, far to near, m. Chosen by hand; not
fitted."""
MAX_DISTANCE_OF_DRAWN_VEHICLES_AND_POSTS_M = 150.0
"""Distance ahead beyond which vehicles and posts are not drawn, m. Chosen by hand; not fitted."""
FINE_SUBSAMPLES, COARSE_SUBSAMPLES = 4, 2
"""Sub-samples per pixel in each direction, for small and for large objects. Chosen by hand; not fitted."""
MIN_AREA_FOR_COARSE_SUBSAMPLES_PX = 12000
"""Area of the drawn part of the image from which coarse sub-samples are used, px. Chosen by hand; not fitted."""
POLYGON_CORNER_FRACTION_BITS = 4
"""Number of fraction bits of the polygons' corners. Chosen by hand; not fitted."""
N_TREE_SHAPES = 12
"""Number of different tree shapes. Chosen by hand; not fitted."""
TREE_IMAGE_SIZE_PX = 96
"""Height and width at which tree shapes are made, px. Chosen by hand; not fitted."""
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


@dataclass(frozen=True)
class FilledShape:
    """A filled polygon with corners (n, 2) as (u, v), px, or an ellipse in the box of two corners; grey 0 to 255."""

    corners: FloatArray
    grey: float
    is_ellipse: bool = False


class _RoadView:
    """The view of the road: it projects points of the body frame, and fades greys with the distance."""

    def __init__(self, camera: RoadCamera, road: RoadAhead, light: Light) -> None:
        self.camera, self.road, self.light = camera, road, light

    def project_body_points(self, x_m: FloatArray, y_m: FloatArray, z_m: FloatArray) -> FloatArray:
        """Project points of the body frame, with z above the road, to image points (n, 2), px."""
        x = np.maximum(np.asarray(x_m, np.float64), MIN_PROJECTED_DISTANCE_M)
        u, v = self.camera.project_to_image_px(
            x, np.asarray(y_m), np.asarray(z_m) + self.road.surface_height_at_distance_m(x)
        )
        return np.column_stack([u, v])

    def grey_at_distance(self, grey: float, distance_m: float) -> float:
        """Grey of an object at a distance, after night or haze."""
        if self.light.night:
            return grey * NIGHT_GREY_FACTOR + grey * 0.5 * math.exp(-((distance_m / 20.0) ** 2))
        clear = math.exp(-(self.light.fog_1pm + 0.0008) * distance_m)
        return grey * clear + DAYLIGHT_FAR_HAZE_GREY * (1.0 - clear)


def draw_roadside(image: Float32Array, camera: RoadCamera, road: RoadAhead, scene: RoadScene) -> None:
    """Draw trees, posts and guard rails, in place."""
    view = _RoadView(camera, road, scene.light)
    _draw_trees(image, view, scene)
    for side in (scene.left_edge_m + 0.7, scene.right_edge_m - 0.7):
        _draw_posts(image, view, side)
    for offset_m in (scene.rail_left_m, scene.rail_right_m):
        if math.isfinite(offset_m):
            _draw_guard_rail(image, view, offset_m)


def draw_vehicles(
    image: Float32Array, camera: RoadCamera, road: RoadAhead, scene: RoadScene, hidden: BoolArray
) -> list[Lamp]:
    """Draw the vehicles in place, and mark the pixels that they hide.

    Returns:
        Lamps that dazzle at night.
    """
    view = _RoadView(camera, road, scene.light)
    lamps: list[Lamp] = []
    for vehicle in sorted(scene.vehicles, key=lambda each: -each.ahead_m):
        if 2.0 < vehicle.ahead_m < MAX_DISTANCE_OF_DRAWN_VEHICLES_AND_POSTS_M:
            lamps += _draw_vehicle(image, view, vehicle, hidden)
    return lamps


def _draw_vehicle(image: Float32Array, view: _RoadView, vehicle: SceneVehicle, hidden: BoolArray) -> list[Lamp]:
    """Draw a vehicle in place, mark the pixels that it hides, and return its lamps."""
    x, y, direction = view.road.pose_at_arc_length(vehicle.ahead_m, vehicle.offset_m)
    forward = np.array([math.cos(direction), math.sin(direction)])
    left = np.array([-forward[1], forward[0]])
    half, height, length = vehicle.width_m / 2, vehicle.height_m, vehicle.length_m
    is_tall = height > 2.2

    def point_of_vehicle_body(along: float, across: float, up: float) -> tuple[float, float, float]:
        place = np.array([x, y]) + along * forward + across * left
        return float(place[0]), float(place[1]), up

    def project_polygon(grey: float, *corners: tuple[float, float, float]) -> FilledShape:
        px, py, pz = np.array([point_of_vehicle_body(*corner) for corner in corners]).T
        return FilledShape(view.project_body_points(px, py, pz), view.grey_at_distance(grey, x))

    def project_upright_rectangle(
        grey: float, left_m: float, right_m: float, low_m: float, high_m: float, along: float = 0.0
    ) -> FilledShape:
        corners = ((left_m, low_m), (right_m, low_m), (right_m, high_m), (left_m, high_m))
        return project_polygon(grey, *((along, across, up) for across, up in corners))

    ground = [(-0.15, half, 0.0), (-0.15, -half, 0.0), (length, -half - 0.15, 0.0), (length, half + 0.15, 0.0)]
    if not view.light.night:
        draw_shapes(image, [project_polygon(25.0, *ground)], opacity=0.75)
    grey, waist = vehicle.grey, height if is_tall else 0.62 * height
    near = half if y < 0 else -half  # the flank that faces the camera's lane
    body, glass = [], 45.0
    low = 0.24
    body.append(
        project_polygon(0.72 * grey, (0, near, low), (length, near, low), (length, near, waist), (0, near, waist))
    )
    body.append(project_polygon(0.3 * grey, (0, near, low), (length, near, low), (length, near, 0.36), (0, near, 0.36)))
    if not is_tall:
        inner = near * 0.82
        body.append(
            project_polygon(glass, (0.35, near, waist), (length * 0.72, near, waist), (length * 0.55, inner, height),
                  (0.8, inner, height))
        )  # fmt: skip
    for along in (0.8, length - 0.9):
        for radius, wheel_grey in ((0.34, 20.0), (0.2, 0.5 * grey + 30.0)):
            body.append(
                project_polygon(
                    wheel_grey, *((along + radius * c, near, 0.33 + radius * d) for c, d in UNIT_CIRCLE_POINTS)
                )
            )
    for across in (half - 0.12, -half + 0.12):
        body.append(project_upright_rectangle(18.0, across + 0.11, across - 0.11, 0.0, 0.4))
    body.append(project_upright_rectangle(0.45 * grey, half, -half, low - 0.08, 0.5))
    body.append(project_upright_rectangle(grey, half, -half, 0.42, waist))
    if is_tall:
        body.append(project_upright_rectangle(0.8 * grey, half - 0.1, -half + 0.1, 0.9, height - 0.12))
        body.append(project_upright_rectangle(30.0, 0.02, -0.02, 0.9, height - 0.12))
    else:
        roof = half * 0.78
        body.append(
            project_polygon(
                grey * 0.9,
                (0.0, half * 0.97, waist),
                (0.0, -half * 0.97, waist),
                (0.55, -roof, height),
                (0.55, roof, height),
            )
        )
        body.append(project_polygon(glass, (0.05, half * 0.85, waist + 0.03), (0.05, -half * 0.85, waist + 0.03),
                          (0.5, -roof * 0.92, height - 0.07), (0.5, roof * 0.92, height - 0.07)))  # fmt: skip
        body.append(project_upright_rectangle(215.0 if grey < 150 else 235.0, 0.26, -0.26, 0.62, 0.74))
    lamp_z = 0.72 * waist if not is_tall else 0.8
    lamps: list[Lamp] = []
    for across in (half - 0.2, -half + 0.2):
        lamp_grey = 240.0 if vehicle.is_oncoming else (170.0 if vehicle.is_braking else 75.0)
        body.append(project_upright_rectangle(lamp_grey, across + 0.16, across - 0.16, lamp_z - 0.07, lamp_z + 0.09))
        centre = view.project_body_points(*(np.array([value]) for value in point_of_vehicle_body(0.0, across, lamp_z)))[
            0
        ]
        radius = view.camera.fx * (0.16 if vehicle.is_oncoming else 0.11) / max(x, 1.0)
        if np.isfinite(centre).all():
            strength = 1.0 if vehicle.is_oncoming else (0.7 if vehicle.is_braking else 0.4)
            lamps.append(Lamp(float(centre[0]), float(centre[1]), max(radius, 0.6), strength))
    draw_shapes(image, body, hidden=hidden)
    return lamps


def _draw_guard_rail(image: Float32Array, view: _RoadView, offset_m: float) -> None:
    """Draw the guard rail at an offset, in place."""
    x, y = (values[: view.road.n_grid_points_ahead] for values in view.road.line_at_offset_m(offset_m))
    starts = np.arange(4.0, 60.0, 4.0)[::-1]
    along = starts[:, None] + np.array([0.0, 0.12, 0.12, 0.0])
    posts = view.project_body_points(
        along.ravel(), np.interp(along.ravel(), x, y), np.tile([0.0, 0.0, 0.7, 0.7], len(starts))
    )
    shapes = [
        FilledShape(corners, view.grey_at_distance(85.0, float(start)))
        for corners, start in zip(posts.reshape(-1, 4, 2), starts, strict=True)
    ]
    for far, near in pairwise(DISTANCES_AHEAD_OF_GUARD_RAIL_PIECE_EDGES_M):
        inside = np.concatenate([[near], x[(x > near) & (x < far)], [far]])
        side = np.interp(inside, x, y)
        there_and_back = np.concatenate([inside, inside[::-1]]), np.concatenate([side, side[::-1]])
        for low, high, grey in RAIL_BAND_LOW_M_HIGH_M_GREY:
            up = np.repeat([low, high], len(inside))
            shapes.append(FilledShape(view.project_body_points(*there_and_back, up), view.grey_at_distance(grey, near)))
    draw_shapes(image, shapes)


def _draw_posts(image: Float32Array, view: _RoadView, offset_m: float) -> None:
    """Draw the guide posts at an offset, in place."""
    first = -view.road.station_m % GUIDE_POST_SPACING_M
    for ahead in np.arange(first, MAX_DISTANCE_OF_DRAWN_VEHICLES_AND_POSTS_M, GUIDE_POST_SPACING_M)[::-1]:
        if ahead < 5.0:
            continue
        x, y, _ = view.road.pose_at_arc_length(float(ahead), offset_m)
        shapes = []
        for low, high, grey in ((0.0, 1.0, 205.0), (0.7, 0.9, 40.0)):
            corners = view.project_body_points(
                np.full(4, x), y + np.array([0.06, -0.06, -0.06, 0.06]), np.array([low, low, high, high])
            )
            shapes.append(FilledShape(corners, view.grey_at_distance(grey, x)))
        draw_shapes(image, shapes)


def _draw_trees(image: Float32Array, view: _RoadView, scene: RoadScene) -> None:
    """Draw trees and bushes along the road, the same ones at the same stations for a scene's seed."""
    first = math.floor(view.road.station_m / TREE_SPACING_M) + 1
    for number in range(first + int(130 / TREE_SPACING_M), first, -1):
        rng = np.random.default_rng([scene.seed, number])
        ahead = (number + rng.uniform(-0.4, 0.4)) * TREE_SPACING_M - view.road.station_m
        if ahead < 9.0:
            continue
        beyond = rng.uniform(3.5, 14.0)
        offset = scene.left_edge_m + beyond if rng.random() < 0.5 else scene.right_edge_m - beyond
        x, y, _ = view.road.pose_at_arc_length(ahead, offset)
        tall = float(rng.uniform(2.5, 9.0))
        wide = tall * float(rng.uniform(0.35, 0.55))
        box = view.project_body_points(np.full(2, x), np.array([y + wide, y - wide]), np.array([tall, -0.1]))
        dark, light = (view.grey_at_distance(grey, x) for grey in (30.0, rng.uniform(70.0, 100.0)))
        draw_tree(image, box, int(rng.integers(0, N_TREE_SHAPES)), dark, light)


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
        fixed = np.round(corners * (1 << POLYGON_CORNER_FRACTION_BITS)).astype(np.int32)
        value = float(np.clip(shape.grey, 0, 255))
        if shape.is_ellipse:
            middle, axes = fixed.mean(axis=0).astype(int), (np.abs(fixed[1] - fixed[0]) // 2).astype(int)
            for layer, paint in ((grey, value), (mask, 255.0)):
                cv2.ellipse(
                    layer,
                    (int(middle[0]), int(middle[1])),
                    (int(axes[0]), int(axes[1])),
                    0, 0, 360, (paint,), -1, cv2.LINE_8, POLYGON_CORNER_FRACTION_BITS,
                )  # fmt: skip
        else:
            cv2.fillPoly(grey, [fixed], (value,), cv2.LINE_8, POLYGON_CORNER_FRACTION_BITS)
            cv2.fillPoly(mask, [fixed], (255.0,), cv2.LINE_8, POLYGON_CORNER_FRACTION_BITS)
    size = (u1 - u0, v1 - v0)
    share = cv2.resize(mask, size, interpolation=cv2.INTER_AREA).astype(np.float32) / 255.0
    value_px = cv2.resize(grey, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    part = image[v0:v1, u0:u1]
    part *= 1.0 - opacity * share
    part += opacity * value_px
    if hidden is not None and opacity == 1.0:
        hidden[v0:v1, u0:u1] |= share >= 0.5


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
