"""Gates: conditions on headline metrics that a run has to meet. For the grammar see `cwcli.metrics.gate_syntax`.

A condition on a metric of a log must hold for every log. A metric that a log does not have, or that has no value there
(precision without a warning), leaves the condition open: `and` and `or` follow Kleene's logic of three values, and a
gate that stays open has failed unless missing metrics are allowed. A log that failed fails every gate that asks it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from difflib import get_close_matches
from enum import Enum
from functools import cached_property

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.metrics.condition_parser import Comparison, Not, Number
from cwcli.metrics.gate_syntax import (
    Aggregate,
    AnyAll,
    Name,
    Node,
    Operand,
    needs_single_log,
    parse_gate,
    percentile_of_function,
)
from cwcli.metrics.headline import METRICS, find_metric
from cwcli.metrics.pooling import LogMetrics, metric_names, pool_metric_value
from cwcli.signals.field_condition import COMPARISONS_BY_SIGN
from cwcli.text import format_number

_FUNCTION_BY_AGGREGATE_NAME: dict[str, Callable[[Sequence[float]], float]] = {
    "mean": lambda values: math.fsum(values) / len(values),
    "median": lambda values: float(np.median(values)),
    "min": min,
    "max": max,
    "sum": math.fsum,
}
"""Name of a function over all logs -> the function that computes it from at least one finite value."""
MEASURE_METRIC_PREFIX = "measures."
"""The metrics of a criticality measure have names that begin with this: `measures.min_ttc_s`."""
EXTREME_WORDS_IN_MEASURE_METRIC_NAMES = ("min", "max")
"""A measure's most critical value in a log is its least or its greatest; its metric's name has one of these words."""
FAILED_LOGS_GATE = "every log was evaluated"
"""Name of the additional gate that a run with failed logs fails."""


class CheckStatus(Enum):
    """The outcome of a check."""

    PASSED = "passed"
    FAILED = "failed"
    SKIPPED = "skipped"


@dataclass(frozen=True)
class GateCheck:
    """The check of a gate on one log.

    Attributes:
        log: The id of the log; "" where the gate is about the run as a whole.
        detail: The values that were compared, and the metrics that are missing.
    """

    log: str
    status: CheckStatus
    detail: str


@dataclass(frozen=True)
class GateResult:
    """One gate and its checks."""

    gate: str
    checks: tuple[GateCheck, ...]

    @property
    def failed_checks(self) -> tuple[GateCheck, ...]:
        """The checks that failed."""
        return tuple(check for check in self.checks if check.status is CheckStatus.FAILED)

    @property
    def status(self) -> CheckStatus:
        """The status of the gate: failed if a check failed, skipped if all checks were."""
        if self.failed_checks:
            return CheckStatus.FAILED
        return (
            CheckStatus.PASSED
            if any(check.status is CheckStatus.PASSED for check in self.checks)
            else CheckStatus.SKIPPED
        )


@dataclass(frozen=True)
class _ExplainedTruth:
    """The truth value of a node (None: unknown), and words that explain it."""

    holds: bool | None
    words: tuple[str, ...]


def check_gates(gates: Sequence[str], logs: Sequence[LogMetrics], *, allow_missing: bool = False) -> list[GateResult]:
    """Check every gate; with gates to check, logs that failed are a failed gate of their own.

    Args:
        logs: The logs of the run, failed ones included.
        allow_missing: Skip a check that stays unknown for lack of a metric, instead of failing it.

    Raises:
        UsageError: An expression is no gate.
    """
    nodes = [(text, parse_gate(text)) for text in gates]
    judge = _GateEvaluator(logs)
    results = [GateResult(" ".join(text.split()), judge.check_gate(node, allow_missing)) for text, node in nodes]
    failed = tuple(GateCheck(log.id, CheckStatus.FAILED, f"the log failed: {log.error}") for log in logs if log.error)
    return [*results, GateResult(FAILED_LOGS_GATE, failed)] if failed and results else results


class _GateEvaluator:
    """Evaluates parsed gates over the logs of a run."""

    def __init__(self, logs: Sequence[LogMetrics]) -> None:
        self._logs = logs
        self._done = [log for log in logs if not log.error]

    @cached_property
    def _all_metric_names(self) -> list[str]:
        """Every metric that some log has."""
        return metric_names(self._logs)

    def check_gate(self, node: Node, allow_missing: bool) -> tuple[GateCheck, ...]:
        """Check a gate: for each log if it is about single logs, else once."""
        if not self._logs:
            return (GateCheck("", CheckStatus.FAILED, "there is no log"),)
        logs_to_check: Sequence[LogMetrics | None] = self._logs if needs_single_log(node) else (None,)
        return tuple(self._check_one_log(node, log, allow_missing) for log in logs_to_check)

    def _check_one_log(self, node: Node, log: LogMetrics | None, allow_missing: bool) -> GateCheck:
        """Check a gate on one log, or on the run as a whole (None)."""
        if log is not None and log.error:
            return GateCheck(log.id, CheckStatus.FAILED, f"the log failed: {log.error}")
        answer = self._evaluate_node(node, log)
        status = CheckStatus.PASSED if answer.holds else CheckStatus.FAILED
        if answer.holds is None and allow_missing:
            status = CheckStatus.SKIPPED
        return GateCheck(log.id if log else "", status, "; ".join(dict.fromkeys(answer.words)))

    def _evaluate_node(self, node: Node, log: LogMetrics | None) -> _ExplainedTruth:
        """Evaluate a node for one log, or for the run as a whole (None)."""
        if isinstance(node, Comparison):
            return self._evaluate_comparison(node, log)
        if isinstance(node, Not):
            inner = self._evaluate_node(node.inner, log)
            return _ExplainedTruth(None if inner.holds is None else not inner.holds, inner.words)
        if isinstance(node, AnyAll):
            return self._evaluate_any_all(node)
        return _combine_answers([self._evaluate_node(part, log) for part in node.parts], is_and=node.is_and)

    def _evaluate_any_all(self, node: AnyAll) -> _ExplainedTruth:
        """Evaluate `any` or `all` over the logs that did not fail."""
        answers = [self._evaluate_node(node.inner, log) for log in self._done]
        combined = _combine_answers(answers, is_and=node.quantifier == "all")
        n_holding = sum(answer.holds is True for answer in answers)
        return _ExplainedTruth(combined.holds, (f"it holds for {n_holding} of {len(answers)} logs",))

    def _evaluate_comparison(self, node: Comparison, log: LogMetrics | None) -> _ExplainedTruth:
        """Evaluate a comparison; with a pattern it must hold for every metric that matches."""
        columns = [self._operand_values(operand, log) for operand in node.operands]
        answers = []
        for row in range(max(len(column) for column in columns)):
            cells = [column[row if len(column) > 1 else 0] for column in columns]
            words = tuple(words for _, words in cells if words)
            values = [value for value, _ in cells]
            if any(value is None for value in values):
                answers.append(_ExplainedTruth(None, words))
                continue
            holds_for_all = all(
                COMPARISONS_BY_SIGN[sign](float(left or 0.0), float(right or 0.0))
                for sign, left, right in zip(node.signs, values, values[1:], strict=False)
            )
            answers.append(_ExplainedTruth(holds_for_all, words))
        return _combine_answers(answers, is_and=True)

    def _operand_values(self, operand: Operand, log: LogMetrics | None) -> list[tuple[float | None, str]]:
        """Return the values of an operand (None: missing) with words for each; several for a pattern."""
        if isinstance(operand, Number):
            return [(operand.value, "")]
        if isinstance(operand, Name):
            assert log is not None
            return [self._value_of_log(name, log) for name in self._metrics_matching(operand, list(log.rows))]
        if isinstance(operand, Aggregate):
            metrics = self._metrics_matching(operand.name, self._all_metric_names, operand.function)
            return [self._aggregate_over_logs(operand.function, name) for name in metrics]
        answers = [self._evaluate_node(operand.inner, each).holds for each in self._done]
        known = [answer for answer in answers if answer is not None]
        if not known:
            return [(None, "no log can say")]
        n_known = sum(known)
        return [(n_known / len(known), f"it holds for {n_known} of {len(known)} logs")]

    def _metrics_matching(self, name: Name, names: list[str], function: str = "") -> list[str]:
        """Return the metrics that match a name; the name itself where there are none.

        The name of a measure, `measures.ttc_s`, means the metric of its most critical value in each log, which is
        either its least or its greatest one.
        """
        if not name.is_pattern:
            extremes = (
                [function]
                if function in EXTREME_WORDS_IN_MEASURE_METRIC_NAMES
                else EXTREME_WORDS_IN_MEASURE_METRIC_NAMES
            )
            column = name.text.removeprefix(MEASURE_METRIC_PREFIX)
            suggestions = [f"{MEASURE_METRIC_PREFIX}{each}_{column}" for each in extremes if name.text != column]
            return [
                next(
                    (
                        each
                        for each in suggestions
                        if each in self._all_metric_names and name.text not in self._all_metric_names
                    ),
                    name.text,
                )
            ]
        return [known for known in names if matches_pattern(name.text, known)] or [name.text]

    def _value_of_log(self, name: str, log: LogMetrics) -> tuple[float | None, str]:
        """Return a metric's value in one log (None: missing), and words for it."""
        row = log.rows.get(name)
        if row is None:
            return None, self._format_missing_metric(name)
        if math.isnan(row.value):
            return None, f"{name} has no value: there was nothing to judge"
        return row.value, f"{name} = {_format_value(row.value, row.unit)}"

    def _aggregate_over_logs(self, function: str, name: str) -> tuple[float | None, str]:
        """Return a function of a metric's values in all logs (None: missing), and words for it."""
        rows = [log.rows[name] for log in self._done if name in log.rows]
        if not rows:
            return None, self._format_missing_metric(name)
        values = [row.value for row in rows if not math.isnan(row.value)]
        if function == "pooled":
            value = pool_metric_value(rows)
        elif not values:
            value = math.nan
        else:
            percentile = percentile_of_function(function)
            value = (
                _FUNCTION_BY_AGGREGATE_NAME[function](values)
                if percentile is None
                else float(np.percentile(values, percentile))
            )
        label = f"{function}({name})"
        if math.isnan(value):
            return None, f"{label} has no value: there was nothing to judge"
        return value, f"{label} = {_format_value(value, rows[0].unit)} over {len(values)} logs"

    def _format_missing_metric(self, name: str) -> str:
        """Return why a metric has no value, with a similar name if there is one."""
        if "*" in name:
            return f"no metric matches {name}"
        if name in self._all_metric_names:
            return f"{name} is missing"
        if find_metric(name) is not None:
            return f"no log has {name}"
        near = get_close_matches(name, [*self._all_metric_names, *(metric.name for metric in METRICS)], n=1)
        return f"no log has {name}" + (f" (did you mean {near[0]}?)" if near else "")


def matches_pattern(pattern: str, name: str) -> bool:
    """Return whether a name matches a pattern whose `*` stand for any characters, in linear time."""
    first, *rest = pattern.split("*")
    if not rest:
        return first == name
    last = rest.pop()
    if len(name) < len(first) + len(last) or not name.startswith(first) or not name.endswith(last):
        return False
    at, end = len(first), len(name) - len(last)
    for part in rest:
        found = name.find(part, at, end)
        if found < 0:
            return False
        at = found + len(part)
    return True


def _combine_answers(answers: Sequence[_ExplainedTruth], *, is_and: bool) -> _ExplainedTruth:
    """Combine answers by Kleene's `and` or `or`; without answers `and` is true and `or` false."""
    words = tuple(word for answer in answers for word in answer.words)
    if any(answer.holds is (not is_and) for answer in answers):
        decided = tuple(word for answer in answers if answer.holds is (not is_and) for word in answer.words)
        return _ExplainedTruth(not is_and, decided)
    if any(answer.holds is None for answer in answers):
        return _ExplainedTruth(None, tuple(word for answer in answers if answer.holds is None for word in answer.words))
    return _ExplainedTruth(is_and, words)


def _format_value(value: float, unit: str) -> str:
    return f"{format_number(value)} {unit}".rstrip() if math.isfinite(value) else f"{value}"
