"""Objects that others perceived: who they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cwcli.logs.read.reader import Log
from cwcli.signals import cpm, sdsm
from cwcli.signals.build import build_signal
from cwcli.signals.canonical import RemoteSignal
from cwcli.signals.perceived import shift_wgs84_positions
from cwcli.signals.role import Role
from tests.laws.input_logs import write_log
from tests.laws.input_messages import DELAY_NS, stamp_of
from tests.laws.perceived_messages import ros_cpm, ros_sdsm

SCHEMA = "etsi_its_cpm_ts_msgs/CollectivePerceptionMessage"


@pytest.mark.parametrize("encoding", ["cdr", "json"])
def test_objects_without_a_number_are_no_road_user(encoding: str, tmp_path: Path) -> None:
    messages = [ros_cpm(k, stamp_of(k))[0] for k in range(3)]
    container = messages[1]["payload"]["cpm_containers"]["value"]["array"][0]
    told = container["container_data_perceived_object_container"]["perceived_objects"]["array"][0]
    told["object_id_is_present"] = False
    if encoding == "json":
        del told["object_id"]
    log_path = write_log(tmp_path / "log.mcap", SCHEMA, encoding, "/cpm", messages)
    with Log.open(log_path) as log:
        signal, quality = build_signal(Role.REMOTE, log.columns("/cpm", fields=cpm.ROS_LEAF_FIELDS))
    assert isinstance(signal, RemoteSignal)
    assert signal.station.values == ("1201:7",)
    assert len(signal.stamp_ns) == 2
    assert quality.objects is not None
    assert quality.objects.read == 3
    assert quality.objects.set_aside == {"object without an id": 1}


@pytest.mark.parametrize("number", [7.25, 65_536.0, -7.0])
def test_no_two_objects_become_one_where_a_number_is_no_object_id(number: float, tmp_path: Path) -> None:
    messages = [ros_cpm(k, stamp_of(k))[0] for k in range(2)]
    container = messages[1]["payload"]["cpm_containers"]["value"]["array"][0]
    told = container["container_data_perceived_object_container"]["perceived_objects"]["array"][0]
    told["object_id"]["value"] = number
    messages[1]["header"]["station_id"]["value"] = 2.0**32
    with Log.open(write_log(tmp_path / "log.mcap", SCHEMA, "json", "/cpm", messages)) as log:
        signal, quality = build_signal(Role.REMOTE, log.columns("/cpm", fields=cpm.ROS_LEAF_FIELDS))
    assert isinstance(signal, RemoteSignal)
    assert signal.station.values == ("1201:7",)
    assert len(signal.stamp_ns) == 1
    assert quality.objects is not None
    left_out = "outside its range, left out"
    assert quality.objects.repaired == {f"StationID {left_out}": 1, f"ObjectId {left_out}": 1}
    assert quality.objects.set_aside == {"object without an id": 1}


@pytest.mark.parametrize("delta_s", [float("inf"), 1e12, -1.6])
def test_units_outside_the_range_of_their_element_are_left_out(delta_s: float, tmp_path: Path) -> None:
    schema = "carma_v2x_msgs/SensorDataSharingMessage"
    messages = [ros_sdsm(is_carma=True)(k, stamp_of(k))[0] for k in range(2)]
    common = messages[1]["objects"]["detected_object_data"][0]["detected_object_common_data"]
    common["measurement_time"]["measurement_time_offset"] = delta_s
    common["speed"]["speed"] = 1e9
    with Log.open(write_log(tmp_path / "log.mcap", schema, "cdr", "/sdsm", messages)) as log:
        signal, quality = build_signal(Role.REMOTE, log.columns("/sdsm", fields=sdsm.ROS_LEAF_FIELDS))
    assert isinstance(signal, RemoteSignal)
    np.testing.assert_allclose(signal.stamp_ns[1] - signal.log_time_ns[1], -DELAY_NS, atol=1_000_000)  # the message's
    np.testing.assert_equal(signal.speed_mps, [10.0, np.nan])
    assert quality.objects is not None
    assert quality.objects.repaired["MeasurementTimeOffset outside its range, left out"] == 1
    assert quality.objects.repaired["no measurement time, message time used"] == 1


def test_an_object_beyond_the_antimeridian_is_on_the_other_side() -> None:
    latitude, longitude = shift_wgs84_positions(*(np.array([value]) for value in (0.0, 179.999, 1000.0, 0.0)))
    assert latitude[0] == 0.0
    np.testing.assert_allclose(longitude, 179.999 + np.rad2deg(1000.0 / 6_378_137.0) - 360.0, atol=1e-9)
