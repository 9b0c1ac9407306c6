"""The stage `observe` on logs of a simulated car: errors, which inputs there are, defined behaviour at the edges."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from cwcli.channels.lateral_state import read_observed_drive
from cwcli.channels.published import OBSERVER
from cwcli.dynamics.config import ObserverConfig
from cwcli.dynamics.observer import observe_lateral_motion as observe_lateral
from cwcli.dynamics.samples import ScalarSamples, linearise_lanes
from cwcli.dynamics.vehicle import load_vehicle
from cwcli.errors import DataError, MissingSignalError
from cwcli.logs.read.reader import Log
from cwcli.logs.write.annotate import annotate_log
from cwcli.pipeline.call import run_stage
from cwcli.pipeline.records import RUN_RECORD_PREFIX, VEHICLE_RECORD_KEY, vehicle_and_notes_from_log
from cwcli.pipeline.result import StageResult
from cwcli.signals.columns import Columns, OutputChannel
from cwcli.simulation.lane_camera import LaneSensorNoise
from cwcli.stages import STAGES
from cwcli.stages.inputs.observer import lane_samples_at_preview
from cwcli.stages.observe import ObserveConfig
from tests.unit.stages.lateral_logs import (
    IMU,
    LANES,
    SPEED,
    STEERING,
    TRUTH,
    drive,
    ego_state_channel,
    lanes_channel,
    write_lane_log,
)

DRIVE = drive()
CAMERA_ONLY = ObserveConfig(vehicle=load_vehicle(), use_gyro=False, use_steer=False)
ALL = ObserveConfig(vehicle=load_vehicle())


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_lane_log(tmp_path_factory.mktemp("lanes") / "lanes.mcap", DRIVE)


def run(path: Path, config: ObserveConfig = ALL, *more: OutputChannel) -> StageResult:
    with Log.open(path) as log:
        return run_stage(STAGES["observe"], log.with_channels(more) if more else log, config)


def errors(result: StageResult) -> dict[str, dict[str, float]]:
    return {row["state"]: row for row in result.tables["observer_errors"].rows_as_dicts()}


@pytest.mark.parametrize(("state", "is_measurement"), [(1, True), (2, False), (4, False)])
def test_a_lane_that_no_frame_shows_is_no_measurement(state: int, *, is_measurement: bool) -> None:
    """Found, held and carried lanes: the observer would take the same measurement several times."""
    channel = lanes_channel(DRIVE.sensed)
    fields: dict[str, Any] = dict(channel.fields) | {
        "state": np.where(np.arange(len(DRIVE.sensed.lanes)) % 2, state, 1)
    }
    sequence = np.zeros(len(channel.log_time_ns), np.uint32)
    columns = Columns(
        LANES, "cwcli.v1.Lanes", "protobuf", channel.log_time_ns, channel.log_time_ns, sequence, fields, 0
    )
    samples = lane_samples_at_preview(columns, where="").samples
    assert np.isfinite(samples.lateral_deviation_m[::2]).all()
    assert np.isfinite(samples.lateral_deviation_m[1::2]).all() == is_measurement


def statuses(result: StageResult) -> list[str]:
    return [row["status"] for row in result.tables["observer"].rows_as_dicts()]


def test_the_stage_is_the_observer_on_the_logs_signals(whole: Path) -> None:
    sensed = DRIVE.sensed
    speed = ScalarSamples(sensed.speed.stamp_ns, sensed.speed.values.round(6).astype(np.float32).astype(np.float64))
    gyro = ScalarSamples(sensed.yaw_rate.stamp_ns, sensed.yaw_rate.values.round(9), 0.0017)
    direct = observe_lateral(linearise_lanes(sensed.lanes), speed, load_vehicle(), yaw_rate=gyro)
    table: Mapping[str, Any] = (
        run(whole, ObserveConfig(vehicle=load_vehicle(), use_steer=False)).tables["observer"].columns
    )
    np.testing.assert_allclose(table["yaw_rate_radps"], direct.state[:, 1], atol=1e-9)
    np.testing.assert_allclose(table["lateral_speed_mps"], direct.state[:, 0], atol=1e-9)


@pytest.mark.parametrize(
    ("config", "yaw_rate_degps", "lateral_mps"),
    [
        (CAMERA_ONLY, 1.0, 0.10),
        (ObserveConfig(vehicle=load_vehicle(), use_steer=False), 0.2, 0.08),
        (ALL, 0.2, 0.08),
        (ObserveConfig(vehicle=load_vehicle(), observer=ObserverConfig("zhang2011")), 1.0, 0.10),
    ],
    ids=["camera and speed", "gyroscope", "gyroscope and steering", "zhang2011"],
)
def test_errors_against_the_truth_are_within_the_bounds(
    whole: Path, config: ObserveConfig, yaw_rate_degps: float, lateral_mps: float
) -> None:
    found = errors(run(whole, config))
    assert np.degrees(found["yaw_rate_radps"]["rms"]) < yaw_rate_degps
    assert found["lateral_speed_mps"]["rms"] < lateral_mps
    assert found["yaw_rate_radps"]["n"] == 101  # 121 frames at 10 Hz, the first 2 s not counted


def test_messages_are_what_the_official_decoder_reads(whole: Path, tmp_path: Path) -> None:
    target = tmp_path / "observed.mcap"
    with Log.open(whole) as log:
        result = run_stage(STAGES["observe"], log, ALL)
        annotate_log(log, result.channels, {"cwcli.run.observe": result.metadata}, target)
    with target.open("rb") as file:
        found = [
            (message.log_time, decoded)
            for _, _, message, decoded in make_reader(
                file, validate_crcs=True, decoder_factories=[DecoderFactory()]
            ).iter_decoded_messages(topics=[OBSERVER.topic])
        ]
    rows = result.tables["observer"].rows_as_dicts()
    assert len(found) == len(rows) == 121
    for (log_time_ns, message), row in zip(found, rows, strict=True):
        assert message.stamp_ns == row["stamp_ns"]
        assert log_time_ns == row["stamp_ns"] + 20_000_000  # when the lanes were logged
        assert message.yaw_rate_radps == row["yaw_rate_radps"]
        assert len(message.covariance) == 16
        assert np.sqrt(message.covariance[5]) == pytest.approx(row["yaw_rate_sigma_radps"])
        assert message.Status.Name(message.status) == f"STATUS_{row['status'].upper()}"
        assert (message.preview_distance_m, message.mass_kg) == (33.5, 1215.0)
    with Log.open(target) as log:
        back = read_observed_drive(log.columns(OBSERVER.topic)).track
        car, notes = vehicle_and_notes_from_log(log)
    np.testing.assert_array_equal(back.state[:, 1], [row["yaw_rate_radps"] for row in rows])
    assert (car, notes) == (load_vehicle(), ())


@pytest.mark.parametrize("told_m", [0.0, -1.0, np.nan, np.inf])
def test_a_preview_distance_that_is_none_is_the_papers(tmp_path: Path, told_m: float) -> None:
    """0 is what protobuf makes of a field that is not set."""
    channel = run(write_lane_log(tmp_path / "lanes.mcap", DRIVE), ALL).channels[0]
    fields: dict[str, Any] = dict(channel.fields)
    fields["preview_distance_m"] = np.where(np.arange(len(channel)) == 60, told_m, fields["preview_distance_m"])
    with Log.open(tmp_path / "lanes.mcap") as log:
        back = read_observed_drive(log.with_channels([replace(channel, fields=fields)]).columns(OBSERVER.topic))
    np.testing.assert_array_equal(back.track.preview_m, np.full(121, 33.5))


def test_a_log_without_the_record_assumes_the_shipped_car_and_says_so(tmp_path: Path) -> None:
    with Log.open(write_lane_log(tmp_path / "lanes.mcap", DRIVE)) as log:
        car, notes = vehicle_and_notes_from_log(log)
    assert car == load_vehicle()
    assert "does not name its car" in notes[0]


@pytest.mark.parametrize("entry", ["[" * 100_000, "{", "[]", '{"name": 3}'])
def test_a_damaged_record_of_the_car_is_an_error(tmp_path: Path, entry: str) -> None:
    with Log.open(write_lane_log(tmp_path / "lanes.mcap", DRIVE)) as log:
        damaged = log.with_channels([], {f"{RUN_RECORD_PREFIX}observe": {VEHICLE_RECORD_KEY: entry}})
        with pytest.raises(DataError, match="the car in the record"):
            vehicle_and_notes_from_log(damaged)


def test_the_speed_may_come_from_the_ego_state(tmp_path: Path) -> None:
    path = write_lane_log(tmp_path / "l.mcap", DRIVE, without=(SPEED, IMU, STEERING))
    result = run(path, ALL, ego_state_channel(DRIVE))
    sources = {row[0]: row[1] for row in result.summary.sections[0].rows}
    assert sources["speed from"] == sources["yaw rate from"] == "/cwcli/ego/state"
    assert np.degrees(errors(result)["yaw_rate_radps"]["rms"]) < 0.3


def test_without_any_speed_it_says_what_is_missing(tmp_path: Path) -> None:
    path = write_lane_log(tmp_path / "l.mcap", DRIVE, without=(SPEED,))
    with pytest.raises(MissingSignalError, match="no channel holds the ego speed") as caught:
        run(path)
    assert "VelocityReport" in caught.value.hint


def test_without_lanes_it_names_the_command_that_makes_them(tmp_path: Path) -> None:
    path = write_lane_log(tmp_path / "l.mcap", DRIVE, without=(LANES,))
    with pytest.raises(MissingSignalError, match="no channel holds the lane boundaries") as caught:
        run(path)
    assert "cwcli lanes" in caught.value.hint


def test_a_speed_on_another_clock_is_an_error(tmp_path: Path) -> None:
    path = write_lane_log(tmp_path / "l.mcap", DRIVE, clock_offset_ns=3600 * 10**9)
    with pytest.raises(DataError, match="covers none of the frames"):
        run(path)


def test_a_gap_of_the_speed_has_no_state_and_the_observer_begins_anew(tmp_path: Path) -> None:
    path = write_lane_log(tmp_path / "l.mcap", DRIVE, speed_gap_s=(5.0, 8.0))
    found = statuses(run(path, CAMERA_ONLY))
    # Kept for 0.5 s beside the last and the first sample: frames from 5.5 to 7.5 s have none.
    assert found[60:75] == ["no_speed"] * 15
    assert found[76] in ("started", "observed")
    assert found.count("started") == 2


def test_boundaries_missing_for_seconds_are_coasted_then_lost_then_found_again(tmp_path: Path) -> None:
    driven = drive(noise=LaneSensorNoise(blind_s=((4.0, 9.0),)))
    path = write_lane_log(tmp_path / "l.mcap", driven)
    without_gyro = statuses(run(path, CAMERA_ONLY))
    assert without_gyro[40:59] == ["predicted"] * 19
    assert without_gyro[61:90] == ["lost"] * 29
    assert without_gyro[91:].count("observed") >= 28
    with_gyro = run(path, ObserveConfig(vehicle=load_vehicle(), use_steer=False))
    assert statuses(with_gyro)[40:90] == ["predicted"] * 50
    assert np.degrees(errors(with_gyro)["yaw_rate_radps"]["rms"]) < 0.2
    count = with_gyro.summary.inputs[0]
    assert (count.read, count.used, dict(count.set_aside)) == (121, 71, {"no boundary found": 50})


def test_no_boundary_at_all_leaves_no_state_and_says_so(tmp_path: Path) -> None:
    path = write_lane_log(tmp_path / "l.mcap", drive(noise=LaneSensorNoise(blind_s=((-1.0, 99.0),))))
    result = run(path)
    assert set(statuses(result)) == {"lost"}
    assert "no frame has a state" in result.summary.notes


def test_a_gyroscope_that_counts_the_other_way_is_not_used(tmp_path: Path) -> None:
    path = write_lane_log(tmp_path / "l.mcap", drive(seconds=20.0), gyro_sign=-1.0)
    result = run(path, ObserveConfig(vehicle=load_vehicle(), use_steer=False))
    assert any("turns the other way than the lane" in note for note in result.summary.notes)
    assert np.degrees(errors(result)["yaw_rate_radps"]["rms"]) < 1.0


def test_standing_still_is_no_motion(tmp_path: Path) -> None:
    path = write_lane_log(tmp_path / "l.mcap", drive(seconds=5.0), speed_factor=0.0, without=(IMU, STEERING, TRUTH))
    table = run(path).tables["observer"].columns
    assert np.abs(np.asarray(table["yaw_rate_radps"])).max() < 1e-3
    assert np.abs(np.asarray(table["lateral_speed_mps"])).max() < 1e-3
    paper = run(path, ObserveConfig(vehicle=load_vehicle(), observer=ObserverConfig("zhang2011")))
    assert set(statuses(paper)) == {"too_slow"}


def test_frames_out_of_order_are_sorted_and_counted(tmp_path: Path) -> None:
    order = np.arange(121)
    order[[30, 31]] = order[[31, 30]]
    order[50] = 49  # the same frame twice
    path = write_lane_log(tmp_path / "l.mcap", DRIVE, lane_order=order)
    result = run(path)
    stamps = np.asarray(result.tables["observer"].columns["stamp_ns"])
    assert (np.diff(stamps) > 0).all()
    count = result.summary.inputs[0]
    assert dict(count.repaired) == {"stamp out of order, sorted": 1}
    assert dict(count.rejected) == {"stamp repeated": 1}
    assert (np.diff(result.channels[0].log_time_ns) >= 0).all()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("method", ["cwcli", "zhang2011"])
@pytest.mark.parametrize("value", [np.inf, -np.inf, 1e300, -1e300])
def test_absurd_numbers_are_left_out_and_counted(
    tmp_path: Path, method: Literal["cwcli", "zhang2011"], value: float
) -> None:
    channel = lanes_channel(DRIVE.sensed)
    fields = {name: np.asarray(values).copy() for name, values in channel.fields.items()}
    for row, (name, unit) in enumerate(
        (("lateral_deviation", "m"), ("heading_deviation", "rad"), ("curvature", "1pm"))
    ):
        fields[f"{name}_{unit}"][40 + row] = value
        fields[f"{name}_sigma_{unit}"][50] = value
    fields["stamp_ns"][[60, 61]] = 0
    changed = OutputChannel(LANES, channel.schema_name, channel.log_time_ns, fields)
    path = write_lane_log(tmp_path / "l.mcap", DRIVE, without=(LANES,))
    result = run(path, ObserveConfig(vehicle=load_vehicle(), observer=ObserverConfig(method)), changed)
    count = result.summary.inputs[0]
    assert dict(count.repaired) == {"value out of range, left out": 3}
    assert dict(count.rejected) == {"no usable stamp": 2}
    assert np.degrees(errors(result)["yaw_rate_radps"]["rms"]) < 1.0


def test_a_changing_preview_distance_is_an_error(tmp_path: Path) -> None:
    channel = lanes_channel(DRIVE.sensed)
    preview = np.asarray(channel.fields["preview_distance_m"]).copy()
    preview[60:] = 20.0
    changed = OutputChannel(
        LANES, channel.schema_name, channel.log_time_ns, {**channel.fields, "preview_distance_m": preview}
    )
    path = write_lane_log(tmp_path / "l.mcap", DRIVE, without=(LANES,))
    with pytest.raises(DataError, match="preview distance changes"):
        run(path, ALL, changed)


def test_the_load_is_estimated_when_asked_for(tmp_path: Path) -> None:
    car = load_vehicle(load="full")
    path = write_lane_log(tmp_path / "l.mcap", drive(seconds=60.0, car=car))
    config = ObserveConfig(vehicle=load_vehicle(), observer=ObserverConfig(estimate_load=True))
    rows = {row[0]: row[1] for row in run(path, config).summary.sections[0].rows}
    mass, sigma = rows["mass at the end (kg)"], rows["its sigma (kg)"]
    assert isinstance(mass, float) and isinstance(sigma, float)
    assert abs(mass - 1460.0) < max(3.0 * sigma, 60.0)
    assert sigma < 240.0  # it began with a fifth of 1215 kg


def test_the_record_holds_configuration_and_car(whole: Path) -> None:
    record = run(whole).metadata
    assert json.loads(record["vehicle"])["mass_kg"] == 1215.0
    assert json.loads(record["configuration"])["observer"]["method"] == "cwcli"


def test_without_a_named_car_the_example_is_noted(whole: Path) -> None:
    assert any("--vehicle" in note for note in run(whole, ObserveConfig()).summary.notes)


def test_a_lane_that_turns_back_before_the_preview_point(tmp_path: Path) -> None:
    """A ramp of 23 m: no value 33.5 m ahead, but the boundaries' shape; the paper's method has no use for it."""
    channel = lanes_channel(DRIVE.sensed)
    ramp = (np.arange(121) >= 60) & (np.arange(121) < 80)
    fields: dict[str, Any] = dict(channel.fields)
    for name in ("lateral_deviation_m", "heading_deviation_rad", "curvature_1pm"):
        fields[name] = np.where(ramp, np.nan, fields[name])
    for side, sign in (("left", 1.0), ("right", -1.0)):
        fields[f"{side}.far_px"] = np.where(ramp, 320.0, np.nan)
        fields[f"{side}.lateral_m"] = np.full(121, 1.8 * sign)
        fields[f"{side}.slope"] = np.zeros(121)
        fields[f"{side}.ground_curvature_1pm"] = np.full(121, 1.0 / (23.0 - 1.8 * sign))
    fields |= {"road_focal_px": np.full(121, 400.0), "road_centre_px": np.full(121, 320.0)}
    path = write_lane_log(tmp_path / "l.mcap", DRIVE, without=(LANES,))
    channel = replace(channel, fields=fields)
    ours = run(path, ALL, channel)
    assert not ours.summary.inputs[0].set_aside
    rows = ours.tables["observer"].rows_as_dicts()
    assert {row["status"] for row in rows[61:80]} <= {"observed", "rejected", "started"}
    with Log.open(path) as log:
        back = read_observed_drive(log.with_channels([channel, *ours.channels]).columns(OBSERVER.topic))
    assert back.track.preview_m[70] == pytest.approx(0.4 * 23.0)  # where the lane has turned by a sine of 0.4
    papers = run(path, ObserveConfig(vehicle=load_vehicle(), observer=ObserverConfig("zhang2011")), channel)
    assert papers.summary.inputs[0].set_aside == {"the lane turns back before the preview point": 20}
