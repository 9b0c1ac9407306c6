"""Motion and lane departure from rendered frames: frames -> lanes -> observer -> path -> warning, against the truth.

    python -m tests.studies.rendered_motion drives       # yaw rate, lateral speed, path and overlay: 8 drives of 30 s
    python -m tests.studies.rendered_motion departures   # 200 drifts: when is each warned of?
    python -m tests.studies.rendered_motion undisturbed  # 30 minutes without a drift: is it silent?
    python -m tests.studies.rendered_motion ramps        # 20 drifts, and 20 drives without one, round ramps of 23 m

`--method`, `--rate` (frames/s), `--weather`, `--look` and `--n` change what is run (on the ramps `--method` and `--n`
alone); `--jobs` runs in parallel.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import TypeVar

import numpy as np

from cwcli.dynamics.config import ObserverConfig
from cwcli.dynamics.observer import observe_lateral_motion
from cwcli.dynamics.samples import LateralTrack
from cwcli.dynamics.vehicle import load_vehicle
from cwcli.prediction.lateral import predict_paths_from_observer
from cwcli.prediction.lateral_calibrate import scale_covariance_across_path
from cwcli.prediction.paths import Paths
from cwcli.reproduction.zhang2011.drives import N_SETTLING_FRAMES, compute_drive_errors
from cwcli.reproduction.zhang2011.drives import WINDING_ROAD as BENDS
from cwcli.reproduction.zhang2011.rendered import RenderedDrive, RenderSettings, sense_rendered_drive
from cwcli.simulation.drivers import TargetLineDriver
from cwcli.simulation.lane_drive import INTEGRATION_STEP_S, LaneDriveTruth, LaneRuns, Road, simulate_lane_runs
from cwcli.simulation.road.camera import wide_camera
from cwcli.simulation.streams import random_stream
from cwcli.vision.methods import DEFAULT_METHOD
from cwcli.vision.path_overlay import BodyPath, project_path_into_image
from cwcli.warning.lane_departure import (
    FrontAxle,
    LaneBoundaries,
    LaneDepartureConfig,
    LaneDepartureResult,
    earliest_warning_line_m,
    evaluate_lane_departure,
)

T = TypeVar("T")
CAR = load_vehicle()
SPEED_MPS = 25.0
DRIVE_S = 30.0
DRIFT_START_S = 2.0
LONGEST_DRIFT_S = 25.0
OUTSIDE_M = 0.4
"""A drift is rendered until the tyre is so far beyond the boundary: ISO's latest line is at 0.3 m."""
UNDISTURBED_S = 60.0
OVERLAY_M, OVERLAY_PX = 30.0, 3.0
ROADS = {
    "straight": Road(),
    "curve of 500 m": Road(np.array([0.0, 50.0, 150.0]), np.array([0.0, 0.0, 0.002])),
}
RAMPS = {
    "ramp to the left": Road(np.array([0.0, 40.0, 65.0]), np.array([0.0, 0.0, 1.0 / 23.0])),
    "ramp to the right": Road(np.array([0.0, 40.0, 65.0]), np.array([0.0, 0.0, -1.0 / 23.0])),
}
RAMP_MPS, RAMP_S = 10.0, 30.0
RAMP_DRIFT_S = 9.0
"""On the ramp: its spiral ends after 6.5 s."""
RAMP_LOOK = RenderSettings(rate_hz=10.0, camera=wide_camera(480, 270))
SLOW_RULE = LaneDepartureConfig(min_speed_mps=5.0)
SENSORS = {"camera and speed": False, "with a gyroscope": True}


def gentle_road(seed: int) -> Road:
    """A road as `cwcli simulate road` draws it: curvature changes evenly between knots every 90 m."""
    station_m = np.arange(0.0, 1800.0, 90.0)
    drawn = random_stream(seed, "study", "gentle").normal(0.0, 0.00065, len(station_m))
    return Road(station_m, np.clip(drawn, -0.001, 0.001))


@dataclass(frozen=True)
class Setting:
    """What is run: a lane method, the look of the frames, and how many runs."""

    method: str = DEFAULT_METHOD
    look: RenderSettings = field(default_factory=RenderSettings)
    n: int = 0


def observed(seen: RenderedDrive, *, with_gyro: bool) -> tuple[LateralTrack, Paths]:
    """The default observer and its paths in the body frame."""
    sensed = seen.sensed
    yaw_rate = sensed.yaw_rate if with_gyro else None
    track = observe_lateral_motion(sensed.lanes, sensed.speed, CAR, ObserverConfig(), yaw_rate=yaw_rate)
    return track, scale_covariance_across_path(predict_paths_from_observer(track, CAR), track)


@dataclass(frozen=True)
class OverlayError:
    """Of each frame, shape (n,), pixels; NaN where the true path does not reach `OVERLAY_M`.

    Attributes:
        path_px: The drawn path, beside the true one in the image where that is `OVERLAY_M` ahead.
        geometry_px: What is left of it if the predicted path were the true one: the point of the true path `OVERLAY_M`
            ahead as the overlay places it, from where it is in the image.
    """

    path_px: np.ndarray
    geometry_px: np.ndarray


def overlay_error(seen: RenderedDrive, paths: Paths, truth: LaneDriveTruth, run: int = 0) -> OverlayError:
    """The overlay against what the car then drove, seen by the true camera of that moment on the true surface."""
    drive = seen.drive
    error = np.full((2, len(drive)), np.nan)
    ahead = np.array([OVERLAY_M])
    for i, index in enumerate(seen.sensed.index.tolist()):
        dx, dy = truth.x_m[index:, run] - truth.x_m[index, run], truth.y_m[index:, run] - truth.y_m[index, run]
        cos, sin = np.cos(truth.yaw_rad[index, run]), np.sin(truth.yaw_rad[index, run])
        forward, left = cos * dx + sin * dy, cos * dy - sin * dx
        if forward[-1] < OVERLAY_M or not np.isfinite(paths.x_m[i]).all():
            continue
        beside = np.interp(ahead, forward, left)
        shown = drive.lane_truth_at(i)
        true_u, true_v = shown.camera.project_to_image_px(ahead, beside, shown.road.surface_height_at_distance_m(ahead))
        camera = seen.camera.with_pitch_and_yaw(
            pitch_rad=float(seen.fits.pitch_rad[i]), yaw_rad=float(seen.fits.yaw_rad[i])
        )
        path = BodyPath(paths.x_m[i], paths.y_m[i], paths.heading_rad[i], paths.position_covariance_m2[i])
        u, v = project_path_into_image(path, camera, width_m=CAR.width_m).points[0].T
        placed_u, placed_v = camera.image_points_from_ground(ahead, beside)
        error[0, i] = np.abs(np.interp(-true_v, -v, u) - true_u)[0]
        error[1, i] = np.hypot(placed_u - true_u, placed_v - true_v)[0]
    return OverlayError(*error)


def drive(number: int, setting: Setting) -> dict[str, dict[str, float]]:
    """One drive: sensors -> what -> error. Even numbers are gentle roads, odd ones bends of 500 and 330 m."""
    road = gentle_road(number) if number % 2 == 0 else BENDS
    runs = LaneRuns(np.full(1, SPEED_MPS), np.zeros(1), np.full(1, np.inf), 0.0, DRIVE_S)
    truth = simulate_lane_runs(road, CAR, runs, seed=number)
    seen = sense_rendered_drive(truth, 0, road, CAR, settings=setting.look, method=setting.method, seed=number)
    found = {}
    for name, with_gyro in SENSORS.items():
        track, paths = observed(seen, with_gyro=with_gyro)
        xy = (paths.x_m, paths.y_m)
        found[name] = compute_drive_errors(truth, 0, seen.sensed, track, xy, paths.position_covariance_m2)
        overlay = overlay_error(seen, paths, truth)
        beside = overlay.path_px[N_SETTLING_FRAMES:]
        found[name] |= {
            "overlay at 30 m, median [px]": float(np.nanmedian(beside)),
            "overlay at 30 m, share within 3 px": float(np.mean(beside[np.isfinite(beside)] <= OVERLAY_PX)),
            "overlay at 30 m, its geometry, worst [px]": float(np.nanmax(overlay.geometry_px[N_SETTLING_FRAMES:])),
        }
    return found


def warned(
    seen: RenderedDrive, *, with_gyro: bool = False, rule: LaneDepartureConfig | None = None
) -> LaneDepartureResult:
    """Lane departure from the boundaries and the path of the default observer."""
    track, paths = observed(seen, with_gyro=with_gyro)
    sensed = seen.sensed
    return evaluate_lane_departure(
        sensed.stamp_ns,
        sensed.stamp_ns,
        paths,
        LaneBoundaries(
            sensed.left_body,
            sensed.right_body,
            CAR.camera_forward_m,
            curvature_change_1pm2=-seen.geometry.curvature_change_1pm2,
        ),
        track.speed_mps,
        rule,
        host=FrontAxle(CAR.width_m, CAR.front_axle_m),
    )


def drift_rates(n: int) -> np.ndarray:
    """n rates of departure of 0.1 to 0.8 m/s, to the left and to the right in turn."""
    return np.linspace(0.1, 0.8, (n + 1) // 2).repeat(2)[:n] * np.tile([1.0, -1.0], (n + 1) // 2)[:n]


def until_outside(truth: LaneDriveTruth) -> LaneDriveTruth:
    """A single run up to where the tyre is `OUTSIDE_M` beyond a boundary."""
    gap_m = np.minimum(truth.left_gap_m, truth.right_gap_m)[:, 0]
    outside = np.flatnonzero(gap_m < -OUTSIDE_M)
    end = int(outside[0]) + 1 if len(outside) else len(gap_m)
    return replace(truth, **{f.name: getattr(truth, f.name)[:end] for f in fields(truth)})


@dataclass(frozen=True)
class Departure:
    """One drift: where the tyre really was (m inside the boundary) when it was warned of; NaN: never."""

    road: str
    rate_mps: float
    gap_m: float
    earliest_m: float
    wrong_events: int
    n_frames: int

    @property
    def is_in_time(self) -> bool:
        """Between ISO's earliest and latest line."""
        return bool(-0.3 <= self.gap_m <= self.earliest_m)


def departure(number: int, setting: Setting, n: int) -> Departure:
    """One of n drifts; half of them on each road."""
    name = tuple(ROADS)[number % 2]
    rate = float(drift_rates((n + 1) // 2)[number // 2])
    runs = LaneRuns(np.full(1, SPEED_MPS), np.full(1, rate), np.full(1, DRIFT_START_S), 0.0, LONGEST_DRIFT_S)
    return judged(name, ROADS[name], runs, setting, number)


def ramp_departure(number: int, setting: Setting, n: int) -> Departure:
    """One of n drifts on a ramp of 23 m; half of them to each side."""
    name = tuple(RAMPS)[number % 2]
    rate = float(drift_rates((n + 1) // 2)[number // 2])
    runs = LaneRuns(np.full(1, RAMP_MPS), np.full(1, rate), np.full(1, RAMP_DRIFT_S), 0.0, RAMP_S)
    return judged(name, RAMPS[name], runs, setting, number, SLOW_RULE)


def ramp_undisturbed(number: int, setting: Setting) -> int:
    """Events on a ramp that the car keeps to."""
    road = tuple(RAMPS.values())[number % 2]
    runs = LaneRuns(np.full(1, RAMP_MPS), np.zeros(1), np.full(1, np.inf), 0.0, RAMP_S)
    truth = simulate_lane_runs(road, CAR, runs, driver=TargetLineDriver(), seed=number)
    seen = sense_rendered_drive(truth, 0, road, CAR, settings=setting.look, method=setting.method, seed=number)
    return len(warned(seen, rule=SLOW_RULE).events)


def judged(
    name: str, road: Road, runs: LaneRuns, setting: Setting, number: int, rule: LaneDepartureConfig | None = None
) -> Departure:
    """A drift, rendered until the car is outside."""
    rate = float(runs.drift_mps[0])
    truth = until_outside(simulate_lane_runs(road, CAR, runs, seed=number))
    seen = sense_rendered_drive(truth, 0, road, CAR, settings=setting.look, method=setting.method, seed=number)
    events = warned(seen, rule=rule).events.rows_as_dicts()
    side = "left" if rate > 0.0 else "right"
    own = [event for event in events if event["side"] == side]
    if not own:
        return Departure(name, rate, np.nan, np.nan, len(events), len(seen.drive))
    at = min(round(own[0]["raised_stamp_ns"] / 1e9 / INTEGRATION_STEP_S), len(truth.time_s) - 1)
    gap_m = float((truth.left_gap_m if rate > 0.0 else truth.right_gap_m)[at, 0])
    approach = float(np.sign(rate) * truth.approach_mps[at, 0])
    line_m = float(earliest_warning_line_m(np.array([approach]))[0])
    return Departure(name, rate, gap_m, line_m, len(events) - len(own), len(seen.drive))


def undisturbed(number: int, setting: Setting) -> tuple[int, float, int]:
    """A minute of lane keeping: events, the nearest that the car came to a boundary (m), frames."""
    road = tuple(ROADS.values())[number % 2] if number % 3 else gentle_road(number)
    runs = LaneRuns(np.full(1, SPEED_MPS), np.zeros(1), np.full(1, np.inf), 0.0, UNDISTURBED_S)
    truth = simulate_lane_runs(road, CAR, runs, driver=TargetLineDriver(), seed=number)
    seen = sense_rendered_drive(truth, 0, road, CAR, settings=setting.look, method=setting.method, seed=number)
    nearest_m = float(min(truth.left_gap_m.min(), truth.right_gap_m.min()))
    return len(warned(seen).events), nearest_m, len(seen.drive)


def each(work: Callable[[int], T], n: int, jobs: int) -> Iterator[T]:
    """work(0), work(1), ..., work(n - 1), in order."""
    if jobs == 1:
        yield from map(work, range(n))
        return
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(work, range(n))


def tell_drives(setting: Setting, jobs: int) -> None:
    """Print every drive, then medians."""
    n = setting.n or 8
    all_found: dict[tuple[str, str], list[float]] = {}
    for number, found in enumerate(each(partial(drive, setting=setting), n, jobs)):
        for name, errors in found.items():
            print(f"drive {number} {name}: " + ", ".join(f"{what} {value:.3f}" for what, value in errors.items()))
            for what, value in errors.items():
                all_found.setdefault((name, what), []).append(value)
    for (name, what), values in all_found.items():
        print(f"{name:18} {what:45} median {np.median(values):.3f}  {min(values):.3f} to {max(values):.3f}")


def tell_departures(setting: Setting, jobs: int) -> None:
    """Print the drifts that were not warned of in time, and how many were."""
    n = setting.n or 200
    made = list(each(partial(departure, setting=setting, n=n), n, jobs))
    for found in made:
        if not found.is_in_time or found.wrong_events:
            print(found)
    gaps = np.array([found.gap_m for found in made])
    print(
        f"{sum(found.is_in_time for found in made)} of {n} drifts warned of between ISO's lines; tyre "
        f"{np.nanmin(gaps):.2f} to {np.nanmax(gaps):.2f} m inside the boundary (median {np.nanmedian(gaps):.2f}); "
        f"{sum(found.wrong_events for found in made)} events of the other side; "
        f"{sum(found.n_frames for found in made)} frames"
    )


def tell_undisturbed(setting: Setting, jobs: int) -> None:
    """Print how many events there were, and how near the car came to the boundaries."""
    n = setting.n or 30
    events, nearest, frames = zip(*each(partial(undisturbed, setting=setting), n, jobs), strict=True)
    print(
        f"{sum(events)} events in {n * UNDISTURBED_S / 60:.0f} minutes ({sum(frames)} frames); the car stays at least "
        f"{min(nearest):.2f} m inside the boundaries; runs with events: {[k for k, e in enumerate(events) if e]}"
    )


def tell_ramps(setting: Setting, jobs: int) -> None:
    """Print each drift round a ramp, and how many events there were on ramps without one."""
    n = setting.n or 20
    setting = replace(setting, look=RAMP_LOOK)
    made = list(each(partial(ramp_departure, setting=setting, n=n), n, jobs))
    for found in made:
        print(found)
    print(f"{sum(found.is_in_time and not found.wrong_events for found in made)} of {n} drifts warned of in time")
    events = list(each(partial(ramp_undisturbed, setting=setting), n, jobs))
    print(f"{sum(events)} events in {n * RAMP_S / 60:.1f} minutes without a drift")


STUDIES = {
    "drives": tell_drives,
    "departures": tell_departures,
    "undisturbed": tell_undisturbed,
    "ramps": tell_ramps,
}


def main() -> None:
    """Run a study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", choices=STUDIES)
    parser.add_argument("--method", default=DEFAULT_METHOD)
    parser.add_argument("--rate", type=float, default=20.0)
    parser.add_argument("--weather", default="clear")
    parser.add_argument("--look", default="good")
    parser.add_argument("--wide", action="store_true", help="the 60 deg camera at 640 x 360 instead of zhang2011's")
    parser.add_argument("--pitch-error", type=float, default=0.0, help="of the mounting as told, degrees")
    parser.add_argument("--n", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args()
    camera = wide_camera(640, 360) if given.wide else None
    look = RenderSettings(given.look, given.weather, given.rate, camera, float(np.radians(given.pitch_error)))
    if given.study == "ramps" and look != RenderSettings():
        parser.error("the ramps have a look of their own (`RAMP_LOOK`): only --method, --n and --jobs change them")
    STUDIES[given.study](Setting(given.method, look, given.n), given.jobs)


if __name__ == "__main__":
    main()
