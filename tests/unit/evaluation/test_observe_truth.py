"""The observed place in the lane against a truth that tells the lane at many distances, or at one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cwcli.channels.lateral_state import ObservedDrive, make_observer_channel, read_observed_drive
from cwcli.channels.published import OBSERVER
from cwcli.dynamics.samples import FrameStatus, LateralTrack, count_frame_statuses
from cwcli.evaluation.observe import build_error_statistics_table
from cwcli.metrics.table import Table
from cwcli.signals.columns import FloatArray, OutputChannel
from tests.unit.evaluation.small_logs import T0_NS, log_of, values

TRUTH = "/truth/lateral"
N = 51
STAMP_NS = T0_NS + 100_000_000 * np.arange(N)
RADIUS_M = 200.0
AHEAD_M = np.arange(1.0, 68.0) / 2.0
OFF_M, OFF_RAD = 0.05, 0.002


def place(x_m: FloatArray) -> FloatArray:
    """y_L and e_L of a right bend of 200 m round which the car goes in the middle, shape (n, 2)."""
    angle = np.arcsin(x_m / RADIUS_M)
    return np.column_stack([RADIUS_M * (1.0 - np.cos(angle)), angle])


def observed(preview_m: FloatArray) -> OutputChannel:
    """An observer that errs by `OFF_M` and `OFF_RAD`, five seconds at 10 Hz."""
    status = np.full(N, FrameStatus.OBSERVED, np.int8)
    status[0] = FrameStatus.STARTED
    state = np.column_stack([np.zeros((N, 2)), place(preview_m) + np.array([OFF_M, OFF_RAD])])
    level = np.full(N, 1.0)
    track = LateralTrack(
        stamp_ns=STAMP_NS,
        state=state,
        preview_m=preview_m,
        covariance=np.tile(np.eye(4), (N, 1, 1)),
        speed_mps=12.0 * level,
        steer_rad=0.0 * level,
        curvature_1pm=level / RADIUS_M,
        mass_kg=level,
        mass_sigma_kg=np.nan * level,
        status=status,
        counts=count_frame_statuses(status),
    )
    return make_observer_channel(ObservedDrive(STAMP_NS, track))


def truth(*, with_ahead: bool, ends_m: float = np.inf) -> OutputChannel:
    """The truth at 33.5 m, and the lane ahead; it has turned away at `ends_m`."""
    own = np.tile(place(np.array([33.5])), (N, 1))
    zero = np.zeros(N)
    fields = {
        "stamp_ns": STAMP_NS,
        "lateral_speed_mps": zero,
        "yaw_rate_radps": zero,
        "lateral_deviation_m": own[:, 0],
        "heading_deviation_rad": own[:, 1],
        "preview_distance_m": zero + 33.5,
    }
    if with_ahead:
        lane = np.where((ends_m > AHEAD_M)[:, None], place(AHEAD_M), np.nan)
        fields["ahead_m"] = np.tile(AHEAD_M, (N, 1))
        fields["ahead_lateral_deviation_m"] = np.tile(lane[:, 0], (N, 1))
        fields["ahead_heading_deviation_rad"] = np.tile(lane[:, 1], (N, 1))
    return OutputChannel(TRUTH, "cwcli.v1.LateralState", STAMP_NS, fields)


def errors(tmp_path: Path, *channels: OutputChannel) -> tuple[Table, dict[str, float]]:
    log = log_of(tmp_path / "a.mcap", list(channels))
    columns = log.load_topics({OBSERVER.topic: None, TRUTH: None})
    return build_error_statistics_table(read_observed_drive(columns[OBSERVER.topic]).track, columns[TRUTH]), values(log)


def of_place(table: Table) -> list[dict[str, float]]:
    rows = {row["state"]: row for row in table.rows_as_dicts()}
    return [rows["lateral_deviation_m"], rows["heading_deviation_rad"]]


def test_a_slow_cars_preview_point_is_judged_where_it_is(tmp_path: Path) -> None:
    preview_m = np.linspace(11.1, 33.5, N)  # between the distances that the truth tells, and at its own
    table, found = errors(tmp_path, observed(preview_m), truth(with_ahead=True))
    y, e = of_place(table)
    assert (y["n"], e["n"], y["left_out"], e["left_out"]) == (31, 31, 0, 0)  # the first 2 s are not counted
    # a chord of 0.5 m of a bend of 200 m is off by 0.5^2 / 8 / 200 = 0.16 mm
    assert y["rms"] == pytest.approx(OFF_M, abs=2e-4)
    assert e["rms"] == pytest.approx(OFF_RAD, abs=1e-6)
    assert found["observer.lateral_deviation_rmse_m"] == pytest.approx(OFF_M, abs=2e-4)
    assert found["observer.heading_deviation_rmse_deg"] == pytest.approx(np.degrees(OFF_RAD), abs=1e-4)


def test_a_truth_of_one_point_judges_that_alone_and_what_is_left_out_is_counted(tmp_path: Path) -> None:
    preview_m = np.full(N, 33.5)
    preview_m[40:] = 12.0
    y, e = of_place(errors(tmp_path, observed(preview_m), truth(with_ahead=False))[0])
    assert (y["n"], e["n"], y["left_out"], e["left_out"]) == (20, 20, 11, 11)
    assert y["rms"] == pytest.approx(OFF_M)


def test_a_lane_that_has_turned_away_is_left_out_and_counted(tmp_path: Path) -> None:
    preview_m = np.full(N, 12.0)
    preview_m[45:] = 20.0
    y, e = of_place(errors(tmp_path, observed(preview_m), truth(with_ahead=True, ends_m=18.0))[0])
    assert (y["n"], e["n"], y["left_out"], e["left_out"]) == (25, 25, 6, 6)
