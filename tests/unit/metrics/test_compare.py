"""Comparing two runs: verdicts by hand, and how often chance is called a change."""

import math
from collections.abc import Mapping

import numpy as np
import pytest
from scipy import stats

from cwcli.metrics.compare import FAMILY_WISE_ERROR_RATE, ChangeVerdict, MetricChange, compare_runs, comparison_table
from cwcli.metrics.headline import METRICS, find_metric
from cwcli.metrics.pooling import LogMetrics, MetricRow
from cwcli.signals.columns import FloatArray

RMSE = "ego.position_rmse_m"
POSITIVE = [
    m.name for m in METRICS if m.is_compared and m.pool in {"rms", "mean"} and m.better == "lower" and m.unit
]  # fmt: skip


def row(name: str, value: float) -> MetricRow:
    metric = find_metric(name)
    assert metric is not None
    weight = 100.0 if math.isfinite(value) else 0.0
    total = {"rms": value**2 * weight, "mean": value * weight}.get(metric.pool, value)
    return MetricRow(metric.stage, name, value, metric.unit, 100, math.nan, math.nan, metric.pool, total, weight)


def run(values: Mapping[str, list[float] | FloatArray], *, first: int = 0, sha256: str = "") -> list[LogMetrics]:
    """One log for each value."""
    n = len(next(iter(values.values())))
    return [
        LogMetrics(
            f"log{first + k}", {name: row(name, float(column[k])) for name, column in values.items()}, "", sha256
        )
        for k in range(n)
    ]


def only(change: tuple[MetricChange, ...]) -> MetricChange:
    (found,) = change
    return found


def test_identical_runs_are_the_same() -> None:
    logs = run({RMSE: [1.0, 2.0], "warnings.recall": [1.0, math.nan]})
    comparison = compare_runs(logs, logs)
    assert [(c.metric, c.verdict, c.change, c.n_pairs) for c in comparison.changes] == [
        (RMSE, ChangeVerdict.SAME, 0.0, 2),
        ("warnings.recall", ChangeVerdict.SAME, 0.0, 1),
    ]


def test_rounding_of_another_processor_is_no_change() -> None:
    values = np.linspace(1.0, 2.0, 12)
    assert (
        only(compare_runs(run({RMSE: values}), run({RMSE: values * (1.0 + 1e-13)})).changes).verdict
        is ChangeVerdict.SAME
    )


def test_a_few_logs_are_unclear_but_exact_judges_them() -> None:
    before, after = run({RMSE: [1.0, 2.0, 3.0]}), run({RMSE: [1.1, 2.2, 3.3]})
    change = only(compare_runs(before, after).changes)
    assert change.verdict is ChangeVerdict.UNCLEAR
    # each grew by a tenth; the floor is 1 % of both runs' pooled sqrt((14 + 1.21 * 14) / 6) = 2.271
    floor = 0.01 * math.sqrt(14.0 * (1.0 + 1.1**2) / 6.0)
    ratios = [(1.1 * x + floor) / (x + floor) for x in (1.0, 2.0, 3.0)]
    assert change.change == pytest.approx(math.prod(ratios) ** (1.0 / 3.0) - 1.0)
    assert only(compare_runs(before, after, exact=True).changes).verdict is ChangeVerdict.WORSE
    assert only(compare_runs(before, after, exact=True, tolerance=0.2).changes).verdict is ChangeVerdict.SAME
    assert only(compare_runs(after, before, exact=True).changes).verdict is ChangeVerdict.IMPROVED


def test_exchanged_runs_give_the_opposite_change() -> None:
    # what the sign-flip test rests on: nothing may depend on which of the two runs is called the baseline
    one, other = np.exp(np.random.default_rng(1).normal(0.0, 1.5, (2, 15)))
    forth, back = (
        only(compare_runs(run({RMSE: before}), run({RMSE: after}), seed=3).changes)
        for before, after in ((one, other), (other, one))
    )
    assert (1.0 + forth.change) * (1.0 + back.change) == pytest.approx(1.0, abs=1e-12)
    assert forth.p == back.p


def test_p_value_of_twelve_changes_to_one_side() -> None:
    before = np.linspace(1.0, 2.0, 12)
    change = only(compare_runs(run({RMSE: before}), run({RMSE: before * 1.05})).changes)
    # only all signs as they are, or all turned, reach the sum: 2 of 2^12
    assert change.p == pytest.approx(2.0 / 2**12, abs=5e-4)
    assert change.verdict is ChangeVerdict.WORSE
    assert 0.045 < change.low <= change.change <= change.high < 0.05


def test_sign_flip_agrees_with_scipy() -> None:
    rng = np.random.default_rng(5)
    before, shift = np.full(25, 0.9), rng.normal(0.01, 0.03, 25)
    change = only(compare_runs(run({"warnings.recall": before}), run({"warnings.recall": before + shift})).changes)
    expected = stats.permutation_test(
        (shift, np.zeros(25)), lambda a, b, axis: np.mean(a - b, axis=axis), permutation_type="samples",
        n_resamples=20_000, vectorized=True, rng=np.random.default_rng(6),
    )  # fmt: skip
    assert change.p == pytest.approx(expected.pvalue, abs=0.015)
    assert not change.is_relative and change.change == pytest.approx(shift.mean())


def test_interval_agrees_with_scipys_bootstrap() -> None:
    shift = np.random.default_rng(7).normal(0.0, 0.02, 60)
    before = np.full(60, 0.5)
    change = only(compare_runs(run({"warnings.recall": before}), run({"warnings.recall": before + shift})).changes)
    expected = stats.bootstrap((shift,), np.mean, method="percentile", rng=np.random.default_rng(8)).confidence_interval
    assert (change.low, change.high) == pytest.approx((expected.low, expected.high), abs=6e-4)


def test_fewer_right_shares_are_worse_and_more_false_alarms_too() -> None:
    lower, higher = np.full(20, 0.9), np.linspace(1.0, 3.0, 20)
    before = run({"warnings.recall": lower, "warnings.false_alarms_per_hour": higher})
    after = run({"warnings.recall": lower - 0.05, "warnings.false_alarms_per_hour": higher * 1.2})
    assert {c.metric: c.verdict for c in compare_runs(before, after).changes} == {
        "warnings.recall": ChangeVerdict.WORSE,
        "warnings.false_alarms_per_hour": ChangeVerdict.WORSE,
    }


def test_a_metric_with_a_target_is_judged_by_its_distance() -> None:
    before = run({"ego.position_nees": np.full(20, 0.5)})
    nearer, past = run({"ego.position_nees": np.full(20, 1.5)}), run({"ego.position_nees": np.full(20, 4.5)})
    assert only(compare_runs(before, nearer).changes).verdict is ChangeVerdict.IMPROVED
    worse = only(compare_runs(before, past).changes)
    assert worse.verdict is ChangeVerdict.WORSE
    assert worse.change == pytest.approx(1.0)  # 2.5 from 2 instead of 1.5


def test_a_certain_but_tiny_change_is_the_same() -> None:
    before = np.linspace(1.0, 2.0, 50)
    change = only(compare_runs(run({RMSE: before}), run({RMSE: before * 1.002})).changes)
    assert change.p < FAMILY_WISE_ERROR_RATE and change.verdict is ChangeVerdict.SAME


def test_noise_without_a_change_is_unclear() -> None:
    rng = np.random.default_rng(1)
    before = rng.uniform(1.0, 2.0, 20)
    after = before * np.exp(rng.normal(0.0, 0.2, 20))
    assert only(compare_runs(run({RMSE: before}), run({RMSE: after})).changes).verdict is ChangeVerdict.UNCLEAR


def test_a_parked_car_does_not_decide() -> None:
    # nine logs got a tenth worse; the error of the tenth, a parked car, fell from nothing to less
    before, after = [1.0] * 9 + [1e-6], [1.1] * 9 + [1e-12]
    assert (
        only(compare_runs(run({RMSE: before}), run({RMSE: after}), exact=True).changes).verdict is ChangeVerdict.WORSE
    )


def test_typical_log_against_pooled_value_is_unclear() -> None:
    # nineteen small errors halve, the one that makes the pooled value doubles
    before, after = [0.1] * 19 + [10.0], [0.05] * 19 + [20.0]
    change = only(compare_runs(run({RMSE: before}), run({RMSE: after})).changes)
    assert change.change < -0.3 and change.candidate > 1.9 * change.baseline
    assert change.verdict is ChangeVerdict.UNCLEAR


def test_missing_metrics_and_logs_are_named() -> None:
    before = run({RMSE: [1.0, 1.0], "lanes.found_share": [1.0, 1.0]}, sha256="x")
    after = [*run({RMSE: [1.0], "tracking.gospa_m": [2.0]}, sha256="y"), LogMetrics("log1", error="cut")]
    after += run({RMSE: [1.0]}, first=7)
    comparison = compare_runs(before, after)
    verdicts = {c.metric: c.verdict for c in comparison.changes}
    assert verdicts == {
        RMSE: ChangeVerdict.SAME,
        "lanes.found_share": ChangeVerdict.MISSING,
        "tracking.gospa_m": ChangeVerdict.NEW,
    }
    assert comparison.failed == ("log1",)
    assert comparison.only_candidate == ("log7",)
    assert comparison.only_baseline == ()
    assert comparison.other_input == ("log0",)


def test_a_value_lost_in_some_logs_is_counted() -> None:
    before, after = run({"warnings.recall": [1.0, 1.0, 1.0]}), run({"warnings.recall": [1.0, math.nan, 1.0]})
    change = only(compare_runs(before, after).changes)
    assert (change.n_pairs, change.n_missing) == (2, 1)


def test_no_pair_at_all() -> None:
    comparison = compare_runs(run({RMSE: [1.0]}), run({RMSE: [1.0]}, first=5))
    assert comparison.n_pairs == 0 and comparison.changes == ()
    assert comparison.only_baseline == ("log0",)


def test_table_of_a_comparison() -> None:
    values = np.linspace(1.0, 2.0, 12)
    (record,) = comparison_table(compare_runs(run({RMSE: values}), run({RMSE: values * 1.1}))).rows_as_dicts()
    assert (record["metric"], record["verdict"], record["n_pairs"], record["is_relative"]) == (RMSE, "worse", 12, True)


def synthetic_pair(seed: int, *, planted: float) -> dict[str, ChangeVerdict]:
    """Two runs of 40 logs: every error differs by 5 % of noise from run to run, and by a planted change in the first.

    The logs' own errors spread over a factor of 2.2 (one sigma of the logarithm is 0.8).
    """
    rng = np.random.default_rng(seed)
    before = np.exp(rng.normal(0.0, 0.8, (40, len(POSITIVE))))
    after = before * np.exp(rng.normal(0.0, 0.05, before.shape))
    after[:, 0] *= 1.0 + planted
    runs = [run(dict(zip(POSITIVE, values.T, strict=True))) for values in (before, after)]
    return {change.metric: change.verdict for change in compare_runs(*runs, seed=seed).changes}


@pytest.mark.parametrize(("n_pairs", "most"), [(50, 7), pytest.param(200, 10, marks=pytest.mark.long)])
def test_planted_regressions_are_found_and_chance_is_not(n_pairs: int, most: int) -> None:
    """At most 5 % of pairs without a change are flagged: of 50 at most 7 in 99 of 100 cases (binomial)."""
    assert len(POSITIVE) >= 12
    found = sum(synthetic_pair(seed, planted=0.05)[POSITIVE[0]] is ChangeVerdict.WORSE for seed in range(n_pairs))
    unplanted = [synthetic_pair(1000 + seed, planted=0.0) for seed in range(n_pairs)]
    flagged = sum(
        bool({ChangeVerdict.WORSE, ChangeVerdict.IMPROVED} & set(verdicts.values())) for verdicts in unplanted
    )
    assert found >= 0.95 * n_pairs
    assert flagged <= most
