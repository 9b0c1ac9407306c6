"""Paths in a file at a chosen rate, while the stages of the same run see all."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cwcli.channels.output import first_of_each_period
from cwcli.channels.predicted_path import PredictedPaths, read_paths, write_paths
from cwcli.channels.published import REMOTE_PATH
from cwcli.logs.read.reader import Log
from cwcli.logs.write.annotate import annotate
from cwcli.prediction.paths import Paths
from cwcli.signals.columns import Strings
from tests.unit.logs_read.builders import T0_NS, small_log

MS = 1_000_000


def test_the_first_row_of_each_vehicle_in_each_period() -> None:
    """Two vehicles every 50 ms, one of them 20 ms later; periods of 200 ms from time 0."""
    stamp_ns = np.array([100, 120, 150, 170, 200, 220, 250, 270, 450, 470]) * MS
    codes = np.array([0, 1] * 5)
    assert first_of_each_period(codes, stamp_ns, 5.0).tolist() == [0, 1, 4, 5, 8, 9]


def test_rows_out_of_order_and_a_rate_above_the_paths_own() -> None:
    stamp_ns = np.array([250, 50, 100]) * MS
    codes = np.zeros(3, np.int32)
    assert first_of_each_period(codes, stamp_ns, 5.0).tolist() == [0, 1]
    assert first_of_each_period(codes, stamp_ns, 1e12).tolist() == [0, 1, 2]
    assert first_of_each_period(codes[:0], stamp_ns[:0], 5.0).tolist() == []


def paths_of(n: int) -> PredictedPaths:
    """Every 50 ms in turns of vehicle 7 and vehicle 8, each path of three points."""
    rows = np.arange(n, dtype=np.float64)[:, None] * 100 + np.arange(3)
    paths = Paths(np.arange(3) * 0.05, rows, rows + 0.1, rows + 0.2, rows + 0.3, np.ones((n, 3, 3)))
    stamps = T0_NS // (200 * MS) * 200 * MS + np.arange(n) * 50 * MS
    return PredictedPaths(Strings(np.arange(n, dtype=np.int32) % 2, ("7", "8")), stamps, stamps + 5, "cv", paths)


def test_a_file_gets_some_and_the_run_sees_all(tmp_path: Path) -> None:
    predicted = paths_of(20)
    channel = write_paths(REMOTE_PATH, predicted, rate_hz=5.0)
    (tmp_path / "in.mcap").write_bytes(small_log(4))
    with Log.open(tmp_path / "in.mcap") as log:
        run = log.with_channels([channel])
        assert len(read_paths(run.columns(REMOTE_PATH.topic))) == 20
        annotate(run, (), {}, tmp_path / "out.mcap")
    with Log.open(tmp_path / "out.mcap") as log:
        found = read_paths(log.columns(REMOTE_PATH.topic))
        assert log.faults.counts() == {}
    rows = [0, 1, 4, 5, 8, 9, 12, 13, 16, 17]
    assert found.stamp_ns.tolist() == predicted.stamp_ns[rows].tolist()
    assert found.log_time_ns.tolist() == predicted.log_time_ns[rows].tolist()
    assert [found.ids.values[code] for code in found.ids.codes] == ["7", "8"] * 5
    assert np.array_equal(found.paths.x_m, predicted.paths.x_m[rows])
    assert np.array_equal(found.paths.speed_mps, predicted.paths.speed_mps[rows])
