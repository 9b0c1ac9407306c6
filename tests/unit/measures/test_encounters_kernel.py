"""The kernel of the encounters against its plain twins."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from cwcli.kernels import encounters as kernel
from tests.unit.measures import naive_encounters

FloatArray = npt.NDArray[np.float64]
SIZES = ((4.5, 1.8), (12.0, 2.5))


def test_accelerated_contact_time_has_the_same_bits() -> None:
    rng = np.random.default_rng(11)
    m = 4000
    centre, speed, bend = rng.normal(size=(3, 4, m)) * np.array([10.0, 6.0, 3.0])[:, None, None]
    reach = rng.uniform(1.0, 8.0, (4, m))
    speed[rng.random((4, m)) < 0.2] = 0.0
    bend[rng.random((4, m)) < 0.2] = 1e-10  # counts as none
    bend[:, 7] = np.nan
    centre[:, :50] = -reach[:, :50]  # touching
    found = kernel.accelerated_contact_time(centre, speed, reach, bend)
    assert found.tobytes() == naive_encounters.accelerated_contact_time(centre, speed, reach, bend).tobytes()
    assert 150 < np.isfinite(found).sum() < m
    assert np.isinf(found[7])


def test_overlap_time_along_arcs() -> None:
    rng = np.random.default_rng(12)
    m, step_s = 3000, 0.1
    place = np.asarray(25.0 * (rng.normal(size=m) + 1j * rng.normal(size=m)), np.complex128)
    direction = np.exp(1j * rng.uniform(-np.pi, np.pi, m))
    speed, yaw_rate = rng.uniform(-2.0, 20.0, (2, m)), rng.normal(0.0, 0.3, (2, m))
    yaw_rate[0, 5] = np.nan
    chords, turns = speed * step_s * np.exp(0.5j * yaw_rate * step_s), np.exp(1j * yaw_rate * step_s)
    expected = naive_encounters.overlap_time_along_arcs(place, direction, chords, turns, SIZES, 50, step_s)

    def find_overlaps(close_m: FloatArray) -> FloatArray:
        """Both numbers of each complex one side by side."""
        a, b, c, d = (each.view(np.float64).reshape(*each.shape, 2) for each in (place, direction, chords, turns))
        return kernel.overlap_time_along_arcs(a, b, c, d, close_m, SIZES[0], SIZES[1], n_steps=50, step_s=step_s)

    found = find_overlaps(np.full(m, 1e3))
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-11)
    assert 200 < np.isfinite(found).sum() < m
    # closer than the outlines reach nothing overlaps, and nothing is linear from what was not compared
    assert np.isnan(find_overlaps(np.zeros(m))).all()


@pytest.mark.parametrize("apart_s", [0, 3, 12, 60])
@pytest.mark.parametrize("is_host_later", [False, True])
def test_rows_of_least_lag(apart_s: int, is_host_later: bool) -> None:
    # two that cross at a right angle, one `apart_s` steps after the other
    t = np.arange(120.0) - 50.0
    along, zero, one = 1.5 * t, np.zeros(120), np.ones(120)
    first, second = (apart_s, 0) if is_host_later else (0, apart_s)
    poses = np.array([along - 1.5 * first, zero, one, zero, zero, along - 1.5 * second, zero, one])
    poses[:, 30] = np.nan
    reach_m = 0.5 * float(np.hypot(*SIZES[0]) + np.hypot(*SIZES[1]))
    found = kernel.rows_of_least_lag(poses, SIZES[0], SIZES[1], reach_m, 51)
    assert found == naive_encounters.rows_of_least_lag(poses, SIZES, 51)
    assert (found == (-1, -1)) == (apart_s == 60)
