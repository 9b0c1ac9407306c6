"""The flags of states: by hand on a straight line, and known at their time where the filter runs alone."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.estimation import EstimatorConfig, Kind, Measurements, Track, estimate_track
from cwcli.signals.vehicle_state import StateFlag

EPOCH_NS = 1_700_000_000_000_000_000
TIME_S = np.arange(0.0, 40.0, 0.1)


def _stamps(time_s: np.ndarray) -> np.ndarray:
    return EPOCH_NS + np.round(time_s * 1e9).astype(np.int64)


def _fixes(time_s: np.ndarray, *, jump_s: float = np.inf) -> Measurements:
    """Each 0.1 s along x at 10 m/s, good to 0.1 m; from `jump_s` on 200 m to the left."""
    rng = np.random.default_rng(0)
    xy = np.stack([10.0 * time_s, 200.0 * (time_s >= jump_s)], axis=1) + 0.1 * rng.standard_normal((len(time_s), 2))
    return Measurements("gps", Kind.POSITION, _stamps(time_s), xy)


def _track(fixes: Measurements, *, causal: bool) -> Track:
    return estimate_track([fixes], EstimatorConfig(latency="none", causal=causal), _stamps(TIME_S))


def _times_of(flag: StateFlag, track: Track) -> np.ndarray:
    return TIME_S[(track.flags & flag) > 0]


@pytest.mark.parametrize("causal", [False, True])
def test_the_first_states_are_starting_until_two_seconds_after_a_heading_showed(causal: bool) -> None:
    """2 m, the least way that shows a heading, take 0.2 s at 10 m/s with the noise found, 0.1 m."""
    track = _track(_fixes(TIME_S), causal=causal)
    starting = _times_of(StateFlag.STARTING, track)
    assert starting[0] == 0.0
    assert 2.0 < starting[-1] < 3.5
    np.testing.assert_allclose(np.diff(starting), 0.1)
    # Online, three fixes in a row are beyond the gate at 12.0 s, because the noise found is small; that is said.
    assert not (track.flags & ~np.uint8(StateFlag.STARTING | StateFlag.REJECTING)).any()


def test_nothing_but_starting_where_no_heading_ever_shows() -> None:
    rng = np.random.default_rng(1)
    parked = Measurements("gps", Kind.POSITION, _stamps(TIME_S), 0.1 * rng.standard_normal((len(TIME_S), 2)))
    assert len(_times_of(StateFlag.STARTING, _track(parked, causal=True))) == len(TIME_S)


def test_a_gap_is_bridged_from_its_first_state_in_hindsight_and_from_two_seconds_on_when_it_happens() -> None:
    seen = TIME_S[(TIME_S < 14.95) | (TIME_S > 24.95)]  # the last fix before is at 14.9 s, the next at 25.0 s
    hindsight = _times_of(StateFlag.BRIDGED, _track(_fixes(seen), causal=False))
    assert (hindsight[0], hindsight[-1]) == pytest.approx((15.0, 24.9))
    online = _times_of(StateFlag.BRIDGED, _track(_fixes(seen), causal=True))
    assert (online[0], online[-1]) == pytest.approx((17.0, 24.9), abs=0.11)
    again = _times_of(StateFlag.STARTING, _track(_fixes(seen), causal=False))
    assert again[again > 10.0] == pytest.approx(np.arange(25.0, 27.0, 0.1), abs=0.01)


def test_states_behind_the_last_position_are_bridged() -> None:
    track = _track(_fixes(TIME_S[TIME_S < 30.05]), causal=True)
    assert _times_of(StateFlag.BRIDGED, track)[0] == pytest.approx(32.0, abs=0.11)


def test_after_a_reset_states_are_flagged_for_two_seconds_and_in_hindsight_since_the_first_rejection() -> None:
    fixes = _fixes(TIME_S, jump_s=19.95)
    online = _times_of(StateFlag.AFTER_RESET, _track(fixes, causal=True))
    hindsight = _times_of(StateFlag.AFTER_RESET, _track(fixes, causal=False))
    assert online[0] == pytest.approx(22.0, abs=0.3)  # two seconds of rejections, see `ekf.MAX_REJECTION_TIME_S`
    assert online[-1] - online[0] == pytest.approx(1.9, abs=0.11)
    assert hindsight[0] == pytest.approx(20.0, abs=0.01)
    assert hindsight[-1] == pytest.approx(online[-1], abs=0.01)


def _with(kind: Kind, values: np.ndarray, *, begin_s: float = 0.0) -> Measurements:
    rows = begin_s - 1e-9 <= TIME_S
    covariance = np.full((int(rows.sum()), values.shape[1] if values.ndim > 1 else 1), 0.01)
    return Measurements(kind.name, kind, _stamps(TIME_S[rows]), values[rows], covariance)


SPEED_MPS, HEADING_RAD = np.full(len(TIME_S), 10.0), np.zeros(len(TIME_S))
VELOCITY_MPS = np.stack([SPEED_MPS, 0.0 * SPEED_MPS], axis=1)


@pytest.mark.parametrize("causal", [False, True])
@pytest.mark.parametrize(
    ("more", "n_starting"),
    [
        pytest.param((_with(Kind.SPEED, SPEED_MPS), _with(Kind.HEADING, HEADING_RAD)), 0, id="whole at once"),
        pytest.param((_with(Kind.VELOCITY, VELOCITY_MPS),), 0, id="velocity of a moving car"),
        pytest.param((_with(Kind.HEADING, HEADING_RAD),), 20, id="no speed"),
        pytest.param(
            (_with(Kind.SPEED, SPEED_MPS, begin_s=0.5), _with(Kind.HEADING, HEADING_RAD)), 5, id="speed from 0.5 s on"
        ),
    ],
)
def test_states_are_not_starting_once_position_speed_and_heading_are_measured(
    more: tuple[Measurements, ...], n_starting: int, causal: bool
) -> None:
    track = estimate_track([_fixes(TIME_S), *more], EstimatorConfig(latency="none", causal=causal), _stamps(TIME_S))
    assert np.count_nonzero(track.flags & StateFlag.STARTING) == n_starting
