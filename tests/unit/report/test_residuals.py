"""Residuals of the sources: what was planted comes back, what was found is taken off, gated ones are marked."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cwcli.channels.vehicle_state import VehicleStates
from cwcli.digest.drive import Drive
from cwcli.digest.encounters import DriveEncounters
from cwcli.digest.story import Story
from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.result import GatedMeasurements
from cwcli.evaluation.doubts import find_doubts_in_evidence
from cwcli.report.map_figure import build_map_figure
from cwcli.report.page import PageRenderer
from cwcli.report.residuals import build_residual_plots, iter_source_residuals, residual_figure
from cwcli.report.sensors import sensor_remarks_sentence
from cwcli.report.views import LogView, SensorsView
from cwcli.signals.columns import encode_strings
from cwcli.signals.vehicle_state import HEADING, SPEED
from cwcli.warning.types import WarningConfig

S = 1_000_000_000
ATOL = 1e-6


def report(source: str, quantity: str, **more: Any) -> dict[str, Any]:
    return {"vehicle": "ego", "source": source, "quantity": quantity, "read": 9, "used": 8, "gated": 1, **more}


def drive(*measured: Measurements, reports: Any = (), rows: Any = (), noise: Any = (), gated_ns: int = -1) -> Drive:
    """A car that drives north at 10 m/s for 9 s, its measurements and what the record tells of them."""
    stamp_ns = np.arange(10) * S
    state = np.zeros((10, 8))
    state[:, 1], state[:, SPEED], state[:, HEADING] = 10.0 * np.arange(10), 10.0, np.pi / 2.0
    states = VehicleStates.from_ego_states(stamp_ns, state, np.tile(np.eye(8), (10, 1, 1)))
    columns = ["source", "quantity", "parameter", "value +- sigma", "unit", "use of the value"]
    sections = [
        {"key": "parameters", "title": "", "columns": columns, "rows": list(rows)},
        {"key": "noise", "title": "", "columns": ["source", "quantity", "white noise (1 sigma)"], "rows": list(noise)},
    ]
    record = {"sources": json.dumps(reports), "summary": json.dumps({"sections": sections})}
    made = Drive("d.mcap", 0, 9 * S, states, (), measured, None, None, WarningConfig(), {"estimate": record}, "")
    if gated_ns < 0:
        return made
    quantity = measured[0].kind.name.lower()
    one = np.array([20.0])
    topic = encode_strings([measured[0].source])
    return replace(made, gated=GatedMeasurements(np.array([gated_ns]), topic, encode_strings([quantity]), one, one))


def test_positions_are_split_ahead_and_left_after_their_latency() -> None:
    """Stamped 0.5 s late, the fix of y = 40 m (t = 4 s) carries 4.5 s; it lies 2 m ahead and 3 m to the east."""
    fix = Measurements("/gps", Kind.POSITION, np.array([4_500_000_000]), np.array([[3.0, 42.0]]))
    (found,) = iter_source_residuals(drive(fix, reports=[report("/gps", "position", latency_s=0.5)]))
    np.testing.assert_allclose(found.values, [[2.0, -3.0]], atol=ATOL)  # east is right of north
    assert not found.is_gated.any()


def test_speeds_lose_their_scale_and_headings_whole_turns() -> None:
    speed = Measurements("/wheel", Kind.SPEED, np.array([3 * S]), np.array([[11.7]]))
    heading = Measurements("/gps", Kind.HEADING, np.array([3 * S]), np.array([[np.pi / 2.0 + 4.0 * np.pi + 0.1]]))
    told = [["/wheel", "speed", "scale", "1.1 +- 0.01", "", "used"], ["/wheel", "speed", "bias", "0.5", "m/s", "used"]]
    reports = [report("/wheel", "speed"), report("/gps", "heading")]
    of_speed, of_heading = iter_source_residuals(drive(speed, heading, reports=reports, rows=told))
    np.testing.assert_allclose(of_speed.values, [[11.7 - 1.1 * 10.0 - 0.5]], atol=ATOL)
    np.testing.assert_allclose(of_heading.values, [[np.degrees(0.1)]], atol=ATOL)


def test_a_parameter_that_was_not_used_is_not_taken_off() -> None:
    speed = Measurements("/wheel", Kind.SPEED, np.array([3 * S]), np.array([[11.0]]))
    told = [["/wheel", "speed", "scale", "1.1", "", "not better"]]
    (found,) = iter_source_residuals(drive(speed, reports=[report("/wheel", "speed")], rows=told))
    np.testing.assert_allclose(found.values, [[1.0]], atol=ATOL)


def test_velocities_are_split_likewise_and_gated_ones_marked() -> None:
    stamps = np.array([2 * S, 3 * S])
    velocity = Measurements("/gps", Kind.VELOCITY, stamps, np.array([[0.0, 10.0], [-1.0, 12.0]]))
    noise = [["/gps", "velocity", "0.2 m/s"]]
    made = drive(velocity, reports=[report("/gps", "velocity")], noise=noise, gated_ns=3 * S)
    (found,) = iter_source_residuals(made)
    np.testing.assert_allclose(found.values, [[0.0, 0.0], [2.0, 1.0]], atol=ATOL)
    assert found.is_gated.tolist() == [False, True]
    figure = residual_figure(made, found, 100)
    assert figure["layout"]["yaxis"]["range"] == [-0.484, 0.484]  # 1.1 times 2.2 sigmas of 0.2 m/s
    crosses = [trace for trace in figure["data"] if trace["name"] == "gated"]
    assert [(trace["x"], trace["y"], trace["text"]) for trace in crosses] == [
        ([3], [0.484], ["2 m/s"]),  # beyond the axis: at its edge
        ([3], [0.484], ["1 m/s"]),
    ]
    assert "1 of 9 gated" in found.hint and "white noise 0.2 m/s" in found.hint


def test_a_level_imu_is_split_into_its_acceleration_and_yaw_rate() -> None:
    values = np.tile([0.3, 0.0, 9.81, 0.0, 0.0, 0.02], (9, 1))
    imu = Measurements("/imu", Kind.IMU, np.arange(9) * S, values)
    reports = [report("/imu", "accel"), report("/imu", "yaw_rate")]
    told = [["/imu", "yaw rate", "bias", "0.005 +- 0.001", "rad/s", "used"]]
    of_accel, of_rate = iter_source_residuals(drive(imu, reports=reports, rows=told))
    np.testing.assert_allclose(of_accel.values, np.full((9, 1), 0.3), atol=ATOL)
    # The vertical is that of the specific force, which leans 0.3 m/s^2 ahead
    upright = 9.81 / np.hypot(0.3, 9.81)
    np.testing.assert_allclose(of_rate.values, np.full((9, 1), np.degrees(0.02 * upright - 0.005)), atol=ATOL)


@pytest.mark.parametrize(
    "reports",
    [[], [7], {"a": 1}, [report("/other", "speed")], [{"vehicle": "ego", "source": None, "quantity": []}]],
)
def test_records_that_tell_nothing_of_the_source_give_no_figure(reports: Any) -> None:
    speed = Measurements("/wheel", Kind.SPEED, np.array([3 * S]), np.array([[10.0]]))
    assert build_residual_plots(drive(speed, reports=reports), "log-1", 100) == ([], 0)


def test_odd_numbers_in_a_record_are_taken_as_not_told() -> None:
    speed = Measurements("/wheel", Kind.SPEED, np.array([3 * S]), np.array([[10.5]]))
    odd = report("/wheel", "speed", latency_s="late", latency_drift=None, nis_per_dof="x", nis_inside="<b>")
    (found,) = iter_source_residuals(drive(speed, reports=[odd], rows=[["/wheel", "speed", "scale", "?", "", "used"]]))
    np.testing.assert_allclose(found.values, [[0.5]], atol=ATOL)


@pytest.mark.parametrize(
    "odd",
    [
        {"latency_s": 10**400, "latency_found_s": -(10**400), "gated": 10**400},
        {"latency_s": 1e300, "latency_found_s": 1e300},
        {"latency_s": -86_401.0, "latency_drift": float("inf")},
        {"latency_s": float("nan"), "latency_drift": 1e300},
    ],
)
def test_latencies_that_no_source_has_are_taken_as_not_told(odd: dict[str, Any]) -> None:
    """A 400-digit whole number is valid JSON."""
    speed = Measurements("/wheel", Kind.SPEED, np.array([3 * S]), np.array([[10.5]]))
    made = drive(speed, reports=[report("/wheel", "speed", **odd)])
    (found,) = iter_source_residuals(made)
    np.testing.assert_allclose(found.values, [[0.5]], atol=ATOL)
    assert len(build_residual_plots(made, "log-1", 100)[0]) == 1


@pytest.mark.parametrize(("key", "most"), [("parameters", 5), ("noise", 2), ("sources", 3), ("nees", 1)])
def test_a_table_without_a_column_that_is_needed_tells_nothing(key: str, most: int) -> None:
    """Rows are as long as their columns, but too few or under other names."""
    speed = Measurements("/wheel", Kind.SPEED, np.array([3 * S]), np.array([[10.5]]))
    made = drive(speed, reports=[report("/wheel", "speed")])
    names = {"noise": ["source", "quantity", "white noise (1 sigma)"], "nees": ["quantity", "NEES/dof"]}.get(
        key, ["source", "quantity", "parameter", "value +- sigma", "unit", "use of the value"]
    )
    row = ["/wheel", "speed", "bias", "1.0", "m/s", "used"]
    for n in range(most + 1):
        for columns in (names[:n], [f"column {k}" for k in range(n)]):
            section = {"key": key, "title": "", "columns": columns, "rows": [row[:n]]}
            record = {**made.records["estimate"], "summary": json.dumps({"sections": [section]})}
            odd = replace(made, records={"estimate": record})
            (found,) = iter_source_residuals(odd)
            np.testing.assert_allclose(found.values, [[0.5]], atol=ATOL)
            assert math.isnan(found.sigma)
            assert sensor_remarks_sentence(odd) == ""
            assert [each.name for each in find_doubts_in_evidence(odd.doubt_evidence)] == ["gated"]  # 1 of 9


def test_more_figures_than_fit_are_counted() -> None:
    sources = [Measurements(f"/{k}", Kind.SPEED, np.array([3 * S]), np.array([[10.5]])) for k in range(11)]
    made = drive(*sources, reports=[report(f"/{k}", "speed") for k in range(11)])
    plots, n = build_residual_plots(made, "log-1", 100)
    assert (len(plots), n) == (8, 11)
    assert [plot.title for plot in plots[::7]] == ["Residuals of /0: speed", "Residuals of /7: speed"]
    sensors = SensorsView("", (), (), plots=tuple(plots), n_residuals=n)
    view = LogView("log-1", "d", Story("", (), ()), (), is_alone=True, is_open=True, sensors=sensors)
    assert "8 of 11 are shown." in PageRenderer().render_log_section(view)
    assert "are shown" not in PageRenderer().render_log_section(replace(view, sensors=replace(sensors, n_residuals=8)))


def test_a_drive_whose_positions_are_no_numbers_has_no_map() -> None:
    made = drive()
    assert made.ego is not None
    meetings = DriveEncounters((), (), None, 0)
    assert build_map_figure(made, meetings) is not None
    for columns in ([0, 1], [0], [1]):
        state = made.ego.state.copy()
        state[:, columns] = np.nan
        assert build_map_figure(replace(made, ego=replace(made.ego, state=state)), meetings) is None


def test_the_top_of_the_page_tells_late_sources_and_a_pitched_imu() -> None:
    """9.80665 sin(11 degrees) = 1.871."""
    sources = {
        "key": "sources",
        "title": "",
        "columns": ["source", "quantity", "latency +- sigma [ms]", "latency status"],
        "rows": [["/gps", "velocity", "1013 +- 88", "applied"], ["/fix", "position", "90 +- 9", "applied"]],
    }
    columns = ["source", "quantity", "parameter", "value +- sigma", "unit", "use of the value"]
    row = ["/imu", "accel", "bias", "-1.871 +- 0.1", "m/s^2", "used"]
    parameters = {"key": "parameters", "title": "", "columns": columns, "rows": [row]}
    record = {"estimate": {"summary": json.dumps({"sections": [sources, parameters]})}}
    made = replace(drive(), records=record)
    assert sensor_remarks_sentence(made) == (
        "Of the sensors the velocity of /gps came 1.01 s late (corrected) and /imu is pitched by 11 degrees."
    )
    assert sensor_remarks_sentence(drive()) == ""
