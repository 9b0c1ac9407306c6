"""Pseudonyms: a vehicle that changes its id stays one, and two are never taken for one."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cwcli.errors import UsageError
from cwcli.signals.canonical import RemoteSignal
from cwcli.signals.columns import Strings
from cwcli.signals.stitch import MAX_ID_CHANGE_PAUSE_S, join_changed_station_ids
from tests.unit.signals.pseudonyms import HERE, RATE_HZ, T0_NS, Scene, scene, score

N_SCENES = 40
N_MANY = 10_000
MOST_BYTES = 100e6
"""A matrix of all ids by all would take 3 GB."""


def alone(seed: int = 1) -> Scene:
    return scene(np.random.default_rng(seed), n_cars=1)


def test_changes_among_ten_neighbours_are_found_and_no_two_cars_become_one() -> None:
    n_changes, n_right, n_wrong = score(N_SCENES, seed=7)
    assert n_changes > 2 * N_SCENES
    assert n_right >= 0.98 * n_changes
    assert n_wrong == 0


def test_the_vehicle_keeps_its_first_id_and_every_message() -> None:
    made = alone()
    found = join_changed_station_ids(made.signal, HERE)
    assert found.joined == (tuple(made.ids[0]),)
    assert found.signal.station.values == (made.ids[0][0],)
    assert set(found.signal.station.codes.tolist()) == {0}
    np.testing.assert_array_equal(found.signal.stamp_ns, made.signal.stamp_ns)


def test_who_is_as_long_away_as_the_pause_allows_is_another() -> None:
    made = alone()
    is_second = made.signal.station.codes == 1
    late_ns = np.where(is_second, round(MAX_ID_CHANGE_PAUSE_S * 1e9), 0)
    found = join_changed_station_ids(replace(made.signal, stamp_ns=made.signal.stamp_ns + late_ns), HERE)
    assert found.joined == ()


def test_another_size_is_another_vehicle() -> None:
    made = alone()
    is_second = made.signal.station.codes == 1
    found = join_changed_station_ids(replace(made.signal, length_m=np.where(is_second, 12.0, 4.5)), HERE)
    assert found.joined == ()
    unknown = join_changed_station_ids(replace(made.signal, length_m=np.where(is_second, np.nan, 4.5)), HERE)
    assert unknown.joined == (tuple(made.ids[0]),)


def test_two_that_could_be_either_stay_apart_and_are_counted() -> None:
    made = alone()
    signal = made.signal
    twice: dict[str, Any] = {
        name: np.concatenate([getattr(signal, name)] * 2)
        for name in signal.__dataclass_fields__
        if isinstance(getattr(signal, name), np.ndarray)
    }
    codes = np.concatenate([signal.station.codes, signal.station.codes + 2]).astype(np.int32)
    station = replace(signal.station, codes=codes, values=(*signal.station.values, "0000000a", "0000000b"))
    found = join_changed_station_ids(replace(signal, station=station, **twice), HERE)
    assert found.joined == ()
    assert found.n_undecided == 2


def test_an_id_that_goes_on_is_not_followed() -> None:
    made = alone()
    is_first = made.signal.station.codes == 0
    shift_ns = np.where(is_first, 0, -round(3.0 * 1e9))
    found = join_changed_station_ids(replace(made.signal, stamp_ns=made.signal.stamp_ns + shift_ns), HERE)
    assert RATE_HZ > 1.0
    assert found.joined == ()


def test_a_name_without_messages_is_no_vehicle() -> None:
    made = alone()
    station = replace(
        made.signal.station, values=("nobody", *made.signal.station.values), codes=made.signal.station.codes + 1
    )
    found = join_changed_station_ids(replace(made.signal, station=station), HERE)
    assert found.joined == (tuple(made.ids[0]),)
    assert found.signal.station.values == (made.ids[0][0],)


def test_who_reverses_is_joined_too() -> None:
    """At -2 m/s it goes on backward during the pause."""
    made = alone()
    signal = made.signal
    turned = replace(signal, speed_mps=-signal.speed_mps, accel_mps2=-signal.accel_mps2)
    found = join_changed_station_ids(replace(turned, heading_rad=signal.heading_rad + np.pi), HERE)
    assert found.joined == (tuple(made.ids[0]),)


def test_too_many_pairs_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cwcli.signals.stitch.MAX_COMPARED_ID_PAIRS", 0)
    with pytest.raises(UsageError, match="2 ids are too many to be joined: 1 pairs are less than 3 s apart"):
        join_changed_station_ids(alone().signal, HERE)


def test_blocks_of_pairs_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    made = scene(np.random.default_rng(3))
    whole = join_changed_station_ids(made.signal, HERE)
    assert whole.joined
    monkeypatch.setattr("cwcli.signals.stitch.PAIRS_PER_BLOCK", 1)
    assert join_changed_station_ids(made.signal, HERE).joined == whole.joined


def test_many_ids_are_joined_in_little_memory() -> None:
    """10,000 cars on a road of their own each, 14 of which change their id each second; 2 s of messages around it."""
    n, each_s = N_MANY, np.array([-1.0, 0.0, 0.6, 1.6])
    change_s = np.arange(n) / 14.0
    at_s = (change_s[:, None] + each_s).ravel()
    car, is_new = np.repeat(np.arange(n), 4), np.tile([0, 0, 1, 1], n)
    speed_mps: np.ndarray = 10.0 + car % 20
    lane_m: np.ndarray = 100.0 * car
    nothing = np.full(4 * n, np.nan)
    signal = RemoteSignal(
        source="/v2x",
        station=Strings((2 * car + is_new).astype(np.int32), tuple(f"{k:08x}" for k in range(2 * n))),
        stamp_ns=T0_NS + np.round(at_s * 1e9).astype(np.int64),
        log_time_ns=T0_NS + np.round(at_s * 1e9).astype(np.int64),
        frame_id="map",
        x_m=speed_mps * at_s,
        y_m=lane_m,
        latitude_deg=nothing,
        longitude_deg=nothing,
        altitude_m=nothing,
        speed_mps=speed_mps,
        heading_rad=np.zeros(4 * n),
        accel_mps2=nothing,
        lateral_accel_mps2=nothing,
        yaw_rate_radps=nothing,
        length_m=np.full(4 * n, 4.5),
        width_m=np.full(4 * n, 1.8),
        position_covariance_m2=np.tile([0.5, 0.0, 0.5], (4 * n, 1)),
        speed_sigma_mps=nothing,
        heading_sigma_rad=nothing,
        accel_sigma_mps2=nothing,
        yaw_rate_sigma_radps=nothing,
        message_count=nothing,
    )
    tracemalloc.start()
    found = join_changed_station_ids(signal, None)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert (len(found.joined), found.n_undecided) == (n, 0)
    assert len(found.signal.station.values) == n
    assert peak < MOST_BYTES
