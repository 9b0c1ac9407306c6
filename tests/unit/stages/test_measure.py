"""Stage `measure`: the measures of a log by hand, encounters, sigmas, and logs that are odd."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cwcli.channels.measures import published_measure_names
from cwcli.channels.published import EGO_ONLINE, EGO_STATE, REMOTE_ONLINE, REMOTE_STATE
from cwcli.channels.vehicle_state import make_vehicle_state_channel
from cwcli.errors import MissingSignalError, UsageError
from cwcli.logs.encoders.schemas import schema_folder
from cwcli.measures import MEASURES
from cwcli.pipeline.result import StageResult
from cwcli.stages.measure import MeasureConfig, measure
from tests.unit.stages.measure_logs import SIGMA, log_of, ring, state_log, states, straight, without_sizes

TIME_S = np.arange(0.0, 6.0, 0.05)


def follower(tmp_path: Path, **settings: object) -> StageResult:
    """The ego at 20 m/s, 80 m behind one at 10 m/s: 75.5 m of gap, 7.55 s to contact at the start."""
    ego = states(["ego"], [straight(0.0, 0.0, 20.0, 0.0, TIME_S)], TIME_S)
    other = states(["car"], [straight(80.0, 0.0, 10.0, 0.0, TIME_S)], TIME_S)
    return measure(state_log(tmp_path / "log.mcap", ego, other), MeasureConfig(**settings))  # type: ignore[arg-type]


def extremes(result: StageResult, encounter: int = 0) -> dict[str, dict[str, Any]]:
    rows = result.tables["extremes"].rows_as_dicts()
    return {row["measure"]: row for row in rows if row["encounter"] == encounter}


def test_series_and_extremes_by_hand(tmp_path: Path) -> None:
    result = follower(tmp_path)
    series: Mapping[str, Any] = result.tables["measures"].columns
    gap = 75.5 - 10.0 * TIME_S
    np.testing.assert_allclose(series["gap_m"], gap)
    np.testing.assert_allclose(series["ttc_s"], gap / 10.0)
    np.testing.assert_allclose(series["thw_s"], gap / 20.0)
    np.testing.assert_allclose(series["drac_mps2"], 50.0 / gap)
    worst = extremes(result)
    assert worst["ttc"]["value"] == pytest.approx(gap[-1] / 10.0)
    assert worst["ttc"]["stamp_ns"] == series["stamp_ns"][-1]
    assert worst["delta-v"]["value"] == pytest.approx(5.0)
    assert np.isnan(worst["ppet"]["value"])
    assert worst["ppet"]["stamp_ns"] == -1
    assert worst["gap"]["unit"] == "m"
    (channel,) = result.channels
    np.testing.assert_array_equal(channel.fields["ttc_s"], series["ttc_s"])


def test_sigma_of_the_time_to_collision_by_hand(tmp_path: Path) -> None:
    # TTC = g / (v_e - v_o): sigma^2 = (2 s_x^2 + TTC^2 2 s_v^2) / (v_e - v_o)^2; headings count to second order
    worst = extremes(follower(tmp_path))["ttc"]
    ttc, closing = worst["value"], 10.0
    expected = np.sqrt(2.0 * SIGMA[0] ** 2 + ttc**2 * 2.0 * SIGMA[2] ** 2) / closing
    assert worst["sigma"] == pytest.approx(expected, rel=0.02)
    assert np.isnan(extremes(follower(tmp_path / "..", with_sigma=False))["ttc"]["sigma"])


def test_chosen_measures_alone_are_computed(tmp_path: Path) -> None:
    result = follower(tmp_path, measures=("pet", "ttc"))
    assert set(extremes(result)) == {"pet", "ttc"}
    assert "gap_m" not in result.tables["measures"].columns
    assert np.isnan(np.asarray(result.channels[0].fields["gap_m"])).all()
    with pytest.raises(UsageError, match="no measure 'nearness'"):
        MeasureConfig(measures=("nearness",))


def test_the_probability_of_contact_takes_the_covariances_where_it_is_asked_for(tmp_path: Path) -> None:
    result = follower(tmp_path, measures=("ttc", "p-contact"))
    values = np.asarray(result.tables["measures"].columns["p_contact"])
    ttc_s = np.asarray(result.tables["measures"].columns["ttc_s"])
    assert not np.isnan(values).any()
    assert (values[ttc_s < 2.0] > 0.9).all()
    assert (values[ttc_s > 4.0] < 0.1).all()
    assert (ttc_s < 2.0).any()
    assert (ttc_s > 4.0).any()
    assert np.isnan(extremes(result)["p-contact"]["sigma"])
    assert "p_contact" not in follower(tmp_path).tables["measures"].columns


def test_one_that_comes_near_twice_has_two_encounters(tmp_path: Path) -> None:
    time_s = np.arange(0.0, 40.0, 0.1)
    away = np.where(np.abs(time_s - 20.0) < 8.0, 150.0, 20.0)  # within 50 m but for 16 s
    ego = states(["ego"], [straight(0.0, 0.0, 10.0, 0.0, time_s)], time_s)
    track = straight(0.0, 0.0, 10.0, 0.0, time_s)
    track[:, 1] = away
    log = state_log(tmp_path / "log.mcap", ego, states(["car"], [track], time_s))
    result = measure(log, MeasureConfig(measures=("gap",)))
    assert [row["encounter"] for row in result.tables["extremes"].rows_as_dicts()] == [0, 1, 2]
    (section,) = result.summary.sections
    spans = sorted((row[1], row[2]) for row in section.rows)
    assert spans == [pytest.approx((0.0, 12.0), abs=0.11), pytest.approx((28.0, 39.9), abs=0.11)]


def test_a_crash_is_driven_again(tmp_path: Path) -> None:
    time_s = np.arange(0.0, 10.0, 0.05)
    ego = states(["ego"], [straight(0.0, 0.0, 20.0, 0.0, time_s)], time_s)
    stands = states(["car"], [straight(164.5, 0.0, 0.0, 0.0, time_s)], time_s)
    result = measure(state_log(tmp_path / "log.mcap", ego, stands), MeasureConfig())
    rows = {row["driver"]: row for row in result.tables["preventability"].rows_as_dicts()}
    assert (rows["RSS"]["conflict_stamp_ns"] - ego.stamp_ns[0]) / 1e9 == pytest.approx(8.0)
    assert rows["RSS"]["avoided"]
    assert not rows["careful human"]["avoided"]
    assert [section.key for section in result.summary.sections] == ["encounters", "preventability"]
    table = result.summary.sections[0]
    assert [row[table.columns.index("outlines touched")] for row in table.rows] == [True]
    assert not follower(tmp_path).tables["preventability"].rows_as_dicts()


def test_online_states_are_measured_where_they_are_asked_for(tmp_path: Path) -> None:
    """The online states say that the other is 10 m nearer: 65.5 m of gap at the start."""
    ego = states(["ego"], [straight(0.0, 0.0, 20.0, 0.0, TIME_S)], TIME_S)
    far, near = (states(["car"], [straight(x_m, 0.0, 10.0, 0.0, TIME_S)], TIME_S) for x_m in (80.0, 70.0))
    made = ((EGO_STATE, ego), (REMOTE_STATE, far), (EGO_ONLINE, ego), (REMOTE_ONLINE, near))
    log = log_of(tmp_path / "log.mcap", [make_vehicle_state_channel(channel, each, None) for channel, each in made])
    for which, gap_m in (("hindsight", 75.5), ("online", 65.5)):
        result = measure(log, MeasureConfig(states=which))  # type: ignore[arg-type]
        assert np.asarray(result.tables["measures"].columns["gap_m"])[0] == pytest.approx(gap_m)


def test_nobody_near_is_said(tmp_path: Path) -> None:
    ego = states(["ego"], [straight(0.0, 0.0, 20.0, 0.0, TIME_S)], TIME_S)
    far = states(["far"], [straight(5000.0, 0.0, 10.0, 0.0, TIME_S)], TIME_S)
    result = measure(state_log(tmp_path / "log.mcap", ego, far), MeasureConfig())
    assert "vehicles that never came within 200 m, and are not measured: 1" in result.summary.notes
    assert len(result.channels[0]) == 0
    assert not result.tables["extremes"].rows_as_dicts()


def test_without_others_it_is_an_error(tmp_path: Path) -> None:
    ego = states(["ego"], [straight(0.0, 0.0, 20.0, 0.0, TIME_S)], TIME_S)
    with pytest.raises(MissingSignalError, match="remote vehicles or targets"):
        measure(state_log(tmp_path / "log.mcap", ego, None), MeasureConfig())


def test_assumed_sizes_are_said(tmp_path: Path) -> None:
    ego = states(["ego"], [straight(0.0, 0.0, 20.0, 0.0, TIME_S)], TIME_S)
    other = without_sizes(states(["car"], [straight(80.0, 0.0, 10.0, 0.0, TIME_S)], TIME_S))
    result = measure(state_log(tmp_path / "log.mcap", ego, other), MeasureConfig(measures=("gap",)))
    assert "vehicles without a size, for which 4.5 x 1.8 m is assumed: 1" in result.summary.notes
    np.testing.assert_allclose(np.asarray(result.tables["measures"].columns["gap_m"]), 75.5 - 10.0 * TIME_S)


def test_five_hundred_vehicles_of_which_few_are_near(tmp_path: Path) -> None:
    time_s = np.arange(0.0, 10.0, 0.1)
    ids = [f"car {k}" for k in range(500)]
    tracks = [straight(40.0 * k - 400.0, 3.5, 10.0, 0.0, time_s) for k in range(500)]
    ego = states(["ego"], [straight(0.0, 0.0, 10.0, 0.0, time_s)], time_s)
    result = measure(state_log(tmp_path / "log.mcap", ego, states(ids, tracks, time_s)), MeasureConfig())
    near = {row["other_id"] for row in result.tables["extremes"].rows_as_dicts()}
    assert near == {f"car {k}" for k in range(6, 15)}  # 160 to 0 m behind, and as far ahead: 4.9 m to 199 m along
    assert any("not measured: 491" in note for note in result.summary.notes)


ODD = ("time jump", "appears and goes", "no number", "standing", "one state")


@pytest.mark.parametrize("odd", ODD)
def test_odd_tracks_make_gaps_and_no_false_values(odd: str, tmp_path: Path) -> None:
    ego = states(["ego"], [straight(0.0, 0.0, 20.0, 0.0, TIME_S)], TIME_S)
    other = states(["car"], [straight(80.0, 0.0, 10.0, 0.0, TIME_S)], TIME_S)
    kept = np.ones(len(TIME_S), dtype=bool)
    if odd == "time jump":
        kept = (TIME_S < 2.0) | (TIME_S > 4.0)
        other = other.select_rows(np.flatnonzero(kept))
    elif odd == "appears and goes":
        kept = (TIME_S > 1.0) & (TIME_S < 5.0)
        other = other.select_rows(np.flatnonzero(kept))
    elif odd == "no number":
        state = other.state.copy()
        state[10:40] = np.nan
        other = replace(other, state=state)
        kept[10:40] = False
    elif odd == "standing":
        ego = states(["ego"], [straight(0.0, 0.0, 0.0, 0.0, TIME_S)], TIME_S)
        other = states(["car"], [straight(80.0, 0.0, 0.0, 1.0, TIME_S)], TIME_S)
    else:
        kept = TIME_S[3] == TIME_S
        other = other.select_rows(np.array([3]))
    result = measure(state_log(tmp_path / "log.mcap", ego, other), MeasureConfig())
    series: Mapping[str, Any] = result.tables["measures"].columns
    seconds = (np.asarray(series["stamp_ns"]) - ego.stamp_ns[0]) / 1e9
    if odd == "one state":
        assert len(seconds) == 0
        return
    np.testing.assert_allclose(seconds, TIME_S[kept], atol=1e-9)
    if odd == "standing":
        assert np.isnan(series["ttc_s"]).all()
        assert np.isnan(series["thw_s"]).all()
    else:
        np.testing.assert_allclose(series["ttc_s"], (75.5 - 10.0 * TIME_S[kept]) / 10.0)


def test_blocks_are_the_whole(tmp_path: Path) -> None:
    time_s = np.arange(0.0, 250.0, 0.05)  # more moments than are measured at once
    tracks = ring(4, time_s)
    ego = states(["ego"], tracks[:1], time_s)
    log = state_log(tmp_path / "log.mcap", ego, states(["a", "b", "c"], tracks[1:], time_s))
    whole = measure(log, MeasureConfig(measures=("ttc", "gap"), with_sigma=False)).tables["measures"].columns
    late = MeasureConfig(measures=("ttc", "gap"), with_sigma=False, start_ns=int(ego.stamp_ns[3000]))
    part = measure(log, late).tables["measures"].columns
    rows = np.flatnonzero(np.asarray(whole["stamp_ns"]) >= late.start_ns)
    for name in ("ttc_s", "gap_m"):
        np.testing.assert_array_equal(np.asarray(whole[name])[rows], part[name])


def test_the_message_has_the_fields_that_are_written() -> None:
    text = (schema_folder() / "cwcli" / "v1" / "measures.proto").read_text(encoding="utf-8")
    fields = [line.split()[1] for line in text.splitlines() if line.strip().startswith("double ")]
    assert tuple(fields) == published_measure_names()
    assert set(fields) == {each.column for each in MEASURES.values() if each.is_series and not each.is_expensive}
