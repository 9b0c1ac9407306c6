"""The probability over manoeuvres against a million random ones."""

from __future__ import annotations

import numpy as np

from cwcli.measures import MEASURES
from cwcli.measures.contact import EdgeProjections, accelerated_contact_time_s
from cwcli.measures.p_mc import CONTACT_HORIZON_S, RANDOM_MANOEUVRE_ACCEL_SIGMA_MPS2
from cwcli.measures.pair import ActualTrack, Pair

N_ENCOUNTERS, N_RANDOM = 8, 60_000
ATOL = 0.005


def test_against_random_samples() -> None:
    rng = np.random.default_rng(2)
    tracks = []
    for _ in range(2):
        place, speed = rng.uniform(-12.0, 12.0, (N_ENCOUNTERS, 2)), rng.uniform(0.0, 8.0, N_ENCOUNTERS)
        heading = rng.uniform(-3.0, 3.0, N_ENCOUNTERS)
        stamps = np.arange(N_ENCOUNTERS) * 10**8
        tracks.append(ActualTrack(stamps, np.column_stack([place, speed, heading])))
    pair = Pair(tracks[0], tracks[1], (4.5, 1.8), (12.0, 2.5), 0.5)
    found = pair.evaluate_measure(MEASURES["p-mc"])
    at = EdgeProjections.from_pair(pair)
    expected = []
    for row in range(N_ENCOUNTERS):
        ax, ay = rng.normal(0.0, RANDOM_MANOEUVRE_ACCEL_SIGMA_MPS2, (2, N_RANDOM))
        hit = accelerated_contact_time_s(at.select_rows(np.full(N_RANDOM, row)), ax, ay) <= CONTACT_HORIZON_S
        expected.append(hit.mean())
    spread = np.array(expected)
    assert ((spread > 0.02) & (spread < 0.98)).sum() >= 3
    np.testing.assert_allclose(found, spread, atol=ATOL)
