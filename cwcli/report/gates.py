"""Gates over the run's headline metrics, as `cwcli evaluate` judges them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from cwcli.report.source import Metric


@dataclass(frozen=True)
class GateResult:
    """One judged gate.

    Attributes:
        expression: As it was given.
        is_failed: It did not hold, or could not be judged.
        value: What was compared, in words.
        failed_logs: Ids of the logs that failed it; empty for a gate on the whole run.
    """

    expression: str
    is_failed: bool
    value: str
    failed_logs: frozenset[str]


def judge_gates(gates: Sequence[str], logs: Sequence[tuple[str, Sequence[Metric]]]) -> list[GateResult]:
    """Judge gates; placeholder until the gate expressions land."""
    return []
