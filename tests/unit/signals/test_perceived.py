"""Objects that others perceived: who they are."""

from __future__ import annotations

from pathlib import Path

import pytest

from cwcli.logs.read.reader import Log
from cwcli.signals import cpm
from cwcli.signals.build import build
from cwcli.signals.canonical import RemoteSignal
from cwcli.signals.role import Role
from tests.laws.input_logs import write_log
from tests.laws.input_messages import stamp_of
from tests.laws.perceived_messages import ros_cpm

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
        signal, quality = build(Role.REMOTE, log.columns("/cpm", fields=cpm.ros_fields()))
    assert isinstance(signal, RemoteSignal)
    assert signal.station.values == ("1201:7",)
    assert len(signal.stamp_ns) == 2
    assert quality.objects is not None
    assert quality.objects.read == 3
    assert quality.objects.set_aside == {"object without a number": 1}
