"""Figures 17 to 19: drives in a lane; observed against actual track, and the path 2 s ahead.

The paper drove on a road that it does not describe. Here a lane of 3.6 m winds with bends of 500 and 330 m radius and
straights between: about its mean curvature of 0.001 1/m. 20 frames (2 s) make one track, as in the paper.

Each drive is seen twice: as simulated points of the boundaries, and in rendered frames, by a lane method.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from cwcli.dynamics.config import ObserverConfig
from cwcli.dynamics.observer import observe_lateral_motion
from cwcli.dynamics.samples import LateralTrack
from cwcli.dynamics.vehicle import load_vehicle
from cwcli.lazy_dataclass import dataclass
from cwcli.prediction.lateral import LateralPathConfig, dead_reckon_x_y_m_and_heading_rad, predict_paths_from_observer
from cwcli.prediction.lateral_calibrate import scale_covariance_across_path
from cwcli.prediction.paths import Paths
from cwcli.reproduction.classes import MeasuredNumber
from cwcli.reproduction.findings import Curve, Plot, StudyPart, median_and_interval_bounds
from cwcli.reproduction.zhang2011.pictures import frame_with_boundaries_plot
from cwcli.reproduction.zhang2011.rendered import RenderedDrive, RenderSettings, sense_rendered_drive
from cwcli.signals.columns import FloatArray
from cwcli.signals.normal_distribution import SIGMAS_HOLDING_90_PERCENT
from cwcli.signals.units import MPS_PER_KMH
from cwcli.simulation.lane_camera import SensedDrive, simulate_lane_sensors_of_run
from cwcli.simulation.lane_drive import INTEGRATION_STEP_S, LaneDriveTruth, LaneRuns, Road, simulate_lane_runs
from cwcli.vision.boundary import BOUNDARY_NOT_FOUND, Boundary
from cwcli.vision.method import LaneFit

PATH_HORIZON_S = 2.0
"""How far ahead the paths are judged, in s: that of figures 17 to 19."""
FRAMES_PER_TRACK = 20
"""Frames of one track: 2 s at 10 Hz, as in the paper."""
N_SETTLING_FRAMES = 20
"""Earlier frames are not judged, because the observers have not settled. Chosen by hand; not fitted."""
FIRST_PLOTTED_FRAME = 150
"""The frame at which the plots begin. Chosen by hand; not fitted."""
MAX_DRIVE_SEEDS = 20
"""The greatest number of seeds of a figure. Chosen by hand; not fitted."""
FRAME_RATE_HZ = 10.0
"""The paper's frame rate, in Hz (zhang2011, section 2.1)."""
CURVE_LABELS = {"zhang2011": "zhang2011", "camera and speed": "camera", "with a gyroscope": "camera and gyroscope"}
"""Method -> its label in plots."""
RENDERED_FRAMES_NUMBER_PREFIX = "rendered frames, "
"""The prefix of numbers from rendered frames."""

WINDING_ROAD = Road(
    np.array([0.0, 200.0, 280.0, 500.0, 580.0, 800.0, 880.0, 1100.0, 1180.0]),
    np.array([0.0, 0.0, 0.002, 0.002, 0.0, 0.0, -0.003, -0.003, 0.0]),
)
"""The lane of the drives, with bends of 500 and 330 m. Chosen by hand, as the paper describes none
(docs/papers/zhang2011-motion.md)."""


@dataclass(frozen=True)
class DriveSetup:
    """One of the paper's drives."""

    load: str
    start_kmh: float
    accel_mps2: float
    duration_s: float = 40.0


DRIVE_BY_FIGURE: dict[str, DriveSetup] = {
    "fig 17": DriveSetup("half", 90.0, 0.0),
    "fig 18": DriveSetup("half", 80.0, 0.2),
    "fig 19": DriveSetup("full", 70.0, 0.18),
}
"""Figure -> the paper's drive."""

NAME_OF_MEDIAN_TRACK_ERROR_OVER_2_S = "track over 2 s, median error"
"""The name of the track's error among the numbers."""
NAME_OF_SHARE_OF_TRUTH_IN_90_PERCENT_BAND = "share of the truth in the 90 % band at 2 s"
"""The name of the band's share among the numbers."""


def observer_path_model_and_gyro_by_method() -> dict[str, tuple[ObserverConfig, str, bool]]:
    """Return name -> observer, path model, and whether the gyroscope is used.

    All are told half load, as the paper's is. The load is not estimated: that takes lanes without errors that last, and
    those of rendered frames have such errors in bends.
    """
    return {
        "zhang2011": (ObserverConfig("zhang2011"), "zhang2011", False),
        "camera and speed": (ObserverConfig(), "cwcli", False),
        "with a gyroscope": (ObserverConfig(), "cwcli", True),
    }


def drive_errors_part(
    figure: str, n_seeds: int, tick: Callable[[], None] = lambda: None, *, lane_method: str | None = None
) -> StudyPart:
    """Compute one figure over seeds 0, 1, 2, ...: medians over the seeds.

    Args:
        figure: A key of `DRIVE_BY_FIGURE`.
        n_seeds: At most `MAX_DRIVE_SEEDS`.
        lane_method: A key of `vision.methods.METHODS` that finds the lanes in rendered frames; None: simulated points.
    """
    method_prefix = "" if lane_method is None else RENDERED_FRAMES_NUMBER_PREFIX
    drive, half = DRIVE_BY_FIGURE[figure], load_vehicle()
    n = max(1, min(n_seeds, MAX_DRIVE_SEEDS))
    start = np.full(n, drive.start_kmh * MPS_PER_KMH)
    runs = LaneRuns(start, np.zeros(n), np.full(n, np.inf), drive.accel_mps2, drive.duration_s)
    truth = simulate_lane_runs(WINDING_ROAD, half.with_load(drive.load), runs, seed=0)
    values: dict[str, dict[str, list[float]]] = {name: {} for name in observer_path_model_and_gyro_by_method()}
    curves: list[Curve] = []
    pictures: list[Plot] = []
    for run in range(n):
        rendered = None
        if lane_method is None:
            sensed = simulate_lane_sensors_of_run(truth, run, WINDING_ROAD, half, seed=run)
        else:
            look = RenderSettings(rate_hz=FRAME_RATE_HZ)
            rendered = sense_rendered_drive(truth, run, WINDING_ROAD, half, settings=look, method=lane_method, seed=run)
            sensed = rendered.sensed
        for name, (config, model, with_gyro) in observer_path_model_and_gyro_by_method().items():
            track = observe_lateral_motion(
                sensed.lanes, sensed.speed, half, config, yaw_rate=sensed.yaw_rate if with_gyro else None
            )
            paths = scale_covariance_across_path(
                predict_paths_from_observer(track, half, LateralPathConfig(model=model)), track
            )
            found = compute_drive_errors(
                truth, run, sensed, track, (paths.x_m, paths.y_m), paths.position_covariance_m2
            )
            for what, value in found.items():
                values[name].setdefault(what, []).append(value)
            if run == 0 and rendered is not None and not with_gyro and name != "zhang2011":
                pictures.append(_predicted_path_plot(figure, rendered, paths))
            if run == 0:
                curves.append(_observed_track_curve(name, track, truth, sensed, run))
        if run == 0:
            curves[:0] = _road_and_track_curves(truth, sensed, run)
        tick()
    measured = [
        MeasuredNumber(figure, f"{method_prefix}{name}: {what}", *median_and_interval_bounds(np.array(found)))
        for name, each in values.items()
        for what, found in each.items()
    ]
    speed = (
        f"from {drive.start_kmh:g} km/h at {drive.accel_mps2:g} m/s^2"
        if drive.accel_mps2
        else f"{drive.start_kmh:g} km/h"
    )
    title = f"{drive.load} load, {speed}: 2 s of the first seed"
    track_plot = Plot(f"{figure} rendered" if method_prefix else f"{figure}a", title, "x [m]", "y [m]", curves)
    if not method_prefix:
        pictures.append(_track_deviation_plot(figure, title, curves))
    return StudyPart(tuple(measured), (track_plot, *pictures))


def _track_deviation_plot(figure: str, title: str, curves: Sequence[Curve]) -> Plot:
    """Plot how far the observed tracks lie to the left of the actual one, which covers them in the plot of tracks."""
    actual = next(curve for curve in curves if curve.label == "actual")
    x, y = (np.asarray(values) for values in (actual.x, actual.y))
    along = np.arctan2(np.gradient(y), np.gradient(x))
    time_s = np.arange(len(x)) / FRAME_RATE_HZ
    deviations = [
        Curve(curve.label, time_s, 100.0 * (np.cos(along) * (curve.y - y) - np.sin(along) * (curve.x - x)))
        for curve in curves
        if curve.label in CURVE_LABELS.values()
    ]
    return Plot(f"{figure} deviation", title, "time [s]", "to the left of the actual track [cm]", deviations)


def _boundary_from_parabola(abc: FloatArray) -> Boundary:
    """Return the boundary of three coefficients of a parabola; not found if they are NaN."""
    a, b, c = abc.tolist()
    return Boundary(a, b, c, np.nan, np.nan, True) if np.isfinite(c) else BOUNDARY_NOT_FOUND


def _predicted_path_plot(figure: str, rendered: RenderedDrive, paths: Paths) -> Plot:
    """Plot figure 17b, 18b or 19b: a frame with its boundaries and the path of the next 2 s."""
    k = FIRST_PLOTTED_FRAME
    camera = rendered.drive.camera
    x_m, y_m = paths.x_m[k] - load_vehicle().camera_forward_m, paths.y_m[k]
    u, v = camera.project_to_image_px(x_m, y_m, np.zeros(len(x_m)))
    inside = (u >= 0) & (u < camera.width_px) & (v >= 0) & (v < camera.height_px)
    path = Curve("path", u[inside] + 0.5, camera.height_px - 0.5 - v[inside])
    left, right = (_boundary_from_parabola(rendered.fits.parabolas[k, side]) for side in range(2))
    fit = LaneFit(left, right)
    title = f"the path of the next {PATH_HORIZON_S:g} s"
    return frame_with_boundaries_plot(f"{figure}b", title, rendered.drive.render_frame_at(k), fit, (path,))


def compute_drive_errors(
    truth: LaneDriveTruth,
    run: int,
    sensed: SensedDrive,
    track: LateralTrack,
    path_xy: tuple[FloatArray, FloatArray],
    covariance: FloatArray,
) -> dict[str, float]:
    """Compute the errors of one run, from `N_SETTLING_FRAMES` on."""
    rows = np.arange(N_SETTLING_FRAMES, len(track))
    index = sensed.index[rows]
    state = track.state[rows]
    yaw_rate = state[:, 1] - truth.yaw_rate_radps[index, run]
    lateral = state[:, 0] - truth.lateral_speed_mps[index, run]
    later = index + round(PATH_HORIZON_S / INTEGRATION_STEP_S)
    ok = (later < len(truth.time_s)) & np.isfinite(state[:, 0])
    rows, index, later = rows[ok], index[ok], later[ok]
    forward, left = _displacement_in_body_frame_m(truth, run, index, later)
    ex, ey = path_xy[0][rows, -1] - forward, path_xy[1][rows, -1] - left
    sigma = np.sqrt(covariance[rows, -1, 2])
    return {
        "yaw rate, RMSE": float(np.degrees(np.sqrt(np.nanmean(yaw_rate**2)))),
        "v_y, RMSE": float(np.sqrt(np.nanmean(lateral**2))),
        NAME_OF_MEDIAN_TRACK_ERROR_OVER_2_S: _median_track_endpoint_distance_m(truth, run, sensed, track),
        "path at 2 s, median error": float(np.median(np.hypot(ex, ey))),
        NAME_OF_SHARE_OF_TRUTH_IN_90_PERCENT_BAND: float(np.mean(np.abs(ey) < SIGMAS_HOLDING_90_PERCENT * sigma)),
    }


def _displacement_in_body_frame_m(
    truth: LaneDriveTruth, run: int, index: npt.NDArray[np.intp], later: npt.NDArray[np.intp]
) -> tuple[FloatArray, FloatArray]:
    """Return the car's later position in its body frame of now, forward and left, m."""
    dx, dy = (values[later, run] - values[index, run] for values in (truth.x_m, truth.y_m))
    cos, sin = np.cos(truth.yaw_rad[index, run]), np.sin(truth.yaw_rad[index, run])
    return cos * dx + sin * dy, -sin * dx + cos * dy


def _median_track_endpoint_distance_m(
    truth: LaneDriveTruth, run: int, sensed: SensedDrive, track: LateralTrack
) -> float:
    """Return the median distance, m, between the ends of observed and actual tracks that begin at the same pose."""
    x, y, heading = dead_reckon_x_y_m_and_heading_rad(track)
    first = np.arange(N_SETTLING_FRAMES, len(track) - FRAMES_PER_TRACK)
    last = first + FRAMES_PER_TRACK
    cos, sin = np.cos(heading[first]), np.sin(heading[first])
    dx, dy = x[last] - x[first], y[last] - y[first]
    forward, left = _displacement_in_body_frame_m(truth, run, sensed.index[first], sensed.index[last])
    return float(np.median(np.hypot(cos * dx + sin * dy - forward, -sin * dx + cos * dy - left)))


def _observed_track_curve(
    name: str, track: LateralTrack, truth: LaneDriveTruth, sensed: SensedDrive, run: int
) -> Curve:
    """Return the observed track of the example, placed at the true pose."""
    rows = slice(FIRST_PLOTTED_FRAME, FIRST_PLOTTED_FRAME + FRAMES_PER_TRACK + 1)
    x, y, heading = (values[rows] for values in dead_reckon_x_y_m_and_heading_rad(track))
    at = sensed.index[FIRST_PLOTTED_FRAME]
    turn = truth.yaw_rad[at, run] - heading[0]
    dx, dy = x - x[0], y - y[0]
    return Curve(
        CURVE_LABELS[name],
        truth.x_m[at, run] + np.cos(turn) * dx - np.sin(turn) * dy,
        truth.y_m[at, run] + np.sin(turn) * dx + np.cos(turn) * dy,
    )


def _road_and_track_curves(truth: LaneDriveTruth, sensed: SensedDrive, run: int) -> list[Curve]:
    """Return the actual track of the example and both boundaries of the lane."""
    index = sensed.index[FIRST_PLOTTED_FRAME : FIRST_PLOTTED_FRAME + FRAMES_PER_TRACK + 1]
    table, x, y, direction = WINDING_ROAD.centre_line_table(float(truth.station_m.max()) + 100.0)
    station = truth.station_m[index, run]
    centre_x, centre_y, along = (np.interp(station, table, values) for values in (x, y, direction))
    half = 0.5 * WINDING_ROAD.lane_width_m
    return [
        Curve("actual", truth.x_m[index, run], truth.y_m[index, run]),
        Curve("left boundary", centre_x - half * np.sin(along), centre_y + half * np.cos(along)),
        Curve("right boundary", centre_x + half * np.sin(along), centre_y - half * np.cos(along)),
    ]
