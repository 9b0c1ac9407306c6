"""The parts of `track` between the log and the tracker: sensors, frames, one target or many, targets as vehicles."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.channels.target import make_target_channels, read_targets_as_states
from cwcli.errors import DataError, MissingSignalError, UsageError
from cwcli.evaluation.target_truth import score_tracks_against_truth
from cwcli.pipeline.records import local_map_from_estimate_record
from cwcli.signals.canonical import DetectionSignal, TargetTruthSignal
from cwcli.signals.columns import Columns, Strings, repeat_string
from cwcli.signals.geodesy import LocalMap
from cwcli.stages.track import TrackConfig
from cwcli.tracking.config import FilterConfig, TrackerConfig
from cwcli.tracking.detections import DetectionKind, Detections, SensorModel
from cwcli.tracking.from_signals import (
    build_sensor_models,
    detections_from_signal,
    require_common_frame_and_tell_if_map,
)
from cwcli.tracking.sensor_setting import SensorSetting
from cwcli.tracking.tracker import track_many_targets, track_one_target, track_targets_and_name_method

T0_NS = 1_700_000_000_000_000_000
STEP_NS = 100_000_000
NAN = float("nan")
PLAIN = TrackerConfig(FilterConfig(smooth=False))


def signal(kind, rows, *, offsets=None, frame="radar", log_time_ns=None, source="/s", covariance=None):
    rows = np.asarray(rows, dtype=float)
    offsets = np.arange(len(rows) + 1) if offsets is None else np.asarray(offsets)
    n = len(offsets) - 1
    stamp_ns = T0_NS + STEP_NS * np.arange(n)
    width = rows.shape[1]
    return DetectionSignal(
        source=source,
        kind=kind,
        stamp_ns=stamp_ns,
        log_time_ns=stamp_ns + 5_000_000 if log_time_ns is None else np.asarray(log_time_ns),
        frame=repeat_string(frame, n),
        offsets=offsets.astype(np.int64),
        values=rows,
        covariance=np.full((len(rows), width, width), NAN) if covariance is None else covariance,
    )


def test_detections_come_in_the_order_of_arrival_with_their_scans() -> None:
    late = [T0_NS + 3, T0_NS + 9, T0_NS + 5]
    data = detections_from_signal(
        signal("position", [[0, 0], [1, 1], [2, 2]], offsets=[0, 1, 2, 3], log_time_ns=late), SensorSetting()
    )
    np.testing.assert_array_equal(data.values[:, 0], [0.0, 2.0, 1.0])
    np.testing.assert_array_equal(data.stamp_ns - T0_NS, [0, 2 * STEP_NS, STEP_NS])
    assert data.scan_stamp_ns is not None
    np.testing.assert_array_equal(data.scan_stamp_ns - T0_NS, [0, STEP_NS, 2 * STEP_NS])


def test_a_radar_s_track_becomes_range_azimuth_and_closing_speed() -> None:
    data = detections_from_signal(signal("radar_track", [[3.0, 4.0, 5.0, 0.0]]), SensorSetting())
    assert data.kind == DetectionKind.RADAR
    np.testing.assert_allclose(data.values, [[5.0, np.arctan2(4, 3), 3.0]])


def test_a_range_rate_that_is_positive_for_what_comes_nearer_is_turned() -> None:
    data = detections_from_signal(signal("radar", [[5.0, 0.1, 2.0]]), SensorSetting(is_rate_towards=True))
    np.testing.assert_allclose(data.values, [[5.0, 0.1, -2.0]])


def test_the_usual_frame_is_accepted_and_a_map_s_frame_stands_still() -> None:
    mixed = signal("position", [[1, 1], [2, 2], [3, 3]])
    mixed = DetectionSignal(**{**mixed.__dict__, "frame": Strings(np.array([1, 0, 1], np.int32), ("other", "lidar"))})
    still = signal("position", [[1, 1]], frame="map", source="/fixed")
    models, notes = build_sensor_models([mixed, still], {})
    assert models["/s"].frame_ids == ("lidar",)
    assert (models["/s"].carrier, models["/fixed"].carrier) == ("body", "map")
    assert len(notes) == 1
    assert "mounting is not given" in notes[0]
    assert build_sensor_models([mixed], {"/s": SensorSetting(x_m=1.0)})[1] == []


def test_a_setting_for_a_topic_that_is_no_sensor() -> None:
    with pytest.raises(UsageError, match="/other"):
        build_sensor_models([signal("position", [[1, 1]])], {"/other": SensorSetting()})


def test_sensors_in_the_map_and_on_the_car_need_the_ego() -> None:
    models = {"/a": SensorModel(carrier="map"), "/b": SensorModel()}
    with pytest.raises(MissingSignalError, match="ego state"):
        require_common_frame_and_tell_if_map(models, has_ego=False, where="log")
    assert require_common_frame_and_tell_if_map(models, has_ego=True, where="log")
    assert require_common_frame_and_tell_if_map({"/a": models["/a"]}, has_ego=False, where="log")
    assert not require_common_frame_and_tell_if_map({"/b": models["/b"]}, has_ego=False, where="log")


def lidar(xy, stamps=None):
    xy = np.asarray(xy, dtype=float)
    stamp_ns = T0_NS + STEP_NS * np.arange(len(xy)) if stamps is None else np.asarray(stamps)
    return Detections("/s", DetectionKind.POSITION, stamp_ns, xy, scan_stamp_ns=np.unique(stamp_ns))


def run(data, **config):
    made = TrackConfig(tracker=PLAIN, **config)
    return track_targets_and_name_method(made.targets, [data], {}, made.tracker)


def test_auto_takes_one_target_where_no_scan_holds_two() -> None:
    xy = np.column_stack([np.arange(40) * 0.5, np.zeros(40)])
    assert run(lidar(xy))[1] == "one"
    assert run(lidar(xy), targets="many")[1] == "many"


def test_auto_takes_many_where_a_scan_holds_two() -> None:
    xy = np.repeat(np.column_stack([np.arange(20) * 0.5, np.zeros(20)]), 2, axis=0)
    xy[1::2, 1] = 30.0
    stamps = T0_NS + STEP_NS * np.repeat(np.arange(20), 2)
    result, how = run(lidar(xy, stamps))
    assert how == "many"
    assert len(result.tracks) == 2
    xy[1::2] = NAN  # what is not finite is no second target
    assert run(lidar(xy, stamps))[1] == "one"


def test_auto_takes_many_where_scans_alternate_between_two_targets() -> None:
    xy = np.column_stack([np.arange(60) * 0.2, np.where(np.arange(60) % 2, 30.0, 0.0)])
    result, how = run(lidar(xy))
    assert how == "many"
    assert len(result.tracks) == 2


def made(in_map=True):
    xy = np.column_stack([np.arange(40) * 0.5, np.zeros(40)])
    data = lidar(xy)
    result = track_one_target([data], {}, PLAIN)
    known = data.scan_stamp_ns, data.scan_stamp_ns + 5_000_000
    return result, make_target_channels(result, in_map=in_map, known_ns=known)[0]


def read_back(channel):
    n = len(channel)
    return Columns(channel.topic, channel.schema_name, "protobuf", channel.log_time_ns, channel.log_time_ns,
                   np.arange(n, dtype=np.uint32), dict(channel.fields))  # fmt: skip


def test_targets_come_back_as_vehicle_states() -> None:
    result, channel = made()
    states = read_targets_as_states(read_back(channel))
    (track,) = result.tracks
    np.testing.assert_array_equal(states.stamp_ns, track.stamp_ns)
    np.testing.assert_array_equal(states.log_time_ns, track.stamp_ns + 5_000_000)
    np.testing.assert_allclose(states.state[:, :2], track.state[:, :2])
    np.testing.assert_allclose(states.state[-1, 2:6], [np.hypot(*track.state[-1, 2:4]), 0.0, 0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(states.covariance[:, 5, 5], track.covariance[:, 4, 4])  # ctrv: the turn rate's
    assert np.isnan(states.length_m).all()


def test_of_two_rows_of_a_target_at_one_time_the_last_is_taken() -> None:
    _, channel = made()
    columns = read_back(channel)
    stamp_ns = np.array(columns.fields["stamp_ns"])
    stamp_ns[1] = stamp_ns[0]
    states = read_targets_as_states(Columns(**{**columns.__dict__, "fields": {**columns.fields, "stamp_ns": stamp_ns}}))
    assert len(states) == 39
    assert states.state[0, 0] == columns.fields["x_m"][1]


def test_targets_in_the_car_s_frame_are_no_vehicle_states() -> None:
    with pytest.raises(DataError, match="car's own frame"):
        read_targets_as_states(read_back(made(in_map=False)[1]))


def test_many_targets_keep_their_rows_in_log_time_order() -> None:
    xy = np.repeat(np.column_stack([np.arange(30) * 0.5, np.zeros(30)]), 2, axis=0)
    xy[1::2, 1] = 30.0
    data = lidar(xy, T0_NS + STEP_NS * np.repeat(np.arange(30), 2))
    result = track_many_targets([data], {}, PLAIN)
    delay = np.where(np.arange(30) == 10, 250_000_000, 5_000_000)  # one scan came late
    targets, scene = make_target_channels(
        result, in_map=True, known_ns=(data.scan_stamp_ns, data.scan_stamp_ns + delay)
    )
    assert (np.diff(targets.log_time_ns) >= 0).all()
    assert (np.diff(scene.log_time_ns) > 0).all()
    assert len(targets) == sum(len(track) for track in result.tracks)


def truth_of(result, **more):
    (track,) = result.tracks
    n = len(track)
    fields = {
        "source": "/truth/target", "frame_id": "map", "id": repeat_string("1", n), "stamp_ns": track.stamp_ns,
        "log_time_ns": track.stamp_ns, "x_m": track.state[:, 0] + 3.0, "y_m": track.state[:, 1] - 4.0,
        "vx_mps": np.full(n, NAN), "vy_mps": np.full(n, NAN),
    }  # fmt: skip
    return TargetTruthSignal(**{**fields, **more})


def test_errors_against_the_truth_by_hand_and_velocities_from_positions() -> None:
    result, _ = made()
    moments = result.tracks[0].stamp_ns
    truth = truth_of(result, x_m=np.arange(40) * 0.5 + 3.0, y_m=np.full(40, -2.0))
    errors, notes = score_tracks_against_truth(truth, result, moments, in_map=True, local_map=None)
    assert errors is not None
    (target,) = errors.scores.targets
    assert target.rmse[:2] == pytest.approx((3.0, 2.0), abs=0.05)
    assert np.abs(target.rmse[2:]).max() < 5.0
    assert target.n_tracked == 40
    assert "differences" in notes[0]


def test_a_truth_in_another_frame_is_not_compared() -> None:
    result, _ = made(in_map=False)
    errors, notes = score_tracks_against_truth(
        truth_of(result), result, result.tracks[0].stamp_ns, in_map=False, local_map=None
    )
    assert errors is None
    assert "not compared" in notes[0]


def test_a_truth_on_the_globe_is_brought_into_the_map_of_the_ego() -> None:
    result, _ = made()
    local_map = local_map_from_estimate_record({"map_origin_latitude_deg": "48.0", "map_origin_longitude_deg": "11.0",
                        "map_origin_altitude_m": "500.0"})  # fmt: skip
    assert isinstance(local_map, LocalMap)
    (track,) = result.tracks
    lat, lon, _ = local_map.wgs84_from_map(track.state[:, 0] + 1.0, track.state[:, 1], np.zeros(len(track)))
    truth = truth_of(result, latitude_deg=lat, longitude_deg=lon)  # its x, y count from elsewhere
    errors, _ = score_tracks_against_truth(truth, result, track.stamp_ns, in_map=True, local_map=local_map)
    assert errors is not None
    assert errors.scores.targets[0].rmse[:2] == pytest.approx((1.0, 0.0), abs=1e-3)
    assert local_map_from_estimate_record({}) is None
