"""The stage `predict-lane`: paths in the map, in `odom` and in the car's axes, against what the simulated car did."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cwcli.channels.predicted_path import PredictedPaths, read_predicted_paths
from cwcli.dynamics.vehicle import load_vehicle
from cwcli.errors import MissingSignalError, UsageError
from cwcli.logs.read.reader import Log
from cwcli.pipeline.call import run_stage
from cwcli.pipeline.result import StageResult
from cwcli.prediction.lateral import transform_paths_to_body
from cwcli.signals.columns import Columns, OutputChannel
from cwcli.simulation.lane_camera import LaneSensorNoise
from cwcli.stages import STAGES
from cwcli.stages.observe import ObserveConfig, observe
from cwcli.stages.predict_lane import PredictLaneConfig, predict_lane
from tests.unit.stages.lateral_logs import EGO_TRUTH, START_NS, TRUTH, drive, ego_state_channel, write_lane_log

DRIVE = drive(seconds=30.0)
TWO_SECONDS = PredictLaneConfig(horizon_s=2.0)
TOPIC = "/cwcli/observer/path"


@pytest.fixture(scope="module")
def lanes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_lane_log(tmp_path_factory.mktemp("lanes") / "lanes.mcap", DRIVE)


def observed(log: Log) -> Log:
    result = observe(log, ObserveConfig(vehicle=load_vehicle()))
    return log.with_channels(result.channels, {"cwcli.run.observe": result.metadata})


def run(
    path: Path, config: PredictLaneConfig = TWO_SECONDS, *more: OutputChannel
) -> tuple[StageResult, PredictedPaths, Columns]:
    with Log.open(path) as log:
        whole = observed(log.with_channels(more) if more else log)
        result = run_stage(STAGES["predict-lane"], whole, config)
        columns = whole.with_channels(result.channels).columns(TOPIC)
    return result, read_predicted_paths(columns), columns


def errors(result: StageResult, model: str, horizon_s: float = 2.0) -> dict[str, Any]:
    rows = result.tables["observer_prediction"].rows_as_dicts()
    return next(row for row in rows if row["model"] == model and row["horizon_s"] == horizon_s)


def frames_of(columns: Columns) -> set[str]:
    field = columns.fields["frame_id"]
    return {field.values[code] for code in field.codes}  # type: ignore[union-attr]


def test_in_the_map_when_the_log_holds_the_ego_state(lanes: Path) -> None:
    result, predicted, columns = run(lanes, TWO_SECONDS, ego_state_channel(DRIVE))
    assert frames_of(columns) == {"map"}
    truth = DRIVE.truth
    index = np.round((predicted.stamp_ns - START_NS) / 1e7).astype(int)
    np.testing.assert_allclose(predicted.paths.x_m[:, 0], truth.x_m[index, 0], atol=0.01)
    np.testing.assert_allclose(predicted.paths.y_m[:, 0], truth.y_m[index, 0], atol=0.01)
    # The axis of the car, not its direction of motion: they differ by v_y / v, here up to 0.01 rad.
    np.testing.assert_allclose(predicted.paths.heading_rad[:, 0], truth.yaw_rad[index, 0], atol=0.003)
    later = index + 200
    known = later < len(truth.time_s)
    gone = np.hypot(
        predicted.paths.x_m[known, -1] - truth.x_m[later[known], 0],
        predicted.paths.y_m[known, -1] - truth.y_m[later[known], 0],
    )
    assert np.median(gone) < 0.35
    assert predicted.model == "lateral"
    assert not any("odom" in note for note in result.summary.notes)


def test_in_odom_without_an_ego_state_and_the_same_way(lanes: Path) -> None:
    result, predicted, columns = run(lanes)
    assert frames_of(columns) == {"odom"}
    assert any("odom" in note for note in result.summary.notes)
    first = (predicted.paths.x_m[0, 0], predicted.paths.y_m[0, 0], predicted.paths.heading_rad[0, 0])
    assert first == (0.0, 0.0, 0.0)
    _, in_map, _ = run(lanes, TWO_SECONDS, ego_state_channel(DRIVE))
    one, other = transform_paths_to_body(predicted.paths), transform_paths_to_body(in_map.paths)
    np.testing.assert_allclose(one.x_m, other.x_m, atol=1e-6)
    np.testing.assert_allclose(one.y_m, other.y_m, atol=1e-6)
    np.testing.assert_allclose(one.position_covariance_m2, other.position_covariance_m2, atol=1e-9)


def test_the_table_tells_the_errors_against_the_truth(lanes: Path) -> None:
    result, _, _ = run(lanes)
    row = errors(result, "lateral")
    assert row["against"] == EGO_TRUTH
    assert row["median_m"] < 0.35
    assert 0.85 <= row["inside_band_90"] <= 0.97
    assert row["mean_m"] < errors(result, "cv")["mean_m"]
    assert errors(result, "lateral-zhang2011")["n"] == row["n"]


def test_without_a_truth_the_own_track_is_the_reference(tmp_path: Path) -> None:
    path = write_lane_log(tmp_path / "l.mcap", DRIVE, without=(TRUTH, EGO_TRUTH))
    alone, _, _ = run(path)
    assert errors(alone, "lateral")["against"] == "the observed motion"
    with_state, _, _ = run(path, TWO_SECONDS, ego_state_channel(DRIVE))
    assert errors(with_state, "lateral")["against"] == "the ego state"
    assert errors(with_state, "lateral")["median_m"] < 0.35


def test_the_papers_path_keeps_speed_and_yaw_rate(lanes: Path) -> None:
    config = PredictLaneConfig(model="lateral-zhang2011", horizon_s=2.0)
    _, predicted, _ = run(lanes, config)
    turned = np.diff(predicted.paths.heading_rad, axis=1)
    np.testing.assert_allclose(turned, turned[:, :1] * np.ones(40), atol=1e-9)
    assert predicted.model == "lateral-zhang2011"


def test_frames_without_a_state_have_no_path_and_are_counted(tmp_path: Path) -> None:
    path = write_lane_log(
        tmp_path / "l.mcap", drive(noise=LaneSensorNoise(blind_s=((4.0, 9.0),))), without=("/imu/data",)
    )
    result, predicted, _ = run(path)
    (count,) = result.summary.inputs
    assert count.read == 121
    assert count.used == len(predicted) == 121 - count.set_aside["no state"]
    assert 25 <= count.set_aside["no state"] <= 31
    assert np.isfinite(predicted.paths.x_m).all()


def test_without_an_observer_channel_it_names_the_command(lanes: Path) -> None:
    with Log.open(lanes) as log, pytest.raises(MissingSignalError, match="observed lateral motion") as caught:
        predict_lane(log, TWO_SECONDS)
    assert "cwcli observe" in caught.value.hint


def test_no_state_at_all_is_an_error(tmp_path: Path) -> None:
    blind = drive(seconds=3.0, noise=LaneSensorNoise(blind_s=((-1.0, 9.0),)))
    with pytest.raises(MissingSignalError, match="no frame of the observer has a state"):
        run(write_lane_log(tmp_path / "l.mcap", blind))


def test_a_model_of_the_states_does_not_start_from_the_observer() -> None:
    with pytest.raises(UsageError, match="does not start from the observer"):
        PredictLaneConfig(model="ctrv")  # type: ignore[arg-type]
