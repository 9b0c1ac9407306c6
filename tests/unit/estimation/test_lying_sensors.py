"""A small part of the study `tests.studies.lying_sensors`: what it counts, and that one drive passes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tests.studies.lying_sensors import (
    FIRST_SEED,
    Case,
    Estimates,
    KnownCases,
    estimated,
    iter_cases,
    judged,
    run_fault,
    simulated,
    variants,
)
from tests.studies.sensor_faults import FAULTS, LATER_FAULTS
from tests.studies.sensor_model import measurements_of


def test_a_case_is_good_where_it_is_harmless_or_named() -> None:
    assert Case(1.1, is_named=False, nees=1.0, verdict="consistent", told="").is_good
    assert Case(99.0, is_named=True, nees=99.0, verdict="not consistent: ...", told="...").is_good
    assert not Case(1.3, is_named=False, nees=1.0, verdict="consistent", told="").is_good
    assert Case(99.0, is_named=True, nees=4.1, verdict="consistent", told="...").has_wrong_verdict
    excepted = Case(
        99.0, is_named=False, nees=4.1, verdict="no contradiction; a slow drift ...", told="", is_drift=True
    )
    assert not excepted.has_wrong_verdict
    assert not excepted.is_good
    assert replace(excepted, is_drift=False).has_wrong_verdict
    assert not Case(99.0, is_named=True, nees=4.1, verdict="input corrected: ...", told="...").has_wrong_verdict


def test_there_are_enough_faults_and_a_quarter_is_kept_aside() -> None:
    assert len({fault.name for fault in FAULTS}) == len(FAULTS) >= 40
    assert len({fault.name for fault in (*FAULTS, *LATER_FAULTS)}) == len(FAULTS) + len(LATER_FAULTS)
    assert 0.2 <= sum(fault.is_kept_aside for fault in FAULTS) / len(FAULTS) <= 0.3


SAME_AT_EVEN_SPEED = next(fault for fault in FAULTS if fault.name == "fix of an antenna 3 m ahead")
"""At 10 m/s throughout, a fix that is 3 m ahead is one that is 0.3 s early: the user is asked, and sigma holds it."""


@pytest.mark.parametrize("variant", ["full", "lean"])
def test_faults_in_a_drive_through_a_bend_are_found_out(variant: str) -> None:
    drive = simulated("curve", FIRST_SEED)
    right = variants(measurements_of(drive))[variant]
    assert judged(right).corrections == ()
    assert judged(right).contradictions == ()
    bad = []
    for fault in (*FAULTS[:: 2 if variant == "lean" else 4], SAME_AT_EVEN_SPEED):
        if not fault.is_kept_aside and any(m.kind is fault.kind for m in right):
            # The error without a fault is 0.1 m.
            case = run_fault(drive, right, fault, 0.1)
            if not case.is_good or case.has_wrong_verdict:
                bad.append((fault.name, case))
    assert bad == []


def test_equal_inputs_are_estimated_once_and_known_cases_are_not_run_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Speeds in other units become the same input; numbers and texts are those of an estimate of its own."""
    drive = simulated("rear-end", FIRST_SEED)
    right = measurements_of(drive)
    faults = [fault for fault in FAULTS if fault.name in ("speed in km/h", "speed / 3.6", "speed x 1.5")]
    estimates = Estimates(drive)
    estimates.of(right)
    for fault in faults:
        error_m, nees, track = estimates.of(fault.apply(right))
        own_error_m, own_nees, own = estimated(drive, fault.apply(right))
        assert (error_m, nees) == pytest.approx((own_error_m, own_nees), rel=1e-6)
        assert track.corrections == own.corrections
        assert track.contradictions == own.contradictions
    assert len(estimates.known) == 2
    path = tmp_path / "cases.jsonl"
    first = list(iter_cases(["rear-end"], [FIRST_SEED], faults, KnownCases(path)))
    monkeypatch.setattr("tests.studies.lying_sensors.estimated", None)
    assert list(iter_cases(["rear-end"], [FIRST_SEED], faults, KnownCases(path))) == first
    assert len(first) == 3
