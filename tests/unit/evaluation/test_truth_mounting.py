"""A truth whose device is pitched and turned against the car is no error of the estimate."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cwcli.estimation import EstimatorConfig, estimate_track
from cwcli.estimation.summary import summarise_track
from cwcli.estimation.verdict import consistency_verdict_sentence
from cwcli.evaluation.truth import TruthErrors, compare_track_with_truth
from cwcli.signals.build import build_signal
from cwcli.signals.columns import Columns
from cwcli.signals.role import Role
from tests.studies.city_drive import EPOCH_NS, city_drive, measure
from tests.unit.signals.mounted_device import odometry

DRIVE = city_drive(4, 120.0)
TIME_S = np.arange(0.0, 119.0, 0.05)
TRUE = DRIVE.at(TIME_S)
MEASURED = measure(DRIVE, 4, {})
TRACK = estimate_track(MEASURED, EstimatorConfig())


def truth(**mounted: Any) -> Columns:
    columns = odometry(TIME_S, TRUE["heading_rad"], TRUE["speed_mps"], start_ns=EPOCH_NS, **mounted)
    place = {f"pose.pose.position.{axis}": TRUE[f"{axis}_m"] for axis in "xy"}
    return replace(columns, fields={**columns.fields, **place})


def errors_of(columns: Columns) -> TruthErrors:
    signal, _ = build_signal(Role.TRUTH, columns)
    found = compare_track_with_truth([signal], MEASURED, TRACK, None, None)
    assert found is not None
    return found


def test_mounting_of_the_device_changes_no_error_and_no_verdict() -> None:
    along, mounted = errors_of(truth()), errors_of(truth(pitch=-3.8, left=0.9))
    for plain, turned in zip(along.rows, mounted.rows, strict=True):
        assert turned.estimated_sigma == pytest.approx(plain.estimated_sigma, rel=1e-3), plain.name
    for before, after in zip(along.nees, mounted.nees, strict=True):
        assert after.per_dof == pytest.approx(before.per_dof, rel=0.01), before.name
    summary = summarise_track(TRACK)
    assert consistency_verdict_sentence(summary, mounted.nees) == consistency_verdict_sentence(summary, along.nees)
    assert "covariance times" not in consistency_verdict_sentence(summary, mounted.nees)


def test_mounting_is_told_where_there_is_one() -> None:
    (note,) = errors_of(truth(pitch=-3.8, left=-0.9)).notes
    assert note.startswith("/truth/odom: its device is mounted 0.9 deg to the right of the direction of travel")
    assert "no error of the estimated heading" in note
    assert errors_of(truth(pitch=-3.8)).notes == ()
