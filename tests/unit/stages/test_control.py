"""The stage `control` on the bundled logs: from causal states to what each policy makes of the warning."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cwcli.channels.vehicle_state import read_vehicle_states
from cwcli.control.encounter import BRAKING_POLICY_NAMES, ReplaySpan
from cwcli.errors import MissingSignalError, UsageError
from cwcli.estimation.config import EstimatorConfig
from cwcli.logs.read.reader import Log
from cwcli.pipeline.result import StageResult
from cwcli.stages.control import ControlConfig, control
from cwcli.stages.estimate import EstimateConfig, estimate

SAMPLES = Path(__file__).parents[3] / "sample_logs"
NS = 1_000_000_000


def estimated(name: str, *, causal: bool = True) -> Log:
    """A sample log with its states in memory."""
    log = Log.open(SAMPLES / f"{name}.mcap")
    made = estimate(log, EstimateConfig(estimator=EstimatorConfig(causal=causal)))
    return log.with_channels(made.channels, {"cwcli.run.estimate": made.metadata})


@pytest.fixture(scope="module")
def rear_end() -> tuple[Log, StageResult]:
    log = estimated("rear-end")
    return log, control(log, ControlConfig(predictor="cj-cya", rule="song2016"))


def rows(result: StageResult) -> dict[str, dict[str, Any]]:
    """Policy -> its row; there must be one warning."""
    found = {str(row["policy"]): row for row in result.tables["control"].rows_as_dicts()}
    assert len(result.tables["control"].rows_as_dicts()) == len(found) == len(BRAKING_POLICY_NAMES)
    return found


def test_rear_end_is_avoided_by_the_controller_only(rear_end: tuple[Log, StageResult]) -> None:
    found = rows(rear_end[1])
    assert {policy: row["collided"] for policy, row in found.items()} == {
        "no-action": True,
        "fuzzy": False,
        "driver": True,
    }
    assert float(found["fuzzy"]["min_distance_m"]) > 4.5  # the outlines of two cars of 4.5 m stay apart too
    assert float(found["fuzzy"]["min_gap_m"]) > 0.0
    assert float(found["driver"]["impact_speed_mps"]) < float(found["no-action"]["impact_speed_mps"])
    assert float(found["fuzzy"]["peak_deceleration_mps2"]) <= 0.8 * 9.80665 + 1e-9  # the car's friction
    assert float(found["fuzzy"]["peak_jerk_mps3"]) <= 15.0 + 1e-6


def test_warning_is_the_papers(rear_end: tuple[Log, StageResult]) -> None:
    log, result = rear_end
    assert (int(rows(result)["fuzzy"]["warning_stamp_ns"]) - log.start_ns) / NS == pytest.approx(3.6, abs=0.15)


def test_channels_hold_the_recording_until_the_warning(rear_end: tuple[Log, StageResult]) -> None:
    log, result = rear_end
    recorded = read_vehicle_states(log.columns("/cwcli/ego/state"))
    warning_ns = int(rows(result)["fuzzy"]["warning_stamp_ns"])
    after = log.with_channels(result.channels)
    speed = {}
    for policy in BRAKING_POLICY_NAMES:
        states = read_vehicle_states(after.columns(f"/cwcli/control/{policy}/state"))
        assert set(states.ids.values) == {"ego"}
        assert np.all(np.diff(states.stamp_ns) > 0)
        before = states.stamp_ns < warning_ns
        for column in range(4):
            expected = np.interp(states.stamp_ns[before], recorded.stamp_ns, recorded.state[:, column])
            np.testing.assert_allclose(states.state[before, column], expected, atol=2e-3)
        speed[policy] = states.state[-1, 2]
    assert speed["no-action"] == pytest.approx(20.0, abs=0.5)
    assert speed["fuzzy"] == speed["driver"] == 0.0


def test_map_position_of_the_replay_is_that_of_the_states(rear_end: tuple[Log, StageResult]) -> None:
    log, result = rear_end
    names = ("stamp_ns", "latitude_deg")
    found = log.with_channels(result.channels).columns("/cwcli/control/no-action/state", names)
    replayed: Mapping[str, Any] = found.fields
    recorded: Mapping[str, Any] = log.columns("/cwcli/ego/state", names).fields
    inside = replayed["stamp_ns"] <= recorded["stamp_ns"][-1]
    expected = np.interp(replayed["stamp_ns"][inside], recorded["stamp_ns"], recorded["latitude_deg"])
    np.testing.assert_allclose(replayed["latitude_deg"][inside], expected, atol=2e-8)  # 2 mm


def test_series_and_table_agree(rear_end: tuple[Log, StageResult]) -> None:
    found, series = rows(rear_end[1]), rear_end[1].tables["control_series"].rows_as_dicts()
    for policy in BRAKING_POLICY_NAMES:
        own = [row for row in series if row["policy"] == policy and row["since_warning_s"] >= 0.0]
        least = min(float(row["distance_m"]) for row in own)
        assert least == pytest.approx(float(found[policy]["min_distance_m"]), abs=0.3)  # 20 Hz against 100 Hz
    assert {row["is_extrapolated"] for row in series} == {True, False}


def test_intersection_is_avoided_with_the_default_chain() -> None:
    found = rows(control(estimated("intersection"), ControlConfig()))
    assert found["no-action"]["collided"]
    assert not found["fuzzy"]["collided"]
    assert found["fuzzy"]["rule"] == "cwcli"


def test_without_a_warning_nothing_is_braked(rear_end: tuple[Log, StageResult]) -> None:
    log, _ = rear_end
    result = control(log, ControlConfig(predictor="cj-cya", rule="song2016", end_ns=log.start_ns + 2 * NS))
    assert result.channels == ()
    assert any("no warning arises" in note for note in result.summary.notes)
    assert [len(table.rows_as_dicts()) for table in result.tables.values()] == [0, 0]
    assert "min_distance_m" in result.tables["control"].columns


def test_states_in_hindsight_are_noted() -> None:
    notes = control(estimated("rear-end", causal=False), ControlConfig(states="hindsight")).summary.notes
    assert any("know what came later" in note for note in notes)


def test_states_are_needed() -> None:
    with Log.open(SAMPLES / "rear-end.mcap") as log, pytest.raises(MissingSignalError) as caught:
        control(log, ControlConfig())
    assert "cwcli estimate" in caught.value.hint


def test_no_state_of_the_ego_in_the_span(rear_end: tuple[Log, StageResult]) -> None:
    log, _ = rear_end
    with pytest.raises(MissingSignalError, match="no state of the ego"):
        control(log, ControlConfig(start_ns=log.end_ns + NS))


@pytest.mark.parametrize(
    "settings",
    [
        {"predictor": "unknown"},
        {"rule": "unknown"},
        {"horizon_s": -1.0},
        {"span": ReplaySpan(duration_s=0.0)},
        {"span": ReplaySpan(after_s=float("nan"))},
    ],
)
def test_settings_out_of_range(settings: dict[str, Any]) -> None:
    with pytest.raises(UsageError):
        ControlConfig(**settings)


def test_rule_goes_with_the_predictor() -> None:
    assert ControlConfig().warning_config.rule == "cwcli"
    assert ControlConfig(predictor="cj-cya").warning_config.rule == "song2016"
    assert ControlConfig(predictor="cj-cya", rule="ttc").warning_config.rule == "ttc"
