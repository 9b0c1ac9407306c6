"""CPI and P_MC against random samples: `python -m tests.studies.sampled_measures [--encounters N] [--samples N]`.

Each encounter is a moment of two vehicles near each other; CPI is looked at over a track of ten moments. Of the samples
of P_MC those of an encounter are drawn anew; the standard error of a million is at most 0.0005. The exit code is 1
where a difference is above 0.005.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

from cwcli.measures import MEASURES
from cwcli.measures.contact import EdgeProjections, accelerated_contact_time_s
from cwcli.measures.cpi import (
    MAX_AVAILABLE_BRAKING_MPS2,
    MIN_AVAILABLE_BRAKING_MPS2,
    AVAILABLE_BRAKING_MEAN_MPS2,
    AVAILABLE_BRAKING_SIGMA_MPS2,
)
from cwcli.measures.p_mc import CONTACT_HORIZON_S
from cwcli.measures.p_mc import RANDOM_MANOEUVRE_ACCEL_SIGMA_MPS2 as MANOEUVRE_MPS2
from cwcli.measures.pair import ActualTrack, Pair
from cwcli.signals.columns import FloatArray

BOUND = 0.005
AT_ONCE = 100_000
STEP_NS = 10**8


def moments(n: int, rng: np.random.Generator) -> Pair:
    """n moments of two that are near each other, each by itself."""
    tracks = []
    for _ in range(2):
        place, speed = rng.uniform(-12.0, 12.0, (n, 2)), rng.uniform(0.0, 8.0, n)
        heading = rng.uniform(-3.0, 3.0, n)
        tracks.append(ActualTrack(np.arange(n) * STEP_NS, np.column_stack([place, speed, heading])))
    return Pair(tracks[0], tracks[1], (4.5, 1.8), (12.0, 2.5), 0.5)


def sampled_p_mc(pair: Pair, n_samples: int, rng: np.random.Generator) -> FloatArray:
    """At each moment, (n,): the share of random accelerations of the host that touch the other."""
    at = EdgeProjections.from_pair(pair)
    found = []
    for row in range(len(pair.stamp_ns)):
        n_hit = 0
        for first in range(0, n_samples, AT_ONCE):
            n = min(AT_ONCE, n_samples - first)
            ax, ay = rng.normal(0.0, MANOEUVRE_MPS2, (2, n))
            n_hit += int(
                (accelerated_contact_time_s(at.select_rows(np.full(n, row)), ax, ay) <= CONTACT_HORIZON_S).sum()
            )
        found.append(n_hit / n_samples)
    return np.array(found)


def approach(rng: np.random.Generator) -> Pair:
    """A second of the host behind one that it closes up to: it needs 3 to 13 m/s^2."""
    gap, host, other = rng.uniform(4.0, 20.0), rng.uniform(12.0, 22.0), rng.uniform(2.0, 8.0)
    time_s, heading = np.arange(10) * 0.1, rng.uniform(-3.0, 3.0)
    tracks = []
    for start, speed in ((0.0, host), (gap + 4.5, other)):
        way = start + speed * time_s
        columns = (way * np.cos(heading), way * np.sin(heading), np.full(10, speed), np.full(10, heading))
        tracks.append(ActualTrack(np.arange(10) * STEP_NS, np.column_stack(columns)))
    return Pair(tracks[0], tracks[1], (4.5, 1.8), (4.5, 1.8), 0.5)


def sampled_cpi(pair: Pair, n_samples: int, rng: np.random.Generator) -> float:
    """Mean over the moments of the share of cars that can't brake as hard as is needed."""
    available = rng.normal(AVAILABLE_BRAKING_MEAN_MPS2, AVAILABLE_BRAKING_SIGMA_MPS2, 2 * n_samples)
    available = available[(available >= MIN_AVAILABLE_BRAKING_MPS2) & (available <= MAX_AVAILABLE_BRAKING_MPS2)][
        :n_samples
    ]
    assert len(available) == n_samples
    needed = np.nan_to_num(-pair.evaluate_measure(MEASURES["a-long-req"]), nan=0.0)
    return float(np.mean([(available < each).mean() for each in needed]))


def worst(n_encounters: int, n_samples: int, seed: int) -> dict[str, float]:
    """Measure -> the greatest difference from the samples."""
    rng = np.random.default_rng(seed)
    pair = moments(n_encounters, rng)
    p_mc = np.abs(pair.evaluate_measure(MEASURES["p-mc"]) - sampled_p_mc(pair, n_samples, rng))
    cpi = []
    for _ in range(n_encounters):
        closing = approach(rng)
        cpi.append(abs(float(closing.evaluate_measure(MEASURES["cpi"])) - sampled_cpi(closing, n_samples, rng)))
    return {"p-mc": float(p_mc.max()), "cpi": max(cpi)}


def main() -> None:
    """Print the worst differences."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--encounters", type=int, default=200)
    parser.add_argument("--samples", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    found = worst(options.encounters, options.samples, options.seed)
    for name, difference in found.items():
        print(f"{name}: at most {difference:.4f} from {options.samples} samples, {options.encounters} encounters")
    sys.exit(int(max(found.values()) > BOUND))


if __name__ == "__main__":
    main()
