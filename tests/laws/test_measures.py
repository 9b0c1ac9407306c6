"""Laws that every registered measure of two vehicles obeys."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cwcli.measures import MEASURES
from cwcli.measures.base import Measure, is_column_named_by_measure
from cwcli.measures.pair import ActualTrack, Pair

FloatArray = npt.NDArray[np.float64]
RTOL = 1e-6
"""Relative, and absolute near 0."""
CAR, TRUCK = (4.5, 1.8), (12.0, 2.5)
T0_NS = 1_700_000_000_000_000_000
STEP_NS = 100_000_000
N = 60

every_measure = pytest.mark.parametrize("name", MEASURES)


def track(
    x_m: float,
    y_m: float,
    speed_mps: float,
    heading_rad: float,
    yaw_rate_radps: float = 0.0,
    accel_mps2: float = 0.0,
    jerk_mps3: float = 0.0,
) -> ActualTrack:
    """Six seconds at 10 Hz from a place, at a constant yaw rate."""
    time_s = np.arange(N) * 0.1
    heading = heading_rad + yaw_rate_radps * time_s
    speed = speed_mps + accel_mps2 * time_s + 0.5 * jerk_mps3 * time_s**2
    middle = heading_rad + yaw_rate_radps * (time_s[:-1] + 0.05)
    steps = 0.1 * 0.5 * (speed[:-1] + speed[1:]) * np.stack([np.cos(middle), np.sin(middle)])
    place = np.array([[x_m], [y_m]]) + np.concatenate([np.zeros((2, 1)), np.cumsum(steps, axis=1)], axis=1)
    rates = [accel_mps2 + jerk_mps3 * time_s, *(np.full(N, each) for each in (yaw_rate_radps, jerk_mps3, 0.0))]
    state = np.column_stack([place.T, speed, heading, *rates])
    return ActualTrack(T0_NS + STEP_NS * np.arange(N), state, np.tile(covariance_along(heading_rad), (N, 1, 1)))


def covariance_along(heading_rad: float) -> FloatArray:
    """Of a state: more along the heading than across, and a place that is off with the heading."""
    root = np.diag([0.8, 0.3, 0.4, 0.03, 0.5, 0.02, 0.3, 0.1])
    root[1, 3] = 0.02
    cosine, sine = np.cos(heading_rad), np.sin(heading_rad)
    root[:2] = np.array([[cosine, -sine], [sine, cosine]]) @ root[:2]
    return np.asarray(root @ root.T)


def pair(host: ActualTrack, other: ActualTrack) -> Pair:
    return Pair(host, other, CAR, TRUCK, max_gap_s=0.5)


def judged(measure: Measure, n: int = 40, seed: int = 5) -> list[Pair]:
    """Scenes for a measure: a few moments of a few where it is dear."""
    if not measure.is_expensive:
        return scenes(n, seed)

    def few(track: ActualTrack) -> ActualTrack:
        return rows_of(track, slice(3))

    return [replace(scene, host=few(scene.host), other=few(scene.other)) for scene in scenes(min(n, 12), seed)]


def rows_of(track: ActualTrack, rows: slice | npt.NDArray[np.intp]) -> ActualTrack:
    """Some of its states."""
    covariance = None if track.covariance is None else track.covariance[rows]
    return ActualTrack(track.stamp_ns[rows], track.state[rows], covariance)


def scenes(n: int = 40, seed: int = 5) -> list[Pair]:
    """Pairs that meet somehow: of any headings, speeds and turns, near each other."""
    rng = np.random.default_rng(seed)
    made = []
    for _ in range(n):
        own, theirs = (
            track(
                *(
                    *rng.uniform(-25.0, 25.0, 2),
                    rng.uniform(-2.0, 20.0),
                    rng.uniform(-9.0, 9.0),
                    *rng.normal(0.0, (0.2, 2.0, 0.5)),
                )
            )
            for _ in range(2)
        )
        made.append(pair(own, theirs))
    return made


def head_on(speed_mps: float = 10.0) -> Pair:
    """Towards each other on one line; they collide."""
    return pair(track(0.0, 0.0, speed_mps, 0.0), track(80.0, 0.0, speed_mps, np.pi))


def never() -> Pair:
    """Side by side, 80 m apart, at one speed."""
    return pair(track(0.0, 0.0, 10.0, 0.0), track(0.0, 80.0, 10.0, 0.0))


def with_state(scene: Pair, change: Callable[[FloatArray], FloatArray], shift_ns: int = 0) -> Pair:
    """The scene with both tracks changed alike; the change is linear but for a shift."""
    slope = change(np.eye(8)) - change(np.zeros((8, 8)))
    tracks = []
    for each in (scene.host, scene.other):
        covariance = None if each.covariance is None else slope.T @ each.covariance[:] @ slope
        tracks.append(ActualTrack(each.stamp_ns + shift_ns, change(each.state), covariance))
    return replace(scene, host=tracks[0], other=tracks[1])


def turned(angle_rad: float) -> Callable[[FloatArray], FloatArray]:
    def change(state: FloatArray) -> FloatArray:
        cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
        x, y, speed, heading, *rates = state.T
        return np.column_stack([cosine * x - sine * y, sine * x + cosine * y, speed, heading + angle_rad, *rates])

    return change


CHANGES: dict[str, tuple[Callable[[FloatArray], FloatArray], int]] = {
    "moved": (lambda state: state + np.array([1e5, -3e4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]), 0),
    "turned by 0.7": (turned(0.7), 0),
    "turned by 180 degrees": (turned(np.pi), 0),
    "turned by 4000 degrees": (turned(np.radians(4000.0)), 0),
    "mirrored": (lambda state: state * [1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0], 0),
    "later": (lambda state: state, 12_345_678_900_000_007),
}


@pytest.mark.parametrize("change", CHANGES)
@every_measure
def test_no_place_direction_or_time_counts(name: str, change: str) -> None:
    measure = MEASURES[name]
    for scene in judged(measure):
        found = with_state(scene, *CHANGES[change]).evaluate_measure(measure)
        np.testing.assert_allclose(found, scene.evaluate_measure(measure), rtol=RTOL, atol=RTOL)


def one_after_another(parts: list[Pair], part_ns: int = 100 * N * STEP_NS) -> Pair:
    """Pairs of as many moments as one pair, each long after the one before."""

    def joined(tracks: list[ActualTrack]) -> ActualTrack:
        stamps = [part_ns * k + each.stamp_ns for k, each in enumerate(tracks)]
        covariances = [each.covariance[:] for each in tracks if each.covariance is not None]
        return ActualTrack(
            np.concatenate(stamps), np.concatenate([each.state for each in tracks]), np.concatenate(covariances)
        )

    hosts, others = [part.host for part in parts], [part.other for part in parts]
    return replace(parts[0], host=joined(hosts), other=joined(others))


@pytest.mark.long
@every_measure
def test_each_of_360_angles_says_the_same(name: str) -> None:
    """Turned by each degree, 10^5 m away, every second one mirrored."""
    measure, away_m = MEASURES[name], np.array([1e5, -7e4, *[0.0] * 6])
    for scene in judged(measure, 3 if measure.is_pointwise else 1, seed=17):
        ways = []
        for angle_deg in range(360):
            turn, mirror = turned(np.radians(angle_deg)), CHANGES["mirrored"][0] if angle_deg % 2 else np.asarray

            def move(state: np.ndarray, turn: Any = turn, mirror: Any = mirror) -> np.ndarray:
                return turn(mirror(state)) + away_m

            ways.append(with_state(scene, move))
        expected = scene.evaluate_measure(measure)
        if measure.is_pointwise:
            found = one_after_another(ways).evaluate_measure(measure).reshape(360, -1)
        else:
            found = np.array([way.evaluate_measure(measure) for way in ways])
        np.testing.assert_allclose(found, np.broadcast_to(expected, found.shape), rtol=RTOL, atol=RTOL)


@every_measure
@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    angle_deg=st.integers(0, 359),
    shift_m=st.tuples(st.floats(-1e5, 1e5), st.floats(-1e5, 1e5)),
    later_s=st.integers(-(10**9), 10**9),
    mirrored=st.booleans(),
)
def test_no_place_direction_or_time_counts_in_any_scene(
    name: str, seed: int, angle_deg: int, shift_m: tuple[float, float], later_s: int, mirrored: bool
) -> None:
    measure, (scene,) = MEASURES[name], judged(MEASURES[name], 1, seed)

    def change(state: FloatArray) -> FloatArray:
        if mirrored:
            state = CHANGES["mirrored"][0](state)
        return turned(np.radians(angle_deg))(state) + np.array([*shift_m, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])

    found = with_state(scene, change, later_s * 10**9).evaluate_measure(measure)
    np.testing.assert_allclose(found, scene.evaluate_measure(measure), rtol=RTOL, atol=RTOL)


@every_measure
def test_either_vehicle_may_be_the_host(name: str) -> None:
    measure = MEASURES[name]
    if not measure.is_symmetric:
        values = [
            (scene.evaluate_measure(measure), swapped(scene).evaluate_measure(measure)) for scene in judged(measure)
        ]
        assert any(not np.allclose(one, other, rtol=RTOL, equal_nan=True) for one, other in values)
        return
    for scene in judged(measure):
        np.testing.assert_allclose(
            swapped(scene).evaluate_measure(measure), scene.evaluate_measure(measure), rtol=RTOL, atol=RTOL
        )


def swapped(scene: Pair) -> Pair:
    return Pair(scene.other, scene.host, scene.other_size, scene.host_size, scene.max_gap_s)


def rear_end() -> Pair:
    """The host drives into a slower one ahead."""
    return pair(track(0.0, 0.0, 15.0, 0.0), track(50.0, 0.3, 3.0, 0.0))


def crossing() -> Pair:
    """Under a right angle, into each other's flank; neither stays."""
    return pair(track(-30.0, 0.0, 10.0, 0.0), track(0.0, -25.0, 10.0, np.pi / 2))


@every_measure
def test_a_collision_is_more_critical_than_two_that_never_meet(name: str) -> None:
    measure = MEASURES[name]
    apart = measure.most_critical_value(never())
    crashes = [measure.most_critical_value(scene) for scene in (head_on(), rear_end(), crossing())]
    known = [crash for crash in crashes if not np.isnan(crash)]
    assert known
    if measure.is_of_host:
        alone = pair(rear_end().host, never().other)
        assert measure.most_critical_value(rear_end()) == measure.most_critical_value(alone)
        return
    for crash in known:
        assert abs(crash) != np.inf or (crash > 0.0) == (measure.critical == "high")
    if not np.isnan(apart):
        assert max(known) > apart if measure.critical == "high" else min(known) < apart


@every_measure
def test_a_series_has_a_value_for_each_stamp_and_none_without_data(name: str) -> None:
    measure = MEASURES[name]
    whole = head_on()
    late = replace(whole, other=rows_of(whole.other, slice(20, 40)))
    values = late.evaluate_measure(measure)
    assert values.dtype == np.float64
    if not measure.is_series:
        assert values.shape == ()
        return
    assert values.shape == (N,)
    assert np.isnan(np.delete(values, slice(20, 40))).all()
    np.testing.assert_array_equal(values[20:40], whole.evaluate_measure(measure)[20:40])


ODD: dict[str, Pair] = {
    "both stand": pair(track(0.0, 0.0, 0.0, 0.0), track(10.0, 0.0, 0.0, 1.0)),
    "one place": pair(track(0.0, 0.0, 0.0, 0.0), track(0.0, 0.0, 0.0, 0.0)),
    "one place and motion": pair(track(0.0, 0.0, 9.0, 0.3), track(0.0, 0.0, 9.0, 0.3)),
    "overlapping at the start": pair(track(0.0, 0.0, 10.0, 0.0), track(1.0, 0.5, 5.0, 2.0)),
    "far apart": pair(track(0.0, 0.0, 10.0, 0.0), track(5000.0, 0.0, 10.0, np.pi)),
    "no size": Pair(track(0.0, 0.0, 10.0, 0.0), track(30.0, 0.0, 5.0, 0.0), (0.0, 0.0), (0.0, 0.0), 0.5),
    "another hour": pair(track(0.0, 0.0, 10.0, 0.0), with_state(head_on(), lambda state: state, 3600 * 10**9).other),
    "one stamp": pair(ActualTrack(np.array([T0_NS]), np.zeros((1, 8))), track(30.0, 0.0, 5.0, 0.0)),
    "nothing": pair(ActualTrack(np.zeros(0, np.int64), np.zeros((0, 8))), track(30.0, 0.0, 5.0, 0.0)),
    "no other": pair(track(30.0, 0.0, 5.0, 0.0), ActualTrack(np.zeros(0, np.int64), np.zeros((0, 8)))),
}


@pytest.mark.parametrize("odd", ODD)
@every_measure
def test_odd_pairs_have_values_or_none(name: str, odd: str) -> None:
    measure, scene = MEASURES[name], replace(ODD[odd])
    with np.errstate(all="raise", under="ignore"):
        values = scene.evaluate_measure(measure)
    assert values.shape == ((len(scene.stamp_ns),) if measure.is_series else ())
    assert np.isnan(values).all() or odd not in ("another hour", "no other")


@every_measure
def test_a_state_that_is_no_number_spoils_no_other(name: str) -> None:
    measure, whole = MEASURES[name], head_on()

    def holed(each: ActualTrack) -> ActualTrack:
        state = each.state.copy()
        state[7] = np.nan
        return ActualTrack(each.stamp_ns, state, each.covariance)

    for scene in (replace(whole, host=holed(whole.host)), replace(whole, other=holed(whole.other))):
        values = np.atleast_1d(scene.evaluate_measure(measure))
        known = np.arange(len(values)) != 7
        rtol = RTOL if measure.is_series else 2.0 / N  # one number for all moments may lack the one
        np.testing.assert_allclose(
            values[known], np.atleast_1d(whole.evaluate_measure(measure))[known], rtol=rtol, atol=RTOL
        )


@every_measure
def test_names_and_words(name: str) -> None:
    measure = MEASURES[name]
    assert is_column_named_by_measure(name, measure.column), "the column is the measure's name, and then a known unit"
    assert measure.summary
    assert measure.symbol
    assert measure.formula
    assert measure.source
    if measure.threshold is not None:
        assert measure.is_series
        words = measure.conflict_text(measure.threshold)
        assert not words.endswith(".")
        assert words != measure.conflict_text(measure.threshold + 1.0)
