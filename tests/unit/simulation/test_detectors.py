"""Lidar and radar of a scenario: what they detect, and the log that holds it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cwcli.errors import UsageError
from cwcli.logs.read.reader import Log
from cwcli.signals.leaf_fields import read_numbers
from cwcli.simulate.sensor_log import write_simulated_log
from cwcli.simulation.detectors import positions_and_velocities_in_host_body_frame
from cwcli.simulation.drive import simulate_scenario
from cwcli.simulation.dual_sensor import TARGET_POSITIONS_BY_PATH_SHAPE
from cwcli.simulation.scenario import load_scenario, parse_scenario


def scene(**sensors: dict[str, object]) -> dict[str, object]:
    """A car that drives north at 10 m/s, 30 m behind one at 16 m/s that is 4 m to its left."""
    return {
        "duration_s": 2,
        "vehicles": {
            "host": {"heading_deg": 90, "speed_mps": 10},
            "other": {"x_m": -4, "y_m": 30, "heading_deg": 90, "speed_mps": 16, "v2x": False},
        },
        "sensors": sensors,
    }


EXACT = {"range_sigma_m": 0, "azimuth_sigma_deg": 0, "rate_sigma_mps": 0}


def test_an_exact_radar_measures_range_azimuth_and_range_rate() -> None:
    scans = simulate_scenario(parse_scenario(scene(radar={"rate_hz": 1, **EXACT}), name="a")).detections["radar"]
    ahead = np.array([30.0, 36.0, 42.0])  # the other is 6 m/s faster
    reach = np.hypot(ahead, 4.0)
    expected = np.column_stack([reach, np.arctan2(4.0, ahead), 6.0 * ahead / reach])
    np.testing.assert_allclose(scans.values, expected, atol=1e-6)
    assert scans.first.tolist() == [0, 1, 2, 3]


def test_an_exact_lidar_measures_the_place_in_the_car() -> None:
    scans = simulate_scenario(parse_scenario(scene(lidar={"rate_hz": 1, "sigma_m": 0}), name="a")).detections["lidar"]
    np.testing.assert_allclose(scans.values, [[30.0, 4.0], [36.0, 4.0], [42.0, 4.0]], atol=1e-6)


def test_a_target_beyond_the_range_or_the_field_of_view_leaves_an_empty_scan() -> None:
    far = simulate_scenario(parse_scenario(scene(lidar={"rate_hz": 1, "max_range_m": 37}), name="a"))
    assert far.detections["lidar"].first.tolist() == [0, 1, 2, 2]
    narrow = simulate_scenario(parse_scenario(scene(radar={"rate_hz": 1, "fov_deg": 14}), name="a"))
    assert narrow.detections["radar"].first.tolist() == [0, 0, 1, 2]  # 7.6, 6.3 and 5.4 degrees to the left


def test_velocities_are_those_in_the_turning_body() -> None:
    """A car that turns on the spot sees a standing pole go round it the other way."""
    host, pole = np.zeros((1, 8)), np.zeros((1, 8))
    host[0, 5], pole[0, 0] = 0.5, 10.0
    np.testing.assert_allclose(positions_and_velocities_in_host_body_frame(host, pole), [[10.0, 0.0, 0.0, -5.0]])


def test_noise_is_as_declared_and_a_seed_gives_the_same_detections() -> None:
    settings: dict[str, object] = {
        "rate_hz": 500,
        "range_sigma_m": 0.25,
        "azimuth_sigma_deg": 0.5,
        "rate_sigma_mps": 0.12,
    }
    scenario = parse_scenario(scene(radar=settings), name="a")
    exact = simulate_scenario(parse_scenario(scene(radar={"rate_hz": 500, **EXACT}), name="a")).detections["radar"]
    noisy = simulate_scenario(scenario, 3).detections["radar"]
    spread = (noisy.values - exact.values).std(axis=0)
    np.testing.assert_allclose(spread, [0.25, np.radians(0.5), 0.12], rtol=0.1)  # 1,001 values: 2 % one sigma
    np.testing.assert_array_equal(noisy.values, simulate_scenario(scenario, 3).detections["radar"].values)


def test_the_log_holds_detections_and_their_truth_in_the_car(tmp_path: Path) -> None:
    drive = simulate_scenario(parse_scenario(scene(lidar={"rate_hz": 1}), name="a"))
    written = write_simulated_log(drive, tmp_path / "a.mcap")
    assert {entry.topic: entry.n_messages for entry in written}["/lidar/detections"] == 3
    with Log.open(tmp_path / "a.mcap") as log:
        truth = log.columns("/truth/targets")
        np.testing.assert_allclose(read_numbers(truth, "x_m")[0], 30.0, atol=1e-6)
        schema = next(channel for channel in log.channels if channel.topic == "/lidar/detections")
        assert schema.schema_name == "cwcli.Detections"


def test_an_unknown_sensor_lists_those_there_are() -> None:
    with pytest.raises(UsageError, match=r"sonar is unknown; permitted: gnss, .*lidar, radar"):
        parse_scenario(scene(sonar={}), name="a")


@pytest.mark.parametrize("name", TARGET_POSITIONS_BY_PATH_SHAPE)
def test_the_four_manoeuvres_are_those_of_the_reproduction(name: str) -> None:
    """The weave is made of straight pieces of yaw rate, the others are exact but for 20 ms of steering."""
    motion = load_scenario(f"xiang2019-{name}").vehicles["target"].motion
    time_s = np.linspace(0.0, 12.0, 25)
    away_m = np.hypot(*(motion.states_at(time_s)[:, :2] - TARGET_POSITIONS_BY_PATH_SHAPE[name](time_s)).T)
    assert away_m.max() < (1.0 if name == "weave" else 0.1)
