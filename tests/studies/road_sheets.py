"""Contact sheets of the rendered road for the documentation: `python tests/studies/road_sheets.py [FOLDER]`.

Writes good.jpg, complex.jpg and truth.jpg (the exact boundaries drawn over the frames) to docs/images.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np

from cwcli.simulation.road.camera import wide_camera
from cwcli.simulation.road.conditions import DRAW_FUNCTION_BY_WEATHER
from cwcli.simulation.road.drive import RoadDriveConfig, plan_road_drive
from cwcli.simulation.road.render import RoadFrame
from tests.set_frames import iter_set_frames

DOCS = Path(__file__).parents[2] / "docs" / "images"
COLUMNS = 5
ORANGE, CYAN, YELLOW = (0, 150, 255), (255, 220, 0), (0, 255, 255)


def tile(frame: RoadFrame, label: str, *, with_truth: bool = False) -> np.ndarray:
    """A frame in colour with its label; visible rows of the boundaries orange, the others blue."""
    image = cv2.cvtColor(frame.grey, cv2.COLOR_GRAY2BGR)
    truth = frame.truth
    if with_truth:
        for u, visible in ((truth.left_u_px, truth.left_visible), (truth.right_u_px, truth.right_visible)):
            for v in np.flatnonzero(np.isfinite(u))[::4]:
                if -50 < u[v] < image.shape[1] + 50:
                    cv2.circle(image, (round(float(u[v])), int(v)), 1, ORANGE if visible[v] else CYAN, -1)
    cv2.putText(image, label, (5, 13), cv2.FONT_HERSHEY_SIMPLEX, 0.4, YELLOW, 1, cv2.LINE_AA)
    return image


def sheet(tiles: list[np.ndarray], columns: int = COLUMNS) -> np.ndarray:
    """Tiles of one size, row by row."""
    return np.vstack([np.hstack(tiles[k : k + columns]) for k in range(0, len(tiles), columns)])


def write(path: Path, image: np.ndarray, quality: int = 82) -> None:
    """Write a JPEG and say how big it is."""
    cv2.imwrite(str(path), image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    print(f"{path} {path.stat().st_size // 1000} kB")


def main(folder: Path) -> None:
    """Make the sheets."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("good", "complex"):
        tiles = [tile(frame, f"{i} {frame.truth.condition}") for i, frame in enumerate(iter_set_frames(name, 20))]
        write(folder / f"road-{name}.jpg", sheet(tiles))
    tiles = [tile(frame, f"{i}", with_truth=True) for i, frame in enumerate(iter_set_frames("complex", 10))]
    write(folder / "road-truth.jpg", sheet(tiles))
    drives = [
        tile(
            plan_road_drive(
                RoadDriveConfig(weather=name, road="complex", seed=9), wide_camera(480, 270)
            ).render_frame_at(60),
            name,
        )
        for name in DRAW_FUNCTION_BY_WEATHER
    ]
    write(folder / "road-weather.jpg", sheet(drives, 4))


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else DOCS)
