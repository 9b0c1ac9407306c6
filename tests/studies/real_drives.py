"""The default lane method on clips made of real pictures: jumps, false departures, wrong boundaries.

    python -m tests.studies.real_drives                         # all clips
    python -m tests.studies.real_drives --part in-sight         # those that were looked at while the method was changed
    python -m tests.studies.real_drives --kinds truck --folder ../pictures     # with a picture of every jump

Needs the logs and pictures in `../shared`. In sight: the video as it is with each change, and the pictures of even
numbers; kept aside: the video's mirror image with each change in other places and strengths, and the odd pictures.
Printed for each kind of clip and for all:

- found: boundaries that are found, of all frames,
- wrong: boundaries of a probability above 0.5 and 0.85 that are wrong (less than 85 % of the rows within 6 pixels at
  320), of all such ones; within `CUT_S` of a cut nothing is judged,
- jumps: between two frames a boundary moves by more than 0.15 m and 0.3 m beside its true movement, somewhere between
  the picture's lower edge and 20 m ahead, with a probability above 0.5 and 0.85 in both frames; told: of those above
  0.15 m and 0.5, the method says itself that it begins anew,
- departures: warnings of the default observer and rule at 25 m/s. No clip has one.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, fields
from pathlib import Path

import cv2
import numpy as np

from cwcli.dynamics.observer import observe_lateral_motion
from cwcli.dynamics.samples import DEFAULT_PREVIEW_POINT_DISTANCE_M, ScalarSamples
from cwcli.dynamics.vehicle import load_vehicle
from cwcli.metrics.lane_scores import (
    VISUAL_STANDARD_COLUMN_TOLERANCE_PX,
    VISUAL_STANDARD_MIN_ROW_SHARE,
    VISUAL_REFERENCE_IMAGE_WIDTH_PX,
    share_of_rows_within_tolerance,
)
from cwcli.metrics.table import Table
from cwcli.prediction.lateral import predict_paths_from_observer
from cwcli.prediction.lateral_calibrate import scale_covariance_across_path
from cwcli.reproduction.zhang2011.rendered import lane_samples_from_geometry
from cwcli.signals.columns import FloatArray
from cwcli.vision.camera import Camera, Mounting, default_camera
from cwcli.vision.fit_columns import FitCollector, FitColumns
from cwcli.vision.ground import compute_lane_geometry
from cwcli.vision.lane_model import LANE_WIDTH_MEAN_AND_SIGMA_M
from cwcli.vision.lane_tracker import LaneTracker, search_size
from cwcli.vision.method import GreyImage, LaneFit, LaneFrame, LaneState
from cwcli.vision.search_clock import SearchClock
from cwcli.warning.lane_departure import FrontAxle, LaneBoundaries, evaluate_lane_departure
from tests.studies.lane_halves import GREEN, ORANGE, YELLOW, drawn
from tests.studies.real_clips import SPEED_MPS, VIDEO_KINDS, Shot, read_video, video_clip
from tests.studies.real_stills import read_stills, still_clip

CUT_S = 1.0
PLACES = (0.98, 0.5, 0.25)
"""Of the road's height in the picture, where jumps are looked for: 5, 10 and 20 m ahead of a wide camera."""
SURE = (0.5, 0.85)
JUMPS_M = (0.15, 0.3)
PARTS = ("in-sight", "aside")
STATES = {state: state.name.lower() for state in LaneState}


@dataclass
class Counts:
    """Sums over clips; `wrong`, `sure` for each of `SURE`, `jumps` for each of `SURE` and `JUMPS_M`."""

    frames: int = 0
    found: int = 0
    sure: FloatArray = field(default_factory=lambda: np.zeros(2, np.int64))
    wrong: FloatArray = field(default_factory=lambda: np.zeros(2, np.int64))
    jumps: FloatArray = field(default_factory=lambda: np.zeros((2, 2), np.int64))
    told: int = 0
    departures: int = 0
    seconds: float = 0.0

    def add(self, other: Counts) -> None:
        """Add another clip's."""
        for each in fields(self):
            setattr(self, each.name, getattr(self, each.name) + getattr(other, each.name))

    def line(self) -> str:
        """One row of the table."""
        wrong = 100.0 * self.wrong / np.maximum(self.sure, 1)
        jumps = ", ".join(f"{low}/{high}" for low, high in self.jumps.T.tolist())
        found = 50.0 * self.found / max(self.frames, 1)
        shares = f"{found:6.2f} % | {wrong[0]:5.2f} %, {wrong[1]:5.2f} %"
        return f"{self.frames:6d} | {shares} | {jumps} ({self.told} told) | {self.departures} in {self.seconds:.0f} s"


@dataclass(frozen=True)
class Seen:
    """A clip as the method saw it, n frames.

    Attributes:
        fits: n rows.
        camera: Of the search.
        stamp_ns: Shape (n,).
        error_m: Shape (n, 2, 3): of each boundary at `PLACES`; NaN where it is not found, or nothing is known.
        share: Shape (n, 2): of each boundary's rows on which it is right.
        is_cut: Shape (n,): within `CUT_S` after a cut.
    """

    fits: FitColumns
    camera: Camera
    stamp_ns: np.ndarray
    error_m: FloatArray
    share: FloatArray
    is_cut: np.ndarray


def watched(shots: Iterable[Shot], folder: Path | None = None, name: str = "", *, is_every_frame: bool = False) -> Seen:
    """Find the lanes in a clip; with a folder, a picture of every jump and the frames around it."""
    clock = SearchClock(is_every_frame=is_every_frame)
    search, recorder, errors, shares, stamps, cuts = LaneTracker(), FitCollector(), [], [], [], []
    pictures: list[GreyImage] = []
    camera = default_camera(64, 64, Mounting())
    for number, shot in enumerate(shots):
        height, width = shot.grey.shape
        if not number:
            camera = default_camera(width, height, Mounting()).with_image_size(*search_size(width, height))
        motion = shot.speed_mps, shot.yaw_rate_radps
        if clock.is_search_due(shot.stamp_ns, (width, height)):
            small = cv2.resize(shot.grey, (camera.width_px, camera.height_px), interpolation=cv2.INTER_AREA)
            fit = search.step(LaneFrame(small, camera, shot.stamp_ns, number, *motion))
        else:
            fit = search.carry(shot.stamp_ns, *motion)
        recorder.append_fit(fit)
        stamps.append(shot.stamp_ns)
        if shot.is_cut:
            cuts.append(shot.stamp_ns)
        error, share, lines = judged(shot, fit, camera)
        errors.append(error)
        shares.append(share)
        if folder is not None:
            pictures.append(picture(shot, fit, lines, number))
    stamp_ns = np.array(stamps)
    since = stamp_ns[:, None] - np.array(cuts, np.int64)[None]
    is_cut = ((since >= 0) & (since <= CUT_S * 1e9)).any(axis=1)
    seen = Seen(recorder.to_columns(), camera, stamp_ns, np.array(errors), np.array(shares), is_cut)
    if folder is not None:
        save(pictures, seen, folder, name)
    return seen


def judged(shot: Shot, fit: LaneFit, camera: Camera) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Errors (2, 3) at `PLACES`, shares (2,) of right rows, and the found columns (2, height) of a frame."""
    height, width = shot.grey.shape
    rows = np.arange(float(height))
    lines = drawn(fit, camera, rows, height)
    for line, boundary in zip(lines, (fit.left, fit.right), strict=True):
        if not boundary.found:
            line[:] = np.nan
    depth = height - 1.0 - shot.horizon_px
    at = np.clip(np.rint(shot.horizon_px + np.array(PLACES) * depth), 0, height - 1).astype(int)
    wide = np.abs(shot.lines[1] - shot.lines[0]) / LANE_WIDTH_MEAN_AND_SIGMA_M[0]
    error = (lines - shot.lines)[:, at] / wide[at]
    inside = (shot.lines >= 0.0) & (shot.lines <= width - 1.0) & (rows > shot.horizon_px + 0.15 * depth)
    tolerance = VISUAL_STANDARD_COLUMN_TOLERANCE_PX * width / VISUAL_REFERENCE_IMAGE_WIDTH_PX
    share = [
        share_of_rows_within_tolerance(line, true, use, tolerance_px=tolerance)
        for line, true, use in zip(lines, shot.lines, inside, strict=True)
    ]
    return error, np.array(share), lines


def jumped(seen: Seen) -> tuple[FloatArray, FloatArray]:
    """Shape (n - 1, 2) each: how far each boundary moved beside its true movement (m), and how sure it was at least."""
    with np.errstate(invalid="ignore"):
        moved = np.nanmax(np.nan_to_num(np.abs(np.diff(seen.error_m, axis=0)), nan=0.0), axis=2)
    chances = np.where(seen.fits.found, seen.fits.probability, 0.0)
    return np.where(seen.is_cut[1:, None], 0.0, moved), np.minimum(chances[1:], chances[:-1])


def departures(seen: Seen) -> Table:
    """Warnings of the default observer and rule."""
    car, n = load_vehicle(), len(seen.stamp_ns)
    geometry = compute_lane_geometry(seen.fits, seen.camera, preview_m=DEFAULT_PREVIEW_POINT_DISTANCE_M)
    speed = ScalarSamples(seen.stamp_ns, np.full(n, SPEED_MPS))
    track = observe_lateral_motion(lane_samples_from_geometry(seen.stamp_ns / 1e9, geometry, seen.fits), speed, car)
    paths = scale_covariance_across_path(predict_paths_from_observer(track, car), track)
    found = seen.fits.found[..., None]
    sides = [np.where(found[:, k], (geometry.left_body, geometry.right_body)[k], np.nan) for k in range(2)]
    is_seen = seen.fits.state != LaneState.HELD
    boundaries = LaneBoundaries(
        *sides, car.camera_forward_m, is_seen, seen.fits.steady_s, -geometry.curvature_change_1pm2
    )
    stamp_ns, host = seen.stamp_ns, FrontAxle(car.width_m, car.front_axle_m)
    result = evaluate_lane_departure(stamp_ns, stamp_ns, paths, boundaries, track.speed_mps, host=host)
    return result.events


def counted(seen: Seen) -> Counts:
    """What is counted of a clip."""
    n = len(seen.stamp_ns)
    moved, sure = jumped(seen)
    jumps = [[int(np.count_nonzero((moved > far) & (sure > chance))) for far in JUMPS_M] for chance in SURE]
    told = (moved > JUMPS_M[0]) & (sure > SURE[0]) & (seen.fits.steady_s[1:, None] == 0.0)
    counts = Counts(n, int(np.count_nonzero(seen.fits.found)), jumps=np.array(jumps), told=int(np.count_nonzero(told)))
    is_judged = np.isfinite(seen.share) & seen.fits.found & ~seen.is_cut[:, None]
    for k, chance in enumerate(SURE):
        use = is_judged & (seen.fits.probability > chance)
        counts.sure[k] = np.count_nonzero(use)
        counts.wrong[k] = np.count_nonzero(use & (seen.share < VISUAL_STANDARD_MIN_ROW_SHARE))
    counts.departures, counts.seconds = len(departures(seen)), float(seen.stamp_ns[-1] - seen.stamp_ns[0]) / 1e9
    return counts


def picture(shot: Shot, fit: LaneFit, lines: FloatArray, number: int) -> GreyImage:
    """A frame with the true lane (yellow) and what was found."""
    image = cv2.cvtColor(shot.grey, cv2.COLOR_GRAY2BGR)
    drawn_lines = [*((line, YELLOW, 1) for line in shot.lines), (lines[0], GREEN, 2), (lines[1], ORANGE, 2)]
    for columns, colour, size in drawn_lines:
        for v in range(0, len(columns), 4):
            if np.isfinite(columns[v]) and -9 < columns[v] < image.shape[1] + 9:
                cv2.circle(image, (round(float(columns[v])), v), size, colour, -1)
    sides = " ".join(f"{each.probability:.2f}" for each in (fit.left, fit.right))
    text = f"{number} {STATES[fit.state]} {sides} steady {fit.steady_s:.2f}"
    cv2.putText(image, text, (10, 30), cv2.FONT_HERSHEY_SIMPLEX, 0.9, YELLOW, 2, cv2.LINE_AA)
    return np.asarray(cv2.resize(image, (640, 360), interpolation=cv2.INTER_AREA))


def save(pictures: list[GreyImage], seen: Seen, folder: Path, name: str) -> None:
    """The frame before each jump, the one of it, and one a while after; first jumps only."""
    folder.mkdir(parents=True, exist_ok=True)
    moved, sure = jumped(seen)
    for k in np.flatnonzero(((moved > JUMPS_M[0]) & (sure > SURE[0])).any(axis=1))[:4].tolist():
        shown = [pictures[min(max(k + step, 0), len(pictures) - 1)] for step in (-4, 0, 1, 6)]
        sheet = np.vstack([np.hstack(shown[:2]), np.hstack(shown[2:])])
        cv2.imwrite(str(folder / f"{name.replace(' ', '_')}_{k + 1}.png"), sheet)


def clips(part: str, kinds: list[str]) -> Iterator[tuple[str, str, Iterator[Shot]]]:
    """Kind, name and shots of every clip of a part."""
    is_aside = part == PARTS[1]
    if any(kind in VIDEO_KINDS for kind in kinds):
        video = read_video()
        for kind in VIDEO_KINDS:
            if kind in kinds:
                yield kind, kind, video_clip(video, kind, is_aside=is_aside)
    for with_motion, kind in ((False, STILL_KINDS[0]), (True, STILL_KINDS[1])):
        if kind in kinds:
            for number, still in enumerate(read_stills()):
                if number % 2 == is_aside:
                    own = kind if still.labels is not None else f"{kind}, no labels"
                    yield own, f"{kind} {still.name}", still_clip(still, with_motion=with_motion)


STILL_KINDS = ("stills", "stills, motion told")


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    choices = [*VIDEO_KINDS, *STILL_KINDS]
    parser.add_argument("--part", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--kinds", nargs="+", choices=choices, default=choices)
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--each", action="store_true", help="a row for each clip that has a jump or a departure")
    parser.add_argument(
        "--every-frame", action="store_true", help="search every frame, as --every-frame of cwcli lanes"
    )
    given = parser.parse_args()
    print("clips | frames | found | wrong of p > 0.5, 0.85 | jumps 0.15 m p > 0.5/0.85, 0.3 m | departures")
    for part in given.part:
        sums: dict[str, Counts] = {}
        for kind, name, shots in clips(part, given.kinds):
            counts = counted(watched(shots, given.folder, f"{part} {name}", is_every_frame=given.every_frame))
            if given.each and (counts.jumps.any() or counts.departures):
                print(f"  {name:28} | {counts.line()}", flush=True)
            sums.setdefault(kind, Counts()).add(counts)
        whole = Counts()
        for kind, counts in sums.items():
            print(f"{part}: {kind:24} | {counts.line()}", flush=True)
            whole.add(counts)
        print(f"{part}: {'all':24} | {whole.line()}", flush=True)


if __name__ == "__main__":
    main()
