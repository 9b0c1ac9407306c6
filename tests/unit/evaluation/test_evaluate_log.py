"""The headline metrics of a log, by hand where the log is made by hand, else against the stages' own tables."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cwcli.channels.predicted_path import PredictedPaths, make_predicted_path_channel
from cwcli.channels.published import EGO_PATH, EGO_STATE
from cwcli.channels.vehicle_state import VehicleStates, make_vehicle_state_channel
from cwcli.errors import UsageError
from cwcli.evaluation.evaluate_log import evaluate_log
from cwcli.evaluation.target_truth import TargetTruthScores, format_score_record_json
from cwcli.logs.read.reader import Log
from cwcli.metrics.headline import METRICS
from cwcli.metrics.pooling import metric_rows_by_name
from cwcli.metrics.table import Table
from cwcli.pipeline.call import run_stage
from cwcli.prediction.paths import Paths
from cwcli.signals.columns import FloatArray, Int64Array, OutputChannel, Strings, repeat_string
from cwcli.stages import STAGES
from cwcli.stages.estimate import EstimateConfig
from cwcli.stages.observe import ObserveConfig
from cwcli.stages.predict import PredictConfig
from cwcli.stages.warn import WarnConfig
from cwcli.tracking.gospa import TargetMoments, score_tracks
from cwcli.tracking.tracker import TrackResult
from cwcli.warning.types import WarningConfig
from tests.unit.evaluation.small_logs import T0_NS, log_of, values
from tests.unit.stages.lateral_logs import drive, write_lane_log

ROOT = Path(__file__).parents[3]
STEP_NS = 50_000_000
N = 101
ATOL = 1e-9


def stamps() -> Int64Array:
    return T0_NS + STEP_NS * np.arange(N)


def straight(*, x0_m: float = 0.0, y_m: float = 0.0, speed_mps: float = 10.0) -> FloatArray:
    """Eastward at a steady 10 m/s, shape (N, 8)."""
    state = np.zeros((N, 8))
    state[:, 0] = x0_m + 10.0 * 0.05 * np.arange(N)
    state[:, 1], state[:, 2] = y_m, speed_mps
    return state


def states(topic: str, state: FloatArray, vehicle: str = "ego", *, variance: float = 0.25) -> OutputChannel:
    known = VehicleStates.from_ego_states(stamps(), state, np.tile(np.eye(8) * variance, (N, 1, 1)))
    return make_vehicle_state_channel(
        EGO_STATE._replace(topic=topic), replace(known, ids=repeat_string(vehicle, N)), None
    )


def paths(topic: str, state: FloatArray, *, speed_mps: float, vehicle: str = "ego") -> OutputChannel:
    """Straight on from each state at a given speed, with a variance of 1 m^2 per axis."""
    time_s = 0.05 * np.arange(51.0)
    x_m = state[:, :1] + speed_mps * time_s
    covariance = np.tile([1.0, 0.0, 1.0], (N, 51, 1))
    whole = Paths(time_s, x_m, np.repeat(state[:, 1:2], 51, 1), 0.0 * x_m, np.full_like(x_m, speed_mps), covariance)
    predicted = PredictedPaths(repeat_string(vehicle, N), stamps(), stamps(), "cv", whole)
    return make_predicted_path_channel(EGO_PATH._replace(topic=topic), predicted)


def test_errors_against_the_truth(tmp_path: Path) -> None:
    estimated = straight(x0_m=0.375, y_m=-0.5, speed_mps=10.125)  # numbers that are published exactly
    estimated[:, 3] = 2.0**-6
    estimated[:, 4], estimated[:, 5] = 0.25, -(2.0**-5)
    log = log_of(tmp_path / "a.mcap", [states(EGO_STATE.topic, estimated), states("/truth/ego", straight())])
    found = values(log)
    expected = {
        "ego.position_rmse_m": 0.625,
        "ego.position_max_m": 0.625,
        "ego.along_rmse_m": 0.375,
        "ego.cross_rmse_m": 0.5,
        "ego.speed_rmse_mps": 0.125,
        "ego.heading_rmse_deg": math.degrees(2.0**-6),
        "ego.yaw_rate_rmse_degps": math.degrees(2.0**-5),
        "ego.accel_rmse_mps2": 0.25,
        "ego.position_nees": 1.5625,  # 0.625^2 / 0.25
        "ego.position_inside_95_share": 1.0,
        "ego.sigma_median_m": 0.5,
    }
    assert {name: found[name] for name in expected} == pytest.approx(expected, abs=1e-8)
    assert not [name for name in values(log, truth="none") if "rmse" in name or "nees" in name]


def test_a_truth_topic_can_be_chosen_and_must_be_there(tmp_path: Path) -> None:
    channels = [
        states(EGO_STATE.topic, straight()),
        states("/truth/a", straight(y_m=1.0)),
        states("/truth/b", straight(y_m=2.0)),
    ]
    log = log_of(tmp_path / "a.mcap", channels)
    assert "ego.position_rmse_m" not in values(log)  # two of them
    assert evaluate_log(log).metadata["notes"] == (
        "two channels hold the truth: /truth/a (cwcli.v1.VehicleState) and /truth/b (cwcli.v1.VehicleState); "
        "none is used (choose one with --truth)"
    )
    assert values(log, truth="/truth/b")["ego.position_rmse_m"] == pytest.approx(2.0, abs=ATOL)
    with pytest.raises(UsageError):
        evaluate_log(log, truth="/truth/c")
    with pytest.raises(UsageError, match="neither a topic"):
        evaluate_log(log, truth="true")


def test_predictions_that_are_a_metre_per_second_too_fast(tmp_path: Path) -> None:
    own = straight()
    log = log_of(
        tmp_path / "a.mcap",
        [
            states(EGO_STATE.topic, own),
            states("/truth/ego", straight(x0_m=-0.375, y_m=0.5)),
            paths(EGO_PATH.topic, own, speed_mps=11.0),
        ],
    )
    rows = metric_rows_by_name(evaluate_log(log))
    for horizon_s in (0.5, 1.0, 1.5, 2.0, 2.5):
        row = rows[f"prediction.ego.fde_{horizon_s:.1f}s_m"]
        assert row.value == pytest.approx(horizon_s, abs=1e-6)
        assert row.n == N - round(horizon_s / 0.05)
        # the mean of 0.05, 0.10, ... up to the horizon
        assert rows[f"prediction.ego.ade_{horizon_s:.1f}s_m"].value == pytest.approx(0.5 * (horizon_s + 0.05), abs=1e-6)
        # h^2 is within -2 ln 0.1 = 4.605 up to 2.1 s
        assert rows[f"prediction.ego.inside_90_{horizon_s:.1f}s_share"].value == (horizon_s < 2.1)
        truth = rows[f"prediction.ego.truth_fde_{horizon_s:.1f}s_m"]
        assert truth.value == pytest.approx(math.hypot(0.375 + horizon_s, 0.5), abs=1e-6)
    assert rows["prediction.ego.cv.fde_2.5s_m"].value == pytest.approx(0.0, abs=1e-6)
    assert rows["prediction.ego.cv.inside_90_2.5s_share"].value == 1.0


def annotated(name: str, warning: WarnConfig = WarnConfig()) -> tuple[Log, dict[str, Table]]:  # noqa: B008 - frozen
    log = Log.open(ROOT / "sample_logs" / f"{name}.mcap")
    tables: dict[str, Table] = {}
    for stage, config in (("estimate", EstimateConfig()), ("predict", PredictConfig()), ("warn", warning)):
        result = run_stage(STAGES[stage], log, config)
        tables |= result.tables
        log = log.with_channels(result.channels, {f"cwcli.run.{result.stage}": result.metadata})
    return log, tables


@pytest.fixture(scope="module")
def intersection() -> tuple[Log, dict[str, Table]]:
    return annotated("intersection")


def test_estimation_agrees_with_the_stages_own_table(intersection: tuple[Log, dict[str, Table]]) -> None:
    log, tables = intersection
    found = values(log)
    own = {
        (r["vehicle"], r["source"], r["quantity"], r["metric"]): r["value"] for r in tables["estimate"].rows_as_dicts()
    }
    sigma = own["ego", "/truth/ego", "position", "estimated_error_sigma"]
    assert found["ego.position_rmse_m"] == pytest.approx(math.sqrt(2.0) * sigma, rel=1e-12)  # the table's is per axis
    for name, quantity in (("speed_rmse_mps", "speed"), ("heading_rmse_deg", "heading"), ("accel_rmse_mps2", "accel")):
        assert found[f"ego.{name}"] == pytest.approx(own["ego", "/truth/ego", quantity, "estimated_error_sigma"])
    assert found["ego.position_nees"] == pytest.approx(own["ego", "/truth/ego", "position", "nees_mean"])
    assert found["ego.position_nis"] == pytest.approx(own["ego", "/gps/fix", "position", "nis_per_dof"])
    inside = [
        own["ego", source, quantity, "nis_lower"] <= value <= own["ego", source, quantity, "nis_upper"]
        for (vehicle, source, quantity, metric), value in own.items()
        if vehicle == "ego" and metric == "nis_per_dof"
    ]
    assert found["ego.nis_inside_share"] == pytest.approx(np.mean(inside))
    # the sensor's noise is 0.6 m per axis; the residuals are almost all of it
    assert found["ego.fix_residual_rmse_m"] == pytest.approx(math.sqrt(2.0) * 0.6, rel=0.1)


def test_predictions_agree_with_the_stages_own_table(intersection: tuple[Log, dict[str, Table]]) -> None:
    log, tables = intersection
    found = values(log)
    for row in tables["prediction"].rows_as_dicts():
        who = "ego" if row["vehicle"] == "ego" else "remote"
        at = f"{row['horizon_s']:.1f}s"
        assert found[f"prediction.{who}.{row['model']}.fde_{at}_m"] == pytest.approx(row["mean_m"])
        if row["model"] == "auto":  # that is what was published
            assert found[f"prediction.{who}.fde_{at}_m"] == pytest.approx(row["mean_m"])
            assert found[f"prediction.{who}.inside_90_{at}_share"] == pytest.approx(row["inside_90"])


def test_tables_of_the_stages_save_work_and_change_nothing(intersection: tuple[Log, dict[str, Table]]) -> None:
    log, tables = intersection
    with_tables, without = evaluate_log(log, tables=tables).rows_as_dicts(), evaluate_log(log).rows_as_dicts()
    assert [row["metric"] for row in with_tables] == [row["metric"] for row in without]
    for one, other in zip(with_tables, without, strict=True):
        assert one["value"] == pytest.approx(other["value"], rel=1e-12, nan_ok=True)


@pytest.mark.parametrize(("name", "rule"), [("intersection", "cwcli"), ("rear-end", "ttc"), ("rear-end", "song2016")])
def test_warnings_agree_with_the_stages_own_scores(name: str, rule: str) -> None:
    log, tables = annotated(name, WarnConfig(rule=WarningConfig(rule=rule)))
    found = values(log)
    (own,) = tables["scores"].rows_as_dicts()
    decided = own["n_true"] + own["n_late"] + own["n_false"]
    warned = own["n_conflicts_warned"] + own["n_conflicts_late"]

    def share(part: float, whole: float) -> float:
        return part / whole if whole else math.nan

    expected = {
        "warnings.count": own["n_events"],
        "warnings.conflicts_count": own["n_conflicts"],
        "warnings.missed_count": own["n_conflicts_missed"],
        "warnings.false_count": own["n_false"],
        "warnings.undecided_count": own["n_undecided"],
        "warnings.withheld_count": own["n_withheld"],
        "warnings.precision": share(own["n_true"] + own["n_late"], decided),
        "warnings.recall": share(warned, own["n_conflicts"]),
        "warnings.timeliness": share(own["n_conflicts_warned"], warned),
        "warnings.lead_time_mean_s": own["lead_time_mean_s"],
        "warnings.false_alarms_per_hour": own["n_false"] / own["host_hours"],
        "warnings.raised_per_hour": own["n_events"] / own["host_hours"],
    }
    assert {key: found[key] for key in expected} == pytest.approx(expected, nan_ok=True)
    assert own["n_conflicts"] == 1


def test_warnings_are_counted_by_the_way_driven() -> None:
    """The host of the scenario drives straight on at 9 m/s for 10 s and is warned once: 1 / 0.09 km."""
    found = values(annotated("intersection")[0])
    assert found["ego.distance_km"] == pytest.approx(0.090, abs=0.001)
    assert found["warnings.raised_per_100km"] == pytest.approx(100.0 / 0.090, rel=0.01)
    assert found["warnings.raised_per_hour"] == pytest.approx(3600.0 / 10.0, rel=0.01)


def test_several_rules_are_judged_by_themselves() -> None:
    log, _ = annotated("rear-end", WarnConfig(rules=("ttc", "cwcli")))
    found = values(log)
    alone = values(annotated("rear-end")[0])
    assert found["warnings.cwcli.lead_time_mean_s"] == pytest.approx(alone["warnings.lead_time_mean_s"])
    assert found["warnings.lead_time_mean_s"] == found["warnings.ttc.lead_time_mean_s"]
    assert "warnings.cwcli.recall" not in alone


def test_lateral_motion_agrees_with_the_stages_own_table(tmp_path: Path) -> None:
    log = Log.open(write_lane_log(tmp_path / "lane.mcap", drive()))
    result = run_stage(STAGES["observe"], log, ObserveConfig())
    found = values(log.with_channels(result.channels, {"cwcli.run.observe": result.metadata}))
    own = {row["state"]: row["rms"] for row in result.tables["observer_errors"].rows_as_dicts()}
    assert found["observer.lateral_speed_rmse_mps"] == pytest.approx(own["lateral_speed_mps"])
    assert found["observer.yaw_rate_rmse_degps"] == pytest.approx(math.degrees(own["yaw_rate_radps"]))
    assert found["observer.heading_deviation_rmse_deg"] == pytest.approx(math.degrees(own["heading_deviation_rad"]))


def test_tracking_scores_come_from_the_record(tmp_path: Path) -> None:
    at = np.array([0, 1, 2]) * 10**8 + T0_NS
    ids = np.zeros(3, np.int64)
    truth = TargetMoments(at, ids, np.zeros((3, 4)))
    tracks = TargetMoments(at[:2], ids[:2], np.array([[3.0, 4.0, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0]]))
    scores = score_tracks(truth, tracks, cutoff_m=10.0)
    empty = TrackResult((), counts={}, consistency={}, frame="map", sources=(), state_names=())
    record = {"scores": format_score_record_json(empty, TargetTruthScores("/truth/target", ("a",), scores))}
    found = values(log_of(tmp_path / "a.mcap", [], {"cwcli.run.track": record}))
    # errors of 5 m and 0, then a miss, which costs 10 / sqrt(2)
    assert found["tracking.gospa_m"] == pytest.approx((5.0 + 0.0 + 10.0 / math.sqrt(2.0)) / 3.0)
    assert found["tracking.position_rmse_m"] == pytest.approx(math.sqrt(25.0 / 2.0))
    assert found["tracking.velocity_rmse_mps"] == pytest.approx(1.0)
    assert found["tracking.tracked_share"] == pytest.approx(2.0 / 3.0)
    assert found["tracking.targets_count"] == found["tracking.switch_count"] == 0.0


def test_counts_of_the_data(tmp_path: Path) -> None:
    fix = {
        "topic": "/gps/fix",
        "role": "ego_position",
        "read": 90,
        "used": 80,
        "rejected": {"x": 6, "y": 4},
        "repaired": {},
    }
    imu = {"topic": "/imu", "role": "imu", "read": 10, "used": 10, "rejected": {}, "repaired": {"z": 3}}
    own = {"topic": "/cwcli/ego/state", "role": "ego_state", "read": 500, "used": 500, "rejected": {}, "repaired": {}}
    records = {
        "cwcli.run.estimate": {"counts": json.dumps([fix, imu])},
        "cwcli.run.track": {"counts": json.dumps([fix, own])},
    }
    found = values(log_of(tmp_path / "a.mcap", [], records))
    assert found == {
        "data.duration_s": 5.0,
        "data.read_count": 100.0,
        "data.used_count": 90.0,
        "data.rejected_count": 10.0,
        "data.repaired_count": 3.0,
        "data.rejected_share": pytest.approx(0.1),
        "data.faults_count": 0.0,
        "doubts.count": 1.0,  # more than 5 % are rejected
    }


@pytest.mark.parametrize(
    "text", ["", "{", "[1, 2]", '{"sources": 5, "rule": [], "rules": {}}', '[{"vehicle": "ego"}]', "[" * 5000]
)
def test_records_of_others_are_never_trusted(tmp_path: Path, text: str) -> None:
    entries = dict.fromkeys(("configuration", "sources", "counts", "scores"), text)
    records = {f"cwcli.run.{stage}": entries for stage in ("estimate", "predict", "warn", "track", "x")}
    own = straight()
    channels = [states(EGO_STATE.topic, own), paths(EGO_PATH.topic, own, speed_mps=10.0), states("/truth/ego", own)]
    empty = {name: Strings(np.zeros(0, np.int32), ()) for name in ("rule", "host_id", "other_id", "message")}
    numbers = {name: np.zeros(0, np.int64) for name in ("stamp_ns", "event_id", "state")}
    channels.append(OutputChannel("/cwcli/warnings", "cwcli.v1.Warning", np.zeros(0, np.int64), {**numbers, **empty}))
    channels.append(states("/cwcli/remote/state", straight(y_m=3.0), "other"))
    found = values(log_of(tmp_path / "a.mcap", channels, records))
    assert found["ego.position_rmse_m"] == pytest.approx(0.0, abs=ATOL)
    assert found["warnings.count"] == 0.0


def test_a_log_without_a_stage_has_the_data_metrics_only(tmp_path: Path) -> None:
    table = evaluate_log(log_of(tmp_path / "a.mcap", []))
    assert {row["stage"] for row in table.rows_as_dicts()} == {"data"}
    assert table.metadata == {"truth": "auto"}


def test_every_metric_of_a_log_is_documented() -> None:
    page = (ROOT / "docs" / "evaluation.md").read_text(encoding="utf-8")
    for metric in METRICS:
        assert f"`{metric.name}`" in page, metric.name
