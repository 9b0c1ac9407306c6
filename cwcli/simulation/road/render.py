"""A frame of a scene from a place on the road: the picture and its exact truth."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass
from cwcli.simulation.road import ground, weather
from cwcli.simulation.road.camera import RoadCamera
from cwcli.simulation.road.geometry import RoadAhead
from cwcli.simulation.road.objects import draw_lamps, draw_roadside, draw_vehicles
from cwcli.simulation.road.paint import paint_marking
from cwcli.simulation.road.rows import compute_road_rows
from cwcli.simulation.road.scene import RoadScene
from cwcli.simulation.road.truth import LaneTruth, compute_lane_truth

RETRO_REFLECTION_GAIN = 1.45
"""Factor on the grey of paint in the own headlights, relative to the road. Chosen by hand; not fitted."""
WET_PAINT_FACTOR = 0.88
"""Factor on the grey of paint in full rain, because a film of water takes contrast. Chosen by hand; not fitted."""
WET_ROAD_FACTOR = 0.72
"""Factor on the grey of the road in full rain. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class RoadFrame:
    """A rendered frame.

    Attributes:
        grey: Shape (height, width), uint8.
        truth: Exact truth of the frame.
    """

    grey: npt.NDArray[np.uint8]
    truth: LaneTruth


def render_frame(scene: RoadScene, camera: RoadCamera, road: RoadAhead, rng: np.random.Generator) -> RoadFrame:
    """Render one frame.

    Args:
        camera: The camera with the pitch of this moment.
        rng: Random stream of rain and sensor noise.
    """
    light = scene.light
    rows = compute_road_rows(camera, road)
    top = camera.height_px - len(rows.v_px)
    surface = rows.map_cells_to_image(ground.surface_grey_by_row_and_cell(rows, scene))
    if light.rain > 0:
        surface *= 1.0 - (1.0 - WET_ROAD_FACTOR) * light.rain
    gain = (RETRO_REFLECTION_GAIN if light.night else 1.0) * (1.0 - (1.0 - WET_PAINT_FACTOR) * light.rain)
    for marking in (*scene.others, scene.left, scene.right):
        paint_marking(surface, rows, marking, gain=gain)
    lit = ground.light_factor_by_row_and_cell(rows, scene)
    if lit is not None:
        surface *= rows.map_cells_to_image(lit)

    image = np.empty((camera.height_px, camera.width_px), np.float32)
    weather.draw_sky_and_skyline(image, camera, road, scene, top)
    image[top:] = surface
    weather.apply_haze(image, rows.x_m, top, light)
    draw_roadside(image, camera, road, scene)
    weather.apply_wet_road_reflection(image, top, light)
    hidden = np.zeros(image.shape, np.bool_)
    found = draw_vehicles(image, camera, road, scene, hidden)
    if light.night or light.rain > 0:
        draw_lamps(image, found, at_night=light.night)
    weather.apply_low_sun_glare(image, camera, top, light)
    image = weather.add_rain_streaks_and_drops(image, light, rng)
    return RoadFrame(
        weather.simulate_image_sensor(image, light, rng), _lane_truth_of_scene(scene, camera, road, hidden)
    )


def compute_frame_truth(scene: RoadScene, camera: RoadCamera, road: RoadAhead) -> LaneTruth:
    """The truth of a frame without rendering it."""
    hidden = np.zeros((camera.height_px, camera.width_px), np.bool_)
    if scene.vehicles:
        draw_vehicles(np.zeros(hidden.shape, np.float32), camera, road, scene, hidden)
    return _lane_truth_of_scene(scene, camera, road, hidden)


def _lane_truth_of_scene(
    scene: RoadScene, camera: RoadCamera, road: RoadAhead, hidden: npt.NDArray[np.bool_]
) -> LaneTruth:
    """The truth of the scene's own lane with pixels (height, width) hidden by vehicles."""
    widths = (scene.left.width_m, scene.right.width_m)
    return compute_lane_truth(camera, road, scene.lane_width_m, widths, scene.condition, hidden, lane_m=scene.lane_m)
