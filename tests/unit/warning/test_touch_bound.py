"""Which pairs need no line through their errors: a bound on what the errors can do."""

import math

import numpy as np
import pytest

from cwcli.measures.collision_probability import MAX_ERROR_OF_POSSIBLE_CONTACT_SIGMAS, is_touch_improbable
from cwcli.prediction.paths import Paths
from cwcli.warning.collision import largest_position_variance_m2
from tests.unit.measures.test_collision_probability import CAR, straight


def paths_with_covariances(covariances_m2: list[list[float]]) -> Paths:
    """One path of three points at rest, with these covariances (xx, xy, yy)."""
    zero = np.zeros((1, 3))
    return Paths(np.array([0.0, 0.1, 0.2]), zero, zero, zero, zero, np.array([covariances_m2]))


def test_the_variance_is_that_along_the_longest_axis() -> None:
    """[[5, 4], [4, 5]] has the eigenvalues 9 (along the diagonal) and 1; the larger end of the path counts."""
    paths = paths_with_covariances([[1.0, 0.0, 2.0], [3.0, 1.0, 3.0], [5.0, 4.0, 5.0]])
    np.testing.assert_allclose(largest_position_variance_m2(paths, np.array([0, 0])), [9.0, 9.0])


@pytest.mark.parametrize("sigma_m", [0.4, 1.5])
@pytest.mark.parametrize("share", [1.001, 1.2])
def test_what_the_bound_leaves_out_has_no_probability(sigma_m: float, share: float) -> None:
    """Behind one another, farther apart than the bound: at its edge 1 - Phi(3.7) = 0.0001."""
    gap_m = share * MAX_ERROR_OF_POSSIBLE_CONTACT_SIGMAS * sigma_m
    distance_m = math.hypot(*CAR) + gap_m
    one = straight(x_m=distance_m, speed_mps=0.0, sigma_m=sigma_m)
    assert is_touch_improbable(np.array([distance_m]), np.array([sigma_m**2]), CAR, CAR).all()
    assert one.probability() < 0.001


def test_the_bound_keeps_what_the_sum_of_both_axes_would_keep_for_one_alone() -> None:
    """With errors along one axis only, the variance along the longest axis is the sum of both."""
    distance_m, sigma_m = math.hypot(*CAR) + 3.6, 1.0
    assert not is_touch_improbable(np.array([distance_m]), np.array([sigma_m**2]), CAR, CAR).any()
