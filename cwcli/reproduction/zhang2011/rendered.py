"""Drives seen through rendered frames: the chain from the picture to the lane, without a log between.

`sense_rendered_drive` gives what `simulate_lane_sensors_of_run` gives, but its boundaries are found by a lane method in
rendered frames.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cwcli.dynamics.samples import DEFAULT_PREVIEW_POINT_DISTANCE_M, LaneSamples
from cwcli.dynamics.vehicle import Vehicle
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray
from cwcli.simulation.lane_camera import SensedDrive, simulate_lane_sensors_of_run
from cwcli.simulation.lane_drive import INTEGRATION_STEP_S, LaneDriveTruth, Road
from cwcli.simulation.road.camera import RoadCamera
from cwcli.simulation.road.drive import RoadDrive
from cwcli.simulation.road.lane_frames import LaneFrameSettings, road_drive_from_lane_run
from cwcli.simulation.streams import seconds_to_ns
from cwcli.vision.camera import Camera, Mounting
from cwcli.vision.fit_columns import FitCollector, FitColumns
from cwcli.vision.ground import GeometrySigmas, LaneGeometry, compute_lane_geometry
from cwcli.vision.method import GreyImage, LaneFrame
from cwcli.vision.methods import DEFAULT_METHOD, METHODS


@dataclass(frozen=True)
class RenderSettings(LaneFrameSettings):
    """Settings of the rendered frames, and of the lane method's camera.

    Attributes:
        pitch_error_rad: How much too steep the mounting that the lane method is told of is.
    """

    pitch_error_rad: float = 0.0


@dataclass(frozen=True)
class RenderedDrive:
    """One run as its rendered camera and its other sensors measured it.

    Attributes:
        sensed: As from `simulate_lane_sensors_of_run`.
        camera: As the lane method was told, in the pixels of the frames.
        fits: n rows, in the pixels of the search image.
        geometry: n rows.
    """

    sensed: SensedDrive
    drive: RoadDrive
    camera: Camera
    fits: FitColumns
    geometry: LaneGeometry


def sense_rendered_drive(
    truth: LaneDriveTruth,
    run: int,
    road: Road,
    vehicle: Vehicle,
    *,
    settings: RenderSettings | None = None,
    method: str = DEFAULT_METHOD,
    seed: int = 0,
) -> RenderedDrive:
    """Render one run, find its lanes, and sense speed and yaw rate.

    Args:
        truth: From `simulate_lane_runs`.
        road, vehicle: As given to `simulate_lane_runs`.
        settings: None: the defaults.
        method: A key of `vision.methods.METHODS`. It is told the speed, not the yaw rate.
    """
    settings = settings or RenderSettings()
    drive = road_drive_from_lane_run(truth, run, road, settings, seed=seed)
    others = simulate_lane_sensors_of_run(truth, run, road, vehicle, seed=seed)
    speed_mps = np.interp(seconds_to_ns(drive.time_s), others.speed.stamp_ns, others.speed.values)
    camera = camera_with_pitch_error(drive.camera, settings.pitch_error_rad)
    fits = find_lanes_in_drive(drive, camera, method, speed_mps, seed)
    search = camera.with_image_size(*METHODS[method].search_size(camera.width_px, camera.height_px))
    geometry = compute_lane_geometry(fits, search, preview_m=DEFAULT_PREVIEW_POINT_DISTANCE_M)
    sensed = replace(
        others,
        index=np.rint(drive.time_s / INTEGRATION_STEP_S).astype(np.intp),
        left_body=geometry.left_body,
        right_body=geometry.right_body,
        lanes=lane_samples_from_geometry(drive.time_s, geometry, fits),
    )
    return RenderedDrive(sensed, drive, camera, fits, geometry)


def camera_with_pitch_error(camera: RoadCamera, pitch_error_rad: float = 0.0) -> Camera:
    """Return the renderer's camera at rest, as a user would describe it."""
    return Camera(
        width_px=camera.width_px,
        height_px=camera.height_px,
        fx=camera.fx,
        fy=camera.fy,
        cx=camera.cx,
        cy=camera.cy,
        mounting=Mounting(height_m=camera.height_m, pitch_rad=camera.pitch_rad + pitch_error_rad),
    )


def find_lanes_in_drive(
    drive: RoadDrive, camera: Camera, method: str, speed_mps: FloatArray, seed: int = 0
) -> FitColumns:
    """Find the boundaries in every frame of a drive.

    Args:
        camera: As the method is told, in the pixels of the frames.
        method: A key of `METHODS`.
        speed_mps: Shape (n,), at the frames.
    """
    chosen = METHODS[method]
    size = chosen.search_size(camera.width_px, camera.height_px)
    search, seen_by = chosen.make(seed), camera.with_image_size(*size)
    recorder = FitCollector()
    for number, stamp_ns in enumerate(seconds_to_ns(drive.time_s).tolist()):
        grey = _resize_to_search_size(drive.render_frame_at(number).grey, size)
        prepared = None if chosen.prepare is None else chosen.prepare(grey)
        frame = LaneFrame(grey, seen_by, stamp_ns, number, speed_mps=float(speed_mps[number]), prepared=prepared)
        recorder.append_fit(search.step(frame))
    return recorder.to_columns()


def lane_samples_from_geometry(time_s: FloatArray, geometry: LaneGeometry, fits: FitColumns) -> LaneSamples:
    """Return the observer's input from the lanes, at the stamps of the frames."""
    is_curve = np.isfinite(fits.roads).all(axis=-1, keepdims=True)
    bodies = np.stack([geometry.left_body, geometry.right_body], axis=1)
    return LaneSamples(
        stamp_ns=seconds_to_ns(time_s),
        lateral_deviation_m=geometry.lateral_deviation_m,
        heading_deviation_rad=geometry.heading_deviation_rad,
        curvature_1pm=geometry.curvature_1pm,
        lateral_sigma_m=geometry.lateral_deviation_sigma_m,
        heading_sigma_rad=geometry.heading_deviation_sigma_rad,
        curvature_sigma_1pm=geometry.curvature_sigma_1pm,
        yaw_sigma_rad=GeometrySigmas().yaw_rad,
        lines=np.where(is_curve, bodies, np.nan),
        curvature_change_1pm2=geometry.curvature_change_1pm2,
    )


def _resize_to_search_size(grey: GreyImage, size: tuple[int, int]) -> GreyImage:
    """Resize a picture to the size of the search, as `vision.frames` does."""
    if grey.shape[1::-1] == size:
        return grey
    import cv2

    shrinks = grey.shape[1] >= size[0] and grey.shape[0] >= size[1]
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR), np.uint8)
