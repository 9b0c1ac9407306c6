"""Fixes whose stamps err."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cwcli.estimation import EstimatorConfig, Kind, Measurements, estimate_track
from cwcli.estimation.calibrated import with_calibrated_noise_and_stamp_error
from cwcli.estimation.calibration import Calibration, Constant
from cwcli.estimation.model import MotionParameters
from cwcli.estimation.parameter import Parameter, ParameterStatus
from cwcli.estimation.passes import FilterStart, SensorSeries, run_filter_pass
from cwcli.simulation.drive import SimulatedDrive, simulate_scenario
from cwcli.simulation.scenario import load_scenario
from tests.drive_truth import true_states_of_vehicle, truth_stamps_ns
from tests.studies.sensor_model import measurements_of
from tests.studies.stamp_noise import jittered, judged, one_run

FIX_M = 0.05


def drive(seed: int, *overrides: str) -> SimulatedDrive:
    made = load_scenario("curve", overrides)
    return simulate_scenario(
        replace(made, sensors={**made.sensors, "gnss": {**made.sensors["gnss"], "sigma_m": FIX_M}}), seed
    )


def fixes(made: SimulatedDrive, sigma_s: float, seed: int) -> Measurements:
    (found,) = (m for m in jittered(measurements_of(made), sigma_s, "normal", seed) if m.kind is Kind.POSITION)
    return found


def error_of(m: Measurements, made: SimulatedDrive) -> Parameter:
    track = estimate_track([m], EstimatorConfig(), truth_stamps_ns(made)[1000::1000])
    return track.sources[0].stamp_error


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_planted_error_is_found(seed: int) -> None:
    found, _ = one_run("curve", seed, 0.03, "uniform", alone=True, fix_m=FIX_M)
    assert found == pytest.approx(0.03, abs=0.003)


def test_states_are_better_with_the_error_than_without(monkeypatch: pytest.MonkeyPatch) -> None:
    _, better = one_run("city", 1, 0.03, "normal", alone=True, fix_m=FIX_M)
    monkeypatch.setattr("cwcli.estimation.noise.fit_stamp_errors", lambda fit, *_: fit)
    found, worse = one_run("city", 1, 0.03, "normal", alone=True, fix_m=FIX_M)
    assert found == 0.0
    for name in ("hindsight position", "online position", "hindsight speed"):
        assert better[name] < 0.95 * worse[name], name


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_right_stamps_show_no_error(seed: int) -> None:
    made = drive(seed)
    assert error_of(fixes(made, 0.0, seed), made) == Parameter(0.0)


def test_outliers_are_no_error_of_the_stamps() -> None:
    made, rng = drive(0), np.random.default_rng(0)
    right = fixes(made, 0.0, 0)
    wrong = right.values + rng.normal(0.0, 3.0, right.values.shape) * (rng.random(len(right)) < 0.05)[:, None]
    assert error_of(replace(right, values=wrong), made).status is ParameterStatus.OFF


def test_a_standing_car_shows_no_error() -> None:
    rng = np.random.default_rng(1)
    stamp_ns = (np.arange(600) * 100_000_000 + rng.normal(0, 3e7, 600)).astype(np.int64)
    standing = Measurements("/gps", Kind.POSITION, np.sort(stamp_ns), rng.normal(0.0, 0.1, (600, 2)))
    track = estimate_track([standing], EstimatorConfig(), np.arange(1, 50) * 1_000_000_000)
    assert track.sources[0].stamp_error == Parameter(0.0)


def test_blind_online_states_take_no_error_from_the_log() -> None:
    made = drive(0)
    config = EstimatorConfig(causal=True, blind=True)
    track = estimate_track([fixes(made, 0.03, 0)], config, truth_stamps_ns(made)[1000::1000])
    assert track.sources[0].stamp_error == Parameter(0.0)
    assert set(judged(track, true_states_of_vehicle(made, "host")[1000::1000])) >= {"position", "speed"}


def test_a_calibration_gives_the_error() -> None:
    constants = {"/gps": {"position": {"noise_sigma": Constant(value=0.1), "stamp_sigma_s": Constant(value=0.02)}}}
    series = SensorSeries("/gps", Kind.POSITION, np.zeros(1), np.zeros((1, 2)), np.ones((1, 3)))
    known = with_calibrated_noise_and_stamp_error(series, Calibration("car", constants))
    assert (known.stamp_error.value, known.stamp_error.status) == (0.02, ParameterStatus.GIVEN)


def likelihood(
    innovation: tuple[float, float], noise: tuple[float, float, float], sigma_s: float
) -> tuple[float, float]:
    """Log-likelihood of one fix of a car at 8 m/s and 30 degrees, and its slope by the variance of the stamps."""
    state, variance = np.zeros(8), np.full(8, 1e-12)
    state[2:4], variance[:2] = (8.0, np.radians(30.0)), (0.04, 0.09)
    fix = SensorSeries("/gps", Kind.POSITION, np.zeros(1), np.array([innovation]), np.array([noise]))
    fix = replace(fix, stamp_error=Parameter(sigma_s))
    motion = MotionParameters().to_process_model(np.zeros(8))
    found = run_filter_pass(
        [fix], FilterStart(0.0, state, np.diag(variance)), motion, np.zeros(0), smooth=False, reset_after=9
    )
    return found.log_likelihood, float(found.nis[0][0, 4])


@pytest.mark.parametrize("innovation", [(0.0, 0.0), (0.9, 0.4), (-0.3, 1.0)])
def test_slope_of_the_likelihood_equals_finite_differences(innovation: tuple[float, float]) -> None:
    noise, small = (0.25, 0.02, 0.16), 1e-6
    base, slope = likelihood(innovation, noise, 0.0)
    along = likelihood(innovation, noise, small**0.5)[0] - base
    c, s = np.cos(np.radians(30.0)), np.sin(np.radians(30.0))
    grown = np.array(noise) + small * 64.0 * np.array([s * s, -c * s, c * c])  # 64 m^2/s^2, across the way
    across = likelihood(innovation, tuple(grown.tolist()), 0.0)[0] - base
    assert slope == pytest.approx((along - across) / small, rel=2e-3, abs=1e-3)


def motorway(seed: int, sigma_s: float, speed_mps: float, begin_s: float, gap_s: tuple[float, float]) -> float:
    """The largest error, m, of ten seconds of states in hindsight from fixes good to 5 cm, ten a second."""
    rng, grid_s = np.random.default_rng(seed), np.arange(0.0, 301.0, 0.005)
    speed, heading = speed_mps + 3.0 * np.sin(grid_s / 20.0), 0.05 * np.sin(grid_s / 15.0)
    way = np.cumsum(speed * np.array([np.cos(heading), np.sin(heading)]), axis=1) * 0.005
    time_s = np.arange(0.0, 300.0, 0.1)
    fix = np.array([np.interp(time_s, grid_s, axis) for axis in way]).T + rng.normal(0.0, FIX_M, (len(time_s), 2))
    kept = (time_s < gap_s[0]) | (time_s > gap_s[1])
    stamp_ns = np.rint((1.0 + time_s + rng.normal(0.0, sigma_s, len(time_s))) * 1e9).astype(np.int64)
    outputs_s = np.arange(begin_s, begin_s + 10.0, 0.05)
    track = estimate_track(
        [Measurements("/gps", Kind.POSITION, stamp_ns[kept], fix[kept])],
        EstimatorConfig(),
        np.rint((1.0 + outputs_s) * 1e9).astype(np.int64),
    )
    truth = np.array([np.interp(outputs_s, grid_s, axis) for axis in way]).T
    return float(np.hypot(*(track.state[:, :2] - truth).T).max())


@pytest.mark.parametrize(("seed", "sigma_s"), [(3, 0.05), (6, 0.05), (3, 0.08), (6, 0.08)])
def test_start_bears_stamps_that_err(seed: int, sigma_s: float) -> None:
    """A fix errs by 1.65 m or 2.64 m along the way, one sigma."""
    assert motorway(seed, sigma_s, 33.0, 2.0, (1e9, 1e9)) < 1.0


@pytest.mark.parametrize("seed", [0, 2, 4])
def test_start_behind_a_gap_bears_stamps_that_err(seed: int) -> None:
    """A fix errs by 1.4 m along the way, one sigma."""
    assert motorway(seed, 0.1, 14.0, 121.0, (100.0, 120.0)) < 1.0


def sine_drive(seed: int, sigma_s: float, fix_m: float = FIX_M) -> tuple[Measurements, np.ndarray, np.ndarray]:
    """Five minutes of fixes at 9 to 21 m/s through wide bends; the place of each and its speed are the truth."""
    rng, grid_s = np.random.default_rng(seed), np.arange(0.0, 301.0, 0.005)
    speed, heading = 15.0 + 6.0 * np.sin(grid_s / 5.0), 0.3 * np.sin(grid_s / 15.0)
    way = np.cumsum(speed * np.array([np.cos(heading), np.sin(heading)]), axis=1) * 0.005
    time_s = np.arange(0.0, 300.0, 0.1)
    truth = np.array([np.interp(time_s, grid_s, axis) for axis in (*way, speed)]).T
    fix = truth[:, :2] + rng.normal(0.0, fix_m, (len(time_s), 2))
    stamp_ns = np.rint((1.0 + time_s + rng.normal(0.0, sigma_s, len(time_s))) * 1e9).astype(np.int64)
    return Measurements("/gps", Kind.POSITION, stamp_ns, fix), truth, np.rint((1.0 + time_s) * 1e9).astype(np.int64)


@pytest.mark.parametrize(("stated_m", "white_m"), [(0.05, 0.05), (0.3, 0.3), (0.005, 0.005), (0.5, 0.05)])
def test_what_a_message_states_is_never_lowered(stated_m: float, white_m: float) -> None:
    fixes, _, output_ns = sine_drive(0, 0.06, white_m)
    stated = replace(fixes, covariance=np.tile(np.eye(2) * stated_m**2, (len(fixes), 1, 1)))
    (report,) = estimate_track([stated], EstimatorConfig(), output_ns).sources
    assert report.stamp_error.value == pytest.approx(0.06, rel=0.2)
    assert report.noise_scale >= 1.0 - 1e-9
    assert report.sigma < max(1.3 * stated_m, 2.0 * FIX_M)


@pytest.mark.parametrize(("seed", "sigma_s"), [(0, 0.03), (0, 0.1), (1, 0.06)])
def test_white_noise_stays_beside_an_error_of_the_stamps(seed: int, sigma_s: float) -> None:
    fixes, _, output_ns = sine_drive(seed, sigma_s)
    (report,) = estimate_track([fixes], EstimatorConfig(), output_ns).sources
    assert report.stamp_error.value == pytest.approx(sigma_s, rel=0.1)
    assert report.sigma == pytest.approx(FIX_M, rel=0.5)


@pytest.mark.parametrize("seed", range(6))
def test_errors_that_last_are_none_of_the_stamps(seed: int) -> None:
    fixes, _, output_ns = sine_drive(seed, 0.0)
    rng, kept = np.random.default_rng((seed, 1)), np.exp(-0.1 / 1.0)
    slow = 0.5 * rng.normal(size=fixes.values.shape)
    for i in range(1, len(slow)):
        slow[i] = kept * slow[i - 1] + (1.0 - kept**2) ** 0.5 * slow[i]
    track = estimate_track([replace(fixes, values=fixes.values + slow)], EstimatorConfig(), output_ns[::100])
    assert track.sources[0].stamp_error.value == 0.0
