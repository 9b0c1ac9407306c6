"""The probability of contact: closed forms, a million-sample study in small, a plain twin, symmetries."""

import math

import numpy as np
import pytest
from scipy import stats

from cwcli.measures.collision_probability import (
    LATTICE_GENERATORS,
    MAX_DIFFERENCE_OF_JOINED_STEPS_SIGMAS,
    MAX_ERROR_OF_POSSIBLE_CONTACT_SIGMAS,
    MAX_VARIANCE_CHANGE_SHARES_FOR_FEW_LINES,
    MIN_VARIANCE_M2,
    UncertainPaths,
    collision_probability,
    cosine_sine_and_errors_of_lines,
)
from tests.studies.collision_probability import Encounter, random_encounter, sampled
from tests.unit.measures.naive_collision import contact_probability, straight_points

CAR, TRUCK = (4.5, 1.8), (12.0, 2.5)
ATOL = 0.005  # a probability
TIME_S = np.arange(51) * 0.05


def straight(
    *,
    x_m: float,
    y_m: float = 0.0,
    speed_mps: float,
    heading_rad: float = 0.0,
    sigma_m: float | tuple[float, float] = 1.0,
) -> Encounter:
    """The other goes straight past a host that stands at the origin, heading along x; the error of the host is none."""
    along, across = sigma_m if isinstance(sigma_m, tuple) else (sigma_m, sigma_m)
    zero, one = np.zeros(len(TIME_S)), np.ones(len(TIME_S))
    way: np.ndarray = speed_mps * TIME_S
    return Encounter(
        x_m + way * math.cos(heading_rad),
        y_m + way * math.sin(heading_rad),
        (zero, heading_rad * one),
        (np.zeros((len(TIME_S), 3)), np.column_stack([along**2 * one, zero, across**2 * one])),
        (CAR, CAR),
    )


def normal_share(mean: float, sigma: float, reach: float) -> float:
    return float(stats.norm.cdf((reach - mean) / sigma) - stats.norm.cdf((-reach - mean) / sigma))


@pytest.mark.parametrize("offset_m", [0.0, 1.0, 1.8, 3.0, 6.0])
@pytest.mark.parametrize("sigma_m", [0.05, 0.4, 1.5])
def test_passing_by_is_a_matter_of_the_offset(offset_m: float, sigma_m: float) -> None:
    """From 60 m behind to 40 m ahead: the widths touch where the offset is below 1.8 m, wherever that is."""
    found = straight(x_m=-60.0, y_m=offset_m, speed_mps=40.0, sigma_m=sigma_m).probability()
    assert found == pytest.approx(normal_share(offset_m, sigma_m, 1.8), abs=ATOL)


@pytest.mark.parametrize("left_m", [-2.0, 0.0, 1.0, 3.0])
def test_who_does_not_get_there_in_time_does_not_touch(left_m: float) -> None:
    """At the end the outlines are `left_m` apart in the same lane, with a sigma of 1.2 m: Phi(-left / sigma)."""
    found = straight(x_m=-(4.5 + left_m + 10.0 * 2.5), speed_mps=10.0, sigma_m=(1.2, 0.1)).probability()
    assert found == pytest.approx(float(stats.norm.cdf(-left_m / 1.2)), abs=ATOL)


def test_two_that_stand_touch_by_both_offsets() -> None:
    found = straight(x_m=5.0, y_m=1.0, speed_mps=0.0, sigma_m=(1.0, 0.7)).probability()
    assert found == pytest.approx(normal_share(5.0, 1.0, 4.5) * normal_share(1.0, 0.7, 1.8), abs=ATOL)


def test_a_diagonal_way_past_a_corner() -> None:
    """At 45 degrees the outlines reach (4.5 + 1.8) / sqrt(2) across the way."""
    reach = 6.3 / math.sqrt(2.0)
    square = straight(x_m=-40.0, y_m=-40.0 + math.sqrt(2.0) * 5.0, speed_mps=40.0, heading_rad=math.pi / 4)
    headings = (square.headings_rad[0], np.zeros(len(TIME_S)))
    found = Encounter(square.x_m, square.y_m, headings, square.covariances_m2, square.sizes).probability()
    assert found == pytest.approx(normal_share(5.0, 1.0, reach), abs=ATOL)


def test_errors_of_one_path_are_the_same_all_along() -> None:
    """The sigma across grows from 0.5 to 1.5 m beside a host that is 4.3 m away: contact is at the end, or never."""
    one = straight(x_m=0.0, y_m=4.3, speed_mps=0.0)
    sigma = np.linspace(0.5, 1.5, len(TIME_S))
    covariance = np.column_stack([np.full(len(sigma), 1e-4), np.zeros(len(sigma)), sigma**2])
    found = Encounter(one.x_m, one.y_m, one.headings_rad, (one.covariances_m2[0], covariance), one.sizes)
    assert found.probability() == pytest.approx(float(stats.norm.cdf(-(4.3 - 1.8) / 1.5)), abs=ATOL)


def test_the_errors_of_both_paths_add_up() -> None:
    one = straight(x_m=-60.0, y_m=2.5, speed_mps=40.0, sigma_m=0.6)
    both = Encounter(
        one.x_m, one.y_m, one.headings_rad, (one.covariances_m2[1] * 4.0, one.covariances_m2[1]), one.sizes
    )
    assert both.probability() == pytest.approx(normal_share(2.5, 0.6 * math.sqrt(5.0), 1.8), abs=ATOL)


@pytest.mark.parametrize(("offset_m", "expected"), [(1.7, 1.0), (1.9, 0.0)])
def test_known_exactly_it_is_certain(offset_m: float, expected: float) -> None:
    assert straight(x_m=-60.0, y_m=offset_m, speed_mps=40.0, sigma_m=0.0).probability() == pytest.approx(
        expected, abs=1e-9
    )


def test_against_samples() -> None:
    """The study in small: 12 encounters, 40,000 samples each, three sigmas of which are 0.0075."""
    rng = np.random.default_rng(3)
    encounters = [random_encounter(rng) for _ in range(12)]
    found = np.array([each.probability() for each in encounters])
    expected = np.array([sampled(each, 40_000, rng) for each in encounters])
    assert 0.2 < expected.mean() < 0.8
    np.testing.assert_allclose(found, expected, atol=0.01)
    assert np.sqrt(np.mean((found - expected) ** 2)) < 0.004


@pytest.mark.parametrize("seed", range(4))
def test_kernel_against_its_plain_twin(seed: int) -> None:
    one = random_encounter(np.random.default_rng(seed))
    ends = np.array([17, 50])
    found = collision_probability(one.x_m[None], one.y_m[None], *one.uncertain_paths(), ends=ends)[0]
    points = straight_points(
        one.x_m,
        one.y_m,
        one.headings_rad,
        one.covariances_m2,
        one.sizes,
        ends=list(ends),
        least_m2=MIN_VARIANCE_M2,
        sigmas=MAX_DIFFERENCE_OF_JOINED_STEPS_SIGMAS,
    )
    assert {17, 50} <= set(points)
    assert len(points) < 50
    expected = [
        contact_probability(
            one.x_m[points],
            one.y_m[points],
            (one.headings_rad[0][points], one.headings_rad[1][points]),
            (one.covariances_m2[0][points], one.covariances_m2[1][points]),
            one.sizes,
            lines=[cosine_sine_and_errors_of_lines(n) for n in LATTICE_GENERATORS],
            enough_below=MAX_VARIANCE_CHANGE_SHARES_FOR_FEW_LINES,
            end=points.index(end),
            far_sigmas=MAX_ERROR_OF_POSSIBLE_CONTACT_SIGMAS,
            least_m2=MIN_VARIANCE_M2,
        )
        for end in ends
    ]
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-9)


def test_laws_of_random_encounters() -> None:
    """More time is no less probable; whichever is the host; however the map is turned or mirrored."""
    rng = np.random.default_rng(8)
    for one in (random_encounter(rng) for _ in range(30)):
        x, y, (own, theirs) = one.x_m[None], one.y_m[None], one.uncertain_paths()
        by_time = collision_probability(x, y, own, theirs, ends=np.array([1, 10, 30, 50]))[0]
        assert (np.diff(by_time) >= 0.0).all()
        assert 0.0 <= by_time[0] <= by_time[-1] <= 1.0
        whole = collision_probability(x, y, own, theirs)[0, 0]
        assert whole == pytest.approx(by_time[-1], abs=0.001)  # the times asked for end steps
        swapped = collision_probability(-x, -y, theirs, own)[0, 0]
        assert swapped == pytest.approx(whole, abs=2.0 * ATOL)  # each of the two within it
        flipped = [
            UncertainPaths(-each.heading_rad, np.array([1.0, -1.0, 1.0]) * each.covariance_m2, each.size)
            for each in (own, theirs)
        ]
        mirrored = collision_probability(x, -y, *flipped)[0, 0]
        assert mirrored == pytest.approx(whole, abs=1e-6)
        turned = [
            UncertainPaths(
                each.heading_rad + np.pi / 2, each.covariance_m2[..., ::-1] * np.array([1.0, -1.0, 1.0]), each.size
            )
            for each in (own, theirs)
        ]
        quarter = collision_probability(-y, x, *turned)[0, 0]
        assert quarter == pytest.approx(whole, abs=1e-6)


def test_a_path_that_is_no_number_has_no_probability_and_spoils_no_other() -> None:
    one = straight(x_m=-60.0, speed_mps=40.0)
    x_m, y_m = (np.stack([each, each]) for each in (one.x_m, one.y_m))
    x_m[0, 7] = np.nan
    both = [
        UncertainPaths(np.repeat(each.heading_rad, 2, axis=0), np.repeat(each.covariance_m2, 2, axis=0), each.size)
        for each in one.uncertain_paths()
    ]
    found = collision_probability(x_m, y_m, *both)[:, 0]
    assert math.isnan(found[0])
    assert found[1] == one.probability()


@pytest.mark.parametrize("n", LATTICE_GENERATORS)
def test_the_lines_hold_the_moments_of_their_errors(n: int) -> None:
    cosine, sine, *errors = cosine_sine_and_errors_of_lines(n).T
    np.testing.assert_allclose(cosine**2 + sine**2, 1.0)
    np.testing.assert_allclose(np.mean(errors, axis=1), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.cov(errors, bias=True), np.eye(2), atol=1e-12)
