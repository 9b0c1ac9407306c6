"""Scenario files: what is read, what overrides do, and the one-line errors with file, key and permitted range."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cwcli.errors import EXIT_USAGE, UsageError
from cwcli.signals.vehicle_state import SPEED
from cwcli.simulation.catalogue import scenario_names
from cwcli.simulation.scenario import (
    load_scenario,
    parse_scenario,
    read_scenario_name_and_document,
    with_override,
)
from cwcli.simulation.spec import (
    DETECTOR_KEYS,
    LATERAL_KEYS,
    LONGITUDINAL_KEYS,
    ORIGIN_KEYS,
    REQUIRED_KEY_DEFAULT,
    SCENARIO_TOP_LEVEL_KEYS,
    SENSOR_KEYS,
    V2X_KEYS,
    VEHICLE_KEYS,
    Key,
)

MINIMAL = {"duration_s": 10, "vehicles": {"host": {"speed_mps": 10}}}


@pytest.mark.parametrize("name", scenario_names())
def test_every_scenario_loads_and_has_a_description(name: str) -> None:
    scenario = load_scenario(name)
    assert scenario.name == name
    assert scenario.description
    assert next(iter(scenario.vehicles)) == "host"


def test_minimal_scenario_gets_the_documented_defaults() -> None:
    scenario = parse_scenario(MINIMAL, name="small")
    assert (scenario.seed, scenario.friction, scenario.truth_rate_hz) == (1, 0.9, 20.0)
    assert scenario.start_ns == 1_475_308_800 * 10**9  # 2016-10-01 08:00:00 UTC
    assert scenario.sensors == {}
    assert scenario.v2x is None


def test_start_time_with_an_offset() -> None:
    document = with_override(MINIMAL, "start_time=2024-02-29T01:00:00.25+01:00")
    assert parse_scenario(document, name="small").start_ns == 1_709_164_800 * 10**9 + 250_000_000
    as_text = with_override(MINIMAL, 'start_time="2024-02-29 01:00:00.25+01:00"')
    assert parse_scenario(as_text, name="small").start_ns == parse_scenario(document, name="small").start_ns


def test_station_ids_are_stable_and_can_be_given() -> None:
    document = with_override(MINIMAL, "vehicles.other.speed_mps=1")
    first = parse_scenario(document, name="small").vehicles["other"].station_id
    assert first == parse_scenario(document, name="other-file").vehicles["other"].station_id
    assert len(first) == 8
    document = with_override(document, 'other.station_id="0000beef"')
    assert parse_scenario(document, name="small").vehicles["other"].station_id == "0000beef"
    document = with_override(document, 'host.station_id="0000beef"')
    with pytest.raises(UsageError, match=r"vehicles.other.station_id is also that of host"):
        parse_scenario(document, name="small")


def test_override_by_vehicle_name_by_path_and_by_index() -> None:
    _, document = read_scenario_name_and_document("rear-end")
    assert with_override(document, "host.speed_mps=12")["vehicles"]["host"]["speed_mps"] == 12
    assert with_override(document, "vehicles.host.speed_mps = 12.5")["vehicles"]["host"]["speed_mps"] == 12.5
    changed = with_override(document, "lead.longitudinal.2.accel_mps2=-4")
    assert changed["vehicles"]["lead"]["longitudinal"][2]["accel_mps2"] == -4
    assert with_override(document, "v2x.format=ode-json")["v2x"]["format"] == "ode-json"
    assert with_override(document, "sensors.gnss.outages=[[1, 2]]")["sensors"]["gnss"]["outages"] == [[1, 2]]


def test_override_leaves_its_argument_alone() -> None:
    _, document = read_scenario_name_and_document("rear-end")
    _, untouched = read_scenario_name_and_document("rear-end")
    with_override(document, "lead.longitudinal.2.accel_mps2=-4")
    assert document == untouched


def test_scenario_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "my-drive.toml"
    path.write_text("duration_s = 3\n[vehicles.host]\nspeed_mps = 5\n")
    scenario = load_scenario(path, ("host.speed_mps=6",))
    assert scenario.name == "my-drive"
    assert scenario.vehicles["host"].motion.states_at(np.zeros(1))[0, SPEED] == 6.0


@pytest.mark.parametrize("text", [f"duration_s = 1{'0' * 5000}", f"a = {'[' * 5000}{']' * 5000}", "a ="])
def test_scenario_file_that_is_not_toml(tmp_path: Path, text: str) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(text)
    with pytest.raises(UsageError, match="not TOML"):
        load_scenario(path)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("host.speed=3", "vehicles.host.speed is unknown; permitted: x_m, "),
        ("hots.speed_mps=3", "hots is unknown; permitted: description, duration_s, "),
        ("host.speed_mps=-1", "vehicles.host.speed_mps is -1; permitted: 0 to 70 m/s"),
        ("host.speed_mps=true", "vehicles.host.speed_mps is True; permitted: a number, 0 to 70 m/s"),
        ("host.speed_mps=fast", "vehicles.host.speed_mps is 'fast'; permitted: a number, 0 to 70 m/s"),
        ("host.v2x=1", "vehicles.host.v2x is 1; permitted: true, false"),
        ("host.station_id=xyz", "vehicles.host.station_id is 'xyz'; permitted: eight lower-case hexadecimal digits"),
        ("seed=1.5", "seed is 1.5; permitted: a whole number, 0 to "),
        ("duration_s=nan", "duration_s is nan; permitted: 0.1 to 3600 s"),
        ("duration_s=inf", "duration_s is inf; permitted: 0.1 to 3600 s"),
        ("start_time=2020-01-01", "start_time is datetime.date(2020, 1, 1); permitted: a date and time with offset"),
        ("start_time=1960-01-01T00:00:00Z", "start_time is 1960-01-01 00:00:00+00:00; permitted: 1970 or later"),
        ("origin.latitude_deg=91", "origin.latitude_deg is 91; permitted: -85 to 85 deg"),
        ("sensors.gnss.rate_hz=-5", "sensors.gnss.rate_hz is -5; permitted: 0.1 to 1000 Hz"),
        (
            "sensors.gnss.outages=[[3, 2]]",
            "sensors.gnss.outages.0 is [3, 2]; permitted: [from, to] with 0 <= from < to",
        ),
        ("sensors.gnss.outages=3", "sensors.gnss.outages is 3; permitted: [[from, to], ...]"),
        (
            "sensors.sonar.rate_hz=5",
            "sensors.sonar is unknown; permitted: gnss, gnss_heading, speed, imu, lidar, radar",
        ),
        ("sensors=3", "sensors is 3; permitted: a table"),
        ("v2x.format=morse", 'v2x.format is \'morse\'; permitted: "bsm-json", "ode-json"'),
        ("v2x.drop_probability=1.5", "v2x.drop_probability is 1.5; permitted: 0 to 1"),
        ("v2x=3", "v2x is 3; permitted: a table"),
        ("vehicles.Other.speed_mps=3", "vehicles.Other is no name; permitted: lower-case letters, digits, - and _"),
        ("vehicles.host=3", "vehicles.host is 3; permitted: a table"),
        ("friction=0.2", "vehicles.lead needs 8.00 m/s^2 of the tyres at 5.79 s; permitted: 0 to 1.96 m/s^2 "),
    ],
)
def test_bad_value_names_file_key_and_permitted_range(setting: str, message: str) -> None:
    with pytest.raises(UsageError) as error:
        load_scenario("rear-end", (setting,))
    assert str(error.value).startswith(f"rear-end.toml: {message}")
    assert "\n" not in str(error.value)
    assert error.value.exit_code == EXIT_USAGE


@pytest.mark.parametrize(
    "text", ["host.speed_mps", "=3", "host..speed_mps=3", "lead.longitudinal.9.accel_mps2=1", "duration_s.x.y=1"]
)
def test_bad_override_is_refused(text: str) -> None:
    _, document = read_scenario_name_and_document("rear-end")
    with pytest.raises(UsageError, match="--set"):
        with_override(document, text)


def test_missing_vehicle_speed_and_host() -> None:
    with pytest.raises(UsageError, match=r"small.toml: vehicles.host.speed_mps is missing; permitted: 0 to 70 m/s"):
        parse_scenario({"duration_s": 1, "vehicles": {"host": {}}}, name="small")
    with pytest.raises(UsageError, match=r"small.toml: vehicles.host is missing"):
        parse_scenario({"duration_s": 1, "vehicles": {"lead": {"speed_mps": 1}}}, name="small")
    with pytest.raises(UsageError, match=r"small.toml: duration_s is missing; permitted: 0.1 to 3600 s"):
        parse_scenario({}, name="small")


def test_unknown_scenario_lists_those_there_are() -> None:
    with pytest.raises(UsageError, match="no scenario and no file is named 'rear-edn'") as error:
        load_scenario("rear-edn")
    assert "rear-end" in error.value.found


@pytest.mark.parametrize("content", [b"duration_s = ", b"\xff\xfe"])
def test_file_that_is_not_toml(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "bad.toml"
    path.write_bytes(content)
    with pytest.raises(UsageError, match=r"^bad.toml: "):
        load_scenario(path)


ALL_TABLES = {
    "top": SCENARIO_TOP_LEVEL_KEYS,
    "origin": ORIGIN_KEYS,
    "vehicle": VEHICLE_KEYS,
    "longitudinal": LONGITUDINAL_KEYS,
    "lateral": LATERAL_KEYS,
    **SENSOR_KEYS,
    **DETECTOR_KEYS,
    "v2x": V2X_KEYS,
}


@pytest.mark.parametrize("table", ALL_TABLES)
def test_docs_hold_every_key_with_its_range_and_default(table: str) -> None:
    text = (Path(__file__).parents[3] / "docs" / "scenarios.md").read_text(encoding="utf-8")
    rows = {line.strip() for line in text.splitlines()}
    for name, key in ALL_TABLES[table].items():
        assert documented_row(name, key) in rows, f"{table}: {name}"


def documented_row(name: str, key: Key) -> str:
    default = key.default
    if default is REQUIRED_KEY_DEFAULT:
        shown = "required"
    elif default in (None, ()):
        shown = "none"
    elif isinstance(default, bool):
        shown = str(default).lower()
    elif isinstance(default, str):
        shown = f'"{default}"'
    else:
        shown = str(default)
    return f"| `{name}` | {key.permitted_text()} | {shown} | {key.doc} |"
