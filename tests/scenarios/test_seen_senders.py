"""A car that sends and is seen by a third station: one vehicle and one warning, in simulated drives."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cwcli.channels.warning import read_warnings, warning_events_with_known_start
from cwcli.logs.read.reader import Log
from cwcli.pipeline.call import run_stage
from cwcli.signals.v2x_time import its_ms_from_unix_ns
from cwcli.simulate.sensor_log import write_simulated_log
from cwcli.simulation.drive import simulate_scenario
from cwcli.simulation.scenario import load_scenario
from cwcli.stages import STAGES
from cwcli.stages.estimate import EstimateConfig
from cwcli.stages.predict import PredictConfig
from cwcli.stages.warn import WarnConfig
from tests.cli.rewritten_logs import Logged, read, write
from tests.laws.perceived_messages import MS, ros_cpm


def seen(message: Logged, rng: np.random.Generator, number: int) -> Logged:
    """What a station near the sender of a BSM tells of it: 0.2 m and 0.3 m/s wrong, 40 ms after the BSM."""
    core = json.loads(message.data)["coreData"]
    told: dict[str, Any]
    told, _ = ros_cpm(0, message.log_time_ns)
    management = told["payload"]["management_container"]
    management["reference_time"]["value"] = int(its_ms_from_unix_ns(np.array([message.log_time_ns]))[0])
    place = management["reference_position"]
    place["latitude"]["value"], place["longitude"]["value"] = core["lat"], core["long"]
    ellipse = place["position_confidence_ellipse"]
    for name in ("semi_major_confidence", "semi_minor_confidence"):
        ellipse[name]["value"] = 25
    container = told["payload"]["cpm_containers"]["value"]["array"][0]
    car = container["container_data_perceived_object_container"]["perceived_objects"]["array"][0]
    car["object_id"]["value"], car["measurement_delta_time"]["value"] = number, 0
    for axis in "xy":
        coordinate = car["position"][f"{axis}_coordinate"]
        coordinate["value"]["value"] = round(100.0 * rng.normal(0.0, 0.2))
        coordinate["confidence"]["value"] = 40
    polar = car["velocity"]["polar_velocity"]
    polar["velocity_magnitude"]["speed_value"]["value"] = max(round(2.0 * core["speed"] + rng.normal(0.0, 30.0)), 0)
    direction = round(900.0 - core["heading"] * 0.125) % 3600
    polar["velocity_direction"]["value"]["value"] = car["angles"]["z_angle"]["value"]["value"] = direction
    car["z_angular_velocity_is_present"] = car["acceleration_is_present"] = False
    data = json.dumps(told).encode()
    schema = ("etsi_its_cpm_ts_msgs/CollectivePerceptionMessage", "jsonschema", b"{}")
    return Logged("/v2x/cpm", "json", schema, message.log_time_ns + 40 * MS, data)


def drive(path: Path, scenario: str, seed: int, *, with_objects: bool) -> Path:
    """The simulated log, with what a third station sees of each sender."""
    write_simulated_log(simulate_scenario(load_scenario(scenario), seed), path)
    messages, rng = read(path), np.random.default_rng(seed)
    numbers: dict[str, int] = {}
    told = []
    for each in messages if with_objects else ():
        if each.topic == "/v2x/bsm":
            station = json.loads(each.data)["coreData"]["id"]
            told.append(seen(each, rng, numbers.setdefault(station, 1 + len(numbers))))
    write(path, sorted([*messages, *told], key=lambda each: each.log_time_ns))
    return path


def warned(path: Path) -> tuple[list[tuple[str, float]], list[str], set[str]]:
    """Each warning's vehicle and second, the notes of `estimate`, and the ids of the remote vehicles."""
    log = Log.open(path)
    notes: list[str] = []
    for name, config in (("estimate", EstimateConfig()), ("predict", PredictConfig()), ("warn", WarnConfig())):
        result = run_stage(STAGES[name], log, config)
        notes += result.summary.notes if name == "estimate" else ()
        log = log.with_channels(result.channels, {f"cwcli.run.{result.stage}": result.metadata})
    events = warning_events_with_known_start(read_warnings(log.columns("/cwcli/warnings")))
    ids = log.columns("/cwcli/remote/state").fields["id"]
    start_ns = log.start_ns
    return [(each.other_id, (each.raised_ns - start_ns) * 1e-9) for each in events], notes, set(ids.values)  # type: ignore[union-attr]


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("scenario", ["rear-end", "intersection"])
def test_one_car_is_one_warning(tmp_path: Path, scenario: str, seed: int) -> None:
    alone, _, sender = warned(drive(tmp_path / "alone.mcap", scenario, seed, with_objects=False))
    both, notes, ids = warned(drive(tmp_path / "both.mcap", scenario, seed, with_objects=True))
    assert [who for who, _ in both] == [who for who, _ in alone] == list(sender)
    assert both[0][1] == pytest.approx(alone[0][1], abs=0.011)  # a hundredth is the host's step
    assert any("are vehicles that send messages themselves" in note for note in notes)
    assert ids >= sender


@pytest.mark.parametrize("lead_s", [0.3, 0.6, 0.9])
@pytest.mark.parametrize("scenario", ["rear-end", "intersection"])
def test_a_warning_waits_for_no_silent_radio(
    tmp_path: Path, scenario: str, lead_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The radio falls silent before the warning, for 1.3 s: half a message's interval is what the object's filter
    needs that began with the silence."""
    messages = read(drive(tmp_path / "both.mcap", scenario, 1, with_objects=True))
    (_, warned_s), *_ = warned(tmp_path / "both.mcap")[0]
    silent_ns = messages[0].log_time_ns + round((warned_s - lead_s) * 1e9)
    heard = [
        each
        for each in messages
        if each.topic != "/v2x/bsm" or not silent_ns <= each.log_time_ns < silent_ns + 1_300 * MS
    ]
    write(tmp_path / "silent.mcap", heard)
    (_, with_s), *_ = warned(tmp_path / "silent.mcap")[0]
    monkeypatch.setattr(
        "cwcli.stages.estimate.drop_seen_objects_that_are_senders_and_note", lambda signal, local_map: (signal, ())
    )
    (_, without_s), *_ = warned(tmp_path / "silent.mcap")[0]
    assert with_s <= without_s + 0.051
