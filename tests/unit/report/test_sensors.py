"""The section on the sensors: what the records tell, what no car can do, and the band of a position error."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cwcli.channels.vehicle_state import VehicleStates
from cwcli.digest.drive import Drive
from cwcli.digest.encounters import DriveEncounters
from cwcli.digest.story import build_story
from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.result import GatedMeasurements
from cwcli.evaluation.doubts import find_doubts_in_evidence
from cwcli.report.sensors import build_sensors_view, sigma_along_error
from cwcli.report.signal_figures import motion_figure
from cwcli.signals.columns import encode_strings
from cwcli.signals.vehicle_state import ACCEL, SPEED, YAW_RATE
from cwcli.warning.types import WarningConfig

S = 1_000_000_000


def drive(summary: dict[str, Any] | None = None, **motion: float) -> Drive:
    """Ten states a second apart with constant values, and the record of the estimator."""
    state = np.zeros((10, 8))
    for name, value in motion.items():
        state[:, {"speed": SPEED, "accel": ACCEL, "yaw_rate": YAW_RATE}[name]] = value
    states = VehicleStates.from_ego_states(np.arange(10) * S, state, np.tile(np.eye(8), (10, 1, 1)))
    record = {} if summary is None else {"estimate": {"summary": json.dumps(summary)}}
    return Drive("drive.mcap", 0, 9 * S, states, (), (), None, None, WarningConfig(), record, "")


def summary(*rows: list[Any], **more: Any) -> dict[str, Any]:
    nees = {
        "key": "nees",
        "title": "NEES",
        "columns": ["quantity", "NEES/dof", "NEES/dof within bounds"],
        "rows": list(rows),
    }
    return {"verdict": "consistent", "notes": [], "sections": [nees], **more}


def test_doubts_come_first_in_the_story() -> None:
    fast = drive(speed=60.0)
    doubts = find_doubts_in_evidence(fast.doubt_evidence)
    story = build_story(fast, DriveEncounters((), (), None, 0), "", doubts)
    assert story.headline.startswith(
        "Do not trust this as it is: the estimate has a speed of 216 km/h at 0 s. The car's motion"
    )
    assert story.sentences == (doubts[0].advice, *story.more, story.length)
    assert story.badges[0].text == "not to be trusted"


def test_other_doubts_follow_with_their_advice() -> None:
    both = drive(speed=60.0, accel=20.0)
    doubts = find_doubts_in_evidence(both.doubt_evidence)
    story = build_story(both, DriveEncounters((), (), None, 0), "", doubts)
    assert [each.name for each in doubts] == ["speed", "acceleration"]
    assert story.sentences[:2] == (doubts[0].advice, f"{doubts[1].sentence} {doubts[1].advice}")


def test_the_section_holds_tables_verdict_and_every_note() -> None:
    told = summary(["speed", 1.0, "in"], verdict="not consistent: x", notes=["/gps/fix: 1 gap"])
    made = replace(
        drive(told), records={**drive(told).records, "predict": {"summary": json.dumps({"notes": ["late"]})}}
    )
    view = build_sensors_view(made)
    assert view is not None
    assert view.verdict == "not consistent: x"
    assert view.notes == ("estimate: /gps/fix: 1 gap", "predict: late")
    (table,) = view.tables
    assert table.columns == (("quantity", False), ("NEES/dof", True), ("NEES/dof within bounds", False))
    assert table.rows == (("speed", "1.000", "in"),)


@pytest.mark.parametrize(
    "broken",
    [
        None,
        {"sections": 3, "notes": {}},
        {"sections": [{"key": "nees", "title": "t", "columns": ["a"], "rows": [[1, 2]]}, 7, {"key": "noise"}]},
    ],
)
def test_a_record_of_anybody_is_not_believed(broken: dict[str, Any] | None) -> None:
    assert build_sensors_view(drive(broken)) is None


def test_band_of_a_position_error_is_the_ellipse_in_its_direction() -> None:
    covariance = np.tile(np.diag([4.0, 1.0]), (4, 1, 1))
    error = np.array([[3.0, 0.0], [0.0, -0.5], [1.0, 1.0], [0.0, 0.0]])
    # Along the axes the standard deviations themselves; diagonally sqrt(2 / (1/4 + 1/1)); without an error the mean.
    expected = [2.0, 1.0, np.sqrt(1.6), np.sqrt(2.5)]
    np.testing.assert_allclose(sigma_along_error(error, covariance), expected)


def test_what_was_gated_is_marked_where_it_was_measured() -> None:
    stamps = np.arange(10) * S
    fix = Measurements("/speed", Kind.SPEED, stamps, np.full((10, 1), 5.0), None)
    names, quantities = encode_strings(["/speed", "/other", "/speed"]), encode_strings(["speed", "speed", "accel"])
    gated = GatedMeasurements(np.array([3, 4, 5]) * S, names, quantities, np.full(3, 50.0), np.full(3, 10.8))
    made = motion_figure(
        replace(drive(speed=5.0), measurements=(fix,), gated=gated), DriveEncounters((), (), None, 0), 100
    )
    assert made is not None
    (crosses,) = (trace for trace in made["data"] if trace["name"] == "gated")
    assert (crosses["x"], crosses["y"]) == ([3], [5])
