"""Pooling of logs, and estimates with what they say."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cwcli.errors import UsageError
from cwcli.estimation import EstimatorConfig, Kind, LatencyStatus, Measurements, estimate_track
from cwcli.estimation.calibration import Calibration, Constant, ConstantStatus
from cwcli.estimation.imu import ImuMounting
from cwcli.estimation.net_acceleration import reports_without_net_acceleration
from cwcli.estimation.pooling import (
    ConstantOfDrive,
    DriveEvidence,
    calibrate_from_drives,
    pool_constant_over_drives,
)
from cwcli.estimation.result import SourceReport
from cwcli.estimation.track import estimate_hindsight_and_online_tracks
from tests.studies.city_drive import EPOCH_NS, city_drive, measure

LATE = {"gnss": 0.12, "speed": 0.04}
DURATION_S = 120.0


def test_logs_that_agree_are_weighted_by_their_variances() -> None:
    """10 +- 1 and 13 +- 2: weights 4 to 1, so 10.6 +- 0.894; chi-square 0.36 + 1.44."""
    found = pool_constant_over_drives([ConstantOfDrive(10.0, 1.0, 5.0), ConstantOfDrive(13.0, 2.0, 7.0)])
    assert (found.status, found.n_logs, found.minutes) == (ConstantStatus.FOUND, 2, 12.0)
    assert (found.value, found.sigma, found.chi_square) == pytest.approx((10.6, math.sqrt(0.8), 1.8))
    assert found.spread == 0.0


def test_logs_that_disagree_have_a_spread_and_are_weighted_alike() -> None:
    """0 and 10, each +- 1: chi-square 50, allowed are 6.6; tau^2 = (50 - 1) / (2 - 1), sigma^2 = (1 + 49) / 2."""
    found = pool_constant_over_drives([ConstantOfDrive(0.0, 1.0, 5.0), ConstantOfDrive(10.0, 1.0, 5.0)])
    assert found.status is ConstantStatus.DISAGREE
    assert (found.value, found.spread, found.sigma) == pytest.approx((5.0, 7.0, 5.0))


def test_a_new_drive_of_logs_that_disagree_is_known_by_their_scatter_alone() -> None:
    """As above: mean +- 5, from drive to drive 7; Student's quantile of one degree of freedom is 12.706."""
    found = pool_constant_over_drives(
        [ConstantOfDrive(0.0, 1.0, 5.0, "monday"), ConstantOfDrive(10.0, 1.0, 5.0, "tuesday")]
    )
    assert found.sigma_in_another_drive == pytest.approx(math.hypot(5.0, 7.0) * 12.706 / 1.96, rel=1e-3)
    assert found.interval_of_95_percent_of_drives == pytest.approx(
        (5.0 - 12.706 * math.hypot(5.0, 7.0), 5.0 + 12.706 * math.hypot(5.0, 7.0)), rel=1e-3
    )
    assert found.i_squared_between_drives == pytest.approx(1.0 - 1.0 / 50.0)
    assert found.of_logs == (("monday", 0.0, 1.0), ("tuesday", 10.0, 1.0))


@pytest.mark.parametrize("pitch_deg", [0.0, 10.0])
@pytest.mark.parametrize("end_mps", [0.0, 20.0])
def test_a_drive_that_ends_faster_is_not_taken_for_a_tilted_imu(pitch_deg: float, end_mps: float) -> None:
    """From 0 to 20 m/s in 20 s is 1 m/s^2, which looks like 5.8 degrees."""
    up = 9.80665 * np.array([math.sin(math.radians(pitch_deg)), 0.0, math.cos(math.radians(pitch_deg))])
    forward = np.array([math.cos(math.radians(pitch_deg)), 0.0, -math.sin(math.radians(pitch_deg))])
    force = np.tile(up + end_mps / 20.0 * forward, (2000, 1))
    taken = ImuMounting.from_mean_specific_force(force, np.zeros((2000, 3)))
    assert taken is not None
    state = np.zeros((2, 8))
    state[1, 2] = end_mps
    report = SourceReport("/imu", Kind.ACCEL, mounting=taken)
    (found,) = (each.mounting for each in reports_without_net_acceleration([report], np.array([0, 20 * 10**9]), state))
    assert found is not None
    assert math.degrees(found.nose_up_rad) == pytest.approx(pitch_deg, abs=1e-4)
    assert found.left_up_rad == taken.left_up_rad


def test_intervals_of_new_drives_hold_what_they_say() -> None:
    """4 drives that differ by five times their sigmas: 95 % of the next drives lie in the interval (400 cars)."""
    rng = np.random.default_rng(0)
    n_inside = 0
    for _ in range(400):
        values = 0.1 + rng.normal(0.0, 0.05, 5) + rng.normal(0.0, 0.01, 5)
        low, high = pool_constant_over_drives(
            [ConstantOfDrive(value, 0.01, 5.0) for value in values[:4]]
        ).interval_of_95_percent_of_drives
        n_inside += low <= values[4] - rng.normal(0.0, 0.01) <= high
    assert n_inside / 400 > 0.9


def test_drives_that_agree_are_pooled_as_sharply_as_their_number_allows() -> None:
    """10 drives without a difference: the sigma falls by the root of 10, and the same one counts for the next drive."""
    rng = np.random.default_rng(1)
    sharp = 0
    for _ in range(200):
        found = pool_constant_over_drives([ConstantOfDrive(value, 0.01, 5.0) for value in rng.normal(0.1, 0.01, 10)])
        sharp += found.sigma_in_another_drive == pytest.approx(0.01 / math.sqrt(10.0))
    assert sharp >= 180  # one in twenty is taken for drives that differ


@pytest.mark.parametrize(
    ("values_s", "is_clear"),
    [((-0.057, -0.127), False), ((0.02, 0.06), False), ((0.11, 0.12), True), ((0.1, 0.1), True)],
)
def test_latency_that_drives_disagree_on_counts_only_where_it_is_clear(
    values_s: tuple[float, ...], is_clear: bool
) -> None:
    assert (
        pool_constant_over_drives([ConstantOfDrive(value, 0.002, 5.0) for value in values_s]).is_usable_in_any_drive
        == is_clear
    )


def test_logs_that_say_nothing_do_not_count() -> None:
    found = pool_constant_over_drives(
        [ConstantOfDrive(math.nan, 1.0, 5.0), ConstantOfDrive(1.0, math.nan, 5.0), ConstantOfDrive(2.0, 0.5, 5.0)]
    )
    assert (found.value, found.sigma, found.n_logs) == (2.0, 0.5, 1)
    assert not pool_constant_over_drives([]).has_value
    assert pool_constant_over_drives([]).status is ConstantStatus.NOT_OBSERVABLE


@pytest.fixture(scope="module")
def car() -> Calibration:
    """Three drives."""
    drives = [measure(city_drive(seed, DURATION_S), seed, LATE) for seed in range(3)]
    return calibrate_from_drives(
        [DriveEvidence(f"{k}", estimate_track(m, EstimatorConfig())) for k, m in enumerate(drives)], "car.toml"
    )


def test_constants_of_a_simulated_car_are_within_three_sigma(car: Calibration) -> None:
    truth = {
        ("gnss", Kind.POSITION, "latency_s"): 0.12,
        ("speed", Kind.SPEED, "latency_s"): 0.04,
        ("heading", Kind.HEADING, "latency_s"): 0.0,
        ("imu", Kind.ACCEL, "bias"): -0.4,
        ("imu", Kind.YAW_RATE, "bias"): 0.004,
        ("gnss", Kind.POSITION, "noise_sigma"): 0.6,
    }
    for (source, kind, name), value in truth.items():
        constant = car.find_constant_or_unknown(source, kind, name)
        assert abs(constant.value - value) < 3.0 * constant.sigma, name
        assert constant.n_logs == 3
    assert car.find_constant_or_unknown("gnss", Kind.POSITION, "latency_s").sigma < 0.006
    assert car.minutes == pytest.approx(6.0, abs=0.1)
    assert car.evidence["accel_rms_mps2"] > 0.5


def test_an_imu_that_is_late_in_every_drive_is_found_late() -> None:
    """In drives of a minute each alone is hardly sure of 50 ms; all together are."""
    drives = [measure(city_drive(seed, 90.0), seed, {"imu": 0.05}) for seed in range(4)]
    car = calibrate_from_drives([DriveEvidence("", estimate_track(m, EstimatorConfig())) for m in drives])
    late = car.find_constant_or_unknown("imu", Kind.YAW_RATE, "latency_s")
    assert late.value == pytest.approx(0.05, abs=max(3.0 * late.sigma, 0.005))
    assert car.find_constant_or_unknown("gnss", Kind.POSITION, "latency_s").value == pytest.approx(0.0, abs=0.02)


def test_causal_estimate_with_a_calibration_knows_nothing_of_what_comes_later(car: Calibration) -> None:
    """Leaving the log's second half out, or spoiling it, changes no state of the first half."""
    whole = measure(city_drive(9, DURATION_S), 9, LATE)
    half_ns = EPOCH_NS + 60_000_000_000
    first = [m.select_rows(m.stamp_ns < half_ns) for m in whole]
    rng = np.random.default_rng(0)
    spoilt = [replace(m, values=m.values.copy()) for m in whole]
    for m in spoilt:
        m.values[m.stamp_ns >= half_ns] *= 3.0 * rng.random()
    output_ns = EPOCH_NS + np.arange(1_000_000_000, 59_500_000_000, 50_000_000)
    config = EstimatorConfig(causal=True, calibration=car)
    tracks = [estimate_track(measurements, config, output_ns) for measurements in (whole, first, spoilt)]
    for other in tracks[1:]:
        np.testing.assert_array_equal(other.state, tracks[0].state)
        np.testing.assert_array_equal(other.covariance, tracks[0].covariance)
    # Without one the noise and the latencies come from the whole log.
    looked_ahead = [estimate_track(m, EstimatorConfig(causal=True), output_ns).state for m in (whole, first)]
    assert not np.array_equal(looked_ahead[0], looked_ahead[1])


def test_online_states_use_the_calibration_as_the_causal_estimate_does(car: Calibration) -> None:
    """Without a search whose result would not count: latencies, biases and states are the same."""
    measurements = measure(city_drive(9, 60.0), 9, LATE)
    output_ns = EPOCH_NS + np.arange(1_000_000_000, 59_500_000_000, 50_000_000)
    _, online = estimate_hindsight_and_online_tracks(
        measurements, EstimatorConfig(calibration=car), output_ns, blind=True
    )
    causal = estimate_track(measurements, EstimatorConfig(causal=True, calibration=car), output_ns)
    assert [each.latency.applied_s for each in online.sources] == [each.latency.applied_s for each in causal.sources]
    assert any(each.latency.applied_s > 0.1 for each in online.sources)
    np.testing.assert_allclose(online.state, causal.state, atol=1e-6)


def test_with_the_smoother_the_calibration_is_weighed_with_the_log(car: Calibration) -> None:
    measurements = measure(city_drive(9, DURATION_S), 9, LATE)
    alone = estimate_track(measurements, EstimatorConfig()).sources[0].latency
    both = estimate_track(measurements, EstimatorConfig(calibration=car)).sources[0].latency
    prior = car.find_constant_or_unknown("gnss", Kind.POSITION, "latency_s")
    assert both.status is LatencyStatus.CALIBRATED
    # The IMU is levelled by the calibration, not by the drive: that moves the last digits.
    assert both.sigma_s == pytest.approx((alone.sigma_s**-2 + prior.sigma**-2) ** -0.5, rel=1e-3)
    assert min(alone.found_s, prior.value) <= both.found_s <= max(alone.found_s, prior.value)


@pytest.mark.parametrize("causal", [False, True])
def test_log_that_contradicts_is_told(car: Calibration, causal: bool) -> None:
    """The receiver is 300 ms later than ever before, and the accelerometer reads 1 m/s^2 more."""
    measurements = measure(city_drive(9, DURATION_S), 9, {**LATE, "gnss": 0.42})
    more = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    measurements = [replace(m, values=m.values + more) if m.kind is Kind.IMU else m for m in measurements]
    track = estimate_track(measurements, EstimatorConfig(causal=causal, calibration=car))
    (note,) = (note for note in track.notes if note.startswith("gnss: position is late"))
    assert ("the calibration counts" if causal else "the log counts") in note
    assert any(note.startswith("imu: the bias of accel") for note in track.notes)
    assert track.sources[0].latency.applied_s == pytest.approx(0.12 if causal else 0.42, abs=0.03)


def test_calibration_of_another_car_is_refused(car: Calibration) -> None:
    measurements = [replace(m, source=f"/other/{m.source}") for m in measure(city_drive(9, 60.0), 9, LATE)]
    for causal in (False, True):
        with pytest.raises(UsageError, match="not the calibration of this car") as found:
            estimate_track(measurements, EstimatorConfig(causal=causal, calibration=car))
        assert "car.toml" in str(found.value)


def test_source_that_the_calibration_does_not_know_is_told(car: Calibration) -> None:
    measurements = measure(city_drive(9, 60.0), 9, LATE)
    heading = measure(city_drive(9, 60.0), 10, LATE)[2]  # with noise of its own: a copy would be left out
    more = Measurements("compass", Kind.HEADING, heading.stamp_ns, heading.values)
    for causal, used in ((False, True), (True, False)):
        track = estimate_track([*measurements, more], EstimatorConfig(causal=causal, calibration=car))
        assert any("compass: the calibration car.toml does not know it" in note for note in track.notes)
        assert (track.sources[-1].n_used > 0) == used


def test_given_latency_counts_before_the_calibration(car: Calibration) -> None:
    measurements = measure(city_drive(9, 60.0), 9, LATE)
    config = EstimatorConfig(causal=True, calibration=car, latency={"gnss": 0.2})
    assert estimate_track(measurements, config).sources[0].latency.applied_s == 0.2


def test_constant_that_no_log_shows_is_not_observable() -> None:
    rng = np.random.default_rng(0)
    stamp_ns = EPOCH_NS + np.arange(0, 100_000_000_000, 50_000_000)
    at_rest = np.tile([0.1, 0.0, 9.81, 0.0, 0.0, 0.0], (len(stamp_ns), 1))
    parked = [
        Measurements("gnss", Kind.POSITION, stamp_ns, rng.standard_normal((len(stamp_ns), 2))),
        Measurements("imu", Kind.IMU, stamp_ns, at_rest + 0.01 * rng.standard_normal(at_rest.shape)),
    ]
    car = calibrate_from_drives([DriveEvidence("", estimate_track(parked, EstimatorConfig()))])
    assert car.find_constant_or_unknown("gnss", Kind.POSITION, "latency_s").status is ConstantStatus.NOT_OBSERVABLE
    assert car.find_constant_or_unknown("gnss", Kind.POSITION, "latency_s") == replace(Constant(), n_logs=0)


OUTPUT_NS = EPOCH_NS + np.arange(1_000_000_000, DURATION_S * 1e9 - 1e9, 50_000_000).astype(np.int64)


def car_of(*late_s: float) -> Calibration:
    """From a drive each with fixes that are so late."""
    drives = [measure(city_drive(seed, DURATION_S), seed, {"gnss": late}) for seed, late in enumerate(late_s)]
    return calibrate_from_drives(
        [DriveEvidence(f"drive {k}", estimate_track(m, EstimatorConfig())) for k, m in enumerate(drives)], "car"
    )


@pytest.fixture(scope="module")
def disagreeing() -> Calibration:
    """Fixes 57 ms early in one drive and 127 ms in another: -92 +- 35 ms, pooled."""
    return car_of(-0.057, -0.127)


def test_drives_that_disagree_do_no_harm_to_a_third_one(disagreeing: Calibration) -> None:
    latency = disagreeing.find_constant_or_unknown("gnss", Kind.POSITION, "latency_s")
    assert latency.status is ConstantStatus.DISAGREE
    assert latency.value == pytest.approx(-0.092, abs=0.02)
    third = measure(city_drive(7, DURATION_S), 7, {})
    truth = city_drive(7, DURATION_S).at((OUTPUT_NS - EPOCH_NS) / 1e9)
    true_xy = np.column_stack([truth["x_m"], truth["y_m"]])
    without = estimate_track(third, EstimatorConfig(causal=True), OUTPUT_NS)
    hindsight, online = estimate_hindsight_and_online_tracks(
        third, EstimatorConfig(calibration=disagreeing), OUTPUT_NS, blind=True
    )
    rmse_m = [float(np.sqrt(((t.state[:, :2] - true_xy) ** 2).sum(axis=1).mean())) for t in (without, online)]
    assert rmse_m[1] < 1.1 * rmse_m[0]
    for track in (hindsight, online):
        position = next(each for each in track.sources if each.source == "gnss")
        assert position.latency.applied_s == 0.0
        assert position.n_resets == 0
        assert any("disagree on the latency of position (-9" in note for note in track.notes)
        assert not any("makes this log worse" in note for note in track.notes)


def test_calibration_that_makes_a_log_worse_is_told_with_both_values(car: Calibration) -> None:
    """The car's receiver is 120 ms late, and not late at all in this drive."""
    other = measure(city_drive(7, DURATION_S), 7, {"speed": LATE["speed"]})
    for causal in (False, True):
        config = EstimatorConfig(calibration=car, causal=causal)
        track, _ = estimate_hindsight_and_online_tracks(other, config, OUTPUT_NS, blind=True)
        (note,) = (note for note in track.notes if "makes this log worse" in note)
        assert "predicts the position of gnss" in note
        assert "latency of gnss position found on it: " in note
        assert ", calibrated: 12" in note or ", calibrated: 11" in note


def test_calibration_that_fits_is_not_called_worse(car: Calibration) -> None:
    for seed in (20, 21, 22):
        same = measure(city_drive(seed, DURATION_S), seed, LATE)
        track, _ = estimate_hindsight_and_online_tracks(same, EstimatorConfig(calibration=car), OUTPUT_NS, blind=True)
        assert not any("makes this log worse" in note for note in track.notes)


def test_calibrated_biases_do_not_make_the_noise_greater(car: Calibration) -> None:
    """The noise of a log is found about the biases that it has, whatever is known of them before."""
    same = measure(city_drive(9, DURATION_S), 9, LATE)
    alone, both = (estimate_track(same, EstimatorConfig(calibration=each), OUTPUT_NS) for each in (None, car))
    for own, calibrated_report in zip(alone.sources, both.sources, strict=True):
        assert calibrated_report.sigma == pytest.approx(own.sigma, rel=0.1), own.kind
        assert calibrated_report.nis_mean == pytest.approx(own.nis_mean, rel=0.1), own.kind


def test_source_that_the_latencies_are_against_is_the_reference(car: Calibration) -> None:
    constant = car.find_constant_or_unknown("imu", Kind.ACCEL, "latency_s")
    assert (constant.status, constant.value) == (ConstantStatus.REFERENCE, 0.0)
    track = estimate_track(measure(city_drive(9, 60.0), 9, LATE), EstimatorConfig(calibration=car, causal=True))
    assert next(r for r in track.sources if r.kind is Kind.ACCEL).latency.status is LatencyStatus.REFERENCE
