"""Is the probability of contact right? `python -m tests.studies.collision_probability [--encounters N] [--samples N]`.

Random encounters of two cars, most of them near misses or collisions: their paths and covariances are those of the
default motion model from random states. Each path's error is drawn as the docstring of
`measures.collision_probability` says, and for every sample it is computed whether the outlines overlap at any time
between two points of the paths. A table tells the largest difference; the exit code is 1 where it is above 0.005.

Each encounter has a seed of its own. With `--kept FILE` its share of touching samples goes there as soon as it is
known: a study that was stopped goes on where it was, and another version of what is judged is held against the same.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from cwcli.measures.collision_probability import UncertainPaths, collision_probability
from cwcli.prediction.rollout import RolloutSettings, roll_out_paths

FloatArray = npt.NDArray[np.float64]
Size = tuple[float, float]

HORIZON_S = 2.5
BOUND = 0.005
SIZES = ((4.5, 1.8), (3.6, 1.6), (12.0, 2.5))
AT_ONCE = 250_000


@dataclass(frozen=True)
class Encounter:
    """Two paths of q points: relative places (q,), headings (q,), covariances (q, 3), sizes."""

    x_m: FloatArray
    y_m: FloatArray
    headings_rad: tuple[FloatArray, FloatArray]
    covariances_m2: tuple[FloatArray, FloatArray]
    sizes: tuple[Size, Size]

    def probability(self, every: int = 1) -> float:
        """What is judged here, from some of the points."""
        places = (each[None, ::every] for each in (self.x_m, self.y_m))
        return float(collision_probability(*places, *self.uncertain_paths(every))[0, 0])

    def uncertain_paths(self, every: int = 1) -> list[UncertainPaths]:
        """Both vehicles, m = 1, from some of the points."""
        return [
            UncertainPaths(heading_rad[None, ::every], covariance_m2[None, ::every], size)
            for heading_rad, covariance_m2, size in zip(self.headings_rad, self.covariances_m2, self.sizes, strict=True)
        ]


def random_encounter(rng: np.random.Generator) -> Encounter:
    """Two cars whose mean paths are about to meet within a few metres, somewhen within 3.5 s."""
    meet_s, paths = rng.uniform(0.3, 3.5), []
    first_heading = rng.uniform(-np.pi, np.pi)
    for _ in range(2):
        speed, accel = rng.uniform(0.0, 25.0), rng.normal(0.0, 2.0)
        heading = first_heading + (rng.choice([0.0, np.pi]) + rng.normal(0.0, 0.1) if rng.random() < 0.4 else 0.0)
        heading = heading if rng.random() < 0.6 else rng.uniform(-np.pi, np.pi)
        state = np.array([[0.0, 0.0, speed, heading, accel, rng.normal(0.0, 0.2) / max(1.0, speed / 8.0), 0.0, 0.0]])
        sigma = [*np.exp(rng.normal(-0.5, 0.8, 2)), np.exp(rng.normal(-1.2, 0.6)), rng.uniform(0.02, 0.12)]
        sigma += [rng.uniform(0.2, 1.2), rng.uniform(0.01, 0.08), 0.3, 0.1]
        covariance = np.diag(np.square(sigma))[None]
        mean = roll_out_paths("auto", state, None, settings=RolloutSettings(horizon_s=4.0))
        at = round(meet_s / 0.05)
        state[0, :2] = rng.normal(0.0, 2.0, 2) - [mean.x_m[0, at], mean.y_m[0, at]]
        paths.append(roll_out_paths("auto", state, covariance, settings=RolloutSettings(horizon_s=HORIZON_S)))
    host, other = paths
    sizes = SIZES[rng.integers(len(SIZES))], SIZES[rng.integers(len(SIZES))]
    return Encounter(
        other.x_m[0] - host.x_m[0],
        other.y_m[0] - host.y_m[0],
        (host.heading_rad[0], other.heading_rad[0]),
        (host.position_covariance_m2[0], other.position_covariance_m2[0]),
        sizes,
    )


def sampled(encounter: Encounter, n: int, rng: np.random.Generator) -> float:
    """The share of n samples that touch."""
    parts = [min(AT_ONCE, n - done) for done in range(0, n, AT_ONCE)]
    return sum(_n_touching(encounter, part, rng) for part in parts) / n


def _n_touching(encounter: Encounter, n: int, rng: np.random.Generator) -> int:
    errors = rng.standard_normal((4, n))
    roots = [np.array([_root(each) for each in covariance]) for covariance in encounter.covariances_m2]
    to_place = np.concatenate([-roots[0], roots[1]], axis=2)
    reach_m = 0.5 * sum(np.hypot(*size) for size in encounter.sizes)
    n_touching, q = 0, len(encounter.x_m)
    here = np.array([[encounter.x_m[0]], [encounter.y_m[0]]]) + to_place[0] @ errors
    for k in range(1, q):
        there = np.array([[encounter.x_m[k]], [encounter.y_m[k]]]) + to_place[k] @ errors
        way, middle = there - here, 0.5 * (here + there)
        near = np.flatnonzero(np.hypot(*middle) <= reach_m + 0.5 * np.hypot(*way))
        headings = [0.5 * (each[k - 1] + each[k]) for each in encounter.headings_rad]
        touching = near[_touch(here[:, near], way[:, near], headings, encounter.sizes)]
        n_touching += len(touching)
        apart = np.ones(errors.shape[1], dtype=bool)
        apart[touching] = False
        errors, here = errors[:, apart], there[:, apart]
    return n_touching


def _touch(start: FloatArray, way: FloatArray, headings: Sequence[float], sizes: tuple[Size, Size]) -> FloatArray:
    """Whether outlines touch while the other goes from `start` by `way`, (2, m) each: the projections, in time."""
    begin, end = np.zeros(start.shape[1]), np.ones(start.shape[1])
    for heading in headings:
        for turn in (0.0, 0.5 * np.pi):
            axis = np.array([np.cos(heading + turn), np.sin(heading + turn)])
            reach = 0.0
            for own, (length, width) in zip(headings, sizes, strict=True):
                reach += 0.5 * (length * abs(np.cos(own - heading - turn)) + width * abs(np.sin(own - heading - turn)))
            place, speed = axis @ start, axis @ way
            speed = np.where(np.abs(speed) < 1e-12, 1e-12, speed)
            one, two = (-reach - place) / speed, (reach - place) / speed
            begin, end = np.maximum(begin, np.minimum(one, two)), np.minimum(end, np.maximum(one, two))
    return np.asarray(begin <= end)


def _root(covariance_m2: FloatArray) -> FloatArray:
    """The symmetric root of xx, xy, yy, by its eigenvectors."""
    xx, xy, yy = covariance_m2
    values, vectors = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T)


def kept_shares(path: Path | None, given: tuple[int, int]) -> dict[int, float]:
    """Encounter -> the share that touched, of the lines of a file that are of this seed and as many samples."""
    if path is None or not path.exists():
        return {}
    rows = [line.split() for line in path.read_text().splitlines()]
    return {int(index): float(share) for seed, n, index, share in rows if (int(seed), int(n)) == given}


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--encounters", type=int, default=200)
    parser.add_argument("--samples", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--every", type=int, default=1, help="of the points, 0.05 s apart, of which it is computed")
    parser.add_argument("--kept", type=Path, metavar="FILE")
    given = parser.parse_args(arguments)
    kept = kept_shares(given.kept, (given.seed, given.samples))
    pairs = []
    for index in range(given.encounters):
        rng = np.random.default_rng([given.seed, index])
        encounter = random_encounter(rng)
        if index not in kept:
            kept[index] = sampled(encounter, given.samples, rng)
            if given.kept is not None:
                with given.kept.open("a") as lines:
                    print(given.seed, given.samples, index, kept[index], file=lines)
        pairs.append((encounter.probability(given.every), kept[index]))
    found, expected = np.array(pairs).T
    difference = np.abs(found - expected)
    low, middle, high = np.quantile(expected, [0.1, 0.5, 0.9])
    print(
        "| encounters | samples of each | probabilities: 10, 50, 90 % | difference: mean | root mean square | largest |"
    )
    print("|---|---|---|---|---|---|")
    shown = f"{low:.3f}, {middle:.3f}, {high:.3f} | {np.mean(found - expected):+.5f}"
    rms = np.sqrt(np.mean(difference**2))
    print(f"| {given.encounters} | {given.samples} | {shown} | {rms:.5f} | {difference.max():.5f} |")
    return int(difference.max() > BOUND)


if __name__ == "__main__":
    sys.exit(main())
