"""Headline metrics of lanes, against labels and a rendered truth."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cwcli.channels.published import LANES
from cwcli.signals.columns import OutputChannel
from tests.unit.evaluation.small_logs import T0_NS, log_of, values


def lanes_channel(*, right_found: list[bool], width_m: list[float]) -> OutputChannel:
    """Upright boundaries at columns 100 and 200 of an image of 320 x 240, which was searched at half its size."""
    n = len(right_found)
    stamp_ns = T0_NS + 10**9 * np.arange(n)
    fields: dict[str, Any] = {
        "stamp_ns": stamp_ns,
        "lane_width_m": np.array(width_m),
        "preview_distance_m": np.full(n, 33.5),
        "lateral_deviation_m": np.linspace(0.1, 0.3, n),
        "heading_deviation_rad": np.full(n, 0.02),
        "curvature_1pm": np.full(n, -0.001),
    }
    sizes = {"search_width_px": 160, "search_height_px": 120, "image_width_px": 320, "image_height_px": 240}
    fields |= {name: np.full(n, size) for name, size in sizes.items()}
    fields |= {name: np.full(n, math.nan) for name in ("horizon_px", "top_px", "road_centre_px", "road_focal_px")}
    # the searched image's column x, counted from 1, is the camera's u = 2 (x - 0.5) - 0.5, counted from 0
    for side, u_px, is_found in (("left", 100.0, [True] * n), ("right", 200.0, right_found)):
        fields |= {
            f"{side}.a": np.zeros(n),
            f"{side}.b": np.zeros(n),
            f"{side}.c": np.full(n, (u_px + 0.5) / 2.0 + 0.5),
        }
        fields[f"{side}.found"] = np.array(is_found)
        fields |= {f"{side}.{name}": np.full(n, math.nan) for name in ("far_px", "near", "bend_px2")}
    for side, line in (("left", (1.75, 0.01, 0.002)), ("right", (-1.75, 0.0, 0.0))):
        for name, value in zip(("lateral_m", "slope", "ground_curvature_1pm"), line, strict=True):
            fields[f"{side}.{name}"] = np.full(n, value)
    return OutputChannel(LANES.topic, "cwcli.v1.Lanes", stamp_ns, fields)


def test_lanes_against_labels_and_a_rendered_truth(tmp_path: Path) -> None:
    rows_px = [120, 160, 200, 239]
    label = {"h_samples": rows_px, "lanes": [[20] * 4, [100] * 4, [205, 205, 205, -2], [310] * 4]}
    label |= {"ground_x_m": [5.0, 10.0, 20.0, 30.0], "ground_left_y_m": [1.75] * 4, "ground_right_y_m": [-1.75] * 4}
    labels = [
        (T0_NS + 10**9 * k, {"timestamp": {"sec": (T0_NS + 10**9 * k) // 10**9, "nsec": 0}, **label}) for k in range(2)
    ]
    own = lanes_channel(right_found=[True, False], width_m=[3.5, 3.7])
    straight = dict.fromkeys(("lateral_deviation_m", "heading_deviation_rad", "curvature_1pm"), np.zeros(2))
    truth = OutputChannel("/truth/boundaries", "cwcli.v1.Lanes", own.log_time_ns, {**own.fields, **straight})
    found = values(log_of(tmp_path / "a.mcap", [own, truth], **{"/truth/lanes": labels}))
    assert found["lanes.found_share"] == 0.5
    assert (found["lanes.left_found_share"], found["lanes.right_found_share"]) == (1.0, 0.5)
    assert found["lanes.width_std_m"] == pytest.approx(0.1)
    assert found["lanes.width_max_jump_m"] == pytest.approx(0.2)
    # the lines beside the camera are those at 100 and 205; of the second one row is not labelled, but it was found
    # there, so 3 of 4 rows fit, which is no match; in the second frame nothing was found on the right
    assert found["lanes.truth_accuracy"] == pytest.approx(((1.0 + 0.75) / 2.0 + (1.0 + 0.0) / 2.0) / 2.0)
    assert found["lanes.truth_missed_share"] == pytest.approx(0.5)
    assert found["lanes.truth_false_share"] == pytest.approx((0.5 + 0.0) / 2.0)
    assert found["lanes.lateral_deviation_rmse_m"] == pytest.approx(math.sqrt((0.1**2 + 0.3**2) / 2.0))
    assert found["lanes.heading_deviation_rmse_deg"] == pytest.approx(math.degrees(0.02))
    assert found["lanes.curvature_rmse_1pm"] == pytest.approx(0.001)
    # left in both frames: the circle that 0.01 x + 0.002 x^2 / 2 touches beside the truth, whose centre is 5 m behind
    # and 500 m aside; right in the first one only, and exact
    radius_m = 500.0 * 1.0001**1.5
    for distance_m, error_m in ((5, 0.075), (10, 0.2), (20, 0.6), (30, 1.2)):
        circle_m = radius_m / math.sqrt(1.0001) - math.sqrt(radius_m**2 - (distance_m + 5.0 * 1.0001) ** 2)
        assert circle_m == pytest.approx(error_m, rel=2e-3)
        expected = pytest.approx(circle_m * math.sqrt(2.0 / 3.0))
        assert found[f"lanes.lateral_{distance_m}m_rmse_m"] == expected


@pytest.mark.parametrize(
    ("top_px", "horizon_px", "accuracy"),
    [
        *[(62.0, math.nan, 1.0), (42.0, math.nan, 5.0 / 8.0), (10.0, math.nan, 4.0 / 8.0)],
        *[(math.nan, math.nan, 6.0 / 8.0), (math.nan, 60.0, 1.0), (math.nan, 10.0, 6.0 / 8.0)],
    ],
)
def test_a_boundary_is_judged_as_far_as_it_is_drawn(
    tmp_path: Path, top_px: float, horizon_px: float, accuracy: float
) -> None:
    """Row 62 of 120 is row 124.5 of 240; both labels end in row 130. In logs of older versions, which tell no top, a
    boundary ends in row 90 (3/8), or 3 % of the height below the horizon if that is lower."""
    rows_px = [60, 85, 100, 120, 130, 160, 200, 239]
    label = {"h_samples": rows_px, "lanes": [[*[-2] * 4, *[100] * 4], [*[-2] * 4, *[200] * 4]]}
    message = (T0_NS, {"timestamp": {"sec": T0_NS // 10**9, "nsec": 0}, **label})
    own = lanes_channel(right_found=[True], width_m=[3.5])
    told = {"top_px": np.array([top_px]), "horizon_px": np.array([horizon_px])}
    channel = replace(own, fields={**own.fields, **told})
    found = values(log_of(tmp_path / "a.mcap", [channel], **{"/truth/lanes": [message]}))
    assert found["lanes.truth_accuracy"] == pytest.approx(accuracy)


def test_a_boundary_is_judged_as_the_road_that_is_drawn(tmp_path: Path) -> None:
    """x = 50 + 0.5 h + 200 / h in the searched image, h rows below its row 20; the parabola is elsewhere."""
    rows_px = np.array([59.5, 79.5, 119.5, 199.5])  # rows 29.5, 39.5, 59.5 and 99.5 of the searched image
    h = (rows_px + 0.5) / 2.0 - 0.5 - 20.0
    u_px = 2.0 * (50.0 + 0.5 * h + 200.0 / h - 0.5) - 0.5
    label = {"h_samples": rows_px.tolist(), "lanes": [u_px.tolist(), (u_px + 100.0).tolist()]}
    message = (T0_NS, {"timestamp": {"sec": T0_NS // 10**9, "nsec": 0}, **label})
    own = lanes_channel(right_found=[True], width_m=[3.5])
    roads = {"left": (50.0, 0.5, 200.0), "right": (100.0, 0.5, 200.0)}
    told = {
        f"{side}.{name}": np.array([value])
        for side, road in roads.items()
        for name, value in zip(("far_px", "near", "bend_px2"), road, strict=True)
    }
    channel = replace(own, fields={**own.fields, **told, "horizon_px": np.array([20.0]), "top_px": np.array([25.0])})
    found = values(log_of(tmp_path / "a.mcap", [channel], **{"/truth/lanes": [message]}))
    assert found["lanes.truth_accuracy"] == pytest.approx(1.0)
