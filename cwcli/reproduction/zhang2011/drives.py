"""Figures 17 to 19: drives in a lane; observed against actual track, and the path 2 s ahead.

The paper drove on a road that it does not describe. Here a lane of 3.6 m winds with bends of 500 and 330 m radius and
straights between: about its mean curvature of 0.001 1/m. 20 frames (2 s) make one track, as in the paper.

Each drive is seen twice: as simulated points of the boundaries, and in rendered frames, by a lane method.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cwcli.dynamics.config import ObserverConfig
from cwcli.dynamics.observer import observe
from cwcli.dynamics.samples import LateralTrack
from cwcli.dynamics.vehicle import load_vehicle
from cwcli.prediction.lateral import Z_90, LateralPathConfig, dead_reckon, lateral_paths
from cwcli.prediction.lateral_calibrate import calibrate_paths
from cwcli.reproduction.findings import NOT_PRINTED, Curve, Finding, Part, Plot, median_interval
from cwcli.reproduction.zhang2011.rendered import Look, sense_rendered
from cwcli.signals.columns import FloatArray
from cwcli.signals.units import MPS_PER_KMH
from cwcli.simulation.lane_camera import SensedDrive, sense_lane
from cwcli.simulation.lane_drive import STEP_S, Road, Runs, Truth, drive_lane

HORIZON_S = 2.0
FRAMES_OF_TRACK = 20
SETTLED_FRAMES = 20
EXAMPLE_FRAME = 150
MAX_SEEDS = 20
FRAME_HZ = 10.0
"""The paper's (section 2.1)."""
PLOT_NAMES = {"zhang2011": "zhang2011", "camera and speed": "camera", "with a gyroscope": "and gyroscope"}
RENDERED = "rendered frames, "

ROAD = Road(
    np.array([0.0, 200.0, 280.0, 500.0, 580.0, 800.0, 880.0, 1100.0, 1180.0]),
    np.array([0.0, 0.0, 0.002, 0.002, 0.0, 0.0, -0.003, -0.003, 0.0]),
)


@dataclass(frozen=True)
class Drive:
    """One of the paper's drives."""

    load: str
    start_kmh: float
    accel_mps2: float
    duration_s: float = 40.0


DRIVES: dict[str, Drive] = {
    "fig 17": Drive("half", 90.0, 0.0),
    "fig 18": Drive("half", 80.0, 0.2),
    "fig 19": Drive("full", 70.0, 0.18),
}

BOUNDS: dict[str, dict[str, tuple[str, float]]] = {
    "camera and speed": {
        "yaw rate, RMSE": ("deg/s", 1.0),
        "v_y, RMSE": ("m/s", 0.10),
        "path at 2 s, median error": ("m", 0.6),
    },
    "with a gyroscope": {
        "yaw rate, RMSE": ("deg/s", 0.2),
        "v_y, RMSE": ("m/s", 0.08),
        "path at 2 s, median error": ("m", 0.35),
    },
}
BAND = (0.85, 0.95)
TRACK = "track over 2 s, median error"
BAND_NAME = "share of the truth in the 90 % band at 2 s"


def methods() -> dict[str, tuple[ObserverConfig, str, bool]]:
    """Name -> observer, path model, whether the gyroscope is used.

    All are told half load, as the paper's is. The load is not estimated: that takes lanes without errors that last, and
    those of rendered frames have such errors in bends.
    """
    return {
        "zhang2011": (ObserverConfig("zhang2011"), "zhang2011", False),
        "camera and speed": (ObserverConfig(), "cwcli", False),
        "with a gyroscope": (ObserverConfig(), "cwcli", True),
    }


def drive_part(
    figure: str, n_seeds: int, tick: Callable[[], None] = lambda: None, *, lane_method: str | None = None
) -> Part:
    """One figure over seeds 0, 1, 2, ...: medians over the seeds.

    Args:
        figure: A key of `DRIVES`.
        n_seeds: At most `MAX_SEEDS`.
        tick: Called after each seed.
        lane_method: A key of `vision.methods.METHODS` that finds the lanes in rendered frames; None: simulated points.
    """
    seen = "" if lane_method is None else RENDERED
    drive, half = DRIVES[figure], load_vehicle()
    n = max(1, min(n_seeds, MAX_SEEDS))
    start = np.full(n, drive.start_kmh * MPS_PER_KMH)
    runs = Runs(start, np.zeros(n), np.full(n, np.inf), drive.accel_mps2, drive.duration_s)
    truth = drive_lane(ROAD, half.loaded(drive.load), runs, seed=0)
    values: dict[str, dict[str, list[float]]] = {name: {} for name in methods()}
    curves: list[Curve] = []
    for run in range(n):
        if lane_method is None:
            sensed = sense_lane(truth, run, ROAD, half, seed=run)
        else:
            look = Look(rate_hz=FRAME_HZ)
            sensed = sense_rendered(truth, run, ROAD, half, look=look, method=lane_method, seed=run).sensed
        for name, (config, model, with_gyro) in methods().items():
            track = observe(sensed.lanes, sensed.speed, half, config, yaw_rate=sensed.yaw_rate if with_gyro else None)
            paths = calibrate_paths(lateral_paths(track, half, LateralPathConfig(model=model)), track)
            found = drive_errors(truth, run, sensed, track, (paths.x_m, paths.y_m), paths.position_covariance_m2)
            for what, value in found.items():
                values[name].setdefault(what, []).append(value)
            if run == 0:
                curves.append(_track_curve(name, track, truth, sensed, run))
        if run == 0:
            curves[:0] = _road_curves(truth, sensed, run)
        tick()
    findings = [
        _finding(figure, name, what, np.array(found), seen)
        for name, each in values.items()
        for what, found in each.items()
    ]
    title = f"{drive.load} load, from {drive.start_kmh:g} km/h at {drive.accel_mps2:g} m/s^2: 2 s of the first seed"
    return Part(tuple(findings), (Plot(f"{figure} rendered" if seen else figure, title, "x [m]", "y [m]", curves),))


def drive_errors(
    truth: Truth,
    run: int,
    sensed: SensedDrive,
    track: LateralTrack,
    path_xy: tuple[FloatArray, FloatArray],
    covariance: FloatArray,
) -> dict[str, float]:
    """Errors of one run, from `SETTLED_FRAMES` on."""
    rows = np.arange(SETTLED_FRAMES, len(track))
    index = sensed.index[rows]
    state = track.state[rows]
    yaw_rate = state[:, 1] - truth.yaw_rate_radps[index, run]
    lateral = state[:, 0] - truth.lateral_speed_mps[index, run]
    later = index + round(HORIZON_S / STEP_S)
    ok = (later < len(truth.time_s)) & np.isfinite(state[:, 0])
    rows, index, later = rows[ok], index[ok], later[ok]
    forward, left = _moved(truth, run, index, later)
    ex, ey = path_xy[0][rows, -1] - forward, path_xy[1][rows, -1] - left
    sigma = np.sqrt(covariance[rows, -1, 2])
    return {
        "yaw rate, RMSE": float(np.degrees(np.sqrt(np.nanmean(yaw_rate**2)))),
        "v_y, RMSE": float(np.sqrt(np.nanmean(lateral**2))),
        TRACK: _track_error(truth, run, sensed, track),
        "path at 2 s, median error": float(np.median(np.hypot(ex, ey))),
        BAND_NAME: float(np.mean(np.abs(ey) < Z_90 * sigma)),
    }


def _moved(
    truth: Truth, run: int, index: npt.NDArray[np.intp], later: npt.NDArray[np.intp]
) -> tuple[FloatArray, FloatArray]:
    """Where the car is later, in its body frame now."""
    dx, dy = (values[later, run] - values[index, run] for values in (truth.x_m, truth.y_m))
    cos, sin = np.cos(truth.yaw_rad[index, run]), np.sin(truth.yaw_rad[index, run])
    return cos * dx + sin * dy, -sin * dx + cos * dy


def _track_error(truth: Truth, run: int, sensed: SensedDrive, track: LateralTrack) -> float:
    """Median distance between the ends of observed and actual tracks of 20 frames that begin at the same pose."""
    x, y, heading = dead_reckon(track)
    first = np.arange(SETTLED_FRAMES, len(track) - FRAMES_OF_TRACK)
    last = first + FRAMES_OF_TRACK
    cos, sin = np.cos(heading[first]), np.sin(heading[first])
    dx, dy = x[last] - x[first], y[last] - y[first]
    forward, left = _moved(truth, run, sensed.index[first], sensed.index[last])
    return float(np.median(np.hypot(cos * dx + sin * dy - forward, -sin * dx + cos * dy - left)))


def _track_curve(name: str, track: LateralTrack, truth: Truth, sensed: SensedDrive, run: int) -> Curve:
    rows = slice(EXAMPLE_FRAME, EXAMPLE_FRAME + FRAMES_OF_TRACK + 1)
    x, y, heading = (values[rows] for values in dead_reckon(track))
    at = sensed.index[EXAMPLE_FRAME]
    turn = truth.yaw_rad[at, run] - heading[0]
    dx, dy = x - x[0], y - y[0]
    return Curve(
        PLOT_NAMES[name],
        truth.x_m[at, run] + np.cos(turn) * dx - np.sin(turn) * dy,
        truth.y_m[at, run] + np.sin(turn) * dx + np.cos(turn) * dy,
    )


def _road_curves(truth: Truth, sensed: SensedDrive, run: int) -> list[Curve]:
    index = sensed.index[EXAMPLE_FRAME : EXAMPLE_FRAME + FRAMES_OF_TRACK + 1]
    table, x, y, direction = ROAD.table(float(truth.station_m.max()) + 100.0)
    station = truth.station_m[index, run]
    centre_x, centre_y, along = (np.interp(station, table, values) for values in (x, y, direction))
    half = 0.5 * ROAD.lane_width_m
    return [
        Curve("actual", truth.x_m[index, run], truth.y_m[index, run]),
        Curve("left", centre_x - half * np.sin(along), centre_y + half * np.cos(along)),
        Curve("right", centre_x + half * np.sin(along), centre_y - half * np.cos(along)),
    ]


def _finding(figure: str, name: str, what: str, values: FloatArray, seen: str) -> Finding:
    median, low, high = median_interval(values)
    bounds, label = BOUNDS.get(name, {}), f"{seen}{name}"
    if what in bounds:
        unit, bound = bounds[what]
        verdict = "reproduced" if median <= bound else "worse"
        text = f"{label}: {what} (bound {bound:g} {unit})"
        return Finding(figure, text, unit, NOT_PRINTED, median, low, high, verdict, is_required=True)
    if what == BAND_NAME and bounds:
        verdict = "reproduced" if BAND[0] <= median <= BAND[1] else "differs"
        text = f"{label}: {what} (bound {BAND[0]:g} to {BAND[1]:g})"
        return Finding(figure, text, "", NOT_PRINTED, median, low, high, verdict, is_required=True)
    unit = {"yaw rate, RMSE": "deg/s", "v_y, RMSE": "m/s", BAND_NAME: ""}.get(what, "m")
    return Finding(figure, f"{label}: {what}", unit, NOT_PRINTED, median, low, high, "reported")
