"""The default lane method on labelled pictures made harder in many kinds (`varied_pictures`), each searched alone.

    python -m tests.studies.lane_variants [--kinds haze bridges ...] [--keep ../before.npz] [--beside ../before.npz]

40 pictures are too few to choose by, and constants were chosen in sight of them; what a change is worth shows in how
it does on pictures that are worse. `CHOSEN_BY` were in sight when constants were chosen, `OTHERS` were not. The log is
that of `lane_halves`; all boundaries count, whatever their probability. --keep writes the scores, and --beside tells
what they gain on kept ones, with 95 % of a bootstrap over the pictures: all kinds of one picture are drawn together.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np

from cwcli.metrics.lane_scores import lanes_beside_ego, tusimple_score
from cwcli.signals.columns import FloatArray
from cwcli.vision.boundary import Boundary
from cwcli.vision.camera import Mounting, default_camera
from cwcli.vision.lane_detect import search_first_frame, prior_with_vanishing_point
from cwcli.vision.lane_model import (
    fit_boundary_parabolas,
    pinhole_of_camera,
    pitch_from_horizon_rad,
    first_frame_prior,
    boundary_road_curves,
)
from cwcli.vision.lane_tracker import search_size
from cwcli.vision.method import GreyImage, LaneFit
from tests.studies.lane_halves import LOG, drawn, labelled
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


def score(picture: Picture) -> tuple[float, float]:
    """TuSimple's accuracy and the share of false boundaries."""
    size = search_size(WIDTH_PX, HEIGHT_PX)
    camera = default_camera(WIDTH_PX, HEIGHT_PX, Mounting()).with_image_size(*size)
    grey: GreyImage = np.asarray(cv2.resize(picture.grey, size, interpolation=cv2.INTER_AREA), np.uint8)
    lane = search_first_frame(grey, camera, prior_with_vanishing_point(grey, first_frame_prior(camera)))[0][0]
    sides = [Boundary(a, b, c, 0.0, 1.0, True) for a, b, c in fit_boundary_parabolas(lane, camera).tolist()]
    roads = boundary_road_curves(lane, pinhole_of_camera(camera))
    lines = drawn(
        LaneFit(sides[0], sides[1], pitch_rad=pitch_from_horizon_rad(lane, camera), roads=roads),
        camera,
        picture.rows,
        HEIGHT_PX,
    )
    made = tusimple_score(list(lines), lanes_beside_ego(picture.lanes, picture.rows, WIDTH_PX, HEIGHT_PX), picture.rows)
    return made.accuracy, made.false_positive


def scores(kinds: dict[str, Change]) -> dict[str, FloatArray]:
    """Shape (n, 2) of each kind: accuracy and false share of every picture."""
    pictures = [
        Picture(np.asarray(frame.image), lanes, np.asarray(rows, np.float64))
        for frame, lanes, rows in labelled(LOG, lambda width, height: (width, height))
    ]
    return {
        name: np.array(
            [score(change(each, np.random.default_rng([n, sum(map(ord, name))]))) for n, each in enumerate(pictures)]
        )
        for name, change in kinds.items()
    }


def gain(made: FloatArray, before: FloatArray) -> str:
    """The mean gain of scores (kinds, pictures, 2), and 95 % of a bootstrap over the pictures."""
    each = (made - before).mean(axis=0)
    drawn_again = each[np.random.default_rng(0).integers(0, len(each), (2000, len(each)))].mean(axis=1)
    low, high = np.quantile(drawn_again, [0.025, 0.975], axis=0)
    return ", ".join(f"{each[:, k].mean():+.4f} ({low[k]:+.4f} to {high[k]:+.4f})" for k in range(2))


def main() -> None:
    """Score, and compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kinds", nargs="+", choices=[*CHOSEN_BY, *OTHERS], default=[*CHOSEN_BY, *OTHERS])
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--beside", type=Path)
    options = parser.parse_args()
    made = scores({name: change for name, change in (CHOSEN_BY | OTHERS).items() if name in options.kinds})
    print("| kind | accuracy | false |\n|---|---|---|")
    for name, each in made.items():
        print(f"| {name} | {each[:, 0].mean():.3f} | {each[:, 1].mean():.3f} |")
    before = None if options.beside is None else dict(np.load(options.beside))
    for title, kinds in (("chosen by", CHOSEN_BY), ("others", OTHERS)):
        names = [name for name in kinds if name in made]
        if not names:
            continue
        all_of = np.array([made[name] for name in names])
        accuracy, wrong = all_of.mean(axis=(0, 1))
        print(f"{title}: {accuracy:.4f}, {wrong:.4f}")
        if before is not None:
            print("  gain: " + gain(all_of, np.array([before[name] for name in names])))
    if options.keep is not None:
        np.savez(options.keep, **made)


if __name__ == "__main__":
    main()
