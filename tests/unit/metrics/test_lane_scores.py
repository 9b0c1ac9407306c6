"""Lane scores: TuSimple's by hand and by a plain copy of its rules, the others by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cwcli.metrics.lane_scores import (
    BoundaryColumns,
    TuSimpleScore,
    lane_width_stability,
    lanes_beside_ego,
    share_of_rows_within_tolerance,
    tusimple_score,
    visual_standard_score,
)

NAN = math.nan
H = list(range(0, 200, 10))  # 20 rows
UPRIGHT = [300.0] * 20
FAR = [900.0] * 20


def shifted(lane: list[float], px: float, rows: int = 20) -> list[float]:
    """The first `rows` rows moved by px."""
    return [u + px * (i < rows) for i, u in enumerate(lane)]


@pytest.mark.parametrize(
    ("predicted", "truth", "expected"),
    [
        pytest.param([UPRIGHT], [UPRIGHT], (1, 0, 0), id="equal"),
        pytest.param([shifted(UPRIGHT, 19.9)], [UPRIGHT], (1, 0, 0), id="just-near-enough"),
        pytest.param([shifted(UPRIGHT, 20)], [UPRIGHT], (0, 1, 1), id="20-pixels-are-too-far"),
        # 17 of 20 rows are 0.85: matched. 16 of 20 are 0.8: missed, but they still count for the accuracy.
        pytest.param([shifted(UPRIGHT, 50, 3)], [UPRIGHT], (0.85, 0, 0), id="85-percent-match"),
        pytest.param([shifted(UPRIGHT, 50, 4)], [UPRIGHT], (0.8, 1, 1), id="80-percent-do-not"),
        pytest.param([], [UPRIGHT], (0, 0, 1), id="no-prediction"),
        pytest.param([UPRIGHT], [], (0, 1, 0), id="no-truth"),
        pytest.param([], [], (0, 0, 0), id="nothing"),
        pytest.param([UPRIGHT, FAR], [UPRIGHT], (1, 0.5, 0), id="one-too-many"),
        pytest.param([UPRIGHT], [UPRIGHT, FAR], (0.5, 0, 0.5), id="one-missing"),
        # Absent in both counts as near: 10 rows there, 10 rows absent in both.
        pytest.param([[-2.0] * 10 + [300.0] * 10], [[-2] * 10 + [300] * 10], (1, 0, 0), id="absent-in-both"),
        pytest.param([[NAN] * 10 + [300.0] * 10], [[-2] * 10 + [300] * 10], (1, 0, 0), id="nan-is-absent"),
        pytest.param([UPRIGHT], [[-2] * 10 + [300] * 10], (0.5, 1, 1), id="predicted-where-absent"),
        # Two lanes of truth 10 px apart take the same prediction: 1 - 2 matched of 1 predicted.
        pytest.param([UPRIGHT], [UPRIGHT, shifted(UPRIGHT, 10)], (1, -1, 0), id="one-prediction-matches-two"),
        pytest.param([UPRIGHT, FAR, FAR], [UPRIGHT], (1, 2 / 3, 0), id="two-too-many"),
        pytest.param([UPRIGHT, FAR, FAR, FAR], [UPRIGHT], (0, 0, 1), id="three-too-many-count-for-nothing"),
    ],
)
def test_tusimple_by_hand(
    predicted: list[list[float]], truth: list[list[float]], expected: tuple[float, float, float]
) -> None:
    score = tusimple_score(predicted, truth, H)
    assert (score.accuracy, score.false_positive, score.false_negative) == pytest.approx(expected)


def test_tusimple_slanted_lane_has_a_wider_threshold() -> None:
    # x = 2 y: the angle from the vertical has tan 2, so the threshold is 20 sqrt(5) = 44.7 px.
    lane = [2.0 * y for y in H]
    assert tusimple_score([shifted(lane, 44.7)], [lane], H).accuracy == 1.0
    assert tusimple_score([shifted(lane, 44.8)], [lane], H).accuracy == 0.0


def test_tusimple_angle_comes_from_the_present_points_only() -> None:
    lane = [-2.0] * 18 + [300.0, 320.0]  # slope 2 over the last two rows
    assert tusimple_score([[-2.0] * 18 + [344.0, 364.0]], [lane], H).accuracy == 1.0
    single = [-2.0] * 19 + [300.0]  # one point: angle 0
    assert tusimple_score([[-2.0] * 19 + [320.0]], [single], H).accuracy == pytest.approx(0.95)


def test_tusimple_five_lanes_forgive_the_worst() -> None:
    lanes = [[200.0 * k] * 20 for k in range(5)]
    # Four found, one missed: accuracy (1+1+1+1+0 - 0)/4, one miss forgiven.
    assert tusimple_score(lanes[:4], lanes, H) == TuSimpleScore(1.0, 0.0, 0.0)
    # Three found: 3/4; two missed, one forgiven, out of four: 1/4.
    assert tusimple_score(lanes[:3], lanes, H) == TuSimpleScore(0.75, 0.0, 0.25)


def test_tusimple_slow_prediction_scores_nothing() -> None:
    assert tusimple_score([UPRIGHT], [UPRIGHT], H, time_ms=200.0).accuracy == 1.0
    assert tusimple_score([UPRIGHT], [UPRIGHT], H, time_ms=200.1) == TuSimpleScore(0.0, 0.0, 1.0)


def _plain_rules(pred: np.ndarray, gt: np.ndarray, rows: np.ndarray) -> tuple[float, float, float]:
    """TuSimple's rules written point by point, the line by `np.polyfit`."""
    if len(pred) > len(gt) + 2:
        return 0.0, 0.0, 1.0
    best = []
    for lane in gt:
        points = [(y, x) for y, x in zip(rows, lane, strict=True) if x >= 0]
        angle = math.atan(np.polyfit([y for y, _ in points], [x for _, x in points], 1)[0]) if len(points) > 1 else 0.0
        scores = [0.0]
        for guess in pred:
            hits = 0
            for g, t in zip(guess, lane, strict=True):
                hits += abs((g if g >= 0 else -100) - (t if t >= 0 else -100)) < 20 / math.cos(angle)
            scores.append(hits / len(lane))
        best.append(max(scores))
    missed = len([b for b in best if b < 0.85])
    matched = len(best) - missed
    if len(gt) > 4:
        missed = max(missed - 1, 0)
        best.remove(min(best))
    n = min(4, len(gt))
    return sum(best) / n, (len(pred) - matched) / len(pred), missed / n


def test_tusimple_as_the_plain_rules_on_random_lanes() -> None:
    rng = np.random.default_rng(5)
    rows = np.arange(240, 720, 10)
    for _ in range(40):
        n_gt, n_pred = rng.integers(1, 7), rng.integers(1, 6)
        slopes, feet = rng.uniform(-2.5, 2.5, n_gt), rng.uniform(200, 1000, n_gt)
        gt = (feet[:, None] + slopes[:, None] * (rows - 480)).round()
        gt[rng.random(gt.shape) < 0.1] = -2
        pred = gt[rng.integers(0, n_gt, n_pred)] + rng.normal(0, 14, (n_pred, len(rows)))
        score = tusimple_score(list(pred), list(gt), rows.astype(float))
        expected = _plain_rules(pred, gt, rows)
        assert (score.accuracy, score.false_positive, score.false_negative) == pytest.approx(expected)


def test_ego_lanes_are_those_beside_the_middle_of_the_lower_edge() -> None:
    rows = np.arange(240.0, 711.0, 10.0)
    down = (rows - 240.0) / 470.0
    lines = {foot: np.where(rows >= 300.0, 640.0 + (foot - 640.0) * down, -2.0) for foot in (-900, 300, 1000, 1900)}
    found = lanes_beside_ego(np.array(list(lines.values())), rows, 1280.0, 720.0)
    np.testing.assert_array_equal(found, [lines[300], lines[1000]])


def test_ego_lanes_follow_a_bend_at_its_near_end() -> None:
    # seen far ahead the lane leans to the right; its lowest rows lean to the left and reach the edge at 639 - 10 = 629
    rows = np.arange(240.0, 711.0, 10.0)
    bend = np.where(rows < 640.0, 800.0 - 0.4 * (rows - 240.0), 709.0 - (rows - 640.0))
    (found,) = lanes_beside_ego(np.array([bend]), rows, 1280.0, 720.0)
    assert found is not None
    left, right = lanes_beside_ego(np.array([bend, np.full(len(rows), 660.0)]), rows, 1280.0, 720.0)
    assert (left[0], right[0]) == (800.0, 660.0)


def test_ego_lanes_of_an_empty_road() -> None:
    rows = np.arange(240.0, 711.0, 10.0)
    assert lanes_beside_ego(np.full((2, len(rows)), -2.0), rows, 1280.0, 720.0) == []
    assert lanes_beside_ego(np.zeros((0, len(rows))), rows, 1280.0, 720.0) == []


def test_tusimple_refuses_a_truth_without_rows() -> None:
    with pytest.raises(ValueError, match="empty"):
        tusimple_score([], [], [])


def test_tusimple_refuses_a_lane_with_another_number_of_rows() -> None:
    with pytest.raises(ValueError, match="prediction does not have"):
        tusimple_score([UPRIGHT[:-1]], [UPRIGHT], H)
    with pytest.raises(ValueError, match="truth does not have"):
        tusimple_score([UPRIGHT], [UPRIGHT[:-1]], H)


def test_visual_standard_needs_85_percent_of_the_visible_rows_of_both() -> None:
    truth = np.full(120, 100.0)
    visible = np.arange(120) < 100
    good, bad = truth.copy(), truth.copy()
    good[:15] += 6.5  # 85 of 100 visible rows are right
    good[100:] += 50.0  # not judged
    bad[:16] += 6.5
    assert visual_standard_score(
        BoundaryColumns(good, truth, visible), BoundaryColumns(truth, truth, visible)
    ).is_correct
    judged = visual_standard_score(BoundaryColumns(bad, truth, visible), BoundaryColumns(truth, truth, visible))
    assert (judged.left_share, judged.right_share, judged.is_correct) == (0.84, 1.0, False)


def test_visual_standard_tolerance_includes_6_pixels_and_scales_with_the_width() -> None:
    truth, visible = np.zeros(10), np.ones(10, bool)
    assert share_of_rows_within_tolerance(truth + 6.0, truth, visible) == 1.0
    assert share_of_rows_within_tolerance(truth - 6.01, truth, visible) == 0.0
    assert visual_standard_score(
        BoundaryColumns(truth + 12.0, truth, visible), BoundaryColumns(truth, truth, visible), width_px=640
    ).is_correct


def test_visual_standard_not_found_is_a_miss_and_an_unseen_boundary_is_not_judged() -> None:
    truth, visible, none = np.zeros(10), np.ones(10, bool), np.zeros(10, bool)
    missing = np.full(10, NAN)
    assert not visual_standard_score(
        BoundaryColumns(missing, truth, visible), BoundaryColumns(truth, truth, visible)
    ).is_correct
    assert visual_standard_score(
        BoundaryColumns(missing, truth, none), BoundaryColumns(truth, truth, visible)
    ).is_correct
    assert not visual_standard_score(
        BoundaryColumns(truth, truth, none), BoundaryColumns(truth, truth, none)
    ).is_correct


def test_width_stability_by_hand() -> None:
    score = lane_width_stability(np.array([3.5, 3.6, NAN, 3.9, 3.6, 3.6]))
    assert (score.n, score.median_m) == (5, 3.6)
    assert score.share_near == 0.8  # 3.9 is 8 % off
    assert score.max_jump_m == pytest.approx(0.3)  # 3.9 -> 3.6; the gap is not bridged
    assert lane_width_stability(np.array([NAN])).n == 0


def test_a_line_on_the_paint_is_no_error() -> None:
    # A stripe of 9 pixels on each side of the truth: 6 pixels beyond its edge are 15 from its middle.
    truth, visible = np.full(4, 100.0), np.ones(4, np.bool_)
    found = np.array([91.0, 85.0, 115.0, 115.5])
    assert share_of_rows_within_tolerance(found, truth, visible) == 0.0
    assert share_of_rows_within_tolerance(found, truth, visible, half_width_px=9.0) == 0.75
    assert share_of_rows_within_tolerance(found, truth, visible, half_width_px=np.array([9.0, 8.0, 9.0, 9.5])) == 0.75
