"""The published schemas: compiled form in step with the sources, and the fields that DESIGN's table promises."""

from __future__ import annotations

from pathlib import Path

import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.records import Schema
from mcap_protobuf.decoder import DecoderFactory

from cwcli.logs.encoders.schemas import CWCLI_DESCRIPTOR_SET_FILE, find_message_schema, schema_folder
from tools.compile_schemas import compile_schemas

PROMISED = {
    "cwcli.v1.VehicleState": "stamp_ns id x_m y_m speed_mps heading_rad accel_mps2 yaw_rate_radps jerk_mps3 "
    "yaw_accel_radps2 latitude_deg longitude_deg covariance",
    "cwcli.v1.PredictedPath": "stamp_ns id model horizon_s step_s x_m y_m heading_rad speed_mps position_covariance",
    "cwcli.v1.Warning": "stamp_ns rule event_id state host_id other_id time_to_event_s predicted_distance_m ttc_s "
    "probability message",
    "cwcli.v1.Lanes": "stamp_ns lateral_deviation_m heading_deviation_rad curvature_1pm",
    "cwcli.v1.LaneBoundary": "a b c score probability found",
    "cwcli.v1.LateralState": "stamp_ns lateral_speed_mps yaw_rate_radps lateral_deviation_m heading_deviation_rad "
    "steer_rad",
    "cwcli.v1.Target": "stamp_ns id x_m y_m vx_mps vy_mps covariance sensor",
}


def test_descriptor_set_is_in_step_with_the_sources() -> None:
    folder = Path(str(schema_folder()))
    shipped = FileDescriptorSet.FromString((folder / CWCLI_DESCRIPTOR_SET_FILE).read_bytes())
    assert shipped == FileDescriptorSet.FromString(compile_schemas(folder))


@pytest.mark.parametrize("name", PROMISED)
def test_promised_fields_are_there(name: str) -> None:
    assert set(PROMISED[name].split()) <= set(find_message_schema(name).descriptor.fields_by_name)


@pytest.mark.parametrize("name", ["cwcli.v1.Lanes", "foxglove.SceneUpdate"])
def test_schema_data_is_complete_for_the_official_decoder(name: str) -> None:
    schema = find_message_schema(name)
    record = Schema(id=1, name=name, encoding="protobuf", data=schema.data)
    decode = DecoderFactory().decoder_for("protobuf", record)
    assert decode is not None
    assert decode(b"").DESCRIPTOR.full_name == name
    names = [file.name for file in FileDescriptorSet.FromString(schema.data).file]
    assert len(names) == len(set(names))


@pytest.mark.parametrize("name", ["foxglove.Nothing", "cwcli.v1.Nothing", "other.Thing"])
def test_unknown_message(name: str) -> None:
    with pytest.raises(KeyError):
        find_message_schema(name)
