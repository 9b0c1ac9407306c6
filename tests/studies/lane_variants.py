"""The default lane method on labelled pictures made harder in many kinds (`varied_pictures`), each searched alone.

    python -m tests.studies.lane_variants [--kinds haze bridges ...] [--known-point] [--keep FILE] [--beside FILE]

40 pictures are too few to choose by, and constants were chosen in sight of them; what a change is worth shows in how
it does on pictures that are worse. `CHOSEN_BY` were in sight when constants were chosen, `OTHERS` were not; `COPIES`
are the same pictures compressed again or of another size, `WEATHER` is laid over them (`--seed` draws it). The log is
that of `lane_halves`. --known-point tells where the labels meet, which shows what finding that point costs. --keep
writes the scores, and --beside tells what they gain on kept ones, with 95 % of a bootstrap over the pictures: all kinds
of one picture are drawn together.
"""

from __future__ import annotations

import argparse
from contextlib import nullcontext
from pathlib import Path
from unittest.mock import patch

import cv2
import numpy as np

from cwcli.metrics.lane_scores import lanes_beside_ego, tusimple_score
from cwcli.signals.columns import FloatArray
from cwcli.vision import lane_detect
from cwcli.vision.camera import Mounting, default_camera
from cwcli.vision.lane_tracker import LaneTracker, search_size
from cwcli.vision.method import GreyImage, LaneFrame
from cwcli.vision.vanishing import VanishingPoint, find_vanishing_points
from tests.studies.lane_halves import LOG, drawn, labelled, matches
from tests.studies.varied_pictures import (
    HEIGHT_PX,
    WIDTH_PX,
    Change,
    Picture,
    beside,
    bridges,
    gamma,
    glare,
    greyed,
    half_erased,
    jpeg,
    local_contrast,
    mirrored,
    motion,
    scaled,
    three_together,
    turned,
    vignette,
)
from tests.studies.weather_pictures import WEATHER


def blurred(picture: Picture, _: np.random.Generator) -> Picture:
    """By a lens out of focus."""
    return Picture(np.asarray(cv2.GaussianBlur(picture.grey, (0, 0), 1.8), np.uint8), picture.lanes, picture.rows)


def noisy(share: float, added: float, noise: float) -> Change:
    """Less light, some of it from everywhere, and a sensor's noise as it is seen in the halved picture."""

    def change(picture: Picture, rng: np.random.Generator) -> Picture:
        grain = np.kron(rng.normal(0.0, noise, (HEIGHT_PX // 2, WIDTH_PX // 2)), np.ones((2, 2)))
        grey = np.clip(picture.grey * share + added + grain, 0, 255).astype(np.uint8)
        return Picture(grey, picture.lanes, picture.rows)

    return change


CHOSEN_BY: dict[str, Change] = {
    "as it is": lambda picture, _: picture,
    "mirror image": lambda picture, _: mirrored(picture),
    "5 % smaller": scaled(0.95),
    "6 % larger": scaled(1.06),
    "moved": scaled(1.0, 9.0, -7.0),
    "to the left": scaled(1.0, -40.0),
    "to the right": scaled(1.0, 40.0),
    "10 % smaller, lower": scaled(0.9, 0.0, 20.0),
    "12 % larger, higher": scaled(1.12, 0.0, -15.0),
    "lower": scaled(1.0, 0.0, 40.0),
    "gamma 0.6": gamma(0.6),
    "gamma 1.6": gamma(1.6),
    "dim, noise": noisy(0.6, 10.0, 2.0),
    "blur": blurred,
}
OTHERS: dict[str, Change] = {
    "JPEG 30": jpeg(30),
    "JPEG 15": jpeg(15),
    "local contrast": local_contrast,
    "gamma 2.2": gamma(2.2),
    "motion": motion(0.5),
    "vignette": vignette,
    "glare": glare,
    "bridges": bridges,
    "every other mark": half_erased(0),
    "the other marks": half_erased(1),
    "0.45 m to the left": beside(0.45),
    "0.45 m to the right": beside(-0.45),
    "turned to the right": turned(0.02, 0.012),
    "turned to the left": turned(-0.02, -0.012),
    "dark, noise": noisy(0.45, 0.0, 2.0),
    "haze": greyed(lambda grey: 0.55 * grey + 80.0),
    "three together": three_together,
    "three others": lambda picture, rng: three_together(mirrored(picture), rng),
}


def resized(by: float) -> Change:
    """The same picture with fewer or more pixels; its labels stay in those of the original."""

    def change(picture: Picture, _: np.random.Generator) -> Picture:
        size = round(by * WIDTH_PX), round(by * HEIGHT_PX)
        how = cv2.INTER_AREA if by < 1.0 else cv2.INTER_CUBIC
        return Picture(np.asarray(cv2.resize(picture.grey, size, interpolation=how)), picture.lanes, picture.rows)

    return change


COPIES: dict[str, Change] = {
    "JPEG 92": jpeg(92),
    "JPEG 75": jpeg(75),
    **{f"size {by:g}": resized(by) for by in (0.35, 0.5, 0.7, 0.85, 1.2, 1.5)},
}
KINDS = {"as it is": CHOSEN_BY["as it is"], **CHOSEN_BY, **OTHERS, **COPIES, **WEATHER}
GROUPS = {"chosen by": CHOSEN_BY, "others": OTHERS, "copies": COPIES, "weather": WEATHER}


def score(picture: Picture, *, knows_point: bool = False) -> list[float]:
    """TuSimple's accuracy, false and missed share of the boundaries that are found; then probability and whether it is
    right (0 or 1) of the left and of the right boundary; searched from where the labels meet if that is known."""
    height, width = picture.grey.shape
    size = search_size(width, height)
    camera = default_camera(width, height, Mounting()).with_image_size(*size)
    how = cv2.INTER_AREA if size[0] <= width else cv2.INTER_LINEAR
    grey: GreyImage = np.asarray(cv2.resize(picture.grey, size, interpolation=how), np.uint8)
    u, v = picture.vanishing()
    point = VanishingPoint(u * size[0] / WIDTH_PX, v * size[1] / HEIGHT_PX, votes=1.0)
    name = find_vanishing_points.__name__
    with patch.object(lane_detect, name, return_value=[point]) if knows_point else nullcontext():
        fit = LaneTracker().step(LaneFrame(grey, camera, 0, 0))
    lines = drawn(fit, camera, picture.rows, HEIGHT_PX)
    truth = lanes_beside_ego(picture.lanes, picture.rows, WIDTH_PX, HEIGHT_PX)
    found = [line for line, side in zip(lines, (fit.left, fit.right), strict=True) if side.found]
    made = tusimple_score(found, truth, picture.rows)
    sides: list[float] = []
    for line, side in zip(lines, (fit.left, fit.right), strict=True):
        sides += [side.probability, float(matches(line, truth, picture.rows))]
    return [made.accuracy, made.false_positive, made.false_negative, *sides]


def scores(kinds: dict[str, Change], seed: int, *, knows_point: bool = False) -> dict[str, FloatArray]:
    """Shape (n, 7) of each kind: `score` of every picture."""
    pictures = [
        Picture(np.asarray(frame.image), lanes, np.asarray(rows, np.float64))
        for frame, lanes, rows in labelled(LOG, lambda width, height: (width, height))
    ]
    return {
        name: np.array(
            [
                score(change(each, np.random.default_rng([n, sum(map(ord, name)), seed])), knows_point=knows_point)
                for n, each in enumerate(pictures)
            ]
        )
        for name, change in kinds.items()
    }


def reliability(made: FloatArray) -> str:
    """Shares of the boundaries that are right, and wrong, with a probability of at least 0.5; and the mean
    probability."""
    probability, right = made[..., 3:].reshape(-1, 2).T
    sure = probability >= 0.5
    shares = (sure * right).mean(), (sure * (1.0 - right)).mean(), probability.mean()
    return " / ".join(f"{share:.3f}" for share in shares)


def row(name: str, made: FloatArray) -> str:
    """One row of the table from scores (n, 7): even and odd pictures, and all."""
    halves = [" / ".join(f"{each:.3f}" for each in part[:, :3].mean(axis=0)) for part in (made[::2], made[1::2], made)]
    return f"| {name} | " + " | ".join(halves) + f" | {reliability(made)} |"


def gain(made: FloatArray, before: FloatArray) -> str:
    """The mean gain of scores (kinds, pictures, 2), and 95 % of a bootstrap over the pictures."""
    each = (made - before).mean(axis=0)
    drawn_again = each[np.random.default_rng(0).integers(0, len(each), (2000, len(each)))].mean(axis=1)
    low, high = np.quantile(drawn_again, [0.025, 0.975], axis=0)
    return ", ".join(f"{each[:, k].mean():+.4f} ({low[k]:+.4f} to {high[k]:+.4f})" for k in range(3))


def main() -> None:
    """Score, and compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kinds", nargs="+", choices=list(KINDS), default=list(KINDS))
    parser.add_argument("--groups", nargs="+", choices=list(GROUPS))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--known-point", action="store_true")
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--beside", type=Path)
    options = parser.parse_args()
    chosen = options.kinds if options.groups is None else ["as it is", *(k for g in options.groups for k in GROUPS[g])]
    kinds = {name: change for name, change in KINDS.items() if name in chosen}
    made = scores(kinds, options.seed, knows_point=options.known_point)
    print("accuracy / false / missed; of all boundaries: right and p >= 0.5 / wrong and so / mean p")
    print("| kind | even | odd | all | boundaries |\n|---|---|---|---|---|")
    for name, each in made.items():
        print(row(name, each))
    before = None if options.beside is None else dict(np.load(options.beside))
    for title, kinds in GROUPS.items():
        names = [name for name in kinds if name in made]
        if not names:
            continue
        all_of = np.array([made[name] for name in names])
        print(row(title, all_of.mean(axis=0)).rsplit("|", 2)[0] + f"| {reliability(all_of)} |")
        if before is not None:
            print("  gain: " + gain(all_of[..., :3], np.array([before[name][:, :3] for name in names])))
    if options.keep is not None:
        np.savez(options.keep, **made)


if __name__ == "__main__":
    main()
