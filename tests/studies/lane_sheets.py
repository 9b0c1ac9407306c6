"""Contact sheets of frames with the lane boundaries that a method found drawn on them.

    python tests/studies/lane_sheets.py                                      # rendered frames, into docs/images
    python tests/studies/lane_sheets.py --method zhang2011 --folder ../pictures   # of another method, somewhere else
    python tests/studies/lane_sheets.py --log ../shared/logs/tusimple-0313-dev.mcap --folder ../pictures [--every 1]

Rendered: of each set twenty drives, each at its sixteenth frame, so that a method has followed the lane for 1.5 s. The
frame's number is green where both boundaries are right (6 pixels on 85 % of the rows), else red. A last sheet shows
what makes real roads hard (`DEFECTS`), a row a drive: the frames after 2, 4, ... 10 s, with speed and yaw rate. Each
row's drive is one of `cwcli simulate road --set ...`, at ten frames a second.

With --log: every so many frames of a log, as `cwcli lanes --render` draws them; real frames never belong into the
project, so their folder has to be named.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from cwcli.logs.read.reader import Log
from cwcli.logs.write.annotate import annotate_log
from cwcli.reproduction.zhang2011.lane_drives import (
    N_JUDGED_FRAMES,
    N_FRAMES_BEFORE_STABLE_PHASE,
    camera_for_lane_methods,
    is_fit_correct,
)
from cwcli.simulation.road.camera import camera_of_zhang2011
from cwcli.simulation.road.car import YAW_RATE
from cwcli.simulation.road.drive import RoadDriveConfig, iter_set_drives, plan_road_drive
from cwcli.simulation.road.render import RoadFrame
from cwcli.simulation.road.sets import FRAME_SETS
from cwcli.stages.lanes import LanesConfig, lanes
from cwcli.vision.boundary_lines import BoundaryLines
from cwcli.vision.fit_columns import FitCollector
from cwcli.vision.ground import boundary_top_rows_px, image_hyperbolas_of_flat_road, repeat_pinhole_per_frame
from cwcli.vision.method import LaneFit, LaneFrame
from cwcli.vision.methods import DEFAULT_METHOD, METHODS, methods_without_model
from tests.studies.road_sheets import DOCS, sheet, write

TILES = 20
RED, GREEN, BLUE, ORANGE = (60, 60, 255), (90, 230, 90), (255, 160, 40), (0, 150, 255)
RENDERED = "/sheet"
DEFECTS: dict[str, dict[str, Any]] = {
    "raised dots": {"markings": "dots"},
    "dots on concrete": {"markings": "dots", "slab_m": 5.0},
    "dashes on concrete": {"markings": "dashed", "slab_m": 5.0, "weather": "shadow"},
    "bridges": {"bridges_per_km": 15.0, "markings": "dashed"},
    "ramp, 25 deg/s": {"ramp_degps": 25.0, "speed_mps": 13.0},
    "mountain bends": {"bends_1pm": 0.012, "speed_mps": 14.0},
    "lane change": {"lane_changes_per_min": 6.0},
    "dots at night": {"markings": "dots", "weather": "night-rain"},
}
"""What `cwcli simulate road --set` is given."""
DEFECT_RATE_HZ = 10.0
DEFECT_SHOWN_S = (2.0, 4.0, 6.0, 8.0, 10.0)


def rendered(name: str, method_name: str) -> list[np.ndarray]:
    """The tiles of a set."""
    method = METHODS[method_name]
    tiles = []
    for number, drive in enumerate(
        iter_set_drives(name, TILES, n_frames=N_FRAMES_BEFORE_STABLE_PHASE + N_JUDGED_FRAMES)
    ):
        search = method.make(number)
        for k, frame in enumerate(drive.iter_rendered_frames()):
            height, width = frame.grey.shape
            size = method.search_size(width, height)
            assert size == (width, height), "the sets are as small as any method wants"
            prepared = None if method.prepare is None else method.prepare(frame.grey)
            stamp_ns = round(float(drive.time_s[k]) * 1e9)
            fit = search.step(LaneFrame(frame.grey, camera_for_lane_methods(*size), stamp_ns, k, prepared=prepared))
        tiles.append(tile(frame, fit, f"{number} {drive.config.weather}"))
    return tiles


def with_defects(method_name: str) -> list[np.ndarray]:
    """The tiles of `DEFECTS`, a row each."""
    method = METHODS[method_name]
    tiles = []
    for name, changes in DEFECTS.items():
        drive = plan_road_drive(
            RoadDriveConfig(rate_hz=DEFECT_RATE_HZ, duration_s=DEFECT_SHOWN_S[-1], **changes), camera_of_zhang2011()
        )
        states, search = drive.states_at(drive.time_s), method.make(1)
        for k, frame in enumerate(drive.iter_rendered_frames()):
            time_s = float(drive.time_s[k])
            height, width = frame.grey.shape
            seen = LaneFrame(
                frame.grey,
                camera_for_lane_methods(width, height),
                round(time_s * 1e9),
                k,
                speed_mps=float(drive.speed_at_mps(drive.time_s)[k]),
                yaw_rate_radps=float(states[k, YAW_RATE]),
                prepared=None if method.prepare is None else method.prepare(frame.grey),
            )
            fit = search.step(seen)
            if min(abs(time_s - each) for each in DEFECT_SHOWN_S) < 0.5 / DEFECT_RATE_HZ:
                tiles.append(tile(frame, fit, f"{name}, {time_s:.0f} s"))
    return tiles


def tile(frame: RoadFrame, fit: LaneFit, label: str) -> np.ndarray:
    """A rendered frame with the boundaries that were found, its label green where both are right."""
    height, width = frame.grey.shape
    image = cv2.cvtColor(frame.grey, cv2.COLOR_GRAY2BGR)
    for columns, colour in zip(drawn(fit, width, height), (ORANGE, BLUE), strict=True):
        for v, u in enumerate(columns):
            if 0 <= u < width:
                cv2.circle(image, (round(float(u)), v), 1, colour, -1)
    colour = GREEN if is_fit_correct(frame, fit, (width, height), by_stripe=True) else RED
    cv2.putText(image, label, (5, 15), cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour, 1, cv2.LINE_AA)
    return image


def drawn(fit: LaneFit, width_px: int, height_px: int) -> np.ndarray:
    """Shape (2, height): the boundaries' columns in every row as `cwcli lanes` draws them, NaN where it does not."""
    recorder = FitCollector()
    recorder.append_fit(fit)
    fits, camera = recorder.to_columns(), camera_for_lane_methods(width_px, height_px)
    is_found = np.isfinite(fits.pitch_rad)
    horizon_px = camera.horizon_row_px(np.where(is_found, fits.pitch_rad, camera.mounting.pitch_rad))
    top_px = boundary_top_rows_px(fits, camera, horizon_px)
    lines = BoundaryLines(
        fits.parabolas,
        image_hyperbolas_of_flat_road(fits, camera),
        horizon_px,
        top_px,
        repeat_pinhole_per_frame(camera, len(fits)),
    )
    return lines.columns_at_heights_px(height_px - np.arange(float(height_px))[None], height_px)[0] - 1.0


def of_log(path: Path, method_name: str, every: int) -> list[np.ndarray]:
    """The tiles of a log, 400 pixels wide."""
    tiles = []
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "rendered.mcap"
        with Log.open(path) as log:
            result = lanes(log, LanesConfig(method=method_name, render=RENDERED))
            annotate_log(log, result.channels, {}, target)
        with Log.open(target) as log:
            for number, frame in enumerate(log.frames(RENDERED)):
                if number % every:
                    continue
                image = cv2.imdecode(np.frombuffer(frame.data, np.uint8), cv2.IMREAD_COLOR)
                assert image is not None
                small = cv2.resize(image, (400, 400 * image.shape[0] // image.shape[1]), interpolation=cv2.INTER_AREA)
                cv2.putText(small, str(number), (5, 15), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (0, 255, 255), 1, cv2.LINE_AA)
                tiles.append(np.asarray(small))
    return tiles


def main() -> None:
    """Make the sheets."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--method", default=DEFAULT_METHOD, choices=methods_without_model())
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--log", type=Path)
    parser.add_argument("--every", type=int, default=1)
    options = parser.parse_args()
    if options.log is None:
        folder = options.folder or DOCS
        folder.mkdir(parents=True, exist_ok=True)
        for name in FRAME_SETS:
            write(folder / f"lanes-{name}-{options.method}.jpg", sheet(rendered(name, options.method)), 70)
        write(folder / f"lanes-defects-{options.method}.jpg", sheet(with_defects(options.method)), 60)
        return
    if options.folder is None:
        parser.error("--folder must be given with --log: real frames stay out of the project")
    options.folder.mkdir(parents=True, exist_ok=True)
    tiles = of_log(options.log, options.method, options.every)
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % 5)
    write(options.folder / f"{options.log.stem}-{options.method}.jpg", sheet(tiles), 80)


if __name__ == "__main__":
    main()
