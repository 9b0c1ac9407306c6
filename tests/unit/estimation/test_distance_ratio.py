"""A speed that the fixes scale by more than worn tyres do is divided by the ratio; one within the prior stays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cwcli.estimation.distance_ratio import find_distance_ratio
from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.prepare import clean_and_sort_measurements_and_note
from cwcli.estimation.source_judgement import judge_sources
from tests.unit.estimation.made_drive import made_drive

TIME_S, VALUES = made_drive()
STAMP_NS = np.rint(1e9 * TIME_S).astype(np.int64)


def drive(
    scale: float, fix_sigma_m: float = 0.5, last: int = -1, *, turning: Kind = Kind.HEADING
) -> list[Measurements]:
    rng = np.random.default_rng(8)
    found = []
    for kind, factor, sigma in ((Kind.POSITION, 1.0, fix_sigma_m), (Kind.SPEED, scale, 0.1), (turning, 1.0, 0.01)):
        values = factor * VALUES[kind].reshape(len(TIME_S), -1)
        noisy = (values + sigma * rng.standard_normal(values.shape))[:last]
        found.append(Measurements(f"/{kind.name.lower()}", kind, STAMP_NS[:last], noisy))
    return found


@pytest.mark.parametrize("turning", [Kind.HEADING, Kind.YAW_RATE])
@pytest.mark.parametrize("scale", [0.9, 0.98, 1.0, 1.15])
@pytest.mark.parametrize("last", [-1, 800, 400])
def test_the_ratio_is_found_within_its_interval(scale: float, last: int, turning: Kind) -> None:
    prepared, _ = clean_and_sort_measurements_and_note(drive(scale, last=last, turning=turning), 0)
    fixes, speed, turn = (p.series for p in prepared)
    found = find_distance_ratio(speed, turn, fixes)
    assert found is not None
    assert abs(found.value - scale) < 1.5 * found.half_width
    assert found.half_width < 0.03


def test_noise_of_fixes_does_not_make_the_way_longer() -> None:
    prepared, _ = clean_and_sort_measurements_and_note(drive(1.0, fix_sigma_m=4.0), 0)
    fixes, speed, turn = (p.series for p in prepared)
    found = find_distance_ratio(speed, turn, fixes)
    assert found is not None
    assert abs(found.value - 1.0) < found.half_width < 0.05


@pytest.mark.parametrize(
    ("scale", "is_corrected"), [(1.0, False), (0.95, False), (1.05, False), (0.9, True), (1.15, True)]
)
def test_only_a_scale_beyond_the_prior_is_corrected_and_told(scale: float, is_corrected: bool) -> None:
    judged = judge_sources(drive(scale), lambda current: clean_and_sort_measurements_and_note(current, 0))
    assert bool(judged.corrections) is is_corrected
    assert not judged.contradictions
    if is_corrected:
        (correction,) = judged.corrections
        assert float(correction.fault.split()[1]) == pytest.approx(scale, abs=0.005)
        speed = next(p.series for p in judged.prepared if p.series.kind is Kind.SPEED)
        np.testing.assert_allclose(speed.values[:, 0].mean(), VALUES[Kind.SPEED].mean(), rtol=0.02)


def test_a_trusted_speed_and_a_drive_without_a_way_stay_as_they_are() -> None:
    def prepare(current: list[Measurements]) -> object:
        return clean_and_sort_measurements_and_note(current, 0)

    assert not judge_sources(drive(1.15), prepare, trusted={"/speed"}).corrections  # type: ignore[arg-type]
    standing = [replace(m, values=0.01 * m.values) for m in drive(1.15, fix_sigma_m=0.0)]
    assert not judge_sources(standing, prepare).corrections  # type: ignore[arg-type]
