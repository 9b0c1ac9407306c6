"""The pictures of the papers' scenes in the tutorial: `python -m tests.studies.scene_pictures [FOLDER]`.

Runs the tutorial's commands and writes departure.jpg (three annotated frames up to the warning) and turn.png (detected,
true and tracked positions) to docs/images.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

import cwcli
from cwcli.logs.read.reader import Log
from tools.results.page_studies import call_cwcli

DOCS = Path(__file__).parents[2] / "docs" / "images"
SHOWN_S = (4.0, 6.5, 8.2)
"""Times of the frames, s: in the middle of the lane, on the way to its boundary, at the warning."""
RENDERED = "/camera/annotated"


def draw_departure(target: Path) -> None:
    """Draw frames of a lane departure as `predict-lane --render` publishes them."""
    with tempfile.TemporaryDirectory() as folder:
        call_cwcli(folder, "simulate", "departure", "-o", "road.mcap")
        call_cwcli(folder, "run", "road.mcap", "-o", "lane.mcap", "--stage", "lanes,observe")
        call_cwcli(folder, "predict-lane", "lane.mcap", "-o", "path.mcap", "--render", RENDERED)
        with Log.open(Path(folder) / "path.mcap") as log:
            frames = [(frame.stamp_ns, bytes(frame.data)) for frame in log.frames(RENDERED)]
    stamps_s = np.array([stamp - frames[0][0] for stamp, _ in frames]) * 1e-9
    shown = []
    for when_s in SHOWN_S:
        data = frames[int(np.abs(stamps_s - when_s).argmin())][1]
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        cv2.putText(image, f"{when_s:g} s", (8, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 230, 255), 1, cv2.LINE_AA)
        shown.append(image)
    cv2.imwrite(str(target), np.hstack(shown), [cv2.IMWRITE_JPEG_QUALITY, 85])


def draw_turn(target: Path) -> None:
    """Draw a target that turns: detections of both sensors, its true way, and the track."""
    from matplotlib.figure import Figure

    with tempfile.TemporaryDirectory() as folder:
        call_cwcli(folder, "simulate", "xiang2019-turn", "-o", "turn.mcap")
        call_cwcli(folder, "track", "turn.mcap", "--filter", "ukf", "-o", "tracked.mcap")
        with cwcli.open(str(Path(folder) / "tracked.mcap")) as log:
            lidar, radar = (
                {name: _flat(log.table(topic)[f"detections.{name}"]) for name in names}
                for topic, names in (
                    ("/lidar/detections", ("x_m", "y_m")),
                    ("/radar/detections", ("range_m", "azimuth_rad")),
                )
            )
            true, track = (
                [log.table(topic)[name].to_numpy() for name in ("x_m", "y_m")]
                for topic in ("/truth/targets", "/cwcli/targets")
            )
    figure = Figure(figsize=(6.0, 4.2), layout="constrained")
    axes = figure.add_subplot(aspect="equal", xlabel="to the right [m]", ylabel="ahead [m]")
    polar = radar["range_m"], radar["azimuth_rad"]
    axes.plot(-polar[0] * np.sin(polar[1]), polar[0] * np.cos(polar[1]), "o", ms=3, color="tab:orange", label="radar")
    axes.plot(-lidar["y_m"], lidar["x_m"], "o", ms=3, color="tab:blue", label="lidar")
    axes.plot(-true[1], true[0], color="black", linewidth=3.0, label="true")
    axes.plot(-track[1], track[0], color="tab:red", linewidth=1.2, label="tracked")
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(target, dpi=110)


def _flat(column: object) -> np.ndarray:
    """Return the values of a column of lists in one array."""
    return np.array([value for row in column.to_pylist() for value in row])  # type: ignore[attr-defined]


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else DOCS
    draw_departure(folder / "departure.jpg")
    draw_turn(folder / "turn.png")
