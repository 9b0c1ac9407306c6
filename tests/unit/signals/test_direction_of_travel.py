"""Direction of travel and horizontal speed of an odometry whose device is turned against the car."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest

from cwcli.signals.angles import wrap_angle
from cwcli.signals.build import build_signal
from cwcli.signals.builders.base import Reading
from cwcli.signals.builders.targets import build_pose_truth
from cwcli.signals.canonical import PoseSignal, SpeedSignal
from cwcli.signals.columns import Columns, FloatArray
from cwcli.signals.direction_of_travel import find_yaw_mounting, travel_direction_and_signed_speed
from cwcli.signals.role import Role
from tests.unit.signals.mounted_device import DEG, odometry
from tests.unit.signals.signal_columns import T0_NS, columns_of, stamp_fields

STEP_S = 0.1
TIME_S = STEP_S * np.arange(1200.0)
EXACT = 1e-9


def curvy_heading() -> FloatArray:
    """Bends to both sides; passes through half a turn."""
    return 2.8 + 0.8 * np.sin(0.12 * TIME_S)


def city_speed() -> FloatArray:
    """From a stand to 20 m/s and back, three times."""
    return 10.0 - 10.0 * np.cos(2.0 * np.pi * TIME_S / 40.0)


def pose_of(columns: Columns) -> PoseSignal:
    signal, _ = build_signal(Role.TRUTH, columns)
    assert isinstance(signal, PoseSignal)
    return signal


@pytest.mark.parametrize(
    "mounted",
    [
        {},
        {"pitch": -3.8, "left": 0.9},
        {"pitch": 3.8, "roll": 12.0, "left": -2.0},
        {"left": 90.0, "roll": -90.0},
        {"left": 180.0},
    ],
    ids=["along", "nose up", "rolled", "camera axes", "backwards"],
)
@pytest.mark.parametrize("is_map", [False, True], ids=["child frame", "axes of the pose"])
def test_speed_course_and_yaw_rate_do_not_depend_on_the_mounting(mounted: dict[str, Any], is_map: bool) -> None:
    heading, speed = curvy_heading(), city_speed()
    signal = pose_of(odometry(TIME_S, heading, speed, is_map=is_map, **mounted))
    in_motion = speed > 2.0
    np.testing.assert_allclose(signal.speed_mps[in_motion], speed[in_motion], atol=EXACT)
    np.testing.assert_allclose(wrap_angle(signal.travel_rad - heading)[in_motion], 0.0, atol=EXACT)
    np.testing.assert_allclose(wrap_angle(signal.travel_rad - heading), 0.0, atol=1e-5)
    np.testing.assert_allclose(signal.speed_mps, speed, atol=1e-6)
    np.testing.assert_allclose(signal.yaw_rate_radps, np.gradient(heading, TIME_S), atol=EXACT)
    assert signal.mounting is not None
    assert wrap_angle(signal.mounting.left_rad - mounted.get("left", 0.0) * DEG) == pytest.approx(0.0, abs=1e-5)
    assert signal.mounting.is_significant == bool(mounted.get("left", 0.0))


def test_note_on_the_mounting_names_side_and_angle() -> None:
    mounting = pose_of(odometry(TIME_S, curvy_heading(), city_speed(), left=0.9, noise_mps=0.05)).mounting
    assert mounting is not None
    assert mounting.mounting_note("/truth/odom").startswith(
        "/truth/odom: its device is mounted 0.9 deg to the left of the direction of travel (sigma 0.0"
    )


def test_car_that_reverses_keeps_its_heading_and_has_a_negative_speed() -> None:
    heading, speed = curvy_heading(), 5.0 + 8.0 * np.cos(2.0 * np.pi * TIME_S / 60.0)
    assert speed.min() < -2.9
    signal = pose_of(odometry(TIME_S, heading, speed, pitch=3.8, left=0.9))
    np.testing.assert_allclose(signal.speed_mps, speed, atol=1e-3)
    np.testing.assert_allclose(wrap_angle(signal.travel_rad - heading), 0.0, atol=1e-4)


def test_car_that_stands_has_the_heading_of_its_device_without_the_mounting_and_no_speed() -> None:
    heading, speed = curvy_heading(), np.maximum(city_speed() - 8.0, 0.0)
    stands = speed == 0.0
    heading[stands] = np.interp(TIME_S[stands], TIME_S[~stands], heading[~stands])
    signal = pose_of(odometry(TIME_S, heading, speed, left=5.0, noise_mps=0.05))
    assert np.abs(np.degrees(wrap_angle(signal.travel_rad - heading)[stands])).max() < 0.2
    assert np.mean(signal.speed_mps[stands]) == pytest.approx(0.0, abs=0.01)  # a magnitude would be 0.06 too fast


def test_car_that_only_stands_shows_no_mounting() -> None:
    signal = pose_of(odometry(TIME_S, np.full(len(TIME_S), 0.3), np.zeros(len(TIME_S)), left=0.9, noise_mps=0.02))
    assert signal.mounting is None
    np.testing.assert_allclose(signal.travel_rad, 0.3 + 0.9 * DEG, atol=EXACT)


@pytest.mark.parametrize("noise_m", [0.0, 0.03])
def test_poses_without_a_twist_show_the_mounting_by_their_way(noise_m: float) -> None:
    heading = curvy_heading()
    columns = odometry(TIME_S, heading, city_speed(), left=0.9, pitch=3.8)
    rng = np.random.default_rng(1)
    fields = {
        name.replace("pose.pose", "pose"): field + noise_m * rng.standard_normal(len(columns)) * ("position" in name)
        for name, field in cast(dict[str, np.ndarray], columns.fields).items()
        if "twist" not in name and "stamp" not in name
    }
    stamps = stamp_fields(T0_NS + np.round(TIME_S * 1e9).astype(np.int64))
    signal = pose_of(columns_of("geometry_msgs/msg/PoseStamped", stamps | fields, topic="/truth/pose"))
    assert signal.mounting is not None
    assert np.degrees(signal.mounting.left_rad) == pytest.approx(0.9, abs=0.1)
    assert np.degrees(wrap_angle(signal.travel_rad - heading)) == pytest.approx(0.0, abs=0.1)
    assert np.isnan(signal.speed_mps).all()


def test_twist_that_was_never_filled_is_no_speed_of_a_car_that_moves() -> None:
    zeros: dict[str, Any] = {
        f"twist.twist.{what}.{axis}": np.zeros(len(TIME_S)) for what in ("linear", "angular") for axis in "xyz"
    }
    signal = pose_of(odometry(TIME_S, curvy_heading(), city_speed(), left=0.9, **zeros))
    assert np.isnan(signal.speed_mps).all()
    assert signal.mounting is not None
    assert np.degrees(signal.mounting.left_rad) == pytest.approx(0.9, abs=0.1)


def test_circle_to_one_side_does_not_show_a_mounting() -> None:
    """A device 2 m ahead of the axle on a circle of 40 m: its course turns by atan(2 / 40), which is no mounting."""
    rate = np.full(len(TIME_S), 0.25)
    heading = rate * TIME_S
    velocity = 10.0 * np.exp(1j * heading) + 2.0 * rate * 1j * np.exp(1j * heading)
    found = find_yaw_mounting(T0_NS + np.round(TIME_S * 1e9).astype(np.int64), velocity, wrap_angle(heading), rate)
    assert found is not None
    assert np.degrees(found.left_rad) == pytest.approx(0.0, abs=3.0 * np.degrees(found.sigma_rad))
    assert not found.is_significant


def test_bends_to_both_sides_tell_a_mounting_from_a_place_ahead_of_the_axle() -> None:
    heading = curvy_heading() + 0.2 * TIME_S / TIME_S[-1]
    rate = np.gradient(heading, TIME_S)
    velocity = city_speed() * np.exp(1j * heading) + 3.0 * rate * 1j * np.exp(1j * heading)
    stamp_ns = T0_NS + np.round(TIME_S * 1e9).astype(np.int64)
    found = find_yaw_mounting(stamp_ns, velocity, wrap_angle(heading + 0.9 * DEG), rate)
    assert found is not None
    assert np.degrees(found.left_rad) == pytest.approx(0.9, abs=0.05)


def test_sigma_of_the_mounting_is_honest_where_errors_last() -> None:
    """Yaw errors of 0.5 degrees that last 5 s, 60 drives: the mounting errs by about its sigma."""
    rng = np.random.default_rng(0)
    stamp_ns = T0_NS + np.round(TIME_S * 1e9).astype(np.int64)
    heading, keep = curvy_heading(), np.exp(-STEP_S / 5.0)
    velocity, rate = city_speed() * np.exp(1j * heading), np.gradient(heading, TIME_S)
    ratios = []
    for _ in range(60):
        error = np.zeros(len(TIME_S))
        for k in range(1, len(TIME_S)):
            error[k] = keep * error[k - 1] + np.sqrt(1.0 - keep**2) * 0.5 * DEG * rng.standard_normal()
        found = find_yaw_mounting(stamp_ns, velocity, wrap_angle(heading + error), rate)
        assert found is not None
        ratios.append(found.left_rad / found.sigma_rad)
    assert 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.5


def test_yaw_that_does_not_follow_the_way_shows_no_mounting() -> None:
    velocity = city_speed() * np.exp(1j * curvy_heading())
    yaw = np.random.default_rng(0).uniform(-np.pi, np.pi, len(TIME_S))
    stamp_ns = T0_NS + np.round(TIME_S * 1e9).astype(np.int64)
    assert find_yaw_mounting(stamp_ns, velocity, yaw, np.zeros(len(TIME_S))) is None


def test_heading_and_speed_of_single_velocities() -> None:
    """Yaw 10 degrees, mounted 5 to the left: the front points to 5 degrees."""
    velocity = np.array([10.0 * np.exp(0.1j), -10.0 * np.exp(0.1j), 0.5 * np.exp(0.1j), -0.5 + 0.0j])
    heading, speed = travel_direction_and_signed_speed(velocity, np.full(4, 10.0 * DEG), 5.0 * DEG)
    np.testing.assert_allclose(heading, [0.1, 0.1, 5.0 * DEG, 5.0 * DEG])
    np.testing.assert_allclose(speed, [10.0, -10.0, 0.5 * np.cos(0.1 - 5.0 * DEG), -0.5 * np.cos(5.0 * DEG)])


def test_odometry_as_speed_source_is_horizontal_too() -> None:
    speed = city_speed()
    signal, _ = build_signal(Role.EGO_SPEED, odometry(TIME_S, curvy_heading(), speed, pitch=-3.8, left=0.9))
    assert isinstance(signal, SpeedSignal)
    np.testing.assert_allclose(signal.speed_mps[speed > 2.0], speed[speed > 2.0], atol=EXACT)


def test_variance_is_taken_along_the_direction_of_travel() -> None:
    """A device that looks to the left drives along minus y: the variance of y counts."""
    covariance = np.zeros((len(TIME_S), 6, 6))
    covariance[:, 0, 0], covariance[:, 1, 1], covariance[:, 2, 2] = 0.25, 0.04, 0.01
    more: dict[str, Any] = {"twist.covariance": covariance.reshape(-1, 36)}
    columns = odometry(TIME_S, curvy_heading(), city_speed() + 3.0, left=60.0, **more)
    signal, _ = build_signal(Role.EGO_SPEED, columns)
    assert isinstance(signal, SpeedSignal)
    expected = 0.25 * np.cos(60.0 * DEG) ** 2 + 0.04 * np.sin(60.0 * DEG) ** 2
    np.testing.assert_allclose(signal.speed_variance_m2ps2, expected, atol=EXACT)


def test_sideways_velocity_that_is_stated_as_not_measured_does_not_count() -> None:
    covariance = np.zeros((len(TIME_S), 6, 6))
    covariance[:, 0, 0], covariance[:, 1, 1], covariance[:, 2, 2] = 0.25, 1e6, np.inf
    more: dict[str, Any] = {
        "twist.covariance": covariance.reshape(-1, 36),
        "twist.twist.linear.y": np.full(len(TIME_S), 7.0),
    }
    signal, _ = build_signal(Role.EGO_SPEED, odometry(TIME_S, curvy_heading(), city_speed() + 3.0, **more))
    assert isinstance(signal, SpeedSignal)
    np.testing.assert_allclose(signal.speed_mps, city_speed() + 3.0, atol=EXACT)
    np.testing.assert_allclose(signal.speed_variance_m2ps2, 0.25, atol=EXACT)


def test_target_that_moves_sideways_has_its_true_velocity() -> None:
    heading, speed = curvy_heading(), city_speed()
    signal, _ = build_pose_truth(odometry(TIME_S, heading, speed, left=40.0, pitch=5.0), Reading(Role.TARGET_TRUTH))
    np.testing.assert_allclose(signal.vx_mps, speed * np.cos(heading), atol=EXACT)
    np.testing.assert_allclose(signal.vy_mps, speed * np.sin(heading), atol=EXACT)
