from itertools import permutations

import numpy as np
import pytest

from cwcli.tracking.gospa import TargetMoments, best_pairs_and_their_distances, score_tracks


def gospa_and_unpaired(truth, tracks, cutoff_m, p):
    """GOSPA from the pairs, and the numbers of targets and tracks without a pair."""
    i, _, distance = best_pairs_and_their_distances(truth, tracks, cutoff_m=cutoff_m, p=p)
    n_missed, n_false = len(truth) - len(i), len(tracks) - len(i)
    total = (distance**p).sum() + 0.5 * cutoff_m**p * (n_missed + n_false)
    return total ** (1.0 / p), n_missed, n_false


def by_all_permutations(truth, tracks, cutoff_m, p):
    """Rahmathullah et al. 2017, eq. 1 with alpha = 2, over all permutations."""
    if len(truth) > len(tracks):
        truth, tracks = tracks, truth
    rest = 0.5 * cutoff_m**p * (len(tracks) - len(truth))
    if not len(truth):
        return rest ** (1.0 / p)
    cost = np.minimum(np.linalg.norm(truth[:, None] - tracks[None], axis=2), cutoff_m) ** p
    best = min(
        sum(cost[i, chosen[i]] for i in range(len(truth))) for chosen in permutations(range(len(tracks)), len(truth))
    )
    return (best + rest) ** (1.0 / p)


@pytest.mark.parametrize("n_truth", [0, 1, 3, 5])
@pytest.mark.parametrize("n_tracks", [0, 1, 4, 5])
@pytest.mark.parametrize("p", [1.0, 2.0])
def test_gospa_equals_the_definition(n_truth, n_tracks, p) -> None:
    rng = np.random.default_rng(10 * n_truth + n_tracks)
    for _ in range(5):
        truth, tracks = rng.uniform(0, 8, (n_truth, 2)), rng.uniform(0, 8, (n_tracks, 2))
        distance, _, _ = gospa_and_unpaired(truth, tracks, 3.0, p)
        assert distance == pytest.approx(by_all_permutations(truth, tracks, 3.0, p))


def test_parts_by_hand() -> None:
    # one pair 3 m apart, one target missed, two tracks false; c = 5, p = 2: 9 + 12.5 + 25 = 46.5
    truth = np.array([[0.0, 0.0], [100.0, 0.0]])
    tracks = np.array([[0.0, 3.0], [50.0, 0.0], [60.0, 0.0]])
    assert gospa_and_unpaired(truth, tracks, 5.0, 2.0) == (pytest.approx(46.5**0.5), 1, 2)


def two_walkers(ids):
    """Two targets 20 m apart for four moments; the tracks have the ids given per moment, and 0.3 m / 0.1 m/s error."""
    stamp = np.repeat(np.arange(4), 2)
    state = np.zeros((8, 4))
    state[1::2, 0] = 20.0
    found = state + np.array([0.3, 0.0, 0.1, 0.0])
    return TargetMoments(stamp, np.tile([1, 2], 4), state), TargetMoments(stamp, np.array(ids).ravel(), found)


def test_id_switches_and_errors_of_each_target() -> None:
    truth, tracks = two_walkers([[7, 8], [7, 8], [8, 7], [8, 7]])
    scores = score_tracks(truth, tracks)
    assert scores.id_switches == 2
    assert [t.id_switches for t in scores.targets] == [1, 1]
    assert [t.n_tracked for t in scores.targets] == [4, 4]
    assert scores.targets[0].position_rmse_m == pytest.approx(0.3)
    assert scores.targets[0].velocity_rmse_mps == pytest.approx(0.1)
    np.testing.assert_allclose(scores.distance, np.sqrt(2 * 0.09))


def test_a_track_that_pauses_and_returns_under_its_id_is_no_switch() -> None:
    truth, tracks = two_walkers([[7, 8], [7, 8], [7, 8], [7, 8]])
    keep = np.array([True, True, False, True, True, True, True, True])
    paused = TargetMoments(tracks.stamp_ns[keep], tracks.id[keep], tracks.state[keep])
    scores = score_tracks(truth, paused)
    assert scores.id_switches == 0
    assert scores.n_missed.tolist() == [0, 1, 0, 0]
    assert scores.targets[0].n_tracked == 3


def test_no_tracks_at_all() -> None:
    truth, _ = two_walkers([[7, 8]] * 4)
    scores = score_tracks(truth, TargetMoments.from_tracks([]))
    np.testing.assert_allclose(scores.distance, 5.0)
    assert np.isnan(scores.targets[0].position_rmse_m)
