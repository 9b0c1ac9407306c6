"""Births, deaths, ids, coasting, clutter, bad input."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from cwcli.simulation.dual_sensor import DualSensorScene, SensorNoise
from cwcli.tracking.config import FilterConfig, TrackerConfig
from cwcli.tracking.detections import DetectionKind, Detections, EgoStates, SensorModel
from cwcli.tracking.gospa import TargetMoments, score_tracks
from cwcli.tracking.tracker import track_many_targets, track_one_target
from tests.crossing_targets import simulate_crossing_targets
from tests.work import count_calls

S = 1_000_000_000
CV = TrackerConfig(FilterConfig(model="cv", noise=0.5))
CAUSAL = TrackerConfig(FilterConfig(model="cv", noise=0.5, smooth=False))
SENSOR = {"lidar": SensorModel(sigma=(0.1, 0.1))}


def lidar(points_of_scan, period_s=0.1):
    """One scan per list of points."""
    stamp = np.round(np.arange(len(points_of_scan)) * period_s * 1e9).astype(np.int64)
    sizes = [len(p) for p in points_of_scan]
    values = np.array([xy for points in points_of_scan for xy in points], float).reshape(-1, 2)
    return Detections("lidar", DetectionKind.POSITION, np.repeat(stamp, sizes), values, scan_stamp_ns=stamp)


def walker(k, x0=0.0, y0=0.0, vx=1.0):
    return (x0 + 0.1 * k * vx, y0)


def test_two_targets_get_two_ids_that_last() -> None:
    scans = [[walker(k), walker(k, y0=10.0, vx=-1.0)] for k in range(50)]
    result = track_many_targets([lidar(scans)], SENSOR, CV)
    assert [t.id for t in result.tracks] == [1, 2]
    assert [len(t) for t in result.tracks] == [50, 50]
    for track, (y, vx) in zip(result.tracks, sorted([(0.0, 1.0), (10.0, -1.0)], key=lambda p: p[0]), strict=True):
        np.testing.assert_allclose(track.state[25], [2.5 * vx, y, vx, 0.0], atol=0.02)
    assert result.frame == "body"
    assert result.counts["lidar"].used == 100


def test_a_target_that_is_missed_a_few_times_keeps_its_id_and_is_coasted() -> None:
    scans = [[walker(k)] if k not in (20, 21, 40) else [] for k in range(60)]
    result = track_many_targets([lidar(scans)], SENSOR, CV)
    assert len(result.tracks) == 1
    track = result.tracks[0]
    assert len(track) == 60
    assert np.flatnonzero(track.source == -1).tolist() == [20, 21, 40]
    np.testing.assert_allclose(track.state[21, 0], 2.1, atol=0.05)
    assert track.covariance[21, 0, 0] > track.covariance[30, 0, 0]


def test_a_target_that_leaves_dies_and_its_id_is_not_used_again() -> None:
    scans = [[walker(k)] for k in range(30)] + [[] for _ in range(30)] + [[walker(k)] for k in range(30)]
    result = track_many_targets([lidar(scans)], SENSOR, CAUSAL)
    assert [t.id for t in result.tracks] == [1, 2]
    assert result.tracks[0].stamp_ns[-1] < 4 * S
    assert result.tracks[1].stamp_ns[0] >= 6 * S


def test_a_track_is_not_revived_after_a_long_pause() -> None:
    stamp = np.concatenate([np.arange(30), 1e8 + np.arange(30)]).astype(np.int64) * 100_000_000
    xy = np.array([walker(k) for k in range(60)])
    result = track_many_targets([Detections("lidar", DetectionKind.POSITION, stamp, xy)], SENSOR, CAUSAL)
    assert [t.id for t in result.tracks] == [1, 2]
    assert len(result.tracks[0]) <= 30


def test_lone_points_are_no_track() -> None:
    rng = np.random.default_rng(0)
    scans = [[rng.uniform(-50, 50, 2) for _ in range(5)] for _ in range(100)]
    result = track_many_targets([lidar(scans)], {"lidar": SensorModel(sigma=(0.1, 0.1), clutter_density=5e-4)}, CAUSAL)
    assert len(result.tracks) <= 1
    assert result.counts["lidar"].rejected["belongs to no confirmed track"] >= 490


def test_a_causal_track_does_not_know_the_future() -> None:
    rng = np.random.default_rng(4)
    scans = [[np.add(walker(k), 0.1 * rng.standard_normal(2))] for k in range(60)]
    known = {"lidar": SensorModel(sigma=(0.1, 0.1), clutter_density=1e-3)}
    full = track_many_targets([lidar(scans)], known, CAUSAL).tracks[0]
    half = track_many_targets([lidar(scans[:30])], known, CAUSAL).tracks[0]
    assert full.stamp_ns[0] == full.confirmed_ns == half.confirmed_ns
    np.testing.assert_array_equal(full.stamp_ns[: len(half)], half.stamp_ns)
    np.testing.assert_array_equal(full.state[: len(half)], half.state)


def test_a_target_out_of_view_is_not_expected_and_does_not_die() -> None:
    """A forward radar does not see the target that the lidar sees beside the car: its empty scans say nothing."""
    points = [[(0.0, 20.0)] for _ in range(50)]
    stamp = np.arange(400) * S // 80
    nothing = Detections("radar", DetectionKind.RADAR, np.zeros(0, np.int64), np.zeros((0, 3)), scan_stamp_ns=stamp)
    narrow = {**SENSOR, "radar": SensorModel(field_of_view_rad=1.0)}
    wide = {**SENSOR, "radar": SensorModel(detection_probability=0.99)}
    assert len(track_many_targets([lidar(points), nothing], narrow, CAUSAL).tracks) == 1
    assert len(track_many_targets([lidar(points), nothing], wide, CAUSAL).tracks) == 0


def test_lidar_and_radar_feed_one_track() -> None:
    t = np.arange(100) * 0.05
    truth = np.stack([10.0 + t, 5.0 + 0.0 * t], axis=1)
    stamp = np.round(t * 1e9).astype(np.int64)
    r = np.hypot(*truth.T)
    polar = np.stack([r, np.arctan2(truth[:, 1], truth[:, 0]), truth[:, 0] / r], axis=1)
    data = [
        Detections("lidar", DetectionKind.POSITION, stamp[::2], truth[::2]),
        Detections("radar", DetectionKind.RADAR, stamp[1::2], polar[1::2]),
    ]
    result = track_many_targets(data, SENSOR, CV)
    assert len(result.tracks) == 1
    assert set(result.tracks[0].source.tolist()) == {0, 1}
    np.testing.assert_allclose(result.tracks[0].state[:, :2], truth, atol=0.02)


def test_tracks_live_in_the_map_when_the_car_moves() -> None:
    """The car drives at 15 m/s past a parked car; in the map it stands still."""
    stamp = np.arange(60) * S // 10
    x: np.ndarray = 15.0 * stamp * 1e-9
    ego = EgoStates(stamp, x, np.zeros(60), np.zeros(60), np.full(60, 15.0), np.zeros(60))
    seen = np.stack([40.0 - x, np.full(60, 3.0)], axis=1)
    data = Detections("lidar", DetectionKind.POSITION, stamp, seen)
    result = track_many_targets([data], SENSOR, CV, ego)
    assert result.frame == "map"
    assert len(result.tracks) == 1
    np.testing.assert_allclose(result.tracks[0].state[:, :4], np.tile([40.0, 3.0, 0.0, 0.0], (60, 1)), atol=1e-3)


def measured(scene: DualSensorScene) -> list[Detections]:
    return [
        Detections(
            "lidar", DetectionKind.POSITION, scene.lidar_stamp_ns, scene.lidar_xy, scan_stamp_ns=scene.lidar_scan_ns
        ),
        Detections("radar", DetectionKind.RADAR, scene.radar_stamp_ns, scene.radar, scan_stamp_ns=scene.radar_scan_ns),
    ]


@pytest.mark.parametrize("with_radar", [False, True])
def test_five_crossing_targets_in_clutter(with_radar) -> None:
    distance, switches = [], 0
    for seed in range(8):
        scene = simulate_crossing_targets(np.random.default_rng(seed), with_radar=with_radar)
        sensors = {
            "lidar": SensorModel(sigma=(0.3, 0.3)),
            "radar": SensorModel(sigma=(0.3, 0.01, 0.2)),
        }
        result = track_many_targets(measured(scene)[: 1 + with_radar], sensors, CAUSAL)
        truth = TargetMoments(scene.truth_stamp_ns, scene.truth_id, scene.truth_state)
        scores = score_tracks(truth, TargetMoments.from_tracks(result.tracks))
        distance.append(scores.distance.mean())
        switches += scores.id_switches
        assert scores.n_false.mean() < 0.05
    assert np.mean(distance) < 1.0
    assert switches <= 8


def test_clutter_density_is_found() -> None:
    scene = simulate_crossing_targets(np.random.default_rng(1), noise=SensorNoise(lidar_m=0.3))
    found = track_many_targets(measured(scene)[:1], {"lidar": SensorModel(sigma=(0.3, 0.3))}, CAUSAL).clutter_density
    assert found["lidar"] == pytest.approx(10.0 / 100.0**2, rel=0.3)


def test_noise_is_tuned_over_all_targets() -> None:
    rng = np.random.default_rng(2)
    scans = [[np.add(walker(k, y0=20.0 * i), 0.05 * rng.standard_normal(2)) for i in range(3)] for k in range(100)]
    config = TrackerConfig(FilterConfig(model="cv", tune=True))
    result = track_many_targets([lidar(scans)], {"lidar": SensorModel(sigma=(0.3, 0.3))}, config)
    assert result.tuned is not None
    assert 0.3 * result.tuned.scale["lidar"][0] == pytest.approx(0.05, rel=0.1)
    assert len(result.tracks) == 3


def test_ten_thousand_detections_in_one_scan_are_bounded_in_memory_and_work() -> None:
    rng = np.random.default_rng(0)
    scans = [[walker(k)] for k in range(20)]
    for k in (10, 11, 12):
        scans[k] = [walker(k), *rng.uniform(-100, 100, (10_000, 2))]
    data = lidar(scans)
    tracemalloc.start()
    results = []
    n_calls = count_calls(lambda: results.append(track_many_targets([data], SENSOR, CAUSAL)))
    (result,) = results
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 300e6
    assert n_calls < 1_000_000
    assert any("refused" in note for note in result.notes)
    first = result.tracks[0]
    np.testing.assert_allclose(first.state[-1, :2], walker(19), atol=0.3)


def test_ten_thousand_detections_in_one_place_do_not_blow_up() -> None:
    scans = [[walker(k)] for k in range(20)]
    scans[10] = [(1.0 + 1e-4 * i, 0.0) for i in range(10_000)]
    scans[11] = scans[10]
    result = track_many_targets([lidar(scans)], SENSOR, CAUSAL)
    assert all(np.isfinite(t.state).all() for t in result.tracks)


@pytest.mark.parametrize("run", [track_one_target, track_many_targets])
def test_nothing_and_only_rubbish_give_no_tracks(run) -> None:
    assert run([]).tracks == ()
    empty = Detections("lidar", DetectionKind.POSITION, np.zeros(0, np.int64), np.zeros((0, 2)))
    assert run([empty]).tracks == ()
    rubbish = Detections(
        "radar", DetectionKind.RADAR, np.arange(3) * S, np.array([[np.nan] * 3, [-1, 0, 0], [np.inf, 0, 0]])
    )
    result = run([empty, rubbish])
    assert result.tracks == ()
    assert result.counts["radar"].used == 0
    assert sum(result.counts["radar"].rejected.values()) == 3


@pytest.mark.parametrize("run", [track_one_target, track_many_targets])
def test_rubbish_among_good_detections_is_counted_and_changes_nothing(run) -> None:
    good = np.array([walker(k) for k in range(60)])
    stamp = np.arange(60) * S // 10
    clean = run([Detections("lidar", DetectionKind.POSITION, stamp, good)], SENSOR, CV)
    values = np.insert(good, [10, 20, 30], [[np.nan, 0.0], [1e9, 0.0], [1.0, 1.0]], axis=0)
    stamps = np.insert(stamp, [10, 20, 30], [S, 2 * S, 900 * S])
    dirty = run([Detections("lidar", DetectionKind.POSITION, stamps, values)], SENSOR, CV)
    assert sum(dirty.counts["lidar"].rejected.values()) == 3
    np.testing.assert_allclose(dirty.tracks[0].state, clean.tracks[0].state)


def test_one_target_counts_gated_detections() -> None:
    good = np.array([walker(k) for k in range(60)])
    good[30] += 30.0
    result = track_one_target([Detections("lidar", DetectionKind.POSITION, np.arange(60) * S // 10, good)], SENSOR, CV)
    assert result.counts["lidar"].rejected == {"outside the gate": 1}
    assert result.counts["lidar"].used == 59
    assert result.tracks[0].source[30] == -1


def test_settings_that_make_no_sense_are_refused() -> None:
    for bad in ({"filter": "pf"}, {"model": "warp"}, {"kappa": -1.0}, {"gate_probability": 0.0}):
        with pytest.raises(ValueError):
            FilterConfig(**bad)
