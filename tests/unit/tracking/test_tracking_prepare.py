"""Checks, counts, frames and mountings."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.signals.columns import Strings
from cwcli.tracking.detections import (
    DetectionKind,
    Detections,
    EgoStates,
    SensorModel,
)
from cwcli.tracking.prepare import arrived_in_order_mask, prepare_detections

S = 1_000_000_000


def lidar(values, stamp=None, **more):
    values = np.asarray(values, float).reshape(-1, 2)
    stamp = np.arange(len(values)) * S // 10 if stamp is None else np.asarray(stamp)
    return Detections("lidar", DetectionKind.POSITION, stamp, values, **more)


def radar(values, stamp=None, **more):
    values = np.asarray(values, float).reshape(-1, 3)
    stamp = np.arange(len(values)) * S // 10 if stamp is None else np.asarray(stamp)
    return Detections("radar", DetectionKind.RADAR, stamp, values, **more)


def test_bad_detections_are_counted_by_reason() -> None:
    values = [
        [5, 0, 0],
        [np.nan, 0, 0],
        [5, np.inf, 0],
        [-1, 0, 0],
        [5, 0, np.nan],
        [5, 0, 1e6],
        [2e4, 0, 0],
        [5, 7, 0],
    ]
    count = prepare_detections([radar(values)]).counts["radar"]
    assert count.rejected == {"not finite": 2, "negative range": 1, "beyond the sensor's range": 1}
    assert count.repaired == {"impossible range rate, left out": 1}
    assert (count.read, count.used) == (8, 4)


def test_a_wrong_frame_id_is_counted() -> None:
    frame = Strings(np.array([0, 1, 0, -1], np.int32), ("lidar_front", "lidar_rear"))
    prepared = prepare_detections(
        [lidar(np.ones((4, 2)), frame=frame)], {"lidar": SensorModel(frame_ids=("lidar_front",))}
    )
    assert prepared.counts["lidar"].rejected == {"wrong frame id": 2}
    assert prepared.rows.index.tolist() == [0, 2]


def test_huge_numbers_do_no_harm() -> None:
    count = prepare_detections([lidar([[1e308, 1e308], [-1e308, 0.0], [1.0, 1.0]])]).counts["lidar"]
    assert count.rejected == {"beyond the sensor's range": 2}


def test_a_missing_rate_makes_a_two_value_row() -> None:
    rows = prepare_detections([radar([[5, 0, 1.0], [5, 0, np.nan]])]).rows
    assert rows.kind.tolist() == [2, 1]
    rows = prepare_detections([radar([[5, 0, 1.0]])], {"radar": SensorModel(use_range_rate=False)}).rows
    assert rows.kind.tolist() == [1]


def test_out_of_sequence_detections_are_put_in_order() -> None:
    stamp = np.array([0, 1, 3, 2, 4]) * S // 10
    prepared = prepare_detections([lidar(np.arange(10), stamp)])
    assert prepared.rows.index.tolist() == [0, 1, 3, 2, 4]
    assert prepared.counts["lidar"].repaired == {"arrived out of order, put in order": 1}
    assert prepared.counts["lidar"].used == 5


@pytest.mark.parametrize(
    ("stamp_s", "kept"),
    [
        ([0, 1, 2, 3], [1, 1, 1, 1]),
        ([0, 1, 9000, 2, 3], [1, 1, 0, 1, 1]),  # one stamp from the future costs one row
        ([100, 101, 102, 3, 103], [1, 1, 1, 0, 1]),  # one from the past, too
        ([100, 101, 102, 103, 104, 5, 6, 7], [1, 1, 1, 1, 1, 0, 0, 0]),  # set back by a jump: the longer part stays
        ([100, 101, 1, 2, 3, 4, 5], [0, 0, 1, 1, 1, 1, 1]),
        ([10, 11, 10.5, 11.5], [1, 1, 1, 1]),  # late by less than the limit
        ([10, 11, 9.5, 12], [1, 1, 0, 1]),
        ([5], [1]),
        ([], []),
    ],
)
def test_time_going_backwards_costs_the_fewest_rows(stamp_s, kept) -> None:
    stamp = (np.array(stamp_s, float) * S).astype(np.int64)
    assert arrived_in_order_mask(stamp, 1.0).astype(int).tolist() == kept


def test_absurd_stamps_do_not_overflow() -> None:
    ends = np.iinfo(np.int64)
    stamp = np.array([ends.max, 0, S, ends.min, 2 * S, 3 * S], np.int64)
    assert arrived_in_order_mask(stamp, 1.0).tolist() == [False, True, True, False, True, True]


def test_time_going_backwards_is_counted() -> None:
    stamp = np.array([100, 101, 1, 102]) * S
    count = prepare_detections([lidar(np.ones((4, 2)), stamp)]).counts["lidar"]
    assert count.rejected == {"time went backwards or jumped": 1}


def test_a_crowded_scan_is_cut_and_counted() -> None:
    stamp = np.concatenate([np.zeros(50), [S]]).astype(np.int64)
    prepared = prepare_detections([lidar(np.ones((51, 2)), stamp)], max_scan=20)
    assert prepared.counts["lidar"].rejected == {"more than 20 in one scan": 30}
    assert np.diff(prepared.scans.first).tolist() == [20, 1]


def test_noise_is_the_messages_then_the_models_then_the_default() -> None:
    given = np.tile(np.eye(2) * 4.0, (4, 1, 1))
    given[1] = np.nan
    given[2] = 0.0
    given[3] = [[1.0, 5.0], [5.0, 1.0]]  # not positive
    prepared = prepare_detections([lidar(np.ones((4, 2)), covariance=given)], {"lidar": SensorModel(sigma=(0.5, 0.5))})
    np.testing.assert_allclose(prepared.rows.r[:, 0, 0], [4.0, 0.25, 0.25, 0.25])
    assert prepared.counts["lidar"].repaired == {"covariance not positive or absurd, the sensor's noise used": 1}
    np.testing.assert_allclose(prepare_detections([lidar([[1, 1]])]).rows.r[0, 0, 0], 0.15**2)


def test_mounting_turns_positions_covariances_and_bearings() -> None:
    model = SensorModel(x_m=2.0, y_m=1.0, yaw_rad=np.pi / 2, sigma=(0.1, 0.4))
    rows = prepare_detections([lidar([[3.0, 0.5]])], {"lidar": model}).rows
    np.testing.assert_allclose(rows.z[0, :2], [2.0 - 0.5, 1.0 + 3.0])
    np.testing.assert_allclose(rows.r[0, :2, :2], np.diag([0.16, 0.01]), atol=1e-15)
    rows = prepare_detections(
        [radar([[3.0, 3.0, 0.0]])], {"radar": SensorModel(x_m=2.0, y_m=1.0, yaw_rad=np.pi / 2)}
    ).rows
    assert rows.z[0, 1] == pytest.approx(3.0 + np.pi / 2 - 2 * np.pi)
    np.testing.assert_allclose(rows.origin[0], [2.0, 1.0, 0.0, 0.0])


def test_paper_axes_are_x_right_y_forward() -> None:
    forward, right = [0.0, 7.0], [3.0, 0.0]
    rows = prepare_detections([lidar([forward, right])], {"lidar": SensorModel(axes="paper")}).rows
    np.testing.assert_allclose(rows.z[:, :2], [[7.0, 0.0], [0.0, -3.0]], atol=1e-12)
    # eq. 4 counts the azimuth from x, the right: straight ahead is 90 degrees, which is 0 in the body frame
    rows = prepare_detections([radar([[7.0, np.pi / 2, 0.0]])], {"radar": SensorModel(axes="paper")}).rows
    assert rows.z[0, 1] == pytest.approx(0.0)


def circle(n=200, rate=20.0):
    """A car on a circle of radius 50 m at 10 m/s, counter-clockwise, from (50, 0) heading north."""
    t = np.arange(n) / rate
    a = 0.2 * t
    stamp = (t * 1e9).astype(np.int64)
    return EgoStates(
        stamp, 50 * np.cos(a), 50 * np.sin(a), a + np.pi / 2, np.full(n, 10.0), np.full(n, 0.2)
    )  # fmt: skip


def test_ego_motion_puts_a_standing_target_at_one_place_of_the_map() -> None:
    ego = circle()
    target = np.array([70.0, 20.0])
    stamp = np.arange(40) * S // 5 + 13_000_000  # between the ego's stamps
    a = 0.2 * stamp * 1e-9
    heading = a + np.pi / 2
    car = np.stack([50 * np.cos(a), 50 * np.sin(a)], axis=1)
    mount = np.array([3.0, 0.5])
    turn = np.stack(
        [np.stack([np.cos(heading), -np.sin(heading)], -1), np.stack([np.sin(heading), np.cos(heading)], -1)], 1
    )
    sensor = car + turn @ mount
    sensor_velocity = 0.2 * np.stack([-sensor[:, 1], sensor[:, 0]], axis=1)  # every point of the car circles the origin
    away = target - sensor
    yaw = 0.3
    in_sensor = np.einsum("nji,nj->ni", turn, away)
    c, s = np.cos(yaw), np.sin(yaw)
    in_sensor = in_sensor @ np.array([[c, -s], [s, c]])
    r = np.hypot(*away.T)
    rate = -(away * sensor_velocity).sum(axis=1) / r
    polar = np.stack([r, np.arctan2(in_sensor[:, 1], in_sensor[:, 0]), rate], axis=1)
    model = SensorModel(x_m=3.0, y_m=0.5, yaw_rad=yaw)
    rows = prepare_detections(
        [lidar(in_sensor, stamp), radar(polar, stamp)], {"lidar": model, "radar": model}, ego
    ).rows
    is_lidar = rows.kind == 0
    np.testing.assert_allclose(rows.z[is_lidar, :2], np.tile(target, (40, 1)), atol=5e-3)  # linear between ego stamps
    seen = rows.z[~is_lidar]
    at = rows.origin[~is_lidar]
    found = at[:, :2] + seen[:, :1] * np.stack([np.cos(seen[:, 1]), np.sin(seen[:, 1])], axis=1)
    np.testing.assert_allclose(found, np.tile(target, (40, 1)), atol=5e-3)
    line = (target - at[:, :2]) / seen[:, :1]
    np.testing.assert_allclose(-(line * at[:, 2:]).sum(axis=1), seen[:, 2], atol=5e-3)


def test_detections_without_an_ego_state_are_counted() -> None:
    ego = circle(20)  # 0 to 0.95 s
    stamp = np.array([0, S // 2, 5 * S])
    prepared = prepare_detections([lidar(np.ones((3, 2)), stamp)], None, ego)
    assert prepared.counts["lidar"].rejected == {"no ego state at that time": 1}
    none = EgoStates(np.zeros(0, np.int64), *np.zeros((5, 0)))
    assert prepare_detections([lidar(np.ones((3, 2)), stamp)], None, none).counts["lidar"].used == 0


def test_a_sensor_fixed_in_the_map_is_not_moved_with_the_car() -> None:
    rows = prepare_detections([lidar([[1.0, 2.0]])], {"lidar": SensorModel(carrier="map")}, circle()).rows
    np.testing.assert_allclose(rows.z[0, :2], [1.0, 2.0])


def test_empty_scans_are_kept() -> None:
    data = lidar(np.ones((2, 2)), np.array([0, 2 * S]), scan_stamp_ns=np.array([0, S, 2 * S, 3 * S]))
    scans = prepare_detections([data]).scans
    assert np.diff(scans.first).tolist() == [1, 0, 1, 0]


def test_two_entries_for_one_source_and_wrong_shapes_are_refused() -> None:
    with pytest.raises(ValueError, match="two entries"):
        prepare_detections([lidar([[1, 1]]), lidar([[1, 1]])])
    with pytest.raises(ValueError, match="values"):
        Detections("x", DetectionKind.RADAR, np.zeros(1, np.int64), np.zeros((1, 2)))
    with pytest.raises(ValueError, match="sigma"):
        SensorModel(sigma=(0.1, -1.0))
    with pytest.raises(ValueError, match="sigmas for"):
        prepare_detections([radar([[1, 1, 1]])], {"radar": SensorModel(sigma=(0.1,))})


def test_nothing_that_was_given_is_changed() -> None:
    values, stamp = np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([S, 0])
    kept = values.copy(), stamp.copy()
    prepare_detections([lidar(values, stamp)], {"lidar": SensorModel(yaw_rad=1.0)})
    np.testing.assert_array_equal(values, kept[0])
    np.testing.assert_array_equal(stamp, kept[1])
