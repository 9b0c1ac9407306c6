"""Speeds in steps of 5 km/h: only the changes and what stands is used."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cwcli.estimation.coarse_speeds import keep_changes_and_standstills_of_coarse_speeds_and_note
from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.prepare import clean_and_sort_measurements_and_note

TIME_S = 0.1 * np.arange(1201.0)
TRUE_MPS = np.maximum(0.0, 12.0 * np.sin(2.0 * np.pi * TIME_S / 60.0))


def selected(step_mps: float) -> tuple[np.ndarray, np.ndarray, list[str]]:
    rounded = step_mps * np.rint(TRUE_MPS / step_mps)
    m = Measurements("/speed", Kind.SPEED, np.rint(1e9 * TIME_S).astype(np.int64), rounded)
    (prepared, *_), notes = keep_changes_and_standstills_of_coarse_speeds_and_note(
        clean_and_sort_measurements_and_note([m], 0)[0]
    )
    return prepared.series.time_s, prepared.series.values[:, 0], notes


def test_changes_are_true_and_zeros_are_of_the_standstill() -> None:
    time_s, speed_mps, notes = selected(5.0 / 3.6)
    true = np.interp(time_s, TIME_S, TRUE_MPS)
    assert np.abs(speed_mps - true).max() < 0.1
    assert (speed_mps == 0.0).sum() > 200
    assert (speed_mps > 0.5).sum() == 2 * 2 * 9  # up and down, twice, through nine of the steps up to 12 m/s
    (note,) = notes
    assert note.startswith("/speed: its speeds are rounded to steps of 1.4 m/s: only the 36 changes")


@pytest.mark.parametrize("step_mps", [1e-6, 1.0 / 3.6, 0.44704])
def test_finer_speeds_are_left_as_they_are(step_mps: float) -> None:
    time_s, _, notes = selected(step_mps)
    assert len(time_s) == len(TIME_S)
    assert not notes


@pytest.mark.parametrize(
    ("to_step", "words"), [(np.floor, "rounded down to"), (np.ceil, "rounded up to"), (np.rint, "rounded to")]
)
def test_fixes_show_which_way_speeds_are_rounded(to_step: Any, words: str) -> None:
    step_mps = 5.0 / 3.6
    stamp_ns = np.rint(1e9 * TIME_S).astype(np.int64)
    east = np.cumsum(TRUE_MPS) * 0.1
    fixes = np.column_stack([east, np.zeros_like(east)]) + 0.5 * np.random.default_rng(0).standard_normal((1201, 2))
    sources = [
        Measurements("/fix", Kind.POSITION, stamp_ns, fixes),
        Measurements("/speed", Kind.SPEED, stamp_ns, step_mps * to_step(TRUE_MPS / step_mps)[:, None]),
    ]
    prepared, (note,) = keep_changes_and_standstills_of_coarse_speeds_and_note(
        clean_and_sort_measurements_and_note(sources, 0)[0]
    )
    s = prepared[1].series
    is_change = s.values[:, 0] > 0.5
    assert np.abs(s.values[is_change, 0] - np.interp(s.time_s[is_change], TIME_S, TRUE_MPS)).max() < 0.1
    assert words in note
