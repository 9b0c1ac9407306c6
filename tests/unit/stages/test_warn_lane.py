"""Lane departure: observe, predict-lane, warn-lane on logs of a simulated car; and several rules in one channel."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cwcli.dynamics.vehicle import load_vehicle
from cwcli.errors import UsageError
from cwcli.logs.read.reader import Log
from cwcli.logs.write.annotate import annotate_log
from cwcli.pipeline.result import StageResult
from cwcli.signals.columns import Strings
from cwcli.simulation.lane_camera import LaneSensorNoise
from cwcli.simulation.lane_drive import Road
from cwcli.stages.estimate import EstimateConfig, estimate
from cwcli.stages.observe import ObserveConfig, observe
from cwcli.stages.predict import PredictConfig, predict
from cwcli.stages.predict_lane import PredictLaneConfig, predict_lane
from cwcli.stages.warn import WarnConfig, warn
from cwcli.stages.warn_lane import WarnLaneConfig, warn_lane
from cwcli.warning.lane_departure import LaneDepartureConfig, earliest_warning_line_m
from tests.unit.stages.lateral_logs import START_NS, LaneDrive, drive, lanes_channel, write_lane_log

SAMPLES = Path(__file__).parents[3] / "sample_logs"


def predicted(log: Log) -> Log:
    made = observe(log, ObserveConfig(vehicle=load_vehicle()))
    log = log.with_channels(made.channels, {"cwcli.run.observe": made.metadata})
    return log.with_channels(predict_lane(log, PredictLaneConfig(horizon_s=2.0)).channels)


def run(path: Path, config: WarnLaneConfig | None = None) -> StageResult:
    with Log.open(path) as log:
        return warn_lane(predicted(log), config or WarnLaneConfig())


def counts(result: StageResult) -> dict[str, int]:
    section = next(each for each in result.summary.sections if each.key == "lane_frames")
    return {str(name): int(value) for name, value in section.rows}  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def intersection(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bundled log with states and paths."""
    target = tmp_path_factory.mktemp("intersection") / "predicted.mcap"
    with Log.open(SAMPLES / "intersection.mcap") as log:
        states = estimate(log, EstimateConfig())
        paths = predict(log.with_channels(states.channels), PredictConfig())
        annotate_log(log, [*states.channels, *paths.channels], {}, target)
    return target


@pytest.fixture(scope="module")
def drifting() -> LaneDrive:
    return drive(seconds=14.0, drift_mps=0.5, road=Road())


@pytest.mark.parametrize("rate_mps", [0.5, -0.5])
def test_a_drift_is_warned_of_between_isos_lines(tmp_path: Path, rate_mps: float) -> None:
    driven = drive(seconds=14.0, drift_mps=rate_mps, road=Road())
    result = run(write_lane_log(tmp_path / "l.mcap", driven))
    event = result.tables["lane_departures"].rows_as_dicts()[0]
    assert event["side"] == ("left" if rate_mps > 0.0 else "right")
    at = (event["raised_stamp_ns"] - START_NS) // 10_000_000
    gap_m = (driven.truth.left_gap_m if rate_mps > 0.0 else driven.truth.right_gap_m)[at, 0]
    approach = np.array([abs(driven.truth.approach_mps[at, 0])])
    assert -0.3 <= gap_m <= float(earliest_warning_line_m(approach)[0])


def test_channel_and_log_tell_raised_held_and_cleared(tmp_path: Path, drifting: LaneDrive) -> None:
    result = run(write_lane_log(tmp_path / "l.mcap", drifting))
    warnings, words = result.channels
    assert (warnings.topic, words.topic) == ("/cwcli/warnings", "/cwcli/log")
    rule, other = warnings.fields["rule"], warnings.fields["other_id"]
    assert isinstance(rule, Strings) and isinstance(other, Strings)
    assert (rule.values, other.values[0]) == (("lane-departure",), "left boundary")
    state = np.asarray(warnings.fields["state"])
    assert state[0] == 1
    assert (state[1:] == 2).sum() > 5
    level = np.asarray(words.fields["level"])
    assert len(level) == np.count_nonzero(state != 2)
    assert level[0] == 3  # foxglove.Log.WARNING
    text = words.fields["message"]
    assert isinstance(text, Strings)
    assert text.values[text.codes[0]].startswith("leaving the lane to the left")


def test_without_a_drift_it_is_silent(tmp_path: Path) -> None:
    result = run(write_lane_log(tmp_path / "l.mcap", drive(seconds=30.0)))
    assert len(result.tables["lane_departures"]) == 0
    assert counts(result)["left evaluated"] == 301


def test_below_the_least_speed_nothing_is_raised(tmp_path: Path, drifting: LaneDrive) -> None:
    path = write_lane_log(tmp_path / "l.mcap", drifting)
    result = run(path, WarnLaneConfig(LaneDepartureConfig(min_speed_mps=30.0)))
    assert len(result.tables["lane_departures"]) == 0
    assert counts(result)["too slow"] == 141


def test_where_a_boundary_is_not_found_that_side_is_silent(tmp_path: Path) -> None:
    blind = drive(seconds=14.0, drift_mps=0.5, road=Road(), noise=LaneSensorNoise(blind_s=((3.5, 99.0),)))
    result = run(write_lane_log(tmp_path / "l.mcap", blind))
    assert len(result.tables["lane_departures"]) == 0
    assert counts(result)["left not found"] == 106  # frames from 3.5 to 14 s


def test_boundaries_that_bend_as_no_road_does_are_none_and_counted(tmp_path: Path, drifting: LaneDrive) -> None:
    """The observer's limit: a curvature that changes by more than 1 per m^2 is no lane's."""
    lanes = lanes_channel(drifting.sensed)
    change_1pm2 = np.zeros(len(lanes))
    change_1pm2[:20], change_1pm2[20:30] = 1e200, -1.5
    told = replace(lanes, fields={**lanes.fields, "curvature_change_1pm2": change_1pm2})
    with Log.open(write_lane_log(tmp_path / "l.mcap", drifting)) as log, warnings.catch_warnings():
        warnings.simplefilter("error")
        result = warn_lane(predicted(log.with_channels([told])), WarnLaneConfig())
    assert (counts(result)["left not found"], counts(result)["right not found"]) == (30, 30)
    assert [event["side"] for event in result.tables["lane_departures"].rows_as_dicts()] == ["left"]


def test_frames_without_a_path_are_counted_and_not_judged(tmp_path: Path, drifting: LaneDrive) -> None:
    path = write_lane_log(tmp_path / "l.mcap", drifting, speed_gap_s=(4.0, 14.1), without=("/imu/data",))
    result = run(path)
    lanes = next(count for count in result.summary.inputs if count.role == "lanes")
    assert lanes.set_aside["no path from the observer"] == 141 - lanes.used
    assert counts(result)["speed not known"] == 141 - lanes.used


def test_a_longer_time_to_line_crossing_holds_the_warning_as_long(tmp_path: Path, drifting: LaneDrive) -> None:
    path = write_lane_log(tmp_path / "l.mcap", drifting)
    early, usual = (run(path, WarnLaneConfig(LaneDepartureConfig(warn_s=warn_s))) for warn_s in (1.9, 0.7))
    raised = [result.tables["lane_departures"].rows_as_dicts()[0]["raised_stamp_ns"] for result in (early, usual)]
    assert raised[0] < raised[1]


def test_warnings_of_an_earlier_stage_of_the_run_stay_in_the_channel(intersection: Path, tmp_path: Path) -> None:
    """As `cwcli run --stage warn,warn-lane` has them: one channel, events numbered on."""
    with Log.open(intersection) as log:
        collisions = warn(log, WarnConfig())
    lanes = write_lane_log(tmp_path / "l.mcap", drive(seconds=14.0, drift_mps=0.5, road=Road()))
    with Log.open(lanes) as log:
        alone = warn_lane(predicted(log), WarnLaneConfig())
        both = warn_lane(predicted(log.with_channels(collisions.channels)), WarnLaneConfig())
    n_before = len(collisions.tables["events"])
    assert n_before > 0
    ids = [row["event_id"] for row in both.tables["lane_departures"].rows_as_dicts()]
    assert ids == [n_before + row["event_id"] for row in alone.tables["lane_departures"].rows_as_dicts()]
    for together, one, other in zip(both.channels, collisions.channels, alone.channels, strict=True):
        assert together.topic == one.topic == other.topic
        assert len(together) == len(one) + len(other)
        assert (np.diff(together.log_time_ns) >= 0).all()


def test_several_collision_rules_number_their_events_on(intersection: Path) -> None:
    with Log.open(intersection) as log:
        one, other = (warn(log, WarnConfig(rules=(rule,))) for rule in ("cwcli", "ttc"))
        both = warn(log, WarnConfig(rules=("cwcli", "ttc")))
    n_one, n_other = len(one.tables["events"]), len(other.tables["events"])
    assert n_one > 0 and n_other > 0
    assert both.tables["events"].rows_as_dicts() == one.tables["events"].rows_as_dicts()
    ids = [row["event_id"] for row in both.tables["events_ttc"].rows_as_dicts()]
    assert ids == [n_one + row["event_id"] for row in other.tables["events"].rows_as_dicts()]
    assert len(both.channels[0]) == len(one.channels[0]) + len(other.channels[0])
    assert (np.diff(both.channels[0].log_time_ns) >= 0).all()
    assert set(np.asarray(both.channels[0].fields["event_id"]).tolist()) == set(range(1, n_one + n_other + 1))


def test_an_unknown_rule_names_those_there_are() -> None:
    with pytest.raises(UsageError, match="'nonsense'") as caught:
        WarnConfig(rules=("nonsense",))
    assert caught.value.hint.startswith("one of: cwcli, ")
