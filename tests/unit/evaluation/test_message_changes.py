"""Two runs compared to the message: the seeded change, and the first channel that differs, are named exactly."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cwcli.channels.output import make_output_channel
from cwcli.channels.published import EGO_ONLINE, EGO_STATE, WARNINGS
from cwcli.channels.vehicle_state import VehicleStates, make_vehicle_state_channel
from cwcli.evaluation.message_changes import LogDifference, compare_messages
from cwcli.evaluation.setting_changes import SettingChange, compare_settings
from cwcli.logs.read.reader import Log
from cwcli.logs.write.writer import LogWriter
from cwcli.signals.columns import Strings

T0_NS = 1_700_000_000_000_000_000
N = 60
STAMP_NS = T0_NS + np.arange(N, dtype=np.int64) * 100_000_000
CONFIGURATION: dict[str, Any] = {
    "estimator": {"gate_probability": 0.999, "model": "cwcli"},
    "calibration": {"/imu": {"gyro_bias_radps": 0.001}},
    "topics": {},
}


def write(path: Path, **changes: Any) -> Path:
    """An annotated log: a recorded topic, states in hindsight and online, two warnings, and a record."""
    status = [{"speed": 0.5 * k, "name": "drive", "ranges": [1.0] * (1 + k % 3)} for k in range(N)]
    for row, field, value in changes.get("status", ()):
        status[row][field] = value
    kept = [k for k in range(N) if k not in changes.get("missing", ())]
    with LogWriter(path, force=True) as log:
        channel = log.add_channel("/status", "json", log.add_schema("Status", "jsonschema", b"{}"))
        log.write_messages(channel, STAMP_NS[kept], [json.dumps(status[k]).encode() for k in kept])
        for topic in (EGO_STATE, EGO_ONLINE):
            state: np.ndarray = np.tile(np.arange(8.0), (N, 1)) + np.arange(N)[:, None]
            for row, column, by in changes.get(topic.topic, ()):
                state[row, column] += by
            states = VehicleStates.from_ego_states(STAMP_NS, state, np.broadcast_to(np.eye(8), (N, 8, 8)))
            log.write_columns(make_vehicle_state_channel(topic, states, None))
        log.write_columns(warnings(changes.get("raised", (10, 40))))
        record = {
            "version": changes.get("version", "1"),
            "configuration": json.dumps(changes.get("config", CONFIGURATION)),
        }
        log.add_metadata("cwcli.run.estimate", record)
    return path


def warnings(rows: tuple[int, ...]) -> Any:
    """A warning that lasts for three messages from each of some rows."""
    every = np.array([row + k for row in rows for k in range(3)])
    fields = {
        "stamp_ns": STAMP_NS[every],
        "known_ns": STAMP_NS[every],
        "rule": Strings(np.zeros(len(every), np.int32), ("cwcli",)),
        "event_id": np.repeat(np.arange(1, len(rows) + 1), 3),
        "state": np.tile(np.array([1, 2, 3], np.int32), len(rows)),
        "other_id": Strings(np.zeros(len(every), np.int32), ("truck",)),
    }
    return make_output_channel(WARNINGS, STAMP_NS[every], fields)


def difference(folder: Path, tolerances: Mapping[str, float] | None = None, /, **changes: Any) -> LogDifference:
    before, after = write(folder / "before.mcap"), write(folder / "after.mcap", **changes)
    with Log.open(before) as early, Log.open(after) as late:
        return compare_messages(early, late, tolerances)


def test_identical_runs_have_no_difference(tmp_path: Path) -> None:
    found = difference(tmp_path)
    assert found.has_no_difference
    assert found.n_channels == 4


@pytest.mark.parametrize("seed", range(50))
def test_seeded_change_is_named_exactly(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    row = int(rng.integers(0, N))
    kind = ("option", "calibration", "recorded", "published", "missing")[seed % 5]
    config = json.loads(json.dumps(CONFIGURATION))
    if kind == "option":
        config["estimator"]["gate_probability"] = 0.99
        column, by = int(rng.integers(0, 8)), float(rng.choice([-0.5, 2.0]))
        found = difference(tmp_path, config=config, **{EGO_STATE.topic: [(row, column, by)]})
        assert found.settings == (SettingChange("estimate", "estimator.gate_probability", "0.999", "0.99"),)
        assert found.channels[0].topic == EGO_STATE.topic
        assert found.channels[0].largest == pytest.approx(abs(by))
    elif kind == "calibration":
        config["calibration"]["/imu"]["gyro_bias_radps"] = 0.002
        found = difference(tmp_path, config=config, **{EGO_ONLINE.topic: [(row, 2, 0.25)]})
        name = "calibration./imu.gyro_bias_radps"
        assert found.settings == (SettingChange("estimate", name, "0.001", "0.002"),)
        assert (found.channels[0].topic, found.channels[0].field) == (EGO_ONLINE.topic, "speed_mps")
    elif kind == "recorded":
        found = difference(tmp_path, status=[(row, "speed", 99.0)], **{EGO_STATE.topic: [(row, 0, 1.0)]})
        assert found.settings == ()
        first = found.channels[0]
        assert (first.topic, first.field, first.after) == ("/status", "speed", "99.0")
    elif kind == "published":
        found = difference(tmp_path, **{EGO_STATE.topic: [(row, 3, 0.125)], EGO_ONLINE.topic: [(0, 3, 1.0)]})
        assert [each.topic for each in found.channels] == [EGO_STATE.topic, EGO_ONLINE.topic]
        assert (found.channels[0].field, found.channels[0].n_different) == ("heading_rad", 1)
    else:
        found = difference(tmp_path, missing=[row])
        assert [(each.topic, each.before, each.after) for each in found.channels] == [("/status", "a message", "")]
    assert found.channels[0].at_ns == STAMP_NS[row]


def test_warnings_that_moved_appeared_and_vanished(tmp_path: Path) -> None:
    moved = difference(tmp_path, raised=(14, 40)).warnings
    assert [each.kind for each in moved] == ["moved"]
    assert moved[0].moved_s == pytest.approx(0.4)
    assert [each.kind for each in difference(tmp_path, raised=(10,)).warnings] == ["vanished"]
    (new,) = difference(tmp_path, raised=(10, 40, 50)).warnings
    assert (new.kind, new.rule, new.other_id, new.raised_ns) == ("appeared", "cwcli", "truck", STAMP_NS[50])


def test_tolerances_hide_small_differences_of_their_field_alone(tmp_path: Path) -> None:
    changes = {EGO_STATE.topic: [(5, 2, 0.25)]}
    assert difference(tmp_path, {"speed_mps": 0.3}, **changes).channels == ()
    assert len(difference(tmp_path, {"speed_mps": 0.2}, **changes).channels) == 1
    assert len(difference(tmp_path, {"x_m": 0.3}, **changes).channels) == 1


def test_tolerances_hold_for_sequences_of_any_length(tmp_path: Path) -> None:
    changes = {"status": [(4, "ranges", [1.0, 1.25])]}
    assert difference(tmp_path, {"ranges": 0.3}, **changes).channels == ()
    (change,) = difference(tmp_path, {"ranges": 0.2}, **changes).channels
    assert (change.field, change.before, change.after) == ("ranges", "[1.0, 1.0]", "[1.0, 1.25]")
    (longer,) = difference(tmp_path, {"ranges": 0.3}, status=[(4, "ranges", [1.0])]).channels
    assert (longer.field, longer.n_different) == ("ranges", 1)


CONSTANTS = (
    '["/imu".yaw_rate]\nbias = {{ status = "found", value = {}, sigma = 0.1, interval = [{}, 9.0], logs = 2 }}\n'
)


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        pytest.param(
            CONSTANTS.format(0.5, 0.3), CONSTANTS.format(0.6, 0.4),
            [("calibration./imu.yaw_rate.bias.value", "0.5", "0.6")], id="a value, and the interval around it",
        ),
        pytest.param(CONSTANTS.format(0.5, 0.3), CONSTANTS.format(0.5, 0.4), [], id="information alone"),
        pytest.param(None, CONSTANTS.format(0.5, 0.3), [("calibration", "null", '"constants from a file"')], id="new"),
        pytest.param("= no TOML", "= nor this", [("calibration", '"= no TOML"', '"= nor this"')], id="damaged"),
    ],
)  # fmt: skip
def test_constants_of_a_calibration_file_are_named(
    tmp_path: Path, before: str | None, after: str | None, expected: list[tuple[str, str, str]]
) -> None:
    paths = []
    for name, text in (("before", before), ("after", after)):
        entries = {"version": "1", "configuration": '{"calibration": null}'}
        paths.append(tmp_path / f"{name}.mcap")
        with LogWriter(paths[-1]) as log:
            for stage in ("estimate", "observe"):  # both read the file, and the change is named once
                log.add_metadata(f"cwcli.run.{stage}", entries | ({} if text is None else {"calibration": text}))
    with Log.open(paths[0]) as early, Log.open(paths[1]) as late:
        found = list(compare_settings(early, late))
    assert found == [SettingChange("estimate", *each) for each in expected]


def test_option_that_becomes_a_table_is_one_change(tmp_path: Path) -> None:
    config = json.loads(json.dumps(CONFIGURATION))
    config["estimator"]["model"] = {"name": "cwcli"}
    (change,) = difference(tmp_path, config=config).settings
    assert (change.name, change.before, change.after) == ("estimator.model", '"cwcli"', '{"name": "cwcli"}')


def test_another_version_is_named(tmp_path: Path) -> None:
    assert difference(tmp_path, version="2").settings == (SettingChange("estimate", "version", '"1"', '"2"'),)


def test_texts_differ(tmp_path: Path) -> None:
    (change,) = difference(tmp_path, status=[(7, "name", "parked")]).channels
    assert (change.field, change.before, change.after, change.n_different) == ("name", "drive", "parked", 1)
