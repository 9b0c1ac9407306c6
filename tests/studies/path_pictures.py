"""The pictures of the drawn path in the documentation: `python -m tests.studies.path_pictures [FOLDER]`.

Writes path-overlay.jpg to docs/images: what `cwcli predict-lane --render` makes of rendered drives, and in
yellow where the car then drove.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np

from cwcli.reproduction.zhang2011.drives import WINDING_ROAD as BENDS
from cwcli.reproduction.zhang2011.rendered import RenderSettings, sense_rendered_drive
from cwcli.simulation.lane_drive import Road, LaneRuns, simulate_lane_runs
from cwcli.simulation.road.camera import wide_camera
from cwcli.vision.boundary_lines import BoundaryLines
from cwcli.vision.ground import image_hyperbolas_of_flat_road, boundary_top_rows_px, repeat_pinhole_per_frame
from cwcli.vision.methods import DEFAULT_METHOD, METHODS
from cwcli.vision.overlay import draw_boundaries, boundary_points_in_image
from cwcli.vision.path_overlay import BodyPath, draw_path, project_path_into_image
from tests.studies.rendered_motion import CAR, ROADS, SPEED_MPS, observed

DOCS = Path(__file__).parents[2] / "docs" / "images"
SIZE = (640, 360)
SHOWN_S = 2.0
YELLOW = (0, 230, 255)
PICTURES: tuple[tuple[str, Road, str, str, float, float], ...] = (
    ("into a bend of 500 m", BENDS, "good", "clear", 0.0, 9.0),
    ("out of a bend of 330 m", BENDS, "good", "overcast", 0.0, 44.0),
    ("drifting to the left at 0.5 m/s", ROADS["straight"], "good", "clear", 0.5, 6.0),
    ("night, bend of 500 m", ROADS["curve of 500 m"], "good", "night", 0.0, 10.0),
)
"""Label, road, look, weather, drift (m/s), when."""


def picture(
    label: str, road: Road, look: str, weather: str, drift_mps: float, at_s: float, *, method: str = DEFAULT_METHOD
) -> np.ndarray:
    """The frame at `at_s` with lanes and path, as published, and the true path as dots."""
    runs = LaneRuns(np.full(1, SPEED_MPS), np.full(1, drift_mps), np.full(1, 3.0), 0.0, at_s + SHOWN_S + 0.5)
    truth = simulate_lane_runs(road, CAR, runs, seed=1)
    seen_as = RenderSettings(look, weather, 10.0, wide_camera(*SIZE))
    seen = sense_rendered_drive(truth, 0, road, CAR, settings=seen_as, method=method, seed=1)
    _, paths = observed(seen, with_gyro=False)
    row = round(at_s * 10.0)
    camera = seen.camera.with_pitch_and_yaw(
        pitch_rad=float(seen.fits.pitch_rad[row]), yaw_rad=float(seen.fits.yaw_rad[row])
    )
    search = METHODS[method].search_size(*SIZE)
    fits, searched_by = seen.fits[slice(row, row + 1)], camera.with_image_size(*search)
    horizon_px = searched_by.horizon_row_px(fits.pitch_rad)
    roads, pinhole = image_hyperbolas_of_flat_road(fits, searched_by), repeat_pinhole_per_frame(searched_by, len(fits))
    lines = BoundaryLines(
        fits.parabolas, roads, horizon_px, boundary_top_rows_px(fits, searched_by, horizon_px), pinhole
    )
    points, is_in = boundary_points_in_image(lines, search, SIZE)
    image = cv2.cvtColor(seen.drive.render_frame_at(row).grey, cv2.COLOR_GRAY2BGR)
    image = draw_boundaries(image, [points[0, side][is_in[0, side]] for side in range(2)])
    path = BodyPath(paths.x_m[row], paths.y_m[row], paths.heading_rad[row], paths.position_covariance_m2[row])
    image = draw_path(image, project_path_into_image(path, camera, width_m=CAR.width_m))
    index = int(seen.sensed.index[row])
    later = index + np.arange(30, round(SHOWN_S * 100) + 1, 10)
    dx, dy = truth.x_m[later, 0] - truth.x_m[index, 0], truth.y_m[later, 0] - truth.y_m[index, 0]
    cos, sin = np.cos(truth.yaw_rad[index, 0]), np.sin(truth.yaw_rad[index, 0])
    forward, left = cos * dx + sin * dy, cos * dy - sin * dx
    shown = seen.drive.lane_truth_at(row)
    for u, v in zip(
        *shown.camera.project_to_image_px(forward, left, shown.road.surface_height_at_distance_m(forward)), strict=True
    ):
        cv2.circle(image, (round(u * 16), round(v * 16)), 32, YELLOW, -1, cv2.LINE_AA, 4)
    cv2.putText(image, label, (8, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, YELLOW, 1, cv2.LINE_AA)
    return image


def main(folder: Path) -> None:
    """Make the pictures."""
    folder.mkdir(parents=True, exist_ok=True)
    made = [picture(*settings) for settings in PICTURES]
    sheet = np.vstack([np.hstack(made[:2]), np.hstack(made[2:])])
    path = folder / "path-overlay.jpg"
    cv2.imwrite(str(path), sheet, [cv2.IMWRITE_JPEG_QUALITY, 82])
    print(f"{path} {path.stat().st_size // 1000} kB")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else DOCS)
