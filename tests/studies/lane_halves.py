"""A lane method on labelled frames, each alone, by halves; with a picture of every frame that has a wrong boundary.

    python -m tests.studies.lane_halves [--method cwcli] [--folder ../pictures] [--all]

The log is `../shared/logs/tusimple-0313-dev.mcap` or what `--log` names: unrelated frames with TuSimple's labels. What
is chosen with one half of the frames (even numbers, odd numbers) is told by its score on the other. With --folder: one
picture a frame whose boundaries are not both right (with --all: of every frame), labels yellow, the found left one
green, the right one orange, and beside it the evidence. Real frames never belong into the project.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from cwcli.logs.read.reader import Log
from cwcli.metrics.lane_scores import TuSimpleScore, lanes_beside_ego, tusimple_score
from cwcli.signals.columns import FloatArray
from cwcli.signals.leaf_fields import numbers_of_row
from cwcli.vision.boundary_lines import BoundaryLines
from cwcli.vision.camera import Camera, Mounting, default_camera
from cwcli.vision.fit_columns import FitCollector
from cwcli.vision.frames import DecodedFrame, SizeOf, decode_frames
from cwcli.vision.ground import image_hyperbolas_of_flat_road, boundary_top_rows_px, repeat_pinhole_per_frame
from cwcli.vision.lane_tracker import LaneTracker
from cwcli.vision.method import GreyImage, LaneFit, LaneFrame
from cwcli.vision.methods import DEFAULT_METHOD, METHODS, methods_without_model

LOG = Path(__file__).parents[2].parent / "shared" / "logs" / "tusimple-0313-dev.mcap"
IMAGES, LABELS = "/camera/image", "/truth/lanes"
HALVES = ("even", "odd")
EDGES = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.001)
YELLOW, GREEN, ORANGE = (0, 255, 255), (60, 220, 60), (0, 140, 255)


@dataclass(frozen=True)
class Judged:
    """A frame.

    Attributes:
        number: In the log.
        grey: The image that was searched.
        fit: What was found in it.
        lines: Shape (2, h): columns in the camera's image at the labels' rows, NaN where there is none.
        labels: Those beside the car, shape (h,) each.
        rows_px: Shape (h,).
        score: TuSimple's.
        is_right: Of each boundary whether it matches a label; None where it was not found.
        evidence: The default method's, or None.
    """

    number: int
    grey: GreyImage
    fit: LaneFit
    lines: FloatArray
    labels: list[FloatArray]
    rows_px: FloatArray
    score: TuSimpleScore
    is_right: tuple[bool | None, bool | None]
    evidence: FloatArray | None


def labels_of(path: Path) -> list[tuple[FloatArray, FloatArray]]:
    """Lanes (k, h) and rows (h,) of each labelled frame."""
    with Log.open(path) as log:
        truth = log.columns(LABELS)
    rows = [numbers_of_row(truth.fields["h_samples"], k) for k in range(len(truth.log_time_ns))]
    return [(numbers_of_row(truth.fields["lanes"], k).reshape(-1, len(each)), each) for k, each in enumerate(rows)]


def drawn(fit: LaneFit, camera: Camera, rows_px: FloatArray, height_px: int) -> FloatArray:
    """Shape (2, h): the columns of both boundaries in an image of `height_px` rows, as `cwcli lanes` draws them."""
    recorder = FitCollector()
    recorder.append_fit(fit)
    fits = recorder.to_columns()
    pitch = np.where(np.isfinite(fits.pitch_rad), fits.pitch_rad, camera.mounting.pitch_rad)
    horizon_px = np.asarray(camera.horizon_row_px(pitch))
    top_px = boundary_top_rows_px(fits, camera, horizon_px)
    lines = BoundaryLines(
        fits.parabolas,
        image_hyperbolas_of_flat_road(fits, camera),
        horizon_px,
        top_px,
        repeat_pinhole_per_frame(camera, len(fits)),
    )
    scale = height_px / camera.height_px
    x_px = lines.columns_at_heights_px(camera.height_px + 0.5 - (rows_px[None] + 0.5) / scale, camera.height_px)[0]
    with np.errstate(invalid="ignore"):
        x_px = np.where((x_px < 0.5) | (x_px > camera.width_px + 0.5), np.nan, x_px)
    return np.asarray((x_px - 0.5) * scale - 0.5)


def labelled(path: Path, search_size: SizeOf) -> Iterator[tuple[DecodedFrame, FloatArray, FloatArray]]:
    """Every frame of the log, of the size that a search wants, with its lanes (k, h) and their rows (h,)."""
    labels = labels_of(path)
    with Log.open(path) as log:
        frames = decode_frames(log.frames(IMAGES), wanted_size_of=search_size, where=path.name)
        for frame, (lanes, rows_px) in zip(frames, labels, strict=True):
            yield frame, lanes, rows_px


def judged(path: Path, method_name: str) -> Iterator[Judged]:
    """Every frame of the log, searched alone."""
    method = METHODS[method_name]
    for number, (frame, lanes, rows_px) in enumerate(labelled(path, method.search_size)):
        assert frame.image is not None
        size = frame.image.shape[1], frame.image.shape[0]
        camera = default_camera(frame.width_px, frame.height_px, Mounting()).with_image_size(*size)
        prepared = None if method.prepare is None else method.prepare(frame.image)
        search = method.make(number)
        fit = search.step(LaneFrame(frame.image, camera, frame.stamp_ns, 0, prepared=prepared))
        lines = drawn(fit, camera, rows_px, frame.height_px)
        beside = lanes_beside_ego(lanes, rows_px, frame.width_px, frame.height_px)
        found = [fit.left.found, fit.right.found]
        score = tusimple_score([line for line, is_found in zip(lines, found, strict=True) if is_found], beside, rows_px)
        right = [
            matches(line, beside, rows_px) if is_found else None for line, is_found in zip(lines, found, strict=True)
        ]
        evidence = search._evidence if isinstance(search, LaneTracker) else None
        shown = None if evidence is None else evidence_image(evidence.rows, evidence.sharp, frame.image.shape)
        yield Judged(number, frame.image, fit, lines, beside, rows_px, score, (right[0], right[1]), shown)


def matches(line: FloatArray, labels: list[FloatArray], rows_px: FloatArray) -> bool:
    """Whether a line matches one of the labels as TuSimple's benchmark has it."""
    return tusimple_score([line], labels, rows_px).false_positive <= 0.0


def evidence_image(rows: FloatArray, evidence: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """Evidence of some rows as an image."""
    image = np.zeros(shape, np.uint8)
    for row, following, values in zip(rows, [*rows[1:], shape[0]], evidence, strict=True):
        image[row:following] = np.round(255.0 * values)
    return image


def table(frames: list[Judged]) -> str:
    """Scores of the halves, and how reliable the probabilities are."""
    lines = ["| frames | accuracy | false | missed |", "|---|---|---|---|"]
    for name, chosen in (*((HALVES[k], frames[k::2]) for k in range(2)), ("all", frames)):
        scores = [frame.score for frame in chosen]
        numbers = np.array([(each.accuracy, each.false_positive, each.false_negative) for each in scores]).mean(axis=0)
        lines.append(f"| {name} | {numbers[0]:.4f} | {numbers[1]:.4f} | {numbers[2]:.4f} |")
    lines += ["", "| probability | " + " | ".join(HALVES) + " |", "|---|---|---|"]
    for low, high in pairwise(EDGES):
        shares = []
        for half in range(2):
            right = [
                is_right
                for frame in frames[half::2]
                for side, is_right in zip((frame.fit.left, frame.fit.right), frame.is_right, strict=True)
                if is_right is not None and low <= side.probability < high
            ]
            shares.append(f"{sum(right)} of {len(right)}")
        lines.append(f"| {low:g} to {min(high, 1):g} | {shares[0]} | {shares[1]} |")
    wrong = [
        f"{each.number}:{'L' * (each.is_right[0] is not True)}{'R' * (each.is_right[1] is not True)}"
        for each in frames
        if each.is_right != (True, True)
    ]
    return "\n".join([*lines, "", "not right: " + " ".join(wrong)])


def picture(frame: Judged) -> GreyImage:
    """A frame with labels and lines, and its evidence below."""
    height, width = frame.grey.shape
    made = []
    for grey in [frame.grey, *([] if frame.evidence is None else [frame.evidence])]:
        image = cv2.resize(cv2.cvtColor(np.ascontiguousarray(grey), cv2.COLOR_GRAY2BGR), (2 * width, 2 * height))
        for columns, colour in [
            *((label, YELLOW) for label in frame.labels),
            (frame.lines[0], GREEN),
            (frame.lines[1], ORANGE),
        ]:
            for u, v in zip(columns, frame.rows_px, strict=True):
                if u >= 0.0:  # the labelled images have twice the pixels of the search
                    cv2.circle(image, (round(float(u)), round(float(v))), 2, colour, -1)
        made.append(image)
    sides = [
        f"{side.probability:.2f} {right}"
        for side, right in zip((frame.fit.left, frame.fit.right), frame.is_right, strict=True)
    ]
    text = f"{frame.number}: {frame.score.accuracy:.3f}  left {sides[0]}  right {sides[1]}"
    cv2.putText(made[0], text, (10, 30), cv2.FONT_HERSHEY_SIMPLEX, 0.9, YELLOW, 2, cv2.LINE_AA)
    return np.vstack(made)


def main() -> None:
    """Score, and draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--method", default=DEFAULT_METHOD, choices=methods_without_model())
    parser.add_argument("--log", type=Path, default=LOG)
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--all", action="store_true")
    options = parser.parse_args()
    frames = list(judged(options.log, options.method))
    print(table(frames))
    if options.folder is not None:
        options.folder.mkdir(parents=True, exist_ok=True)
        for frame in frames:
            if options.all or frame.is_right != (True, True):
                cv2.imwrite(str(options.folder / f"{frame.number:02}.jpg"), picture(frame))


if __name__ == "__main__":
    main()
