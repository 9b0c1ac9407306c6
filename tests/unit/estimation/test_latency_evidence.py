"""The evidence for a latency: parabolas through three passes, their scatter over blocks, and their halves."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.estimation.latency_evidence import LatencyEvidence

F = np.ndarray


def blocks(latency_s: F, sigma_s: F | float, rows: int = 10) -> LatencyEvidence:
    """Blocks of ten seconds with so many rows each; each block asks for its latency with its sigma."""
    bend = np.repeat(np.broadcast_to(1.0 / np.square(sigma_s), latency_s.shape) / rows, rows)
    n = len(bend)
    time_s = np.linspace(0.0, 10.0 * len(latency_s), n)
    return LatencyEvidence(time_s, 0.0, np.zeros(n), -bend * np.repeat(latency_s, rows), bend)


def test_parabola_goes_through_the_three_passes() -> None:
    """7 + 3 (100 (tau - 0.42))^2, probed at 0.35, 0.4 and 0.45 s, has its vertex at 0.42 s."""
    tau = np.array([0.35, 0.4, 0.45])
    less, just, more = (np.array([7.0 + 3.0 * (100.0 * (t - 0.42)) ** 2]) for t in tau)
    found = LatencyEvidence.from_three_passes(np.zeros(1), 0.4, 0.05, less, just, more)
    assert found.likeliest_latency_s == pytest.approx(0.42)
    assert found.formal_sigma_s == pytest.approx(1.0 / np.sqrt(60_000.0))
    assert found.level[0] + found.slope[0] * 0.02 + 0.5 * found.bend[0] * 0.02**2 == pytest.approx(7.0)


def test_latency_and_formal_sigma_are_the_weighted_means() -> None:
    """0.1 s +- 10 ms and 0.2 s +- 20 ms: weights 4 to 1, so 0.12 s; sigma 1 / sqrt(10000 + 2500) = 8.94 ms."""
    found = blocks(np.array([0.1, 0.2]), np.array([0.01, 0.02]))
    assert found.likeliest_latency_s == pytest.approx(0.12)
    assert found.formal_sigma_s == pytest.approx(0.00894427)


def test_sigma_is_the_standard_error_of_the_blocks_mean_with_students_factor() -> None:
    """Sixteen blocks, 0 and 100 ms in turn: 50 sqrt(16 / 15) / 4 ms, and 2.131 / 1.960 for 15 degrees of freedom."""
    in_turn = blocks(np.tile([0.0, 0.1], 8), 0.01)
    assert in_turn.block_scatter_sigma_s == pytest.approx(0.012910 * 2.131 / 1.960, rel=1e-3)


def test_sigma_of_errors_that_last_longer_than_a_block_comes_from_longer_blocks() -> None:
    """Two neighbours err alike: eight blocks of twenty seconds, 50 sqrt(8 / 7) / sqrt(8) ms, and 2.365 / 1.960."""
    in_pairs = blocks(np.tile([0.0, 0.0, 0.1, 0.1], 4), 0.01)
    assert in_pairs.block_scatter_sigma_s == pytest.approx(0.018898 * 2.365 / 1.960, rel=1e-3)


def test_sigma_is_never_below_the_formal_one() -> None:
    """Six blocks that agree by chance."""
    assert blocks(np.full(6, 0.1), 0.01).block_scatter_sigma_s == pytest.approx(0.01 / np.sqrt(6.0))


def test_sigma_is_three_times_the_formal_one_where_one_block_tells_nearly_all() -> None:
    sigma_s = np.full(20, 0.1)
    sigma_s[3] = 0.005
    lonely = blocks(np.zeros(20), sigma_s)
    assert lonely.block_scatter_sigma_s == pytest.approx(3.0 * lonely.formal_sigma_s)


@pytest.mark.parametrize("n_blocks", [8, 20])
def test_two_sigma_hold_the_truth_in_95_percent_of_honest_blocks_with_unequal_weights(n_blocks: int) -> None:
    rng = np.random.default_rng(0)
    sigma_s = rng.uniform(0.01, 0.03, n_blocks)
    drawn = [blocks(0.3 + 2.0 * sigma_s * rng.standard_normal(n_blocks), sigma_s, rows=1) for _ in range(4000)]
    inside = np.mean([abs(d.likeliest_latency_s - 0.3) < 1.96 * d.block_scatter_sigma_s for d in drawn])
    assert 0.95 <= inside < 1.0  # 0.95 by one scale; the larger one of two holds it more often


def test_evidence_that_says_nothing_has_no_latency() -> None:
    flat = LatencyEvidence(np.arange(3.0), 0.2, np.ones(3), np.array([1.0, -2.0, 0.5]), np.array([0.0, -1.0, 0.5]))
    assert np.isnan(flat.likeliest_latency_s)
    assert flat.formal_sigma_s == flat.block_scatter_sigma_s == np.inf
    assert np.isnan(flat.cross_validated_neg_log_likelihood())


def test_crossed_gives_each_half_the_latency_of_the_other() -> None:
    """Two equal halves, 0.1 s and 0.13 s, each +- 10 ms and 3 at its least: each misses by three sigma, 3 + 9 / 2."""
    bend = np.full(2, 1e4)
    found = LatencyEvidence(np.array([0.0, 1.0]), 0.1, np.array([3.0, 3.0 + 4.5]), np.array([0.0, -300.0]), bend)
    assert found.cross_validated_neg_log_likelihood() == pytest.approx((3.0 + 4.5) * 2)


def test_halves_are_of_information_not_of_time() -> None:
    """One late row says as much as three early ones: 0.1 s of the early ones, 0.2 s of the late one."""
    bend = np.array([1e4, 1e4, 1e4, 3e4])
    found = LatencyEvidence(np.arange(4.0), 0.1, np.zeros(4), np.array([0.0, 0.0, 0.0, -3e3]), bend)
    # Early rows at 0.2 s: 3e4 * 0.1^2 / 2; the late row at 0.1 s is where it has nothing.
    assert found.cross_validated_neg_log_likelihood() == pytest.approx(150.0)


def test_rows_are_put_in_time_order_and_those_that_a_pass_does_not_know_left_out() -> None:
    """Row 1 lies before the start with the stamps moved more."""
    just, more = np.zeros(3), np.array([2.0, np.nan, 4.0])
    found = LatencyEvidence.from_three_passes(np.array([3.0, 1.0, 2.0]), 0.0, 1.0, just, just, more)
    np.testing.assert_array_equal(found.time_s, [2.0, 3.0])
    np.testing.assert_array_equal(found.slope, [2.0, 1.0])
    np.testing.assert_array_equal(found.bend, [4.0, 2.0])


def test_a_line_through_the_blocks_is_the_drift() -> None:
    """Sixteen blocks that are known to 10 ms, later by 5 ms every 10 s."""
    found = blocks(0.1 + 0.005 * np.arange(16), 0.01).find_drift_rate_and_middle_s()
    assert found is not None
    assert found[0] == pytest.approx(5e-4, rel=1e-2)
    assert found[1] == pytest.approx(80.0)


@pytest.mark.parametrize(
    ("latency_s", "sigma_s"),
    [
        pytest.param(np.full(16, 0.1), 0.01, id="constant"),
        pytest.param(0.1 + 0.005 * np.arange(16), 0.05, id="a drift that the blocks are too unsure of"),
        pytest.param(np.tile([0.0, 0.0, 0.1, 0.1], 4), 0.01, id="swings"),
        pytest.param(0.1 + 0.05 * np.arange(7), 0.01, id="too few blocks"),
    ],
)
def test_no_drift_where_a_line_predicts_no_better(latency_s: F, sigma_s: float) -> None:
    assert blocks(latency_s, sigma_s).find_drift_rate_and_middle_s() is None
