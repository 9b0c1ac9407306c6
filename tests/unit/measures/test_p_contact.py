"""The probability of contact by the covariances of both states: closed forms, finite differences, samples of states."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest
from scipy import stats

from cwcli.errors import UsageError
from cwcli.measures import MEASURES
from cwcli.measures.outlines import outline_separation_m
from cwcli.measures.p_contact import CONTACT_HORIZON_S, PATH_TIMES_S, propagate_to_x_y_heading_and_xy_covariance
from cwcli.measures.pair import ActualTrack, Pair
from cwcli.signals.packed_covariances import PackedCovariances
from cwcli.warning.conflict_definition import parse_conflict_definition

FloatArray = npt.NDArray[np.float64]
CAR = (4.5, 1.8)
MEASURE = MEASURES["p-contact"]


def track(state: FloatArray, sigmas: FloatArray) -> ActualTrack:
    """One moment, packed as it is in a channel."""
    covariance = PackedCovariances.from_dense(np.diag(np.maximum(sigmas, 1e-6) ** 2)[None])
    return ActualTrack(np.zeros(1, np.int64), state[None], covariance)


def of(
    x_m: float, y_m: float, speed_mps: float, heading_rad: float, accel: float = 0.0, turn: float = 0.0
) -> FloatArray:
    return np.array([x_m, y_m, speed_mps, heading_rad, accel, turn, 0.0, 0.0])


def pair(host: FloatArray, other: FloatArray, own: FloatArray, theirs: FloatArray) -> Pair:
    """Two at one moment: the state of a track of one stamp is known there alone."""
    tracks = track(host, own), track(other, theirs)
    return Pair(*tracks, CAR, CAR, 0.5).with_states(tracks[0], other[None, :4], other[None, 4:7])


def sigmas(**named: float) -> FloatArray:
    return np.array([named.get(name, 0.0) for name in ("x", "y", "v", "h", "a", "w", "j", "q")])


@pytest.mark.parametrize("left_m", [-2.0, 0.0, 1.5])
def test_who_closes_up_touches_if_its_speed_and_place_are_far_enough_off(left_m: float) -> None:
    """After 2.5 s at 4 m/s more the two are `left_m` apart; the sigma then is that of place and speed together."""
    other = of(4.5 + left_m + 4.0 * CONTACT_HORIZON_S, 0.0, 8.0, 0.0)
    found = pair(of(0.0, 0.0, 12.0, 0.0), other, sigmas(x=0.5, v=0.4), sigmas(x=0.3)).evaluate_measure(MEASURE)
    sigma = math.sqrt(0.5**2 + (0.4 * CONTACT_HORIZON_S) ** 2 + 0.3**2)
    assert found[0] == pytest.approx(float(stats.norm.cdf(-left_m / sigma)), abs=0.005)


def test_braking_ends_where_the_car_stands() -> None:
    """At 10 m/s and -5 m/s^2 it stands after 10 m; 12 m less half of each length away it does not get there."""
    still = sigmas(x=0.1)
    for gap_m, expected in ((10.5, 0.0), (9.5, 1.0)):
        found = pair(of(0.0, 0.0, 10.0, 0.0, -5.0), of(4.5 + gap_m, 0.0, 0.0, 0.0), still, still).evaluate_measure(
            MEASURE
        )
        assert found[0] == pytest.approx(expected, abs=0.003)  # half a metre is 3.5 sigmas


@pytest.mark.parametrize("speed_mps", [0.0, -1e-12, 1e-12])
def test_who_stands_neither_drives_backwards_nor_turns(speed_mps: float) -> None:
    sure = np.eye(6)[None] * 1e-6
    x, y, heading, _ = propagate_to_x_y_heading_and_xy_covariance(
        np.array([[0.0, 0.0, speed_mps, 0.2, -3.0, 1.0]]), sure
    )
    assert np.abs(np.stack([x, y, heading - 0.2])).max() < 1e-9
    heading = propagate_to_x_y_heading_and_xy_covariance(np.array([[0.0, 0.0, 0.0, 0.2, 0.0, 1.0]]), sure)[2]
    assert (heading == 0.2).all()


def test_who_brakes_turns_until_it_stands() -> None:
    """From 2 m/s at -4 m/s^2: half a second, and 0.3 rad at 0.6 rad/s."""
    heading = propagate_to_x_y_heading_and_xy_covariance(
        np.array([[0.0, 0.0, 2.0, 0.0, -4.0, 0.6]]), np.eye(6)[None] * 1e-6
    )[2][0]
    np.testing.assert_allclose(heading, np.minimum(0.6 * PATH_TIMES_S, 0.3), atol=1e-12)


def test_a_path_carries_its_covariance_as_finite_differences_do() -> None:
    rng = np.random.default_rng(4)
    state = np.array([[3.0, -2.0, 9.0, 0.7, 1.2, 0.25], [0.0, 0.0, 4.0, -2.0, -3.0, -0.3]])
    root = rng.normal(size=(2, 6, 6)) * 0.2
    covariance = root @ np.swapaxes(root, 1, 2)
    x, y, heading, spread = propagate_to_x_y_heading_and_xy_covariance(state, covariance)
    slopes = np.empty((2, len(PATH_TIMES_S), 2, 6))
    for k in range(6):
        high, low = (
            propagate_to_x_y_heading_and_xy_covariance(state + sign * 1e-5 * np.eye(6)[k], covariance)
            for sign in (1.0, -1.0)
        )
        slopes[..., 0, k], slopes[..., 1, k] = ((high[i] - low[i]) / 2e-5 for i in (0, 1))
    expected = np.einsum("mqai,mij,mqbj->mqab", slopes, covariance, slopes)
    for at, (a, b) in enumerate(((0, 0), (0, 1), (1, 1))):
        np.testing.assert_allclose(spread[..., at], expected[..., a, b], rtol=0.02, atol=0.02)
    fine = [finely(each) for each in state]
    for row, (x_m, y_m) in enumerate(fine):
        np.testing.assert_allclose(x[row], x_m, atol=0.002)
        np.testing.assert_allclose(y[row], y_m, atol=0.002)
    moving_s = np.minimum(PATH_TIMES_S, [[np.inf], [4.0 / 3.0]])
    np.testing.assert_allclose(heading, state[:, 3:4] + state[:, 5:6] * moving_s)


def finely(state: FloatArray, n: int = 200) -> tuple[FloatArray, FloatArray]:
    """Where a car is at the times, in small steps."""
    step = PATH_TIMES_S[1] / n
    at = (np.arange((len(PATH_TIMES_S) - 1) * n) + 0.5) * step
    x, y, speed, heading, accel, turn = state
    way = np.maximum(speed + accel * at, 0.0) * step
    moved = [np.concatenate([[0.0], np.cumsum(way * f(heading + turn * at))])[::n] for f in (np.cos, np.sin)]
    return x + moved[0], y + moved[1]


@pytest.mark.parametrize(
    ("seed", "largest"),
    [(9, 0.02), *(pytest.param(seed, 0.03, marks=pytest.mark.long) for seed in (10, 11, 12))],
)
def test_against_samples_of_states(seed: int, largest: float) -> None:
    """Errors of states, not of paths: to first order, and as one error all along, it is what is summed.

    docs/measures.md says the bounds of all seeds.
    """
    rng = np.random.default_rng(seed)
    own, theirs = sigmas(x=0.5, y=0.4, v=0.4, h=0.02, a=0.4, w=0.01), sigmas(x=0.4, y=0.6, v=0.3, h=0.03, a=0.3, w=0.02)
    differences = []
    for _ in range(8):
        host, other = (
            of(0.0, 0.0, rng.uniform(5.0, 15.0), rng.uniform(-3.0, 3.0), rng.normal(), rng.normal(0.0, 0.1))
            for _ in range(2)
        )
        meet = rng.integers(20, len(PATH_TIMES_S))
        ends = [np.array(finely(each[:6], 5))[:, meet] for each in (host, other)]
        other[:2] = ends[0] - ends[1] + rng.normal(0.0, 1.5, 2)
        found = pair(host, other, own, theirs).evaluate_measure(MEASURE)[0]
        differences.append(found - sampled(host, other, own, theirs, rng))
    assert np.abs(differences).max() < largest
    assert np.sqrt(np.mean(np.square(differences))) < 0.01


def sampled(
    host: FloatArray, other: FloatArray, own: FloatArray, theirs: FloatArray, rng: np.random.Generator
) -> float:
    """The share of 20,000 that touch at one of the times."""
    moved = []
    for state, sigma in ((host, own), (other, theirs)):
        states = state[:6] + sigma[:6] * rng.standard_normal((20_000, 6))
        # in parts that fit into the processor's cache: the paths' covariances, which nobody reads, are many numbers
        parts = [
            propagate_to_x_y_heading_and_xy_covariance(part, np.zeros((len(part), 6, 6)))[:3]
            for part in np.split(states, 100)
        ]
        moved.append([np.concatenate(each) for each in zip(*parts, strict=True)])
    (x, y, heading), (to_x, to_y, to_heading) = moved
    touching = np.zeros(len(x), bool)
    for share in (0.0, 0.25, 0.5, 0.75):
        dx, dy, own, their = [
            each[:, :-1] + share * np.diff(each, axis=1) for each in (to_x - x, to_y - y, heading, to_heading)
        ]
        near = np.hypot(dx, dy) <= math.hypot(*CAR)  # no others can touch
        row = np.nonzero(near)[0]
        touching[row[outline_separation_m(dx[near], dy[near], own[near], their[near], CAR, CAR) <= 0.0]] = True
    return float(touching.mean())


def test_without_covariances_there_is_no_value() -> None:
    tracks = [ActualTrack(np.arange(3) * 10**8, np.tile(of(x, 0.0, 5.0, 0.0), (3, 1))) for x in (0.0, 10.0)]
    assert np.isnan(Pair(tracks[0], tracks[1], CAR, CAR, 0.5).evaluate_measure(MEASURE)).all()


def test_it_defines_no_conflict() -> None:
    with pytest.raises(UsageError, match="p-contact needs covariances"):
        parse_conflict_definition("p-contact > 0.5", distance_m=2.5)
