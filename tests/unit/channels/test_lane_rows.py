"""Lanes as read from a channel: what is no number there."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cwcli.channels.lanes import read_lanes
from cwcli.channels.published import LANES
from cwcli.signals.columns import Columns


@pytest.mark.parametrize("value", [math.inf, -math.inf, math.nan])
def test_an_infinite_change_of_curvature_is_none(value: float) -> None:
    n = 2
    road = {"far_px": 320.0, "near": -1.4, "bend_px2": 100.0, "spiral_px3": value, "found": 1.0}
    fields = {f"{side}.{name}": np.full(n, each) for side in ("left", "right") for name, each in road.items()}
    fields["curvature_change_1pm2"] = np.array([value, 0.001])
    times = np.arange(n, dtype=np.int64)
    rows = read_lanes(Columns(LANES.topic, LANES.schema, "protobuf", times, times, times.astype(np.uint32), fields))
    assert rows.curvature_change_1pm2.tolist() == [0.0, 0.001]
    np.testing.assert_array_equal(rows.image_boundaries.roads[..., 3], np.zeros((n, 2)))
