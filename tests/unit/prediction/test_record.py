"""The measured gains: what parts there are, what follows, and what a record makes of it."""

import numpy as np
import numpy.typing as npt
import pytest

from cwcli.prediction.calibrate import plan_vehicle_paths
from cwcli.prediction.fleet import (
    HORIZON_KNOTS_S,
    FleetPrior,
    acting_time_from_displacement_share_s,
    interpolate_acting_time_s,
    load_fleet_prior,
)
from cwcli.prediction.outcome_history import (
    PRIOR_WEIGHT_IN_OUTCOMES_BY_PART,
    PathStarts,
    StateHistory,
    accel_and_yaw_rate_clearness_0_to_1,
    actual_displacement_beyond_constant_velocity_m,
    displacement_from_accel_and_yaw_rate_m,
    gain_of_each_part_from_outcomes,
    measure_acting_time_s,
    state_histories_by_vehicle,
    unclear_lasting_new_shares_of_derivatives,
)
from cwcli.prediction.paths import Paths
from cwcli.prediction.rollout import RolloutSettings, roll_out_paths

FloatArray = npt.NDArray[np.float64]
T0_NS = 1_700_000_000_000_000_000
STEP_NS = 100_000_000


def stamps(n: int) -> npt.NDArray[np.int64]:
    return T0_NS + np.arange(n) * STEP_NS


def drive(accel: FloatArray, yaw_rate: FloatArray, speed: float = 10.0) -> FloatArray:
    """States (n, 8) every 0.1 s of a car with these derivatives, by fine Euler steps."""
    n, fine = len(accel), 100
    state = np.zeros((n, 8))
    x = y = heading = 0.0
    for i in range(n):
        state[i, :6] = x, y, speed, heading, accel[i], yaw_rate[i]
        for _ in range(fine):
            dt = 0.1 / fine
            middle = heading + yaw_rate[i] * dt / 2.0
            x, y = x + speed * np.cos(middle) * dt, y + speed * np.sin(middle) * dt
            speed, heading = speed + accel[i] * dt, heading + yaw_rate[i] * dt
    return state


def sure(n: int) -> FloatArray:
    return np.tile(np.eye(8) * 1e-6, (n, 1, 1))


def track_of(state: FloatArray) -> StateHistory:
    n = len(state)
    (track,) = state_histories_by_vehicle(PathStarts(np.zeros(n, dtype=np.int64), stamps(n), state, sure(n), stamps(n)))
    return track


def acted_of(state: FloatArray, log_time_ns: npt.NDArray[np.int64] | None = None) -> FloatArray:
    n = len(state)
    return measure_acting_time_s(PathStarts(np.zeros(n, dtype=np.int64), stamps(n), state, sure(n), log_time_ns))


def test_prior_that_ships_has_gains_between_0_and_1_and_nothing_for_what_is_unclear() -> None:
    prior = load_fleet_prior()
    assert prior.gain.shape == (2, 4, 3)
    assert ((prior.gain >= 0.0) & (prior.gain <= 1.0)).all()
    assert (prior.gain[..., 0] == 0.0).all()
    assert (prior.error_m > 0.0).all()
    assert prior.log_squared.shape == (4, 6)
    assert (np.diff(prior.log_squared, axis=1) > 0.0).all()


def test_derivative_that_goes_on_acts_all_the_time() -> None:
    np.testing.assert_allclose(
        acting_time_from_displacement_share_s(np.ones((2, 4))), [HORIZON_KNOTS_S, HORIZON_KNOTS_S]
    )


def test_acted_time_by_hand() -> None:
    # full until 1 s: 0.5 s^2; at 2.5 s then 0.4 * 3.125 = 1.25 s^2 asks for 0.75 s^2 more: at -2/3, back to 0
    # until 5 s nothing more: 0.1 * 12.5 = 1.25 s^2
    share = np.tile([1.0, 1.0, 0.4, 0.1], (2, 1))
    np.testing.assert_allclose(acting_time_from_displacement_share_s(share), [[0.5, 1.0, 0.0, 0.0]] * 2, atol=1e-12)


def test_acceleration_is_taken_back_to_the_speed_of_the_start_and_a_turn_as_fast_as_it_was_made() -> None:
    # after 0.5 s both have moved 0.125 s^2 and are to be back at 0 s^2 1 s ahead, which neither can; then for good.
    # a turn: -1 for 0.5 s, so 0 and 0.25 s^2; then -2 0.25 / 1.5^2 = -0.222 until 2.5 s: -0.333 and 0 s^2; then
    # 2 0.333 2.5 / 2.5^2 = 0.267 until 5 s: 0.333 and again 0 s^2
    share = np.tile([1.0, 0.0, 0.0, 0.0], (2, 1))
    np.testing.assert_allclose(
        acting_time_from_displacement_share_s(share), [[0.5, 0.0, 0.0, 0.0], [0.5, 0.0, -1 / 3, 1 / 3]], atol=1e-12
    )


def test_no_derivative_acts_faster_than_it_said_nor_an_acceleration_against_its_sign() -> None:
    acted = acting_time_from_displacement_share_s(np.random.default_rng(0).uniform(size=(500, 2, 4)))
    assert (acted[:, 0] >= -1e-12).all()
    rate = np.diff(acted, axis=2, prepend=0.0) / np.diff(HORIZON_KNOTS_S, prepend=0.0)
    assert (rate <= 1.0 + 1e-12).all()
    assert (rate[:, 1] >= -1.0 - 1e-12).all()


def test_acted_time_between_the_knots_and_after_them() -> None:
    acted = np.array([[0.5, 0.8, 1.4, 0.4]])
    times = np.array([[0.0, 0.25, 0.75, 5.0, 9.0]])
    expected = [0.0, 0.25, 0.65, 0.4, 0.4]
    np.testing.assert_allclose(interpolate_acting_time_s(acted, times)[0], expected)
    np.testing.assert_allclose(interpolate_acting_time_s(acted[0], times[0]), expected)
    np.testing.assert_allclose(
        interpolate_acting_time_s(np.tile(acted, (2, 1)), np.tile(times, (2, 1))), [expected] * 2
    )


def test_five_sigmas_are_half_clear() -> None:
    state, covariance = np.zeros((2, 8)), np.zeros((2, 8, 8))
    state[:, 4], state[:, 5] = (-1.0, 2.0), (0.0, 0.1)
    covariance[:, 4, 4], covariance[:, 5, 5] = 0.04, 1e-4
    # (5 * 0.2 / 2)^8 = 1/256; (5 * 0.01 / 0.1)^8 likewise; a yaw rate of 0 is noise
    np.testing.assert_allclose(
        accel_and_yaw_rate_clearness_0_to_1(state, covariance), [[0.5, 0.0], [256.0 / 257.0, 256.0 / 257.0]]
    )
    assert (accel_and_yaw_rate_clearness_0_to_1(state, None) == 1.0).all()


def test_what_is_promised_by_hand() -> None:
    state = np.zeros((1, 8))
    state[0, 2], state[0, 4], state[0, 5] = 4.0, -2.0, 0.1
    # along: -h^2 until it stands at 2 s after 4 m; across: 4 * 0.1 h^2 / 2
    np.testing.assert_allclose(
        displacement_from_accel_and_yaw_rate_m(state)[0, 0], [-0.25, -1.0, 4.0 - 10.0, 4.0 - 20.0]
    )
    np.testing.assert_allclose(displacement_from_accel_and_yaw_rate_m(state)[0, 1], 0.2 * HORIZON_KNOTS_S**2)


@pytest.mark.parametrize("speed", [10.0, -10.0])
def test_steady_bend_and_steady_acceleration_follow_in_full(speed: float) -> None:
    bend = track_of(drive(np.zeros(80), np.full(80, 0.2), speed))
    straight = track_of(drive(np.full(80, 0.5 * np.sign(speed)), np.zeros(80), speed))
    for track in (bend, straight):
        followed = actual_displacement_beyond_constant_velocity_m(track)
        is_known = np.isfinite(followed)
        assert is_known.any(axis=0).all()
        np.testing.assert_allclose(
            followed[is_known], displacement_from_accel_and_yaw_rate_m(track.state)[is_known], atol=2e-3
        )


def test_parts_tell_what_lasts_from_what_is_new() -> None:
    turn_in = drive(np.zeros(60), np.where(np.arange(60) < 30, 0.0, 0.2))
    parts = unclear_lasting_new_shares_of_derivatives(track_of(turn_in))
    np.testing.assert_allclose(parts.sum(axis=-1), 1.0)
    assert parts[31, 1, 3, 2] > 0.9  # turned for 0.1 s of the last 2.5 s
    assert parts[59, 1, 3, 1] > 0.99  # turned for all of them
    np.testing.assert_allclose(parts[30 + 10, 1, 3, 1], 10 / 25, atol=1e-3)


def test_gain_is_the_ridge_estimate_of_the_outcomes_known_so_far() -> None:
    rng = np.random.default_rng(1)
    n = 120
    state = drive(rng.normal(size=n), rng.normal(size=n) * 0.1)
    state[:, 4:6] += rng.normal(size=(n, 2)) * [0.5, 0.05]
    track = track_of(state)
    prior = FleetPrior(np.full((2, 4, 3), 0.4), np.full((2, 4), 0.7), np.zeros((4, 6)))
    gain = gain_of_each_part_from_outcomes(track, unclear_lasting_new_shares_of_derivatives(track), prior)
    promised, followed = (
        displacement_from_accel_and_yaw_rate_m(state)[..., None] * unclear_lasting_new_shares_of_derivatives(track),
        actual_displacement_beyond_constant_velocity_m(track),
    )
    at = 100
    for axis in (0, 1):
        expected = prior.gain[axis, 0]
        for k, knot_s in enumerate(HORIZON_KNOTS_S.tolist()):
            known = np.arange(at - round(knot_s * 10) + 1)  # outcomes up to now
            x, y = promised[known, axis, k], followed[known, axis, k]
            left = np.minimum(np.abs(y - x @ prior.gain[axis, k]), np.abs(y))
            weight = np.where(known == 0, 0.0, 0.1) / knot_s / (1.0 + left / 0.7)
            ridge = np.diag(PRIOR_WEIGHT_IN_OUTCOMES_BY_PART * 0.7**2)
            normal = (weight[:, None] * x).T @ x + ridge
            found = np.linalg.solve(normal, (weight[:, None] * x).T @ y + ridge @ expected)
            doubt = 0.7 * np.sqrt(np.linalg.inv(normal)[0, 0]) / np.sqrt(2.0 * np.pi)
            found[0] = max(found[0] - doubt, min(found[0], expected[0]))
            expected = np.clip(found, 0.0, 1.0)
            np.testing.assert_allclose(gain[at, axis, k], expected, rtol=1e-9)


def test_derivatives_that_carry_nothing_leave_constant_velocity() -> None:
    rng = np.random.default_rng(2)
    n = 1200
    state = drive(np.zeros(n), np.zeros(n), speed=15.0)
    state[:, 4], state[:, 5] = rng.normal(size=n) * 2.0, rng.normal(size=n) * 0.1  # with a filter that is sure of them
    late = acted_of(state)[600:]
    still = roll_out_paths("cv", state[600:], None, settings=RolloutSettings(horizon_s=5.0))
    moved = roll_out_paths("auto", state[600:], None, settings=RolloutSettings(horizon_s=5.0), acting_s=late)
    error, bare = (
        np.hypot(p.x_m[:, -1] - still.x_m[:, -1], p.y_m[:, -1] - still.y_m[:, -1]).mean()
        for p in (moved, roll_out_paths("ctra", state[600:], None, settings=RolloutSettings(horizon_s=5.0)))
    )
    assert error < 0.02 * bare


def test_derivatives_that_hold_are_followed_though_the_fleet_doubts_them() -> None:
    rng = np.random.default_rng(3)
    accel = np.repeat(rng.choice([-0.5, 0.5], size=12), 100)  # each for 10 s
    state = drive(accel, np.repeat(rng.choice([-0.1, 0.1], size=12), 100), speed=25.0)
    doubt = FleetPrior(np.zeros((2, 4, 3)), np.full((2, 4), 1.0), np.zeros((4, 6)))
    n = len(state)
    vehicle = np.zeros(n, dtype=np.int64)
    acted = measure_acting_time_s(PathStarts(vehicle, stamps(n), state, sure(n), None), doubt)
    assert (acted[:5] == 0.0).all()
    assert np.median(acted[600:, :, 2]) > 0.8 * 2.5


def test_other_vehicles_of_the_log_teach_a_new_one() -> None:
    rng = np.random.default_rng(4)
    n = 600
    noisy = drive(np.zeros(n), np.zeros(n), speed=15.0)
    noisy[:, 4] = rng.normal(size=n) * 2.0
    vehicle = np.concatenate([np.zeros(n), np.ones(100)]).astype(np.int64)
    state = np.concatenate([noisy, noisy[:100]])
    stamp_ns = np.concatenate([stamps(n), stamps(n)[-100:]])
    acted = measure_acting_time_s(PathStarts(vehicle, stamp_ns, state, sure(n + 100), None))
    alone = acted_of(noisy[:100])
    assert np.abs(acted[n + 5 :, 0, 1]).mean() < 0.2 * np.abs(alone[5:, 0, 1]).mean()


def test_nothing_depends_on_what_was_known_later() -> None:
    rng = np.random.default_rng(6)
    n = 300
    state = np.concatenate([drive(rng.normal(size=n), rng.normal(size=n) * 0.1) for _ in range(2)])
    vehicle = np.repeat([0, 1], n)
    stamp_ns = np.concatenate([stamps(n), stamps(n) + 37_000_000])
    log_time_ns = stamp_ns + rng.integers(0, 400_000_000, size=2 * n)  # some overtake others
    whole = measure_acting_time_s(PathStarts(vehicle, stamp_ns, state, sure(2 * n), log_time_ns))
    for cut_ns in rng.integers(T0_NS, stamp_ns[-1], size=50):
        kept = log_time_ns < cut_ns
        part = measure_acting_time_s(
            PathStarts(vehicle[kept], stamp_ns[kept], state[kept], sure(int(kept.sum())), log_time_ns[kept])
        )
        np.testing.assert_array_equal(part, whole[kept])


def test_no_path_or_ellipse_depends_on_what_was_known_later() -> None:
    rng = np.random.default_rng(8)
    n = 150
    state = np.concatenate([drive(rng.normal(size=n), rng.normal(size=n) * 0.1) for _ in range(2)])
    vehicle = np.repeat([0, 1], n)
    stamp_ns = np.tile(stamps(n), 2)
    log_time_ns = stamp_ns + rng.integers(0, 400_000_000, size=2 * n)

    def predicted(rows: npt.NDArray[np.bool_]) -> Paths:
        starts = PathStarts(vehicle[rows], stamp_ns[rows], state[rows], sure(int(rows.sum())), log_time_ns[rows])
        return plan_vehicle_paths("auto", starts).paths_of_rows(slice(None))

    whole = predicted(np.full(2 * n, True))
    for cut_ns in rng.integers(T0_NS, stamp_ns[-1], size=10):
        kept = log_time_ns < cut_ns
        part, before = predicted(kept), whole.paths_of_rows(np.flatnonzero(kept))
        for name in ("x_m", "y_m", "heading_rad", "speed_mps", "position_covariance_m2"):
            np.testing.assert_array_equal(getattr(part, name), getattr(before, name))


def test_rows_may_come_in_any_order_and_a_state_that_is_not_finite_teaches_nothing() -> None:
    rng = np.random.default_rng(7)
    n = 200
    state = drive(rng.normal(size=n), rng.normal(size=n) * 0.1)
    expected = acted_of(state)
    broken = np.insert(state, 100, np.nan, axis=0)
    stamp_ns = np.insert(stamps(n), 100, stamps(n)[100] - 50_000_000)
    order = rng.permutation(n + 1)
    found = np.empty((n + 1, 2, 4))
    vehicle = np.zeros(n + 1, dtype=np.int64)
    found[order] = measure_acting_time_s(PathStarts(vehicle, stamp_ns[order], broken[order], sure(n + 1), None))
    np.testing.assert_allclose(np.delete(found, 100, axis=0), expected, atol=1e-12)
