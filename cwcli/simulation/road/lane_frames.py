"""Rendered frames of a run of `lane_drive`: the same car and truth before a rendered camera."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cwcli.dynamics.vehicle import load_vehicle
from cwcli.lazy_dataclass import dataclass
from cwcli.simulation.lane_drive import LaneDriveTruth, LaneRuns, Road, simulate_lane_runs
from cwcli.simulation.road.camera import RoadCamera, camera_of_zhang2011
from cwcli.simulation.road.drive import (
    DRIFT_START_S,
    ROAD_CURVATURE_KNOT_SPACING_M,
    RoadDrive,
    RoadDriveConfig,
    body_pitch_rad,
    check_drive_config,
    draw_vertical_curvature_1pm,
    spread_scene_along_drive,
)
from cwcli.simulation.road.geometry import ARC_LENGTH_GRID_M
from cwcli.simulation.road.sets import FRAME_SETS, draw_scene
from cwcli.simulation.streams import random_stream

MIN_KNOT_SPACING_M = 1e-6
"""Smallest distance of two stations that are kept as separate knots, m, against rounding."""


@dataclass(frozen=True)
class LaneFrameSettings:
    """Settings of the rendered frames.

    Attributes:
        road: Name of a set of frames (good, complex, hard): surface, markings, traffic, crests and the body's motion on
            its springs.
        weather: A name of `DRAW_FUNCTION_BY_WEATHER`.
        rate_hz: Rate of the camera.
        camera: The camera; None: zhang2011's.
    """

    road: str = "good"
    weather: str = "clear"
    rate_hz: float = 20.0
    camera: RoadCamera | None = None


def plan_drifting_drive(config: RoadDriveConfig, camera: RoadCamera) -> RoadDrive:
    """Plan a drive whose car leaves the middle of a straight lane with the drift of the configuration.

    Raises:
        UsageError: A value is out of its range, or asks for a road that is not straight.
    """
    check_drive_config(config)
    runs = LaneRuns(
        np.array([config.speed_mps]),
        np.array([config.drift_mps]),
        np.array([DRIFT_START_S]),
        config.accel_mps2,
        config.duration_s,
    )
    road = Road()
    truth = simulate_lane_runs(road, load_vehicle(), runs, seed=config.seed)
    settings = LaneFrameSettings(config.road, config.weather, config.rate_hz, camera)
    drive = road_drive_from_lane_run(truth, 0, road, settings, seed=config.seed)
    return replace(drive, config=replace(drive.config, drift_mps=config.drift_mps))


def road_drive_from_lane_run(
    truth: LaneDriveTruth, run: int, road: Road, settings: LaneFrameSettings, *, seed: int = 0
) -> RoadDrive:
    """Convert one run of a lane drive to a drive whose frames can be rendered.

    Args:
        run: Column of the run in the truth.
        road: The road of the runs; its curvature and the lane's width are kept.
        seed: Seed of the look and of the frames' noise.
    """
    look, weather, rate_hz = settings.road, settings.weather, settings.rate_hz
    duration_s = float(truth.time_s[-1])
    speed_mps = float(truth.speed_mps[0, run])
    accel_mps2 = (float(truth.speed_mps[-1, run]) - speed_mps) / duration_s
    config = RoadDriveConfig(weather, look, seed, duration_s, rate_hz, speed_mps, accel_mps2)
    spec = replace(FRAME_SETS[look], lane_width_m=(road.lane_width_m, road.lane_width_m))
    rng = random_stream(seed, "road-run", str(run))
    length_m = float(truth.station_m[:, run].max()) + float(ARC_LENGTH_GRID_M[-1]) + ROAD_CURVATURE_KNOT_SPACING_M
    grid_m = np.arange(
        -ROAD_CURVATURE_KNOT_SPACING_M, length_m + ROAD_CURVATURE_KNOT_SPACING_M, ROAD_CURVATURE_KNOT_SPACING_M
    )
    vertical = draw_vertical_curvature_1pm(spec, len(grid_m), rng)
    knots_m = np.union1d(grid_m, road.station_m)
    knots_m = knots_m[np.concatenate([[True], np.diff(knots_m) > MIN_KNOT_SPACING_M])]
    time_s = np.arange(int(duration_s * rate_hz + 1e-9) + 1) / rate_hz
    columns = (
        *(truth.lateral_speed_mps, truth.yaw_rate_radps, truth.station_m, truth.offset_m, truth.heading_rad),
        *(truth.x_m, truth.y_m, truth.yaw_rad, truth.steer_rad),
    )
    return RoadDrive(
        config=config,
        camera=settings.camera or camera_of_zhang2011(),
        scene=spread_scene_along_drive(draw_scene(spec, weather, rng), config, length_m, rng),
        time_s=time_s,
        fine_time_s=truth.time_s,
        fine_states=np.column_stack([column[:, run] for column in columns]),
        knots_m=knots_m,
        curvature_1pm=road.curvature_at_1pm(knots_m),
        vertical_1pm=np.interp(knots_m, grid_m, vertical),
        pitch_rad=body_pitch_rad(spec, config, time_s, rng.uniform(0.0, 2 * np.pi, 3)),
    )
