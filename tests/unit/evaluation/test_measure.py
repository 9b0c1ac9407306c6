"""The headline metrics of `measure`, and a gate by them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cwcli.evaluation.evaluate_log import evaluate_log
from cwcli.metrics.gates import CheckStatus, check_gates
from cwcli.metrics.pooling import LogMetrics, metric_rows_by_name
from cwcli.stages.measure import MeasureConfig, measure
from tests.unit.stages.measure_logs import state_log, states, straight

TIME_S = np.arange(0.0, 6.0, 0.05)


def judged(tmp_path: Path, other_mps: float) -> LogMetrics:
    """The ego at 20 m/s, 80 m behind another."""
    ego = states(["ego"], [straight(0.0, 0.0, 20.0, 0.0, TIME_S)], TIME_S)
    other = states(["car"], [straight(80.0, 0.0, other_mps, 0.0, TIME_S)], TIME_S)
    log = state_log(tmp_path / "log.mcap", ego, other)
    made = measure(log, MeasureConfig())
    return LogMetrics("drive", metric_rows_by_name(evaluate_log(log.with_channels(made.channels))))


def test_most_critical_values_and_a_gate(tmp_path: Path) -> None:
    metrics = judged(tmp_path, 10.0)
    ttc = (75.5 - 10.0 * TIME_S[-1]) / 10.0
    assert metrics.rows["measures.min_ttc_s"].value == pytest.approx(ttc)
    assert metrics.rows["measures.max_drac_mps2"].value == pytest.approx(5.0 / ttc)
    for gate, status in (
        ("measures.min_ttc_s > 1", CheckStatus.PASSED),
        ("min(measures.min_ttc_s) > 2", CheckStatus.FAILED),
    ):
        assert check_gates([gate], [metrics])[0].status is status


def test_what_never_had_a_value_is_no_metric(tmp_path: Path) -> None:
    metrics = judged(tmp_path, 25.0)
    assert "measures.min_ttc_s" not in metrics.rows
    assert check_gates(["measures.min_ttc_s > 1"], [metrics])[0].status is CheckStatus.FAILED
    assert check_gates(["measures.min_ttc_s > 1"], [metrics], allow_missing=True)[0].status is CheckStatus.SKIPPED
