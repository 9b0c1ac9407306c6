"""The scale of an accelerometer by gravity and by the motion, and that of the map of the fixes by the accelerometer."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.source_judgement import JudgedSources
from tests.studies.lying_sensors import judged, simulated, variants
from tests.studies.sensor_faults import LATER_FAULTS
from tests.studies.sensor_model import measurements_of
from tests.unit.estimation.test_source_judgement import ALL, LEAN, _drive, _gyro, _judge, _with_fault


def _forward_accelerations(judged: JudgedSources) -> np.ndarray:
    return next(p.series.values[:, 0] for p in judged.prepared if p.series.kind is Kind.ACCEL)


@pytest.mark.parametrize("kinds", [ALL, LEAN], ids=["all", "lean"])
@pytest.mark.parametrize(
    ("scale", "told"),
    [(0.8, "0.80 times the acceleration, as gravity"), (1.3, "1.30 times the acceleration, as gravity")],
)
def test_an_accelerometer_of_another_scale_is_corrected_by_gravity(
    kinds: tuple[Kind, ...], scale: float, told: str
) -> None:
    right = _drive(*kinds)
    judged = _judge(_with_fault(right, Kind.IMU, lambda v: v * np.repeat([scale, 1.0], 3)))
    (correction,) = judged.corrections
    assert told in correction.fault
    assert judged.contradictions == ()
    accel, expected = (_forward_accelerations(each) for each in (judged, _judge(right)))
    assert np.abs(accel - expected).max() < 0.01 * np.abs(expected).max()


@pytest.mark.parametrize(
    ("east", "north"), [(0.6, 0.6), (1.5, 1.5), (1.5, 1.0), (1.0, 0.6)], ids=["degrees", "far", "east", "north"]
)
def test_a_map_of_another_scale_is_named_where_gravity_shows_that_of_the_accelerometer(
    east: float, north: float
) -> None:
    """A map may be stretched in one direction alone, as where a longitude is not multiplied by its cosine."""
    judged = _judge(_with_fault(_drive(*LEAN), Kind.POSITION, lambda v: v * [east, north]))
    assert judged.corrections == ()
    found = judged.contradictions[0]
    assert str(found.who) == "ego_position (/position)"
    assert "the accelerations of /imu show, whose gravity is right" in found.what
    assert found.left_out == ()


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_a_gyroscope_of_another_scale_blames_no_map_in_a_drive_with_few_turns(scale: float) -> None:
    """Speed times turn rate is the lateral acceleration; the turns of the fixes show which of the two is wrong."""
    lean = variants(measurements_of(simulated("curve", 30153)))["lean"]
    found = judged(_with_fault(lean, Kind.IMU, lambda v: v * np.repeat([1.0, scale], 3))).contradictions
    assert [str(each.who) for each in found] == ["imu yaw rate (imu)"]
    for wrong_map in (lambda v: 0.6 * v, lambda v: 1.5 * v):
        found = judged(_with_fault(lean, Kind.POSITION, wrong_map)).contradictions
        assert [str(each.who) for each in found] == ["ego_position (gnss)"]


@pytest.mark.parametrize("seed", [30117, 30202])
def test_a_stretch_to_the_east_shows_in_one_coarse_fix_a_second(seed: int) -> None:
    """As where degrees of longitude are not multiplied by their cosine, at 48 degrees north."""
    lean = variants(measurements_of(simulated("city-coarse", seed)))["lean"]
    assert judged(lean).contradictions == ()
    fault = next(fault for fault in LATER_FAULTS if fault.name == "fix east x 1.5")
    (found,) = judged(fault.apply(lean)).contradictions
    assert str(found.who) == "ego_position (gnss)"
    stretch = re.search(r"move (\d\.\d) times as far to the east as to the north", found.what)
    assert stretch is not None
    assert float(stretch[1]) == pytest.approx(1.5, abs=0.16)  # the next one that is tried is 1.65


def test_an_imu_without_gravity_shows_no_scale() -> None:
    def fault(m: Measurements) -> Measurements:
        return replace(m, values=0.7 * m.values if m.kind is Kind.POSITION else m.values - [0, 0, 9.80665, 0, 0, 0])

    assert not any(
        str(each.who).startswith("ego_position") for each in _judge(list(map(fault, _drive(*LEAN)))).contradictions
    )


@pytest.mark.parametrize("kinds", [ALL, LEAN], ids=["all", "lean"])
@pytest.mark.parametrize(("columns", "name"), [((3, 4, 5), "a gyroscope"), ((0, 1), "an accelerometer")])
def test_a_part_of_an_imu_that_lags_behind_the_other_is_moved(
    kinds: tuple[Kind, ...], columns: tuple[int, ...], name: str
) -> None:
    """Both have one clock, so that no latency explains it; 16 rows at 20 Hz are 0.8 s."""

    def lagging(values: np.ndarray) -> np.ndarray:
        late = values.copy()
        late[16:, list(columns)] = values[:-16, list(columns)]
        return late

    judged = _judge(_with_fault(_drive(*kinds), Kind.IMU, lagging))
    (correction,) = judged.corrections
    assert re.match(rf"has {name} that lags behind its \w+ by 0\.[89] s", correction.fault)
    moved = next(p.series for p in judged.prepared if p.series.kind is Kind.YAW_RATE)
    assert judged.contradictions == ()
    assert np.abs(moved.values[moved.time_s % 20.0 > 13.0, 0]).max() < 0.05  # going straight again


def test_a_clipped_accelerometer_is_set_aside_where_it_is_at_the_end_of_its_range() -> None:
    (correction,) = _judge(_with_fault(_drive(*LEAN), Kind.IMU, lambda v: np.clip(v, -1.0, 20.0))).corrections
    assert "saturated" in correction.fault
    # It brakes by 2 m/s^2 in six times 4 s. To the right it turns three times alone, which is no end of a range yet.
    assert correction.n_set_aside == pytest.approx(6 * 4 * 20, abs=10)


@pytest.mark.parametrize("kinds", [ALL, LEAN], ids=["all", "lean"])
@pytest.mark.parametrize(("lag_s", "told"), [(2.0, "2.0 s earlier"), (-2.0, "2.0 s later")])
def test_clocks_of_fixes_and_imu_that_are_seconds_apart_are_named_and_nothing_is_moved(
    kinds: tuple[Kind, ...], lag_s: float, told: str
) -> None:
    """Either may be wrong."""
    late = {Kind.IMU} if lag_s > 0.0 else {*ALL} - {Kind.IMU}
    apart = [replace(m, stamp_ns=m.stamp_ns + 2 * 10**9 * (m.kind in late)) for m in _drive(*kinds)]
    judged = _judge(apart)
    assert judged.corrections == ()
    (found,) = (each for each in judged.contradictions if "come about" in each.what)
    assert told in found.what
    assert found.left_out == ()


def test_fixes_that_are_early_beside_all_others_move_none_of_these() -> None:
    early = [replace(m, stamp_ns=m.stamp_ns + 1_500_000_000 * (m.kind is not Kind.POSITION)) for m in _drive(*ALL)]
    judged = _judge(early)
    assert judged.corrections == ()
    assert any("1.5 s earlier in its fixes" in each.what for each in judged.contradictions)


@pytest.mark.parametrize(("early_s", "told"), [(1.0, True), (0.5, False), (-1.0, False)])
def test_noisy_fixes_of_a_second_ahead_are_named_and_what_the_search_for_latencies_finds_is_not(
    early_s: float, told: bool
) -> None:
    """Of ten fixes a second all are used, so that a noise of 0.5 m hides no second."""
    lean = variants(measurements_of(simulated("city", 30202)))["lean"]
    shift_ns = round(early_s * 1e9) * np.array([m.kind is Kind.POSITION for m in lean])
    moved = [replace(m, stamp_ns=m.stamp_ns - shift) for m, shift in zip(lean, shift_ns.tolist(), strict=True)]
    assert [each.what[:65] for each in judged(moved).contradictions] == [
        "the same turns and changes of speed come about 1.0 s earlier in i"
    ] * told


def _drive_with_lever_arm_and_late_fixes(
    speed_mps: np.ndarray, yaw_rate_radps: np.ndarray, lever_arm_m: float = 0.0, late_s: float = 0.0
) -> list[Measurements]:
    """Return fixes at 10 Hz and an IMU x m ahead of the rear axle at 50 Hz, which reads v' - x w^2 and v w + x w'."""
    rng, step_s = np.random.default_rng(0), 0.02
    t = step_s * np.arange(len(speed_mps))
    heading = 0.3 + step_s * np.cumsum(yaw_rate_radps)
    east, north = (step_s * np.cumsum(speed_mps * f(heading)) for f in (np.cos, np.sin))
    forward = np.gradient(speed_mps, t) - lever_arm_m * yaw_rate_radps**2
    left = speed_mps * yaw_rate_radps + lever_arm_m * np.gradient(yaw_rate_radps, t)
    imu = np.column_stack([forward, left, 0.0 * t + 9.80665, 0.0 * t, 0.0 * t, yaw_rate_radps])
    imu += rng.standard_normal(imu.shape) * np.repeat([0.1, 0.005], 3)
    fixes = np.column_stack([np.interp(t - late_s, t, each) for each in (east, north)])[::5]
    stamp_ns = np.rint(1e9 * t).astype(np.int64)
    return [
        Measurements("/position", Kind.POSITION, stamp_ns[::5], fixes + 0.3 * rng.standard_normal(fixes.shape)),
        Measurements("/imu", Kind.IMU, stamp_ns, imu),
    ]


@pytest.mark.parametrize(
    ("lever_arm_m", "fast_mps", "slow_mps"), [(2.0, 8.0, 4.0), (3.0, 10.0, 4.0), (5.0, 11.0, 5.0), (5.0, 11.0, 8.0)]
)
def test_an_imu_ahead_of_the_rear_axle_lags_in_no_turn(lever_arm_m: float, fast_mps: float, slow_mps: float) -> None:
    """Turns by a right angle in 5 s every 20 s: x w' leads v w as a gyroscope that lags would."""
    speed, rate = _slow_turns(fast_mps, slow_mps, 5.0)
    judged = _judge(_drive_with_lever_arm_and_late_fixes(speed, rate, lever_arm_m=lever_arm_m))
    assert judged.corrections == ()


def _slow_turns(
    fast_mps: float, slow_mps: float, turn_s: float, *, one_in: float = 3.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return speed and turn rate of five minutes of turns by a right angle every 20 s; one in some is to the right."""
    t = 0.02 * np.arange(15_000)
    since = (t + 10.0) % 20.0 - 10.0
    side = np.where((t + 10.0) // 20.0 % one_in == 1.0, -1.0, 1.0)
    rate = side * np.where(np.abs(since) < 0.5 * turn_s, np.pi**2 / 4.0 / turn_s * np.cos(np.pi * since / turn_s), 0.0)
    return fast_mps - (fast_mps - slow_mps) * np.exp(-0.5 * (since / 3.5) ** 2), rate


@pytest.mark.parametrize(
    ("lever_arm_m", "fast_mps", "slow_mps", "turn_s", "one_in"),
    [
        (-3.0, 8.0, 4.0, 5.0, 3.0),
        (-1.5, 10.0, 4.0, 3.0, 3.0),
        (-3.0, 6.0, 3.0, 3.0, math.inf),
        (2.0, 6.0, 3.0, 3.0, math.inf),
    ],
)
def test_a_lever_arm_in_slow_turns_is_no_high_pass_filter_and_no_yaw(
    lever_arm_m: float, fast_mps: float, slow_mps: float, turn_s: float, one_in: float
) -> None:
    """Behind the axle w^2 adds in each turn, where the car is slow; in turns to the left alone it goes with v w."""
    speed, rate = _slow_turns(fast_mps, slow_mps, turn_s, one_in=one_in)
    judged = _judge(_drive_with_lever_arm_and_late_fixes(speed, rate, lever_arm_m=lever_arm_m))
    assert judged.corrections == ()
    assert judged.contradictions == ()


def test_a_yaw_is_found_beside_a_lever_arm() -> None:
    speed, rate = _slow_turns(8.0, 4.0, 5.0)
    fixes, imu = _drive_with_lever_arm_and_late_fixes(speed, rate, lever_arm_m=-2.0)
    c, s = math.cos(math.radians(20.0)), math.sin(math.radians(20.0))
    turned = imu.values.copy()
    turned[:, :2] = imu.values[:, :2] @ np.array([[c, -s], [s, c]])
    (correction,) = _judge([fixes, replace(imu, values=turned)]).corrections
    assert re.match(r"is mounted turned by (19|20|21) degrees", correction.fault)


def test_a_lever_arm_is_no_other_unit_of_an_accelerometer_whose_gravity_is_right() -> None:
    """A bus that winds at 8 m/s: x w' of 6 m makes the left acceleration much greater than v w."""
    rng, t = np.random.default_rng(1), 0.02 * np.arange(15_000)

    def smooth_noise(scale: float, correlation_s: float) -> np.ndarray:
        kernel = np.exp(-0.5 * (np.arange(-5.0 * correlation_s, 5.0 * correlation_s, 0.02) / correlation_s) ** 2)
        return scale * np.convolve(rng.standard_normal(len(t)), kernel / np.sqrt((kernel**2).sum()), "same")

    speed, rate = np.maximum(8.0 + smooth_noise(1.0, 5.0), 1.0), smooth_noise(0.25, 1.2)
    fixes, imu = _drive_with_lever_arm_and_late_fixes(speed, rate, lever_arm_m=6.0)
    others = [
        Measurements("/speed", Kind.SPEED, imu.stamp_ns, speed[:, None]),
        Measurements("/heading", Kind.HEADING, imu.stamp_ns, (0.3 + 0.02 * np.cumsum(rate))[:, None]),
    ]
    assert _judge([fixes, *others, imu]).corrections == ()


@pytest.mark.parametrize(("late_s", "period_s", "rate_radps"), [(0.8, 4.5, 0.5), (1.0, 4.5, 0.5), (1.0, 5.0, 0.4)])
def test_fixes_that_are_late_in_a_slalom_are_no_imu_that_is_late_by_the_rest_of_its_period(
    late_s: float, period_s: float, rate_radps: float
) -> None:
    t = 0.02 * np.arange(6_000)
    rate = rate_radps * np.cos(2.0 * np.pi * t / period_s)
    judged = _judge(_drive_with_lever_arm_and_late_fixes(0.0 * t + 15.0, rate, late_s=late_s))
    assert judged.corrections == ()
    assert not any("come about" in each.what for each in judged.contradictions)


def test_a_lag_is_moved_without_making_up_the_last_rows() -> None:
    def lagging(values: np.ndarray) -> np.ndarray:
        return np.column_stack([values[:, :3], np.roll(values[:, 3:], 16, axis=0)])

    right = _drive(*LEAN)
    (correction,) = _judge(_with_fault(right, Kind.IMU, lagging)).corrections
    # 20 rows a second are lost for the lag that was found, 0.8 or 0.9 s.
    n_lost = len(right[1]) - correction.n_rows
    assert 16 <= n_lost <= 18
    assert f"({n_lost} rows without later ones are left out)" in correction.action


def test_a_gyroscope_and_a_heading_that_both_count_clockwise_do_not_mirror_the_map() -> None:
    """Two against one: but the IMU's own lateral acceleration is with the fixes."""
    both = _with_fault(_with_fault(_drive(*ALL), Kind.IMU, _gyro(-1.0)), Kind.HEADING, lambda v: 0.5 * np.pi - v)
    judged = _judge(both)
    assert [(each.who.kind, each.name) for each in judged.corrections] == [
        (Kind.IMU, "gyro-reversed"),
        (Kind.HEADING, "clockwise-from-north"),
    ]
    assert judged.contradictions == ()


def test_a_mirrored_map_does_not_reverse_the_gyroscope() -> None:
    judged = _judge(_with_fault(_drive(*ALL), Kind.POSITION, lambda v: v * [-1.0, 1.0]))
    assert [each.who.kind for each in judged.corrections] == [Kind.POSITION]


@pytest.mark.parametrize("step", [0.1, 0.5])
def test_a_coarse_imu_is_not_at_the_end_of_its_range(step: float) -> None:
    """Rounded to few values it often repeats its greatest one, but the one beside it more often."""

    def rounded(values: np.ndarray) -> np.ndarray:
        return np.column_stack([step * np.rint(values[:, :3] / step), values[:, 3:]])

    coarse = _with_fault(_drive(*LEAN), Kind.IMU, rounded)
    assert not any("saturated" in each.fault for each in _judge(coarse).corrections)
