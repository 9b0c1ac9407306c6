"""Pandas takes the tables of a result."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import cwcli

ROOT = Path(__file__).parents[2]


def test_a_table_becomes_a_data_frame_with_the_same_names() -> None:
    result = cwcli.open(ROOT / "sample_logs" / "intersection.mcap").run("estimate", "predict", "warn")
    frame = result.warnings.to_pandas()
    assert list(frame.columns) == result.warnings.column_names
    assert frame["stamp_ns"].dtype == np.int64
    assert set(frame["rule"]) == {"cwcli"}
    assert len(result.ego.to_pandas()) == result.ego.num_rows
