"""A rendered drive along a road: the car's motion, and a frame for each instant of the camera."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from cwcli.dynamics.vehicle import load_vehicle
from cwcli.errors import UsageError
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray
from cwcli.simulation.drivers import SwayingDriver
from cwcli.simulation.road.camera import RoadCamera, camera_of_zhang2011
from cwcli.simulation.road.car import BEARING, HEADING, OFFSET, STATION, times_and_states_of_drive_along_lane
from cwcli.simulation.road.conditions import DRAW_FUNCTION_BY_WEATHER, draw_shadow_band
from cwcli.simulation.road.defects import CURVATURE_KNOT_SPACING_OF_BENDS_AND_RAMPS_M as FINE_KNOT_M
from cwcli.simulation.road.defects import (
    MARKING_KINDS,
    LaneChangingDriver,
    draw_lane_change_times_s,
    draw_mountain_curvature_1pm,
    draw_ramp_curvature_1pm,
    with_bridge_shadows,
    with_concrete_joints,
    with_free_left_lane,
    with_marking_kind,
    with_own_lane_at_offset,
)
from cwcli.simulation.road.geometry import ARC_LENGTH_GRID_M, RoadAhead
from cwcli.simulation.road.junctions import JUNCTION_KINDS, add_junctions_to_scene
from cwcli.simulation.road.render import RoadFrame, compute_frame_truth, render_frame
from cwcli.simulation.road.scene import RoadScene, SceneVehicle, Shadow
from cwcli.simulation.road.sets import FRAME_SETS, FRAMES_PER_SET, SetSpec, draw_scene
from cwcli.simulation.road.truth import LaneTruth
from cwcli.simulation.streams import random_stream

ROAD_CURVATURE_KNOT_SPACING_M = 90.0
"""Distance of the knots between which the road's curvature changes evenly, m. Chosen by hand
(docs/road-renderer.md)."""
SHADOWS_PER_M = 1 / 15.0
"""Number of shadow bands per metre of a drive with shadows, 1/m. Chosen by hand; not fitted."""
DRIVES_PER_SET = 20
"""Number of drives into which a set of frames is divided. Chosen by hand; not fitted."""
PAPER_FRAME_RATE_HZ = 10.0
"""Frame rate of the paper's camera, Hz; zhang2011, section 2.1."""
MAX_DRIVE_DURATION_S = 3600.0
"""Longest duration of a drive, s. Chosen by hand; not fitted."""
FRAME_RATE_RANGE_HZ = (1.0, 100.0)
"""Lowest and highest frame rate, Hz. Chosen by hand; not fitted."""
SPEED_RANGE_MPS = (5.0, 60.0)
"""Lowest and highest speed of a drive, m/s. Chosen by hand; not fitted."""
CONFIG_FIELDS_OF_ROAD_DEFECTS = (
    "markings",
    "bends_1pm",
    "ramp_degps",
    "lane_changes_per_min",
    "bridges_per_km",
    "slab_m",
    "junctions",
)
"""Fields of the configuration that ask for the difficulties of `defects` and `junctions`."""
BEND_CURVATURE_RANGE_1PM = (0.0, 0.05)
"""Lowest and highest curvature of mountain bends, 1/m. Chosen by hand; not fitted."""
RAMP_YAW_RATE_RANGE_DEGPS = (0.0, 40.0)
"""Lowest and highest yaw rate on ramps, deg/s. Chosen by hand; not fitted."""
DRIFT_START_S = 5.0
"""Time at which a drift begins, s. Chosen by hand: the observers have settled by then."""
DRIFT_RANGE_MPS = (-2.0, 2.0)
"""Lowest and highest lateral speed of a drift, m/s. Chosen by hand; not fitted."""
LANE_CHANGE_RANGE_PER_MIN = (0.0, 6.0)
"""Lowest and highest number of lane changes per minute. Chosen by hand; not fitted."""
BRIDGE_RANGE_PER_KM = (0.0, 20.0)
"""Lowest and highest number of bridges per kilometre. Chosen by hand; not fitted."""
SLAB_LENGTH_RANGE_M = (0.0, 30.0)
"""Lowest and highest length of concrete slabs, m; 0 is asphalt. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class RoadDriveConfig:
    """The configuration of a rendered drive.

    Attributes:
        weather: A name of `DRAW_FUNCTION_BY_WEATHER`.
        road: A name of a set of frames: how worn, winding and busy the road is.
        seed: Seed of all draws.
        duration_s, rate_hz: Duration of the drive and rate of the camera.
        speed_mps, accel_mps2: Speed at the start, and the constant acceleration.
        markings: Kind of the own lane's markings: painted, dashed or dots.
        bends_1pm: Greatest curvature of mountain bends, instead of the road's own ones; 0: none.
        ramp_degps: Yaw rate on ramps at the start's speed; 0: none.
        lane_changes_per_min, bridges_per_km: How many lane changes, and shadows of bridges.
        slab_m: Length of concrete slabs, with joints; 0: asphalt.
        junctions: Roads that join or leave the lane on its right: none, exits or merges.
        drift_mps: Lateral speed, left positive, with which the driver leaves the middle of a straight lane from
            `DRIFT_START_S` on; 0: the driver stays in the lane.
    """

    weather: str = "clear"
    road: str = "good"
    seed: int = 1
    duration_s: float = 20.0
    rate_hz: float = 20.0
    speed_mps: float = 25.0
    accel_mps2: float = 0.0
    markings: str = "painted"
    bends_1pm: float = 0.0
    ramp_degps: float = 0.0
    lane_changes_per_min: float = 0.0
    bridges_per_km: float = 0.0
    slab_m: float = 0.0
    junctions: str = "none"
    drift_mps: float = 0.0


@dataclass(frozen=True)
class RoadDrive:
    """A planned drive; each frame is rendered on its own, when it is needed.

    Attributes:
        config: The configuration.
        camera: The camera at rest; the body's motion on its springs is added.
        scene: The scene at the start.
        time_s: Shape (n,): times of the frames.
        fine_time_s: Shape (m,): a grid of 10 ms.
        fine_states: Shape (m, 9), see `car.times_and_states_of_drive_along_lane`.
        knots_m, curvature_1pm: Curvature of the lane at stations, linear between them; left positive.
        vertical_1pm: Shape (k,): crests and sags at the same stations.
        pitch_rad: Shape (n,): pitch of the body at the frames, nose down positive.
    """

    config: RoadDriveConfig
    camera: RoadCamera
    scene: RoadScene
    time_s: FloatArray
    fine_time_s: FloatArray
    fine_states: FloatArray
    knots_m: FloatArray
    curvature_1pm: FloatArray
    vertical_1pm: FloatArray
    pitch_rad: FloatArray

    def __len__(self) -> int:
        return len(self.time_s)

    def states_at(self, time_s: FloatArray) -> FloatArray:
        """The car's states at the times (n,), shape (n, 9), linear between the 10 ms of the grid."""
        columns = [np.interp(time_s, self.fine_time_s, column) for column in self.fine_states.T]
        return np.column_stack(columns)

    def speed_at_mps(self, time_s: FloatArray) -> FloatArray:
        """The longitudinal speed at the times (n,), m/s."""
        return self.config.speed_mps + self.config.accel_mps2 * np.asarray(time_s)

    def render_frame_at(self, index: int) -> RoadFrame:
        """Render the frame with an index."""
        scene, camera, road = self._scene_camera_and_road_at(index)
        return render_frame(scene, camera, road, random_stream(self.config.seed, "road-drive", "frame", str(index)))

    def lane_truth_at(self, index: int) -> LaneTruth:
        """The truth of the frame with an index, without its picture."""
        return compute_frame_truth(*self._scene_camera_and_road_at(index))

    def iter_rendered_frames(self) -> Iterator[RoadFrame]:
        """Render all frames in order."""
        return (self.render_frame_at(index) for index in range(len(self)))

    def _scene_camera_and_road_at(self, index: int) -> tuple[RoadScene, RoadCamera, RoadAhead]:
        """The scene, the camera and the road ahead at the frame with an index."""
        time_s = float(self.time_s[index])
        state = self.states_at(np.array([time_s]))[0]
        stations = state[STATION] + ARC_LENGTH_GRID_M
        road = RoadAhead(
            np.interp(stations, self.knots_m, self.curvature_1pm),
            offset_m=float(state[OFFSET]),
            heading_rad=float(state[HEADING]),
            vertical_1pm=float(np.interp(state[STATION] + 40.0, self.knots_m, self.vertical_1pm)),
            station_m=float(state[STATION]),
            bearing_rad=float(state[BEARING]),
        )
        moved = tuple(
            self._vehicle_moved_to_time(vehicle, number, time_s) for number, vehicle in enumerate(self.scene.vehicles)
        )
        scene = with_own_lane_at_offset(replace(self.scene, vehicles=moved), float(state[OFFSET]))
        return scene, self.camera.with_added_pitch(float(self.pitch_rad[index])), road

    def _vehicle_moved_to_time(self, vehicle: SceneVehicle, number: int, time_s: float) -> SceneVehicle:
        """The vehicle at a time: it keeps its distance in the own lane, passes or falls back in others, or comes."""
        rng = random_stream(self.config.seed, "road-drive", "vehicle", str(number))
        if vehicle.is_oncoming:
            ahead = vehicle.ahead_m - 1.9 * self.config.speed_mps * time_s
        elif abs(vehicle.offset_m) < self.scene.lane_width_m / 2:
            ahead = vehicle.ahead_m * (1.0 + 0.15 * math.sin(2 * math.pi * time_s / rng.uniform(12, 25)))
        else:
            faster = rng.uniform(1.0, 4.0) if vehicle.offset_m > 0 else rng.uniform(-4.0, -1.0)
            ahead = vehicle.ahead_m + faster * time_s
        return replace(vehicle, ahead_m=ahead)


def plan_road_drive(config: RoadDriveConfig, camera: RoadCamera) -> RoadDrive:
    """Draw the road, the traffic and the weather, and simulate the car's motion.

    Raises:
        UsageError: The weather or the road is unknown, or a number is out of its range.
    """
    check_drive_config(config)
    spec = FRAME_SETS[config.road]
    rng = random_stream(config.seed, "road-drive", "plan")
    n = math.floor(config.duration_s * config.rate_hz + 1e-9) + 1
    time_s = np.arange(n) / config.rate_hz
    end_mps = config.speed_mps + config.accel_mps2 * config.duration_s
    length_m = (
        max(config.speed_mps, end_mps) * config.duration_s + ARC_LENGTH_GRID_M[-1] + 2 * ROAD_CURVATURE_KNOT_SPACING_M
    )
    knots_m = np.arange(
        -ROAD_CURVATURE_KNOT_SPACING_M, length_m + ROAD_CURVATURE_KNOT_SPACING_M, ROAD_CURVATURE_KNOT_SPACING_M
    )
    curvature = np.clip(
        rng.normal(0.0, 1.3 * spec.curvature_1pm[0], len(knots_m)), -spec.curvature_1pm[1], spec.curvature_1pm[1]
    )
    vertical = draw_vertical_curvature_1pm(spec, len(knots_m), rng)
    phases = rng.uniform(0.0, 2 * math.pi, 5)
    wander_rad = (float(phases[0]), float(phases[1]))
    scene = spread_scene_along_drive(draw_scene(spec, config.weather, rng), config, length_m, rng)
    driver = SwayingDriver(wander_rad=wander_rad)
    if any(getattr(config, name) != getattr(RoadDriveConfig, name) for name in CONFIG_FIELDS_OF_ROAD_DEFECTS):
        own = random_stream(config.seed, "road-drive", "defects")
        knots_m, curvature, vertical = _fine_knots_with_drawn_bend_and_ramp_curvature(
            config, knots_m, curvature, vertical, own
        )
        scene = _add_configured_difficulties_to_scene(scene, config, length_m, own)
        change_s = draw_lane_change_times_s(config.lane_changes_per_min, config.duration_s, own)
        driver = LaneChangingDriver(
            wander_rad=wander_rad, lane_change_start_s=change_s, lane_width_m=scene.lane_width_m
        )
    fine_time_s, states = times_and_states_of_drive_along_lane(
        lambda station: float(np.interp(station, knots_m, curvature)),
        lambda t: config.speed_mps + config.accel_mps2 * t,
        driver,
        config.duration_s,
        load_vehicle(),
    )
    pitch_rad = body_pitch_rad(spec, config, time_s, phases[2:])
    return RoadDrive(config, camera, scene, time_s, fine_time_s, states, knots_m, curvature, vertical, pitch_rad)


def _fine_knots_with_drawn_bend_and_ramp_curvature(
    config: RoadDriveConfig, knots_m: FloatArray, curvature: FloatArray, vertical: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Knots, curvature and crests with mountain bends and ramps, if the configuration has them."""
    if not (config.bends_1pm or config.ramp_degps):
        return knots_m, curvature, vertical
    fine_m = np.arange(knots_m[0], knots_m[-1], FINE_KNOT_M)
    fine_curvature_1pm = draw_mountain_curvature_1pm(fine_m, config.bends_1pm, rng)
    fine_curvature_1pm += draw_ramp_curvature_1pm(fine_m, math.radians(config.ramp_degps), config.speed_mps, rng)
    return fine_m, fine_curvature_1pm, np.interp(fine_m, knots_m, vertical)


def _add_configured_difficulties_to_scene(
    scene: RoadScene, config: RoadDriveConfig, length_m: float, rng: np.random.Generator
) -> RoadScene:
    """Add the difficulties that the configuration has to the scene."""
    scene = with_marking_kind(scene, config.markings)
    if config.lane_changes_per_min:
        scene = with_free_left_lane(scene)
    scene = add_junctions_to_scene(scene, config.junctions, length_m, rng)
    scene = with_concrete_joints(scene, config.slab_m, length_m, rng)
    return with_bridge_shadows(scene, config.bridges_per_km, length_m, rng)


def draw_vertical_curvature_1pm(spec: SetSpec, n: int, rng: np.random.Generator) -> FloatArray:
    """Draw the vertical curvature at n stations, 1/m: crests are negative, sags positive."""
    sigma, limit = spec.vertical_1pm
    return np.clip(rng.normal(0.0, sigma, n), -limit, limit)


def body_pitch_rad(spec: SetSpec, config: RoadDriveConfig, time_s: FloatArray, phases: FloatArray) -> FloatArray:
    """Pitch of the body on its springs at the times (n,), rad, nose down positive; phases of shape (3,)."""
    sway = (
        np.sin(2 * math.pi * 1.4 * time_s + phases[0])
        + 0.6 * np.sin(2 * math.pi * 2.3 * time_s + phases[1])
        + 0.8 * np.sin(2 * math.pi * 0.23 * time_s + phases[2])
    )
    return np.asarray(0.5 * spec.pitch_rad[0] * sway - 0.004 * config.accel_mps2)


def iter_set_drives(
    name: str,
    n_drives: int = DRIVES_PER_SET,
    *,
    seed: int = 0,
    camera: RoadCamera | None = None,
    n_frames: int = FRAMES_PER_SET // DRIVES_PER_SET,
) -> Iterator[RoadDrive]:
    """Plan a set as short drives at the paper's 10 Hz instead of single frames, for methods that follow the lane.

    Args:
        name: Name of the set: good, complex or hard.
        n_drives: Number of drives; each has its own road, traffic, speed (17 to 33 m/s) and weather.
        seed: Another seed gives another set with the same distribution.
        n_frames: Frames of each drive; 20 drives of 25 make the 500 of a set.
    """
    spec = FRAME_SETS[name]
    names, chances = list(spec.conditions), np.array(list(spec.conditions.values()))
    for number in range(n_drives):
        rng = random_stream(seed, "road-set-drive", name, str(number))
        config = RoadDriveConfig(
            weather=names[int(rng.choice(len(names), p=chances / chances.sum()))],
            road=name,
            seed=int(rng.integers(0, 2**31)),
            duration_s=(n_frames - 1) / PAPER_FRAME_RATE_HZ,
            rate_hz=PAPER_FRAME_RATE_HZ,
            speed_mps=rng.uniform(17.0, 33.0),
        )
        yield plan_road_drive(config, camera or camera_of_zhang2011())


def spread_scene_along_drive(
    scene: RoadScene, config: RoadDriveConfig, length_m: float, rng: np.random.Generator
) -> RoadScene:
    """Repeat patches and shadows along the whole drive at random stations."""
    patches = []
    for patch in scene.patches:
        for start in np.arange(0.0, length_m, 80.0):
            patches.append(replace(patch, station_m=float(start + rng.uniform(0.0, 80.0))))
    shadows: list[Shadow] = []
    if scene.light.shadows:
        shadows = [draw_shadow_band(rng, 0.0, length_m) for _ in range(int(length_m * SHADOWS_PER_M))]
    return replace(scene, patches=tuple(patches), light=replace(scene.light, shadows=tuple(shadows)))


def check_drive_config(config: RoadDriveConfig) -> None:
    """Refuse unknown names and numbers outside their ranges."""
    for name, chosen, known in (
        ("weather", config.weather, DRAW_FUNCTION_BY_WEATHER),
        ("road", config.road, FRAME_SETS),
        ("kind of markings", config.markings, MARKING_KINDS),
        ("kind of junctions", config.junctions, JUNCTION_KINDS),
    ):
        if chosen not in known:
            raise UsageError(f"there is no {name} {chosen!r}", hint=f"known: {', '.join(known)}")
    limits = {
        "duration": (config.duration_s, (0.1, MAX_DRIVE_DURATION_S), "s"),
        "rate": (config.rate_hz, FRAME_RATE_RANGE_HZ, "Hz"),
        "speed": (config.speed_mps, SPEED_RANGE_MPS, "m/s"),
        "speed at the end": (config.speed_mps + config.accel_mps2 * config.duration_s, SPEED_RANGE_MPS, "m/s"),
        "curvature of bends": (config.bends_1pm, BEND_CURVATURE_RANGE_1PM, "1/m"),
        "yaw rate of ramps": (config.ramp_degps, RAMP_YAW_RATE_RANGE_DEGPS, "deg/s"),
        "rate of lane changes": (config.lane_changes_per_min, LANE_CHANGE_RANGE_PER_MIN, "per minute"),
        "rate of bridges": (config.bridges_per_km, BRIDGE_RANGE_PER_KM, "per km"),
        "length of slabs": (config.slab_m, SLAB_LENGTH_RANGE_M, "m"),
        "drift": (config.drift_mps, DRIFT_RANGE_MPS, "m/s"),
    }
    for name, (value, (low, high), unit) in limits.items():
        if not low <= value <= high:
            raise UsageError(f"the {name} of {value:g} {unit} is not between {low:g} and {high:g}")
    standard = RoadDriveConfig()
    if config.drift_mps and any(
        getattr(config, name) != getattr(standard, name) for name in CONFIG_FIELDS_OF_ROAD_DEFECTS
    ):
        raise UsageError(
            "a drift is driven on a straight road with painted markings",
            hint=f"leave out drift, or {', '.join(CONFIG_FIELDS_OF_ROAD_DEFECTS)}",
        )
