"""Two runs over the same logs: what got better, what got worse, and whether it could be chance.

Logs are paired by their id. For each metric every pair gives one change, and the changes of all pairs are judged:

- the change of a positive quantity (an error, a rate) is relative, ln(candidate / baseline), so that a hard log counts
  no more than an easy one; that of a share, or of a quantity that is 0 or negative in some log, is a plain difference;
  that of a metric with a target (NEES, coverage) is how much farther from the target the value has moved;
- the interval is a paired percentile bootstrap over the logs, widened by sqrt(n / (n - 1));
- the p-value is that of the sign-flip permutation test of the mean change: if nothing has changed but by chance, the
  change of each log is as likely to be the other way round;
- many metrics are judged at once, so the p-values are adjusted by Holm's method: the probability that any metric at all
  is called improved or worse by chance is at most 2 %;
- a change smaller than the tolerance (1 % unless told) is never called improved or worse, however certain it is;
- where the typical log moves one way and the pooled value the other, by more than the tolerance, it is unclear.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import Enum

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.metrics.headline import Metric, find_metric
from cwcli.metrics.pooling import (
    MIN_LOGS_FOR_BOOTSTRAP,
    LogMetrics,
    MetricRow,
    UInt16Array,
    bootstrap_draw_counts,
    metric_names,
    pool_metric_value,
    resampled_sums,
)
from cwcli.metrics.table import ColumnDoc, Table
from cwcli.signals.columns import FloatArray

FAMILY_WISE_ERROR_RATE = 0.02
"""Greatest probability that any metric of a run is called improved or worse by chance; chosen by hand."""
INTERVAL_COVERAGE = 0.95
"""Coverage of the interval of a change, as a share; the usual convention."""
MIN_RELATIVE_CHANGE = 0.01
"""Smallest relative change that is called improved or worse by default; chosen by hand."""
N_SIGN_FLIPS = 9999
"""Number of random sign flips; with the observed one the p-values are multiples of 1 / 10000."""
SIGN_FLIPS_PER_BATCH = 1111
"""Number of sign flips computed at once, a divisor of `N_SIGN_FLIPS`; it bounds the memory."""
ROUNDING_TOLERANCE = 1e-9
"""Greatest relative difference that counts as rounding, as between two processors; chosen by hand."""
SHARE_OF_POOLED_VALUE_ADDED_TO_RATIO = 0.01
"""Share of the pooled value added to both values of a ratio, to keep tiny errors from deciding; chosen by hand."""


class ChangeVerdict(Enum):
    """The verdict on the change of a metric."""

    IMPROVED = "improved"
    WORSE = "worse"
    SAME = "same"
    UNCLEAR = "unclear"
    MISSING = "missing"
    NEW = "new"
    NOT_JUDGED = "-"


@dataclass(frozen=True)
class MetricChange:
    """One metric in two runs.

    Attributes:
        metric: Its name.
        unit: Unit of `baseline` and `candidate`.
        baseline, candidate: The values pooled over the pairs.
        n_pairs: Number of logs in which both runs have a value.
        n_changed: Number of pairs whose values differ.
        n_missing: Number of logs in which the baseline has a value and the candidate has none.
        change: Mean change of the pairs; a ratio minus 1 if `is_relative`, else a difference.
        low, high: 95 % interval of the change; NaN with fewer than 5 pairs.
        is_relative: See `change`.
        p: P-value of the sign-flip test, adjusted for the number of metrics; NaN if the metric was not tested.
        verdict: The verdict.
    """

    metric: str
    unit: str
    baseline: float
    candidate: float
    n_pairs: int
    n_changed: int
    n_missing: int
    change: float
    low: float
    high: float
    is_relative: bool
    p: float
    verdict: ChangeVerdict


@dataclass(frozen=True)
class RunComparison:
    """The comparison of two runs.

    Attributes:
        changes: One entry a metric, in the order of `METRICS`.
        n_pairs: Number of logs in both runs.
        only_baseline, only_candidate: Ids of logs that the other run does not have.
        failed: Ids of logs that failed in the candidate only.
        other_input: Ids of logs whose inputs differ.
    """

    changes: tuple[MetricChange, ...]
    n_pairs: int
    only_baseline: tuple[str, ...]
    only_candidate: tuple[str, ...]
    failed: tuple[str, ...]
    other_input: tuple[str, ...]

    def changes_with_verdict(self, verdict: ChangeVerdict) -> tuple[MetricChange, ...]:
        """Return the changes of the metrics with this verdict."""
        return tuple(change for change in self.changes if change.verdict is verdict)


def compare_runs(
    baseline: Sequence[LogMetrics],
    candidate: Sequence[LogMetrics],
    *,
    seed: int = 0,
    tolerance: float = MIN_RELATIVE_CHANGE,
    exact: bool = False,
) -> RunComparison:
    """Compare two runs.

    Args:
        baseline, candidate: Their logs; ids are unique in each.
        seed: Seed of the bootstrap and of the permutations.
        tolerance: See the module; of a share it is absolute, of a metric with a target relative to the target.
        exact: Take the logs as the whole population, not as a sample: any mean change beyond the tolerance counts.
    """
    before = {log.id: log for log in baseline if not log.error}
    after = {log.id: log for log in candidate if not log.error}
    ids = [name for name in before if name in after]
    pairs = [(before[name], after[name]) for name in ids]
    names = metric_names([*(log for pair in pairs for log in pair)])
    effects = [_metric_changes_of_pairs(name, pairs, tolerance) for name in names]
    takes_part_in_tests = np.array([effect.takes_part_in_tests for effect in effects], dtype=bool)
    p = np.full(len(effects), np.nan)
    if takes_part_in_tests.any():
        p[takes_part_in_tests] = _adjust_p_values_holm(
            _sign_flip_p_values(np.column_stack([e.changes for e in effects if e.takes_part_in_tests]), seed)
        )
    drawn = bootstrap_draw_counts(len(pairs), seed) if len(pairs) >= MIN_LOGS_FOR_BOOTSTRAP else None
    tried = {log.id for log in candidate}
    return RunComparison(
        changes=tuple(
            _judge_metric_change(e, float(each), drawn, exact=exact) for e, each in zip(effects, p, strict=True)
        ),
        n_pairs=len(pairs),
        only_baseline=tuple(log.id for log in baseline if log.id not in tried),
        only_candidate=tuple(log.id for log in candidate if log.id not in {each.id for each in baseline}),
        failed=tuple(log.id for log in candidate if log.error and log.id in before),
        other_input=tuple(a.id for a, b in pairs if a.sha256 and b.sha256 and a.sha256 != b.sha256),
    )


@dataclass(frozen=True)
class _PairedChanges:
    """The changes of one metric: (n,) over all pairs, NaN where a run has no value; positive: the value grew.

    For a metric with a target positive means: farther from it.
    """

    name: str
    metric: Metric | None
    rows: tuple[tuple[MetricRow, MetricRow], ...]
    changes: FloatArray
    is_relative: bool
    tolerance: float
    n_missing: int
    is_new: bool

    @property
    def finite_changes(self) -> FloatArray:
        """The changes of the pairs in which both runs have a value, shape (k,)."""
        return self.changes[np.isfinite(self.changes)]

    def pooled_value_contradicts(self, mean: float, before: float, after: float) -> bool:
        """Return whether the pooled value moved against the mean change by more than the tolerance."""
        metric = self.metric
        if metric is not None and metric.better == "near":
            change_of_pooled_value = abs(after - metric.target) - abs(before - metric.target)
        elif self.is_relative and before > 0.0 and after > 0.0:
            change_of_pooled_value = math.log(after / before)
        else:
            change_of_pooled_value = after - before
        return change_of_pooled_value * mean < 0.0 and abs(change_of_pooled_value) > self.tolerance

    @property
    def takes_part_in_tests(self) -> bool:
        """Whether it takes part in the tests: it is a headline metric, has a better side, and differs somewhere."""
        return self.metric is not None and self.metric.is_compared and bool(self.finite_changes.any())


def _metric_changes_of_pairs(
    name: str, pairs: Sequence[tuple[LogMetrics, LogMetrics]], tolerance: float
) -> _PairedChanges:
    """Return the changes of one metric over all pairs of logs."""
    metric = find_metric(name)
    before = np.array([a.metric_value(name) for a, _ in pairs])
    after = np.array([b.metric_value(name) for _, b in pairs])
    known = np.isfinite(before) & np.isfinite(after)
    rows = tuple((a.rows[name], b.rows[name]) for (a, b), both in zip(pairs, known, strict=True) if both)
    changes = np.full(len(pairs), np.nan)
    is_relative, limit = False, tolerance
    if known.any():
        changes[known], is_relative, limit = _changes_whether_relative_and_tolerance(
            metric, before[known], after[known], rows, tolerance
        )
    return _PairedChanges(
        name,
        metric,
        rows,
        changes,
        is_relative,
        limit,
        n_missing=int((np.isfinite(before) & ~np.isfinite(after)).sum()),
        is_new=not np.isfinite(before).any() and bool(np.isfinite(after).any()),
    )


def _changes_whether_relative_and_tolerance(
    metric: Metric | None,
    before: FloatArray,
    after: FloatArray,
    rows: Sequence[tuple[MetricRow, MetricRow]],
    tolerance: float,
) -> tuple[FloatArray, bool, float]:
    """Return the changes (n,), whether they are relative, and the tolerance in their unit."""
    equal = np.abs(after - before) <= ROUNDING_TOLERANCE * np.maximum(np.abs(before), np.abs(after))
    reference = abs(pool_metric_value([row for pair in rows for row in pair]))  # of both: the flips exchange them
    if metric is not None and metric.better == "near":
        found = np.abs(after - metric.target) - np.abs(before - metric.target)
        return np.where(equal, 0.0, found), False, tolerance * abs(metric.target)
    if metric is not None and metric.is_share:
        return np.where(equal, 0.0, after - before), False, tolerance
    if (before > 0.0).all() and (after > 0.0).all():
        floor = SHARE_OF_POOLED_VALUE_ADDED_TO_RATIO * reference
        return np.where(equal, 0.0, np.log((after + floor) / (before + floor))), True, math.log1p(tolerance)
    return np.where(equal, 0.0, after - before), False, tolerance * reference


def _sign_flip_p_values(changes: FloatArray, seed: int) -> FloatArray:
    """Return two-sided p-values (h,) of the mean changes (n, h) by flipping the signs of logs; NaN counts as 0."""
    values = np.nan_to_num(changes, nan=0.0)
    observed = np.abs(values.sum(axis=0)) * (1.0 - 1e-12)
    rng = np.random.default_rng(seed)
    reached = np.ones(values.shape[1])
    for _ in range(N_SIGN_FLIPS // SIGN_FLIPS_PER_BATCH):
        signs = rng.integers(0, 2, (SIGN_FLIPS_PER_BATCH, len(values)), dtype=np.int8) * 2.0 - 1.0
        reached += (np.abs(signs @ values) >= observed).sum(axis=0)
    return np.asarray(reached / (N_SIGN_FLIPS + 1))


def _adjust_p_values_holm(p: FloatArray) -> FloatArray:
    """Adjust p-values for their number (Holm 1979)."""
    order = np.argsort(p, kind="stable")
    adjusted = np.maximum.accumulate((len(p) - np.arange(len(p))) * p[order])
    out = np.empty_like(p)
    out[order] = np.minimum(adjusted, 1.0)
    return out


def _judge_metric_change(effect: _PairedChanges, p: float, drawn: UInt16Array | None, *, exact: bool) -> MetricChange:
    """Return the change of one metric with its interval and verdict."""
    known = effect.finite_changes
    mean = float(known.mean()) if len(known) else math.nan
    low, high = _bootstrap_interval_of_mean(effect.changes, drawn)
    both = [pool_metric_value([row[side] for row in effect.rows]) for side in (0, 1)]
    verdict = _decide_verdict(effect, mean, low, high, p, exact=exact)
    if verdict in (ChangeVerdict.IMPROVED, ChangeVerdict.WORSE) and effect.pooled_value_contradicts(mean, *both):
        verdict = ChangeVerdict.UNCLEAR

    def metric_value_as_displayed(value: float) -> float:
        return math.expm1(value) if effect.is_relative else value

    return MetricChange(
        metric=effect.name,
        unit=effect.rows[0][0].unit if effect.rows else "",
        baseline=both[0],
        candidate=both[1],
        n_pairs=len(known),
        n_changed=int(np.count_nonzero(known)),
        n_missing=effect.n_missing,
        change=metric_value_as_displayed(mean),
        low=metric_value_as_displayed(low),
        high=metric_value_as_displayed(high),
        is_relative=effect.is_relative,
        p=p,
        verdict=verdict,
    )


def _bootstrap_interval_of_mean(changes: FloatArray, draw_counts: UInt16Array | None) -> tuple[float, float]:
    """Return the percentile bootstrap interval of the mean change; NaN below `MIN_LOGS_FOR_BOOTSTRAP` values."""
    present = np.isfinite(changes)
    n = int(present.sum())
    if draw_counts is None or n < MIN_LOGS_FOR_BOOTSTRAP:
        return math.nan, math.nan
    counts = resampled_sums(draw_counts, present.astype(np.float64))
    sums = resampled_sums(draw_counts, np.nan_to_num(changes, nan=0.0))
    mean = float(changes[present].mean())
    means = mean + math.sqrt(n / (n - 1)) * (sums[counts > 0] / counts[counts > 0] - mean)
    low, high = np.quantile(means, [0.5 - 0.5 * INTERVAL_COVERAGE, 0.5 + 0.5 * INTERVAL_COVERAGE])
    return float(low), float(high)


def _decide_verdict(
    effect: _PairedChanges, mean: float, low: float, high: float, p: float, *, exact: bool
) -> ChangeVerdict:
    """Return the verdict from the mean change, its interval (low, high) and the adjusted p-value."""
    metric, limit = effect.metric, effect.tolerance
    if metric is None or not metric.is_compared:
        return ChangeVerdict.NOT_JUDGED
    if not len(effect.finite_changes):
        return (
            ChangeVerdict.NEW
            if effect.is_new
            else ChangeVerdict.MISSING
            if effect.n_missing
            else ChangeVerdict.NOT_JUDGED
        )
    is_large = abs(mean) > limit
    if is_large and (exact or p < FAMILY_WISE_ERROR_RATE):
        is_worse = (mean > 0.0) != (metric.better == "higher")
        return ChangeVerdict.WORSE if is_worse else ChangeVerdict.IMPROVED
    is_same = not effect.finite_changes.any() or exact or (-limit <= low and high <= limit)
    return ChangeVerdict.SAME if is_same else ChangeVerdict.UNCLEAR


def comparison_table(comparison: RunComparison) -> Table:
    """Return a comparison as a table with one row for each metric."""
    changes = comparison.changes
    numbers = ("baseline", "candidate", "change", "low", "high", "p")
    counts = ("n_pairs", "n_changed", "n_missing")
    return Table(
        "comparison",
        {
            "metric": [change.metric for change in changes],
            "unit": [change.unit for change in changes],
            "verdict": [change.verdict.value for change in changes],
            **{name: np.array([getattr(change, name) for change in changes], np.float64) for name in numbers},
            "is_relative": np.array([change.is_relative for change in changes], np.bool_),
            **{name: np.array([getattr(change, name) for change in changes], np.int64) for name in counts},
        },
        docs={
            "change": ColumnDoc(doc="mean over the pairs: a ratio minus 1 if is_relative, else a difference"),
            "p": ColumnDoc(doc="sign-flip test, adjusted for the number of metrics by Holm's method"),
        },
    )
