"""`--sigma`: the noise of sensors whose messages state none."""

import numpy as np
import pytest

from cwcli.errors import UsageError
from cwcli.estimation.measurements import QUANTITY_BY_KIND, Kind, Measurements
from cwcli.estimation.prepare import clean_and_sort_measurements_and_note, prepare_without_looking_ahead
from cwcli.estimation.stated_noise import (
    fill_missing_noise_with_stated,
    parse_sigmas_by_role_or_topic,
    require_known_names_and_sigma_counts,
)
from cwcli.signals.role import Role


def speeds(covariance: list[float] | None = None) -> Measurements:
    stated = None if covariance is None else np.array(covariance)
    return Measurements("/speed", Kind.SPEED, np.arange(3), np.full(3, 10.0), stated)


def test_sigmas_are_in_si_units_and_degrees_are_converted() -> None:
    found = parse_sigmas_by_role_or_topic(["ego_speed=0.5", "ego_heading=1deg", "imu=0.05/0.1deg"])
    assert found["ego_speed"] == (0.5,)
    assert found["ego_heading"] == pytest.approx((np.radians(1.0),))
    assert found["imu"] == pytest.approx((0.05, np.radians(0.1)))


@pytest.mark.parametrize(
    "entry", ["ego_speed", "ego_speed=", "ego_speed=0", "ego_speed=-1", "ego_speed=nan", "=1", "a=1/2/3"]
)
def test_a_malformed_entry_is_refused(entry: str) -> None:
    with pytest.raises(UsageError, match="is not NAME=VALUE"):
        parse_sigmas_by_role_or_topic([entry])


def test_a_name_that_comes_twice_is_refused() -> None:
    with pytest.raises(UsageError, match="names ego_speed twice"):
        parse_sigmas_by_role_or_topic(["ego_speed=1", "ego_speed=2"])


def test_only_rows_without_a_stated_noise_get_it() -> None:
    sigmas = {"ego_speed": (0.5,)}
    (bare,) = fill_missing_noise_with_stated([speeds()], Role.EGO_SPEED, sigmas)
    assert bare.covariance is not None
    np.testing.assert_allclose(bare.covariance.ravel(), 0.25)
    (mixed,) = fill_missing_noise_with_stated([speeds([0.04, np.nan, 0.0])], Role.EGO_SPEED, sigmas)
    assert mixed.covariance is not None
    np.testing.assert_allclose(mixed.covariance.ravel(), [0.04, 0.25, 0.25])


def test_a_topic_comes_before_its_role_and_other_quantities_stay() -> None:
    turn = Measurements("/speed", Kind.YAW_RATE, np.arange(3), np.zeros(3))
    done = fill_missing_noise_with_stated([speeds(), turn], Role.EGO_SPEED, {"ego_speed": (0.5,), "/speed": (2.0,)})
    assert done[0].covariance is not None
    assert done[0].covariance[0, 0, 0] == 4.0
    assert done[1] is turn


def test_an_imu_has_one_value_for_each_of_its_sensors() -> None:
    imu = Measurements("/imu", Kind.IMU, np.arange(2), np.zeros((2, 6)))
    (done,) = fill_missing_noise_with_stated([imu], Role.IMU, {"imu": (0.05, 0.002)})
    assert done.covariance is not None
    np.testing.assert_allclose(np.diag(done.covariance[1]), [0.05**2] * 3 + [0.002**2] * 3)
    with pytest.raises(UsageError, match="an IMU needs two values"):
        require_known_names_and_sigma_counts({"imu": (0.05,)}, [], where="a.mcap")
    with pytest.raises(UsageError, match="neither a role nor a topic"):
        require_known_names_and_sigma_counts({"ego_sped": (0.05,)}, ["/speed"], where="a.mcap")


def imu_that_states(accel_variance: float, yaw_rate_variance: float) -> Measurements:
    """An IMU at rest with noise of 0.05 m/s^2 and 0.01 rad/s, whatever its messages say."""
    rng = np.random.default_rng(4)
    values = rng.standard_normal((500, 6)) * ([0.05] * 3 + [0.01] * 3)
    values[:, 2] += 9.81
    variances = np.diag([accel_variance] * 3 + [yaw_rate_variance] * 3)
    stamp_ns = np.arange(500, dtype=np.int64) * 10_000_000
    return Measurements("/imu", Kind.IMU, stamp_ns, values, np.tile(variances, (500, 1, 1)))


def test_noise_that_no_such_sensor_has_is_found_from_the_log_and_said() -> None:
    """Ones on the diagonal are a field that nobody filled: 1 rad/s would leave the gyroscope without any weight."""
    prepared, notes = clean_and_sort_measurements_and_note([imu_that_states(1.0, 1.0)], 0)
    accel, yaw_rate = (each.series for each in prepared)
    assert (accel.noise_origin, yaw_rate.noise_origin) == ("message", "default")
    np.testing.assert_allclose(accel.noise[:, 0], 1.0)  # half of gravity is the limit of an accelerometer
    assert np.sqrt(yaw_rate.noise[0, 0]) == pytest.approx(0.01, rel=0.2)
    assert notes == [
        "/imu: 500 messages state a sigma of the yaw rate of up to 1 rad/s, and no such sensor has 0.3 rad/s: the "
        "noise is found from the log instead"
    ]


def test_noise_within_the_limits_is_taken_as_stated() -> None:
    prepared, notes = clean_and_sort_measurements_and_note([imu_that_states(1.0, 0.04)], 0)
    assert [each.series.noise_origin for each in prepared] == ["message", "message"]
    assert prepared[1].series.noise[0, 0] == pytest.approx(0.04)
    assert notes == []


def test_noise_beyond_the_limits_is_no_noise_without_looking_ahead_either() -> None:
    yaw_rate = prepare_without_looking_ahead([imu_that_states(1.0, 1.0)], 0, {})[1].series
    assert yaw_rate.noise_origin == "default"
    assert np.sqrt(yaw_rate.noise[0, 0]) == QUANTITY_BY_KIND[Kind.YAW_RATE].default_sigma
