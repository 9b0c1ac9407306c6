"""Sensors and the V2X link: noise, lag, delay, loss, order, and random streams that don't disturb each other."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from cwcli.simulation.drive import SimulatedDrive, simulate_scenario
from cwcli.simulation.scenario import load_scenario
from tests.drive_truth import true_states_of_vehicle, truth_stamps_ns

NS = 1_000_000_000
G = 9.80665

NO_NOISE = (
    "sensors.gnss.sigma_m=0",
    "sensors.gnss_heading.sigma_deg=0",
    "sensors.speed.sigma_mps=0",
    "sensors.imu.accel_sigma_mps2=0",
    "sensors.imu.yaw_rate_sigma_dps=0",
)


def drive(name: str, *overrides: str, seed: int = 1) -> SimulatedDrive:
    return simulate_scenario(load_scenario(name, overrides), seed)


def truth_at(made: SimulatedDrive, stamp_ns: np.ndarray, vehicle: str = "host") -> np.ndarray:
    return made.scenario.vehicles[vehicle].motion.states_at((stamp_ns - made.scenario.start_ns) / NS)


def test_noise_free_sensors_report_the_truth() -> None:
    made = drive("curve", *NO_NOISE)
    truth = truth_at(made, made.sensors["gnss"].stamp_ns)
    np.testing.assert_allclose(made.sensors["gnss"].values[:, :2], truth[:, :2], atol=1e-9)
    np.testing.assert_allclose(made.sensors["gnss_heading"].values[:, 0], truth[:, 3], atol=1e-12)
    np.testing.assert_allclose(made.sensors["speed"].values[:, 0], truth[:, 2], atol=1e-12)
    imu = made.sensors["imu"].values
    np.testing.assert_allclose(imu[:, 5], truth[:, 5], atol=1e-12)
    # In the bend: 10 m/s on 40 m gives 2.5 m/s^2 to the left, 0.25 rad/s, and g up.
    middle = imu[20 * 22]
    np.testing.assert_allclose(middle, [0, 2.5, G, 0, 0, 0.25], atol=1e-9)


@pytest.mark.parametrize(
    ("sensor", "column", "truth_column", "sigma"),
    [
        pytest.param("gnss", 0, 0, 0.6, id="east"),
        pytest.param("gnss", 1, 1, 0.6, id="north"),
        pytest.param("gnss_heading", 0, 3, np.radians(1.0), id="heading"),
        pytest.param("speed", 0, 2, 0.5, id="speed"),
        pytest.param("imu", 0, 4, 0.049, id="acceleration"),
        pytest.param("imu", 5, 5, np.radians(0.1), id="yaw-rate"),
    ],
)
def test_default_noise_is_that_of_song2016(sensor: str, column: int, truth_column: int, sigma: float) -> None:
    made = drive("curve")
    data = made.sensors[sensor]
    error = data.values[:, column] - truth_at(made, data.stamp_ns)[:, truth_column]
    n = len(error)
    assert n == 36 * 20 + 1
    low, high = chi2.ppf([1e-5, 1 - 1e-5], n)
    assert low < np.sum((error / sigma) ** 2) < high
    assert abs(np.corrcoef(error[:-1], error[1:])[0, 1]) < 4.5 / np.sqrt(n)  # white
    assert data.sigma[column] == pytest.approx(sigma, rel=1e-12)


@pytest.mark.parametrize("latency_s", [-0.05, 0.0, 0.12, 0.3])
def test_latency_is_hidden_in_the_value_and_delay_shows_in_the_log_time(latency_s: float) -> None:
    made = drive("straight", *NO_NOISE, f"sensors.speed.latency_s={latency_s}", "sensors.speed.delay_s=0.08")
    data = made.sensors["speed"]
    np.testing.assert_array_equal(data.log_time_ns - data.stamp_ns, 80_000_000)
    truth = truth_at(made, data.stamp_ns - round(latency_s * NS))[:, 2]
    np.testing.assert_allclose(data.values[:, 0], truth, atol=1e-9)


def test_biases_and_a_pitched_mount_by_hand() -> None:
    made = drive(
        "parallel-lanes",
        *NO_NOISE,
        "sensors.gnss.bias_east_m=2",
        "sensors.speed.bias_mps=-0.5",
        "sensors.gnss_heading.bias_deg=3",
        "sensors.imu.accel_bias_mps2=0.1",
        "sensors.imu.mount_pitch_deg=10",
        "sensors.imu.yaw_rate_bias_dps=1",
    )
    assert made.sensors["gnss"].values[0] == pytest.approx([2, 0, 0])
    assert made.sensors["speed"].values[5, 0] == pytest.approx(19.5)
    assert made.sensors["gnss_heading"].values[5, 0] == pytest.approx(np.radians(3))
    # Nose down by 10 degrees: the forward axis sees -g sin 10 deg = -1.7029 m/s^2.
    expected = [-1.70290 + 0.1, 0, 9.65767, 0, 0, np.radians(1)]
    assert made.sensors["imu"].values[7] == pytest.approx(expected, abs=1e-4)


def test_outage_drops_and_rate() -> None:
    made = drive(
        "straight",
        "sensors.gnss.rate_hz=10",
        "sensors.gnss.phase_s=0.03",
        "sensors.gnss.outages=[[5, 10], [20, 21]]",
        "sensors.speed.drop_probability=0.3",
    )
    gnss = made.sensors["gnss"]
    run_s = (gnss.stamp_ns - made.scenario.start_ns) / NS
    assert run_s[0] == pytest.approx(0.03)
    assert np.median(np.diff(run_s)) == pytest.approx(0.1)
    assert not np.any(((run_s >= 5) & (run_s < 10)) | ((run_s >= 20) & (run_s < 21)))
    assert (len(run_s), gnss.n_lost) == (220 - 60, 60)
    speed = made.sensors["speed"]
    assert len(speed.stamp_ns) + speed.n_lost == 441
    assert 0.2 < speed.n_lost / 441 < 0.4


def test_jitter_lies_between_nothing_and_its_bound_and_log_times_ascend() -> None:
    made = drive("straight", "sensors.imu.jitter_s=0.2", "sensors.imu.delay_s=0.01")
    data = made.sensors["imu"]
    delay_s = (data.log_time_ns - data.stamp_ns) / NS
    assert delay_s.min() >= 0.01
    assert delay_s.max() < 0.21
    assert delay_s.max() - delay_s.min() > 0.15
    assert np.all(np.diff(data.log_time_ns) >= 0)
    assert np.any(np.diff(data.stamp_ns) < 0)  # 0.2 s of jitter at 20 Hz: messages overtake each other


def test_another_sensor_another_vehicle_or_a_loss_changes_no_other_draw() -> None:
    plain = drive("rear-end")
    document_without = dict(plain.scenario.document)
    document_without["sensors"] = {"gnss": {}}
    from cwcli.simulation.scenario import parse_scenario

    alone = simulate_scenario(parse_scenario(document_without, name="alone"), 1)
    np.testing.assert_array_equal(alone.sensors["gnss"].values, plain.sensors["gnss"].values)
    np.testing.assert_array_equal(alone.v2x["lead"].state, plain.v2x["lead"].state)

    lossy = drive("rear-end", "sensors.gnss.drop_probability=0.5", "sensors.gnss.jitter_s=0.01")
    kept = np.isin(plain.sensors["gnss"].stamp_ns, lossy.sensors["gnss"].stamp_ns)
    order = np.argsort(lossy.sensors["gnss"].stamp_ns)
    np.testing.assert_array_equal(lossy.sensors["gnss"].values[order], plain.sensors["gnss"].values[kept])

    more = drive("rear-end", "vehicles.third.speed_mps=5", "vehicles.third.y_m=50")
    np.testing.assert_array_equal(more.v2x["lead"].state, plain.v2x["lead"].state)
    np.testing.assert_array_equal(more.sensors["imu"].values, plain.sensors["imu"].values)


def test_seed_decides_the_draws_and_not_the_truth() -> None:
    one, again, two = drive("rear-end", seed=1), drive("rear-end", seed=1), drive("rear-end", seed=2)
    np.testing.assert_array_equal(one.sensors["gnss"].values, again.sensors["gnss"].values)
    np.testing.assert_array_equal(one.v2x["lead"].state, again.v2x["lead"].state)
    assert not np.any(one.sensors["gnss"].values == two.sensors["gnss"].values)
    np.testing.assert_array_equal(true_states_of_vehicle(one, "lead"), true_states_of_vehicle(two, "lead"))


def test_truth_grid_is_one_millisecond_and_holds_every_vehicle() -> None:
    made = drive("rear-end")
    assert set(made.scenario.vehicles) == {"host", "lead"}
    assert true_states_of_vehicle(made, "lead").shape == (10001, 8)
    assert np.all(np.diff(truth_stamps_ns(made)) == 1_000_000)
    # Until 1.2 s both drive 20 m/s; at 3.45 s the lead has lost 1 m/s^2 * (2.25 - 0.25) s = 2 m/s (ramp of 0.5 s).
    assert true_states_of_vehicle(made, "lead")[1200, :3] == pytest.approx([44.0, 0.0, 20.0])
    assert true_states_of_vehicle(made, "lead")[3450, 2] == pytest.approx(18.0, abs=1e-9)


def test_v2x_noise_is_the_estimated_column_of_table_1() -> None:
    made = drive("intersection", "duration_s=60", "vehicles.other.lateral=[{from_s=0, curvature_1pm=0}]")
    sent = made.v2x["other"]
    error = sent.state - truth_at(made, sent.stamp_ns, "other")[:, :6]
    sigma = np.array([0.15, 0.15, 0.1, np.radians(0.21), 0.0027 * G, np.radians(0.043)])
    np.testing.assert_allclose(sent.sigma, sigma, rtol=2e-3)
    n = len(error)
    assert n == 1201
    low, high = chi2.ppf([1e-5, 1 - 1e-5], n)
    statistic = np.sum((error / sigma) ** 2, axis=0)
    assert np.all((low < statistic) & (statistic < high))


def test_link_loss_latency_jitter_and_order() -> None:
    made = drive(
        "rear-end",
        "duration_s=60",
        "lead.longitudinal=[{from_s=0, accel_mps2=0}]",
        "v2x.rate_hz=10",
        "v2x.delay_s=0.1",
        "v2x.jitter_s=0.25",
        "v2x.drop_probability=0.2",
        "v2x.outages=[[30, 40]]",
    )
    got = made.v2x["lead"]
    delay_s = (got.log_time_ns - got.stamp_ns) / NS
    assert 0.1 <= delay_s.min() < delay_s.max() < 0.35
    assert np.all(np.diff(got.log_time_ns) >= 0)
    assert np.any(np.diff(got.count) < 0)  # overtaken on the way
    run_s = (got.stamp_ns - made.scenario.start_ns) / NS
    assert not np.any((run_s >= 30) & (run_s < 40))
    np.testing.assert_allclose(got.count, run_s * 10, atol=1e-6)  # numbered as sent, so gaps show losses
    assert len(got.stamp_ns) + got.n_lost == 601
    n_lost_on_air = got.n_lost - 100
    assert 0.2 * 501 - 4 * np.sqrt(501 * 0.16) < n_lost_on_air < 0.2 * 501 + 4 * np.sqrt(501 * 0.16)


def test_vehicle_without_v2x_and_scenario_without_link_send_nothing() -> None:
    assert drive("rear-end", "lead.v2x=false").v2x == {}
    assert drive("straight", "vehicles.other.speed_mps=5", "vehicles.other.y_m=50").v2x == {}


HILLY = ("host.slope_deg=3", "host.bounce_deg=0.3", "host.squat_degpmps2=0.4")


def test_pitch_rate_is_the_pitch_s_slope_but_for_turning_on_a_slope() -> None:
    """d pitch / dt = pitch rate - yaw rate * roll: a car that turns on a slope pitches without a pitch rate."""
    made = load_scenario("city", HILLY)
    time_s = np.arange(0.0, 200.0, 1e-3)
    state = made.vehicles["host"].motion.states_at(time_s)
    pitch, roll, rate = made.vehicles["host"].attitude.pitch_roll_and_pitch_rate_at(time_s, state).T
    smooth = np.abs(np.gradient(state[:, 6])) < 0.05  # not where the jerk steps
    smooth[[0, -1]] = False
    difference = np.gradient(pitch, time_s) - (rate - state[:, 5] * roll)
    np.testing.assert_allclose(difference[smooth], 0.0, atol=1e-4)


def test_slope_has_the_sigma_that_is_asked_for() -> None:
    attitude = load_scenario("city", ("host.slope_deg=3",)).vehicles["host"].attitude
    rng = np.random.default_rng(0)
    state = np.zeros((20_000, 8))
    state[:, :2], state[:, 3] = rng.uniform(-2e4, 2e4, (20_000, 2)), rng.uniform(-np.pi, np.pi, 20_000)
    tilt = attitude.pitch_roll_and_pitch_rate_at(np.zeros(len(state)), state)
    np.testing.assert_allclose(np.degrees(tilt[:, :2].std(axis=0)), 3.0, rtol=0.05)


def test_gravity_through_pitch_shows_on_the_forward_axis_and_the_lever_arm_on_the_wheels() -> None:
    made = drive("city", *NO_NOISE, *HILLY, "sensors.speed.lever_arm_m=1.2", "sensors.speed.scale=0.99")
    host = made.scenario.vehicles["host"]

    def true(sensor: str) -> tuple[np.ndarray, np.ndarray]:
        time_s = (made.sensors[sensor].stamp_ns - made.scenario.start_ns) / NS
        state = host.motion.states_at(time_s)
        return state, host.attitude.pitch_roll_and_pitch_rate_at(time_s, state)

    state, tilt = true("imu")
    imu = made.sensors["imu"].values
    np.testing.assert_allclose(imu[:, 0], state[:, 4] * np.cos(tilt[:, 0]) - G * np.sin(tilt[:, 0]), atol=1e-9)
    np.testing.assert_allclose(imu[:, 4], tilt[:, 2], atol=1e-12)
    state, tilt = true("speed")
    expected = 0.99 * (state[:, 2] - 1.2 * tilt[:, 2])
    np.testing.assert_allclose(made.sensors["speed"].values[:, 0], expected, atol=1e-12)


def test_slow_error_of_the_fixes_has_its_sigma_and_time_constant() -> None:
    """Sigma 2 m and, at a lag of 1 s, the time constant, an autocorrelation of exp(-1)."""
    slow = ("sensors.gnss.sigma_m=0", "sensors.gnss.slow_sigma_m=2", "sensors.gnss.slow_time_s=1")
    made = drive("city", *slow)
    data = made.sensors["gnss"]
    error = (data.values[:, :2] - truth_at(made, data.stamp_ns)[:, :2]).T
    assert error.std() == pytest.approx(2.0, rel=0.1)
    lagged = np.mean([np.corrcoef(axis[:-10], axis[10:])[0, 1] for axis in error])
    assert lagged == pytest.approx(np.exp(-1.0), abs=0.1)
