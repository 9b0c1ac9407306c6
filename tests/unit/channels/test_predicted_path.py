"""Paths in a file at a chosen rate, while the stages of the same run see all."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cwcli.channels.output import first_rows_of_each_vehicle_and_period
from cwcli.channels.predicted_path import LazyPaths, make_lazy_path_channel, read_predicted_paths
from cwcli.channels.published import REMOTE_PATH
from cwcli.logs.read.reader import Log
from cwcli.logs.write.annotate import annotate_log
from cwcli.pipeline.paths import replanned_or_logged_paths_and_notes
from cwcli.prediction.plan import PathPlan
from cwcli.prediction.rollout import RolloutSettings
from cwcli.signals.columns import Strings
from cwcli.signals.vehicle_state import N_STATES, SPEED
from tests.unit.logs_read.builders import T0_NS, small_log

MS = 1_000_000


def test_the_first_row_of_each_vehicle_in_each_period() -> None:
    """Two vehicles every 50 ms, one of them 20 ms later; periods of 200 ms from time 0."""
    stamp_ns = np.array([100, 120, 150, 170, 200, 220, 250, 270, 450, 470]) * MS
    codes = np.array([0, 1] * 5)
    assert first_rows_of_each_vehicle_and_period(codes, stamp_ns, 5.0).tolist() == [0, 1, 4, 5, 8, 9]


def test_rows_out_of_order_and_a_rate_above_the_paths_own() -> None:
    stamp_ns = np.array([250, 50, 100]) * MS
    codes = np.zeros(3, np.int32)
    assert first_rows_of_each_vehicle_and_period(codes, stamp_ns, 5.0).tolist() == [0, 1]
    assert first_rows_of_each_vehicle_and_period(codes, stamp_ns, 1e12).tolist() == [0, 1, 2]
    assert first_rows_of_each_vehicle_and_period(codes[:0], stamp_ns[:0], 5.0).tolist() == []


def planned(n: int) -> LazyPaths:
    """Every 50 ms a start of vehicle 7 and of vehicle 8 in turns, at constant velocity."""
    state = np.zeros((n, N_STATES))
    state[:, 0], state[:, SPEED] = np.arange(n) * 100.0, 8.0
    stamps = T0_NS // (200 * MS) * 200 * MS + np.arange(n) * 50 * MS
    plan = PathPlan("cv", RolloutSettings(1.0, 0.05), state, np.tile(np.eye(N_STATES), (n, 1, 1)))
    return LazyPaths(Strings(np.arange(n, dtype=np.int32) % 2, ("7", "8")), stamps, stamps + 5, plan)


def test_a_log_gets_some_paths_and_whoever_reads_the_channel_in_the_run_the_same(tmp_path: Path) -> None:
    given = planned(20)
    channel = make_lazy_path_channel(REMOTE_PATH, given, rate_hz=5.0)
    (tmp_path / "in.mcap").write_bytes(small_log(4))
    with Log.open(tmp_path / "in.mcap") as log:
        run = log.with_channels([channel])
        seen = read_predicted_paths(run.columns(REMOTE_PATH.topic))
        assert replanned_or_logged_paths_and_notes(run, REMOTE_PATH.topic, "remote_state") == (given, ())
        annotate_log(run, (), {}, tmp_path / "out.mcap")
    with Log.open(tmp_path / "out.mcap") as log:
        found = read_predicted_paths(log.columns(REMOTE_PATH.topic))
        assert log.faults.counts_by_reason() == {}
    rows = [0, 1, 4, 5, 8, 9, 12, 13, 16, 17]
    for each in (seen, found):
        assert each.stamp_ns.tolist() == given.stamp_ns[rows].tolist()
        assert each.log_time_ns.tolist() == given.log_time_ns[rows].tolist()
        assert [each.ids.values[code] for code in each.ids.codes] == ["7", "8"] * 5
        assert each.paths.time_s.tolist() == [0.0, 0.25, 0.5, 0.75, 1.0]
        assert each.paths.x_m[1].tolist() == [100.0, 102.0, 104.0, 106.0, 108.0]  # 8 m/s
        exact = given.plan.paths_of_rows(np.array(rows))
        np.testing.assert_allclose(each.paths.position_covariance_m2, exact.position_covariance_m2[:, ::5], rtol=2**-5)


@pytest.mark.parametrize("step_s, kept", [(0.05, 5), (0.1, 2), (0.25, 1), (0.3, 1)])
def test_points_are_a_quarter_of_a_second_apart_at_most(step_s: float, kept: int) -> None:
    given = replace(planned(2), plan=replace(planned(2).plan, settings=RolloutSettings(3.0, step_s)))
    channel = make_lazy_path_channel(REMOTE_PATH, given, rate_hz=5.0)
    assert np.asarray(channel.make_rows(0, 2)["step_s"]).tolist() == pytest.approx([kept * step_s] * 2)
