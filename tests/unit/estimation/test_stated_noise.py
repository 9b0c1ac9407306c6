"""`--sigma`: the noise of sensors whose messages state none."""

import numpy as np
import pytest

from cwcli.errors import UsageError
from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.stated_noise import (
    apply_stated_noise,
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
    (bare,) = apply_stated_noise([speeds()], Role.EGO_SPEED, sigmas)
    assert bare.covariance is not None
    np.testing.assert_allclose(bare.covariance.ravel(), 0.25)
    (mixed,) = apply_stated_noise([speeds([0.04, np.nan, 0.0])], Role.EGO_SPEED, sigmas)
    assert mixed.covariance is not None
    np.testing.assert_allclose(mixed.covariance.ravel(), [0.04, 0.25, 0.25])


def test_a_topic_comes_before_its_role_and_other_quantities_stay() -> None:
    turn = Measurements("/speed", Kind.YAW_RATE, np.arange(3), np.zeros(3))
    done = apply_stated_noise([speeds(), turn], Role.EGO_SPEED, {"ego_speed": (0.5,), "/speed": (2.0,)})
    assert done[0].covariance is not None
    assert done[0].covariance[0, 0, 0] == 4.0
    assert done[1] is turn


def test_an_imu_has_one_value_for_each_of_its_sensors() -> None:
    imu = Measurements("/imu", Kind.IMU, np.arange(2), np.zeros((2, 6)))
    (done,) = apply_stated_noise([imu], Role.IMU, {"imu": (0.05, 0.002)})
    assert done.covariance is not None
    np.testing.assert_allclose(np.diag(done.covariance[1]), [0.05**2] * 3 + [0.002**2] * 3)
    with pytest.raises(UsageError, match="an IMU needs two values"):
        require_known_names_and_sigma_counts({"imu": (0.05,)}, [], where="a.mcap")
    with pytest.raises(UsageError, match="neither a role nor a topic"):
        require_known_names_and_sigma_counts({"ego_sped": (0.05,)}, ["/speed"], where="a.mcap")
