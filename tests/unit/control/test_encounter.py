"""Replays of estimated tracks around a warning, against kinematics by hand."""

import numpy as np
import pytest

from cwcli.control.closed_loop import RecordedMotion
from cwcli.control.encounter import (
    BRAKING_POLICY_NAMES,
    RecordedTrack,
    ReplaySpan,
    contiguous_rows_around,
    extend_motion,
    replay_warning,
)

T0_NS = 1_700_000_000_000_000_000
STEP_NS = 50_000_000
FUZZY, DRIVER = BRAKING_POLICY_NAMES.index("fuzzy"), BRAKING_POLICY_NAMES.index("driver")


def track(start_m: float, speed_mps: float, seconds: float, *, first_s: float = 0.0) -> RecordedTrack:
    """East along the x axis at constant speed."""
    stamp_ns = T0_NS + np.arange(round(first_s * 20), round((first_s + seconds) * 20) + 1) * STEP_NS
    state = np.zeros((len(stamp_ns), 8))
    state[:, 0] = start_m + speed_mps * (stamp_ns - T0_NS) * 1e-9
    state[:, 2] = speed_mps
    return RecordedTrack(stamp_ns, state)


def test_no_action_drives_through_a_standing_car_as_recorded() -> None:
    # 20 m/s towards a car at 120 m: the centres are 2.5 m apart after 117.5 / 20 = 5.875 s, 3.875 s after the warning.
    # The driver needs 30 m for his reaction and 31.7 m for 6.3 m/s^2, and there are 80 m.
    found = replay_warning(track(0.0, 20.0, 8.0), track(120.0, 0.0, 8.0), T0_NS + 2_000_000_000, ReplaySpan())
    assert found.collided.tolist() == [True, False, False]
    assert found.collision_time_s[0] == pytest.approx(3.88, abs=1e-6)  # the first step of 0.01 s after 3.875 s
    assert found.impact_speed_mps[0] == pytest.approx(20.0)
    assert found.min_distance_m[0] == pytest.approx(0.0, abs=0.1)
    assert np.isnan(found.stopped_time_s[0])
    assert found.peak_deceleration_mps2[0] == 0.0


def test_controller_brakes_before_the_driver_does() -> None:
    found = replay_warning(track(0.0, 20.0, 8.0), track(120.0, 0.0, 8.0), T0_NS + 2_000_000_000, ReplaySpan())
    assert found.stopped_time_s[FUZZY] < found.stopped_time_s[DRIVER]
    assert found.min_distance_m[FUZZY] > found.min_distance_m[DRIVER] - 1e-9
    early = (found.outcome.time_s > 0.3) & (found.outcome.time_s < 1.45)
    assert np.all(found.outcome.speed_mps[FUZZY, early] < 20.0)
    np.testing.assert_allclose(found.outcome.speed_mps[DRIVER, early], 20.0)
    # The driver: 7 MPa * 0.9 = 6.3 m/s^2.
    assert found.peak_deceleration_mps2[DRIVER] == pytest.approx(6.3, abs=0.01)


def test_all_policies_are_the_recording_until_the_warning() -> None:
    found = replay_warning(track(0.0, 20.0, 8.0), track(100.0, 0.0, 8.0), T0_NS + 3_000_000_000, ReplaySpan())
    before = found.outcome.time_s <= 1e-9
    assert found.outcome.time_s[0] == pytest.approx(-3.0)  # the record begins there
    expected = 20.0 * (found.outcome.time_s[before] + 3.0)
    for policy in range(len(BRAKING_POLICY_NAMES)):
        np.testing.assert_allclose(found.outcome.x_m[policy, before], expected, atol=1e-6)


def test_replay_goes_on_beyond_the_record_and_says_so() -> None:
    found = replay_warning(
        track(0.0, 10.0, 4.0), track(60.0, 10.0, 3.0), T0_NS + 2_000_000_000, ReplaySpan(after_s=5.0)
    )
    assert found.recorded_until_s == pytest.approx(1.0)
    assert found.outcome.time_s[-1] == pytest.approx(6.0)
    np.testing.assert_allclose(found.outcome.distance_m[0], 60.0, atol=1e-6)


def test_duration_bounds_the_replay() -> None:
    found = replay_warning(track(0.0, 10.0, 60.0), track(60.0, 10.0, 60.0), T0_NS + 20_000_000_000, ReplaySpan())
    assert (found.outcome.time_s[0], found.outcome.time_s[-1]) == pytest.approx((-5.0, 15.0))


def test_standing_host_with_noisy_positions_stays_where_it_is() -> None:
    host = track(0.0, 0.0, 20.0)
    host.state[:, :2] += np.random.default_rng(1).normal(0.0, 0.3, (len(host.stamp_ns), 2))
    found = replay_warning(host, track(50.0, 0.0, 20.0), T0_NS + 10_000_000_000, ReplaySpan())
    assert np.ptp(found.outcome.x_m[FUZZY]) < 2.0


@pytest.mark.parametrize(
    ("host", "other", "is_behind"),
    [
        (track(0.0, 10.0, 10.0), track(60.0, 5.0, 10.0), False),
        (track(0.0, 10.0, 10.0), track(-60.0, 15.0, 10.0), True),
    ],
)
def test_who_is_behind(host: RecordedTrack, other: RecordedTrack, is_behind: bool) -> None:
    assert replay_warning(host, other, T0_NS + 2_000_000_000, ReplaySpan()).is_behind is is_behind


def test_rows_end_at_a_gap() -> None:
    stamp_ns = np.array([0, 1, 2, 5, 6, 7, 20]) * 1_000_000_000
    assert contiguous_rows_around(stamp_ns, 6_500_000_000) == slice(3, 6)
    assert contiguous_rows_around(stamp_ns, 0) == slice(0, 3)
    assert contiguous_rows_around(stamp_ns, 30_000_000_000) == slice(6, 7)
    assert contiguous_rows_around(stamp_ns, -500_000_000) == slice(0, 3)  # a sender whose clock is ahead
    with pytest.raises(ValueError, match="after the warning"):
        contiguous_rows_around(stamp_ns, -1_500_000_000)


def test_extension_is_an_arc() -> None:
    # Speed pi m/s and yaw rate pi/4 rad/s from the origin, eastward: radius 4 m; after 2 s a quarter circle to (4, 4).
    time_s = np.array([0.0, 1.0])
    still = np.zeros(2)
    motion = RecordedMotion(time_s, still, still, still, np.full(2, np.pi), still, np.full(2, np.pi / 4.0))
    longer = extend_motion(motion, 3.0)
    assert longer.time_s[-1] == 3.0
    assert (longer.x_m[-1], longer.y_m[-1]) == pytest.approx((4.0, 4.0))
    assert longer.heading_rad[-1] == pytest.approx(np.pi / 2.0)
    assert extend_motion(motion, 1.0) is motion


@pytest.mark.parametrize("first_s", [0.0, 0.3], ids=["first state", "sender's clock ahead"])
def test_warning_at_the_first_state(first_s: float) -> None:
    """The host has its speed from the start, although nothing is recorded before the warning."""
    found = replay_warning(
        track(0.0, 20.0, 8.0), track(100.0, 0.0, 8.0 - first_s, first_s=first_s), T0_NS, ReplaySpan()
    )
    assert found.outcome.time_s[0] == pytest.approx(-0.05)
    here = int(found.after_warning_mask.argmax())
    np.testing.assert_allclose(found.outcome.speed_mps[:, here], 20.0, atol=0.05)
    assert found.collided.tolist() == [True, False, False]
