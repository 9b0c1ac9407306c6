"""Measures of two predicted paths, by hand: head-on, rear-end, crossing, parallel, stopped, overtaking."""

import math

import numpy as np
import pytest
from scipy import stats

from cwcli.prediction.paths import Paths
from cwcli.signals.normal_distribution import normal_cdf
from cwcli.warning.collision import PathPairs
from cwcli.warning.measures import Measures, add_contact_probabilities, measure_paths
from cwcli.warning.remote_alignment import interpolate_paths
from tests.unit.warning.vehicles import straight

TIME_S = np.arange(51.0) * 0.05
CAR = (4.5, 1.8)


def between(host_paths: Paths, other_paths: Paths) -> Measures:
    row, zero = np.array([0]), np.array([0.0])
    measured = measure_paths(
        interpolate_paths(host_paths, row, zero, TIME_S),
        interpolate_paths(other_paths, row, zero, TIME_S),
        TIME_S,
        horizon_s=2.5,
        radius_m=2.5,
        host_size=CAR,
        other_size=CAR,
    )
    pairs = PathPairs(host_paths, other_paths, row, row, zero, CAR, CAR)
    return add_contact_probabilities(
        measured, pairs, TIME_S, horizon_s=2.5, min_probability_to_brake=0.0, braking_deceleration_mps2=2.0
    )


def at(sigma_m: float = 0.01, **values: float) -> Paths:
    paths = straight("car", duration_s=0.0, sigma_m=sigma_m, **values).paths  # type: ignore[arg-type]
    assert isinstance(paths, Paths)
    return paths


def test_head_on() -> None:
    found = between(at(speed_mps=15.0), at(x_m=60.0, speed_mps=10.0, heading_rad=math.pi))
    assert found.distance_m[0] == pytest.approx(60.0)
    assert found.closing_mps[0] == pytest.approx(25.0)
    assert found.ttc_s[0] == pytest.approx(2.4)
    assert found.entry_s[0] == pytest.approx((60.0 - 2.5) / 25.0)
    assert found.overlap_s[0] == pytest.approx((60.0 - 4.5) / 25.0)
    assert found.min_distance_m[0] == pytest.approx(0.0, abs=1e-9)
    assert found.min_time_s[0] == pytest.approx(2.4)
    assert found.horizon_distance_m[0] == pytest.approx(2.5)


def test_rear_end_with_a_braking_lead() -> None:
    # 20 m ahead, both 20 m/s, the lead brakes with 8 m/s^2: 20 - 4 t^2 = 2.5 at sqrt(17.5 / 4)
    found = between(at(speed_mps=20.0), at(x_m=20.0, speed_mps=20.0, accel_mps2=-8.0))
    assert found.entry_s[0] == pytest.approx(math.sqrt(17.5 / 4.0), abs=5e-4)  # between points 5 ms of curve
    assert found.overlap_s[0] == pytest.approx(math.sqrt(15.5 / 4.0), abs=5e-4)
    assert found.ttc_s[0] == math.inf
    assert found.horizon_distance_m[0] == pytest.approx(5.0, abs=1e-6)  # 20 - 25: past each other on paper


def test_stopped_car_ahead() -> None:
    found = between(at(speed_mps=10.0), at(x_m=27.0, speed_mps=0.0))
    assert found.entry_s[0] == pytest.approx(2.45)
    assert found.overlap_s[0] == pytest.approx(2.25)


def test_crossing() -> None:
    # both reach the crossing after 2 s: r = (20 - 10 t)(1, -1), 2.5 m when 20 - 10 t = 2.5 / sqrt(2)
    found = between(at(x_m=-20.0, speed_mps=10.0), at(y_m=-20.0, speed_mps=10.0, heading_rad=math.pi / 2))
    assert found.entry_s[0] == pytest.approx(2.0 - 0.25 / math.sqrt(2.0))
    # flank and front: 20 - 10 t = 2.25 + 0.9
    assert found.overlap_s[0] == pytest.approx(1.685)
    assert found.closing_mps[0] == pytest.approx(10.0 * math.sqrt(2.0))


def test_crossing_with_a_near_miss() -> None:
    # the other is 4 sqrt(2) m late: the miss distance across the relative motion is 4 m
    found = between(
        at(x_m=-20.0, speed_mps=10.0), at(y_m=-20.0 - 4.0 * math.sqrt(2.0), speed_mps=10.0, heading_rad=math.pi / 2)
    )
    assert found.min_distance_m[0] == pytest.approx(4.0)
    assert found.entry_s[0] == math.inf
    # the outlines are longer than the circle: along both ways they overlap from 20 + 4 sqrt(2) - 3.15 = 10 t on
    assert found.overlap_s[0] == pytest.approx(
        (20.0 + 4.0 * math.sqrt(2.0) - 3.15) / 10.0, abs=5e-3
    )  # between two points
    assert found.probability[0] > 0.5  # by a corner alone


def test_parallel_and_overtaking() -> None:
    # 3.5 m to the left, 10 m behind, 5 m/s faster: beside after 2 s
    found = between(at(speed_mps=20.0), at(x_m=-10.0, y_m=3.5, speed_mps=25.0))
    assert found.min_distance_m[0] == pytest.approx(3.5)
    assert found.min_time_s[0] == pytest.approx(2.0)
    assert found.overlap_s[0] == math.inf
    assert found.probability[0] < 0.01


def test_passing_between_two_points_of_the_paths_is_seen() -> None:
    # 100 m/s of closing speed: 5 m a step; the closest approach falls between two points
    found = between(at(speed_mps=50.0), at(x_m=102.4, y_m=1.0, speed_mps=50.0, heading_rad=math.pi))
    assert found.min_distance_m[0] == pytest.approx(1.0)
    assert found.entry_s[0] == pytest.approx((102.4 - math.sqrt(2.5**2 - 1.0)) / 100.0)


def test_the_probability_across_is_a_normal_one() -> None:
    # the lines of the centres are 3 m apart, the widths touch at 1.8 m; 1 m of sigma each, so sqrt(2) across
    found = between(at(1.0, speed_mps=20.0), at(1.0, x_m=60.0, y_m=3.0, speed_mps=20.0, heading_rad=math.pi))
    sigma = math.sqrt(2.0 * (1.0 + driver_cross_m2(1.5)))
    expected = stats.norm.cdf((1.8 - 3.0) / sigma) - stats.norm.cdf((-1.8 - 3.0) / sigma)
    assert found.probability[0] == pytest.approx(expected, abs=0.005)


def driver_cross_m2(time_s: float) -> float:
    """What the driver's noise adds across the path after a time, at 20 m/s."""
    certain = straight("car", speed_mps=20.0, duration_s=0.0, sigma_m=0.0).paths
    assert isinstance(certain, Paths)
    return float(certain.position_covariance_m2[0, round(time_s / 0.05), 2])


def test_probability_is_a_half_where_the_outlines_touch_at_the_horizon() -> None:
    # head-on, the mean paths' outlines touch at 2.5 s exactly: as likely sooner as later
    found = between(at(0.3, speed_mps=20.0), at(0.3, x_m=104.5, speed_mps=20.0, heading_rad=math.pi))
    assert found.probability[0] == pytest.approx(0.5, abs=0.005)


def test_normal_cdf_against_scipy() -> None:
    z = np.linspace(-9.0, 9.0, 1801)
    np.testing.assert_allclose(normal_cdf(z), stats.norm.cdf(z), rtol=3e-7)


def test_probability_of_a_pair_that_has_passed_is_small() -> None:
    """The lead pulls away: on the line of a collision, but behind it in time."""
    found = between(at(speed_mps=10.0, sigma_m=0.5), at(x_m=10.0, speed_mps=14.0, sigma_m=0.5))
    assert found.entry_s[0] == math.inf
    assert found.probability[0] < 1e-3


@pytest.mark.parametrize("speed_mps", [2.0, 4.0, 5.5, -3.0])
def test_probability_within_the_horizon_against_sampled_pairs(speed_mps: float) -> None:
    """In one lane contact is at the horizon or before: by the distance there, and by the widths."""
    sigma_m = 1.0
    host, other = at(sigma_m, speed_mps=10.0), at(sigma_m, x_m=14.0, speed_mps=10.0 - speed_mps)
    found = between(host, other)
    both_m2 = host.position_covariance_m2[0, :51] + other.position_covariance_m2[0, :51]
    rng = np.random.default_rng(0)
    errors = rng.standard_normal((2, 100_000))
    touches = np.zeros(errors.shape[1], dtype=bool)
    for k, tau in enumerate(TIME_S):
        ahead, aside = (
            14.0 - speed_mps * tau + math.sqrt(both_m2[k, 0]) * errors[0],
            math.sqrt(both_m2[k, 2]) * errors[1],
        )
        touches |= (np.abs(ahead) <= 4.5) & (np.abs(aside) <= 1.8)
    assert found.probability[0] == pytest.approx(touches.mean(), abs=0.01)


def test_a_lead_that_gentle_braking_keeps_clear_of() -> None:
    """Closing with 5 m/s over a gap of 12.5 m, 1 m/s^2 is enough; with 10 m/s it takes 4."""
    needs_1 = between(at(speed_mps=20.0, sigma_m=0.1), at(x_m=17.0, speed_mps=15.0, sigma_m=0.1))
    needs_4 = between(at(speed_mps=20.0, sigma_m=0.1), at(x_m=17.0, speed_mps=10.0, sigma_m=0.1))
    assert needs_1.braked_probability[0] < 0.01
    assert needs_4.braked_probability[0] > 0.99


def test_braking_does_not_put_off_what_it_does_not_avoid() -> None:
    """A car that stands 52 m ahead of 20 m/s: 2 m/s^2 bring the host to it after the horizon, at 14 m/s."""
    found = between(at(speed_mps=20.0), at(x_m=52.0, speed_mps=0.0))
    assert found.overlap_s[0] == pytest.approx(47.5 / 20.0)
    assert found.braked_probability[0] == pytest.approx(1.0)


def test_who_stands_can_not_brake() -> None:
    found = between(at(speed_mps=0.0), at(x_m=20.0, speed_mps=10.0, heading_rad=math.pi))
    assert found.probability[0] == pytest.approx(1.0)
    assert found.braked_probability[0] == pytest.approx(1.0)
