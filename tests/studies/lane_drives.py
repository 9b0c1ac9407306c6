"""The default lane method over time on roads that real drives have: what it finds, how it jumps, what it warns of.

    python -m tests.studies.lane_drives                       # every kind of road, 3 drives of 40 s each
    python -m tests.studies.lane_drives --kinds ramp change --seeds 100-109
    python -m tests.studies.lane_drives --seconds 600 --kinds bridges joints   # false departures in long drives

Frames of the wide camera (60 degrees, 480 x 270) at 10 Hz, mounting known, speed and yaw rate measured; `--no-motion`
leaves both out. Printed for each kind and for all:

- right: frames in which both boundaries are found and within 6 pixels (at 320) on 85 % of their visible rows,
- wrong: boundaries of a probability above 0.5 that are not, of all found ones,
- jumps: changes of a boundary's place 8 m ahead between frames that differ from the true change by more than 0.15 m,
- changes: lane changes told within 1 s of the moment in which the camera crosses the boundary, of all; and events
  without a change,
- departures: warnings of the default observer and rule on drives on which nobody changes lanes.

Within a second of a crossing either lane is right. A boundary that is bare (without paint on more than half of its
visible rows, where a ramp joins or leaves) need not be found; if it is, it must be where the line would go on. Seeds
below 50 were in sight while the tracking was made.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import partial

import numpy as np

from cwcli.dynamics.config import ObserverConfig
from cwcli.dynamics.observer import observe_lateral_motion
from cwcli.dynamics.samples import DEFAULT_PREVIEW_POINT_DISTANCE_M, LateralTrack, ScalarSamples
from cwcli.dynamics.vehicle import load_vehicle
from cwcli.metrics.lane_scores import (
    VISUAL_STANDARD_COLUMN_TOLERANCE_PX,
    VISUAL_STANDARD_MIN_ROW_SHARE,
    VISUAL_REFERENCE_IMAGE_WIDTH_PX,
    share_of_rows_within_tolerance,
)
from cwcli.prediction.lateral import predict_paths_from_observer
from cwcli.prediction.lateral_calibrate import scale_covariance_across_path
from cwcli.reproduction.zhang2011.rendered import camera_with_pitch_error, lane_samples_from_geometry
from cwcli.signals.columns import FloatArray, BoolArray
from cwcli.signals.lane_geometry import lateral_positions_of_arcs_m
from cwcli.simulation.road.camera import wide_camera
from cwcli.simulation.road.car import OFFSET, YAW_RATE
from cwcli.simulation.road.drive import RoadDrive, RoadDriveConfig, plan_road_drive
from cwcli.simulation.road.render import RoadFrame
from cwcli.simulation.road.truth import LaneTruth
from cwcli.simulation.streams import random_stream, seconds_to_ns
from cwcli.vision.boundary_lines import BoundaryLines
from cwcli.vision.fit_columns import FitCollector, FitColumns
from cwcli.vision.ground import (
    LaneGeometry,
    boundary_top_rows_px,
    compute_lane_geometry,
    repeat_pinhole_per_frame,
    image_hyperbolas_of_flat_road,
)
from cwcli.vision.method import LaneFrame, LaneState
from cwcli.vision.methods import DEFAULT_METHOD, METHODS
from cwcli.warning.lane_departure import FrontAxle, LaneBoundaries, LaneDepartureResult, evaluate_lane_departure
from tests.studies.rendered_motion import each
from tests.unit.simulation.road.painted_stations import painted_station_mask

KINDS: dict[str, dict[str, float | str]] = {
    "plain": {},
    "bridges": {"bridges_per_km": 6.0},
    "joints": {"slab_m": 5.0},
    "dots": {"markings": "dots"},
    "dots-joints": {"markings": "dots", "slab_m": 5.0},
    "ramp": {"ramp_degps": 25.0, "speed_mps": 10.0},
    "change": {"lane_changes_per_min": 4.0},
    "mountain": {"bends_1pm": 0.012, "speed_mps": 14.0},
    "mountain-glare": {"bends_1pm": 0.012, "speed_mps": 14.0, "weather": "glare"},
    "merge": {"junctions": "merges"},
    "exit": {"junctions": "exits"},
}
SIZE = (480, 270)
RATE_HZ = 10.0
JUMP_M = 0.15
JUMP_AT_M = 8.0
CHANGE_S = 1.0
SPEED_SIGMA_MPS, YAW_RATE_SIGMA_RADPS = 0.05, 0.002


@dataclass(frozen=True)
class Seen:
    """A drive as the lane method saw it, n frames.

    Attributes:
        drive: Its truth.
        frames: Of it; pictures are not kept.
        fits, geometry: n rows.
        share: Shape (n, 2): of each boundary's visible rows on which it is right; NaN without visible rows.
        is_bare: Shape (n, 2): paint is missing on more than half of the boundary's visible rows.
        is_near_change: Shape (n,): within `CHANGE_S` of a crossing.
        speed, yaw_rate: As measured.
    """

    drive: RoadDrive
    fits: FitColumns
    geometry: LaneGeometry
    share: FloatArray
    is_bare: BoolArray
    is_near_change: BoolArray
    speed: ScalarSamples
    yaw_rate: ScalarSamples


@dataclass
class Counts:
    """Sums over drives."""

    frames: int = 0
    right: int = 0
    found: int = 0
    wrong: int = 0
    jumps: int = 0
    changes: int = 0
    told: int = 0
    untrue: int = 0
    departures: int = 0
    seconds: float = 0.0

    def add(self, other: Counts) -> None:
        """Add another drive's."""
        for each_field in fields(self):
            setattr(self, each_field.name, getattr(self, each_field.name) + getattr(other, each_field.name))

    def line(self) -> str:
        """One row of the table."""
        right, wrong = 100 * self.right / self.frames, 100 * self.wrong / max(self.found, 1)
        changes = f"{self.told} of {self.changes}, {self.untrue} untrue"
        departures = f"{self.departures} in {self.seconds:.0f} s"
        return f"{self.frames:6d} | {right:6.2f} % | {wrong:6.2f} % | {self.jumps:4d} | {changes} | {departures}"


def planned(kind: str, seed: int, seconds: float) -> RoadDrive:
    """A drive of a kind."""
    config = RoadDriveConfig(seed=seed, duration_s=seconds, rate_hz=RATE_HZ, **KINDS[kind])  # type: ignore[arg-type]
    return plan_road_drive(config, wide_camera(*SIZE))


def watched(
    drive: RoadDrive,
    frames: Iterator[RoadFrame],
    *,
    with_motion: bool = True,
    with_yaw_rate: bool = True,
    method: str = DEFAULT_METHOD,
) -> Seen:
    """Find the lanes in a drive's frames, told speed and yaw rate, or the speed alone, or neither."""
    chosen, camera = METHODS[method], camera_with_pitch_error(drive.camera)
    search, recorder = chosen.make(0), FitCollector()
    rng = random_stream(drive.config.seed, "study", "motion")
    n = len(drive)
    speed_mps = drive.speed_at_mps(drive.time_s) + rng.normal(0.0, SPEED_SIGMA_MPS, n)
    yaw_rate = drive.states_at(drive.time_s)[:, YAW_RATE] + rng.normal(0.0, YAW_RATE_SIGMA_RADPS, n)
    stamp_ns = seconds_to_ns(drive.time_s)
    told = np.column_stack([speed_mps, yaw_rate]) if with_motion else np.full((n, 2), np.nan)
    if not with_yaw_rate:
        told[:, 1] = np.nan
    truths = []
    for number, made in enumerate(frames):
        truths.append(made.truth)
        frame = LaneFrame(made.grey, camera, int(stamp_ns[number]), number, *told[number].tolist())
        recorder.append_fit(search.step(frame))
    fits = recorder.to_columns()
    horizon_px = np.asarray(camera.horizon_row_px(fits.pitch_rad))
    top_px = boundary_top_rows_px(fits, camera, horizon_px)
    lines = BoundaryLines(
        fits.parabolas,
        image_hyperbolas_of_flat_road(fits, camera),
        horizon_px,
        top_px,
        repeat_pinhole_per_frame(camera, len(fits)),
    )
    rows = np.arange(SIZE[1], dtype=np.float64)
    u_px = lines.columns_at_heights_px(np.tile(SIZE[1] - rows, (n, 1)), SIZE[1]) - 1.0
    offset_m = drive.states_at(drive.time_s)[:, OFFSET]
    lane = np.rint(offset_m / drive.scene.lane_width_m)
    crossed_s = drive.time_s[np.flatnonzero(np.diff(lane)) + 1]
    near = (np.abs(drive.time_s[:, None] - crossed_s[None]) <= CHANGE_S).any(axis=1)
    tolerance_px = VISUAL_STANDARD_COLUMN_TOLERANCE_PX * SIZE[0] / VISUAL_REFERENCE_IMAGE_WIDTH_PX
    share = np.full((n, 2), np.nan)
    for i, truth in enumerate(truths):
        lanes = [0.0]
        if near[i]:
            lanes = [-truth.lane_width_m, 0.0, truth.lane_width_m]
        shares = []
        for shift_m in lanes:
            pair = []
            for side, own in enumerate((truth.left_visible, truth.right_visible)):
                at = truth.lane_m + shift_m + (0.5 - side) * truth.lane_width_m
                true_px = truth.road.line_column_at_distance_px(truth.camera, at, truth.x_m)
                visible = own
                if shift_m:
                    with np.errstate(invalid="ignore"):
                        visible = (true_px >= 0) & (true_px < SIZE[0]) & (truth.x_m <= 60.0)
                pair.append(share_of_rows_within_tolerance(u_px[i, side], true_px, visible, tolerance_px=tolerance_px))
            shares.append(pair)
        share[i] = max(shares, key=lambda pair: np.nan_to_num(np.array(pair), nan=1.0).min())
    geometry = compute_lane_geometry(fits, camera, preview_m=DEFAULT_PREVIEW_POINT_DISTANCE_M)
    is_bare = np.array([_bare(drive, truth) for truth in truths])
    return Seen(
        drive,
        fits,
        geometry,
        share,
        is_bare,
        near,
        ScalarSamples(stamp_ns, speed_mps),
        ScalarSamples(stamp_ns, yaw_rate),
    )


def _bare(drive: RoadDrive, truth: LaneTruth) -> list[bool]:
    made = []
    for marking, visible in ((drive.scene.left, truth.left_visible), (drive.scene.right, truth.right_visible)):
        station_m = truth.road.line_station_at_distance_m(marking.offset_m, truth.x_m[visible])
        made.append(bool(visible.any()) and painted_station_mask(drive.scene, marking, station_m).mean() < 0.5)
    return made


def places_m(seen: Seen) -> tuple[FloatArray, FloatArray]:
    """Shape (n, 2) each: the boundaries' places `JUMP_AT_M` ahead, found and true, left positive."""
    ahead = np.array([JUMP_AT_M])
    change = -seen.geometry.curvature_change_1pm2
    found = np.stack([lateral_positions_of_arcs_m(road, ahead, change) for road in _bodies(seen)], axis=1)
    true = np.array(
        [
            [float(truth.boundary_y_m(side, ahead)[0]) for side in ("left", "right")]
            for truth in map(seen.drive.lane_truth_at, range(len(seen.drive)))
        ]
    )
    return found, true


def _bodies(seen: Seen) -> tuple[FloatArray, FloatArray]:
    found = seen.fits.found[..., None]
    return np.where(found[:, 0], seen.geometry.left_body, np.nan), np.where(
        found[:, 1], seen.geometry.right_body, np.nan
    )


def motion(seen: Seen) -> LateralTrack:
    """The default observer on the lanes, with the gyroscope."""
    return observe_lateral_motion(
        lane_samples_from_geometry(seen.drive.time_s, seen.geometry, seen.fits),
        seen.speed,
        load_vehicle(),
        ObserverConfig(),
        yaw_rate=seen.yaw_rate,
    )


def departures(seen: Seen) -> LaneDepartureResult:
    """Lane departure with the default observer and rule."""
    car, track = load_vehicle(), motion(seen)
    paths = scale_covariance_across_path(predict_paths_from_observer(track, car), track)
    left, right = _bodies(seen)
    return evaluate_lane_departure(
        seen.speed.stamp_ns,
        seen.speed.stamp_ns,
        paths,
        LaneBoundaries(
            *(left, right, car.camera_forward_m, seen.fits.state != LaneState.HELD, seen.fits.steady_s),
            -seen.geometry.curvature_change_1pm2,
        ),
        track.speed_mps,
        host=FrontAxle(car.width_m, car.front_axle_m),
    )


def counted(seen: Seen) -> Counts:
    """What is counted of a drive."""
    n = len(seen.drive)
    is_judged = np.isfinite(seen.share)
    is_right = seen.share >= VISUAL_STANDARD_MIN_ROW_SHARE
    sure = (seen.fits.probability > 0.5) & seen.fits.found & is_judged
    found, true = places_m(seen)
    moved = np.abs(np.diff(found, axis=0) - np.diff(true, axis=0))
    near = seen.is_near_change[1:, None]
    with np.errstate(invalid="ignore"):
        jumps = int(np.count_nonzero((moved > JUMP_M) & ~near))
    counts = Counts(
        frames=n,
        right=int(np.count_nonzero((is_right | ~is_judged | (seen.is_bare & ~seen.fits.found)).all(axis=1))),
        found=int(np.count_nonzero(sure)),
        wrong=int(np.count_nonzero(sure & ~is_right)),
        jumps=jumps,
    )
    _count_changes(seen, counts)
    if not counts.changes:
        counts.departures = len(departures(seen).events)
        counts.seconds = float(seen.drive.time_s[-1])
    return counts


def _count_changes(seen: Seen, counts: Counts) -> None:
    drive = seen.drive
    lane = np.rint(drive.states_at(drive.time_s)[:, OFFSET] / drive.scene.lane_width_m)
    steps = np.diff(lane, prepend=lane[:1])
    true = [(drive.time_s[i], steps[i]) for i in np.flatnonzero(steps)]
    told = [(drive.time_s[i], seen.fits.lane_change[i]) for i in np.flatnonzero(seen.fits.lane_change)]
    for time_s, step in true:
        match = next((each for each in told if abs(each[0] - time_s) <= CHANGE_S and each[1] == step), None)
        counts.told += match is not None
        if match is not None:
            told.remove(match)
    counts.changes, counts.untrue = len(true), len(told)


def one(job: tuple[str, int], seconds: float, with_motion: bool) -> Counts:
    """A drive of a kind, from its seed."""
    kind, seed = job
    drive = planned(kind, seed, seconds)
    return counted(watched(drive, drive.iter_rendered_frames(), with_motion=with_motion))


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--seeds", default="0-2", help="first and last")
    parser.add_argument("--seconds", type=float, default=40.0)
    parser.add_argument("--no-motion", action="store_true")
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args()
    first, last = (int(part) for part in given.seeds.split("-"))
    print("kind | frames | right | wrong | jumps | changes told | departures")
    whole = Counts()
    for kind in given.kinds:
        total = Counts()
        jobs = [(kind, seed) for seed in range(first, last + 1)]
        work = partial(one, seconds=given.seconds, with_motion=not given.no_motion)
        for counts in each(lambda k, jobs=jobs, work=work: work(jobs[k]), len(jobs), given.jobs):
            total.add(counts)
        print(f"{kind:11} | {total.line()}", flush=True)
        whole.add(total)
    print(f"{'all':11} | {whole.line()}")


if __name__ == "__main__":
    main()
