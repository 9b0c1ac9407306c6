"""Records of annotated logs, read back; those of logs that anybody may have written."""

from __future__ import annotations

import json
from typing import Any

import pytest

from cwcli.evaluation.records import source_config_from_record, warning_config_from_record
from cwcli.pipeline.records import local_map_from_estimate_record, read_configuration, read_input_counts
from cwcli.stages.inputs.sources import SourceConfig
from cwcli.warning.types import WarningConfig

ORIGIN = {"map_origin_latitude_deg": "48.0", "map_origin_longitude_deg": "11.0", "map_origin_altitude_m": "500.0"}


def configured(**configuration: Any) -> dict[str, str]:
    return {"configuration": json.dumps(configuration)}


def test_what_fits_is_read() -> None:
    found = local_map_from_estimate_record(ORIGIN)
    assert found is not None
    assert (found.origin_lat_deg, found.origin_lon_deg, found.origin_alt_m) == (48.0, 11.0, 500.0)
    sources = {"topics": {"imu": "/imu"}, "clock": "log", "ego_station": "7", "start_ns": 3, "end_ns": None}
    assert source_config_from_record(configured(sources=sources)) == SourceConfig(
        topics={"imu": "/imu"}, clock="log", ego_station="7", start_ns=3
    )
    rule = {"rule": "ttc", "distance_m": 3, "conflict": "drac", "persistence_s": None}
    assert warning_config_from_record(configured(rule=rule)) == WarningConfig(rule="ttc", distance_m=3, conflict="drac")
    assert read_input_counts({"counts": json.dumps([{"read": 1}, 2])}) == [{"read": 1}]


@pytest.mark.parametrize("name", list(ORIGIN)[:2])
@pytest.mark.parametrize("value", ["", "x", "nan", "inf", "1e400", "181"])
def test_an_origin_that_is_no_place_is_none(name: str, value: str) -> None:
    assert local_map_from_estimate_record({**ORIGIN, name: value}) is None


@pytest.mark.parametrize("text", ["", "3", "[]", "null", "{", "[" * 100_000, '{"sources": 1, "rule": []}'])
def test_a_broken_configuration_is_as_if_it_were_not_there(text: str) -> None:
    record = {"configuration": text, "counts": text}
    assert read_input_counts(record) == []
    assert isinstance(read_configuration(record), dict)
    assert source_config_from_record(record) == SourceConfig()
    assert warning_config_from_record(record) == WarningConfig()


@pytest.mark.parametrize("value", ["bogus", -1.0, True, None, [1], {"a": 1}, float("inf")])
def test_a_threshold_that_does_not_fit_is_left_at_its_default(value: Any) -> None:
    names = ("use", "distance_m", "max_lead_s", "max_gap_s")
    assert warning_config_from_record(configured(rule=dict.fromkeys(names, value))) == WarningConfig()
