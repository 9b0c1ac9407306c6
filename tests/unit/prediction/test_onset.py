"""The hypothesis that a manoeuvre goes on, by hand."""

import numpy as np
import pytest

from cwcli.prediction.driver import DriverPrior
from cwcli.prediction.models.onset import MODEL
from cwcli.prediction.rollout import roll_out_paths

NONE = np.zeros((1, 8, 8))


def one(v: float, a: float = 0.0, w: float = 0.0, j: float = 0.0, dw: float = 0.0) -> np.ndarray:
    return np.array([[0.0, 0.0, v, 0.0, a, w, j, dw]])


def test_braking_grows_until_five_and_stays_there() -> None:
    # a = -1 - 4 t reaches -5 after 1 s; v = 30 - t - 2 t^2 = 27 there, then 27 - 5 (t - 1)
    paths = roll_out_paths("onset", one(30.0, a=-1.0, j=-4.0), None)
    assert paths.speed_mps[0, 20] == pytest.approx(27.0)
    assert paths.speed_mps[0, 50] == pytest.approx(19.5)
    # 30 - 1/2 - 4/6 m in the first second, 27 * 1.5 - 5 * 1.5^2 / 2 after it
    assert paths.x_m[0, 50] == pytest.approx(30.0 - 0.5 - 2.0 / 3.0 + 40.5 - 5.625)


def test_turning_in_ends_at_four_of_lateral_acceleration() -> None:
    # 10 m/s: 0.4 rad/s, reached after 2 s of 0.2 rad/s^2: 0.4 rad, and 0.2 rad in the last half second
    paths = roll_out_paths("onset", one(10.0, dw=0.2), None)
    assert paths.heading_rad[0, 40] == pytest.approx(0.4)
    assert paths.heading_rad[0, 50] == pytest.approx(0.6)


def test_car_beyond_the_limit_brakes_no_harder() -> None:
    held = roll_out_paths("onset", one(30.0, a=-7.0, j=-4.0), None)
    steady = roll_out_paths("ca", one(30.0, a=-7.0), None)
    np.testing.assert_allclose(held.x_m, steady.x_m, atol=1e-9)


def test_easing_off_ends_at_the_other_limit() -> None:
    # a = -4 + 4 t: 0 after 1 s, full throttle is out of reach within 2.25 s
    paths = roll_out_paths("onset", one(20.0, a=-4.0, j=4.0), None)
    assert paths.speed_mps[0, -1] == pytest.approx(20.0 - 4.0 * 2.5 + 2.0 * 2.25**2 + 9.0 * 0.25)


def test_derivatives_within_the_noise_are_left_out() -> None:
    covariance = NONE.copy()
    covariance[0, 6, 6], covariance[0, 7, 7] = 1.0, 0.01
    prior = DriverPrior()
    assert MODEL.trust(one(20.0, j=0.9, dw=0.19), covariance, prior)[0, [1, 3]] == pytest.approx([0.0, 0.0])
    # 1 - 1 / 2^2 and 1 - 4 * 0.01 / 0.4^2
    assert MODEL.trust(one(20.0, j=-2.0, dw=0.4), covariance, prior)[0, [1, 3]] == pytest.approx([0.75, 0.75])
    assert MODEL.trust(one(20.0), covariance, prior)[0, [1, 3]] == pytest.approx([0.0, 0.0])


def test_stopping_car_stays_stopped() -> None:
    # v = 2 - 2 t^2 is 0 after 1 s and 4/3 m
    paths = roll_out_paths("onset", one(2.0, j=-4.0), None)
    assert (paths.speed_mps[0, 20:] == 0.0).all()
    assert paths.x_m[0, -1] == pytest.approx(4.0 / 3.0)
