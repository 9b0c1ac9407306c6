"""Ten scenes that SUMO drives and measures now, with the package `eclipse-sumo`: the measures are its own."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from cwcli.measures import MEASURES
from cwcli.measures.pair import Pair
from tests.peers.sumo_scenes import SCENES, driven

BOUNDS = {"ttc": 0.02, "drac": 0.01, "mdrac": 0.01}
MAX_TTC_S = 40.0
REACTION_S = 1.0
STEP_S = 0.1
FOLLOWER = 2
"""SUMO's type of an encounter in which the ego follows. Where ways cross or merge its DRAC asks for what lets the other
leave first, and its distances are those along lanes: docs/measures.md tells the differences."""
FOLLOWING = [name for name in SCENES if name.startswith(("following", "overtaking", "merging"))]
CROSSING = [name for name in SCENES if name.startswith("crossing")]


@cache
def seen(name: str) -> tuple[Pair, list[ET.Element]]:
    with TemporaryDirectory() as folder:
        return driven(SCENES[name], Path(folder))


def numbers(conflict: ET.Element, name: str) -> np.ndarray:
    element = conflict.find(name)
    assert element is not None
    return np.array([np.nan if each == "NA" else float(each) for each in element.attrib["values"].split()])


def rows_of(pair: Pair, conflict: ET.Element) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the conflict that both cars are there in, and their rows in the pair."""
    at_ns = np.rint(numbers(conflict, "timeSpan") * 1e9).astype(np.int64)
    row = np.searchsorted(pair.stamp_ns, at_ns)
    there = np.flatnonzero(row < len(pair.stamp_ns))
    return there, row[there]


def _at(pair: Pair, rows: np.ndarray) -> np.ndarray:
    """The other's rows at the host's."""
    return np.clip(np.searchsorted(pair.other.stamp_ns, pair.stamp_ns[rows]), 0, len(pair.other.stamp_ns) - 1)


@pytest.mark.parametrize("name", FOLLOWING)
def test_one_that_follows(name: str) -> None:
    pair, conflicts = seen(name)
    n_judged = 0
    for conflict in conflicts:
        there, rows = rows_of(pair, conflict)
        follows = numbers(conflict, "typeSpan")[there] == FOLLOWER
        ttc = numbers(conflict, "TTCSpan")[there]
        is_straight = np.abs(pair.host.state[rows, 3] - pair.other.state[:, 3][_at(pair, rows)]) < 1e-3
        judged = follows & (ttc < MAX_TTC_S) & is_straight
        n_judged += int(judged.sum())
        for measure, bound in BOUNDS.items():
            theirs = numbers(conflict, f"{measure.upper()}Span")[there]
            ours = pair.evaluate_measure(MEASURES[measure])[rows]
            in_time = judged & (ttc > REACTION_S) if measure == "mdrac" else judged  # later SUMO says a negative one
            np.testing.assert_allclose(ours[in_time], theirs[in_time], rtol=0.0, atol=bound, err_msg=measure)
    assert n_judged > 40


@pytest.mark.parametrize("name", CROSSING)
def test_two_whose_ways_cross(name: str) -> None:
    pair, (conflict,) = seen(name)
    pet = conflict.find("PET")
    assert pet is not None
    assert float(pair.evaluate_measure(MEASURES["pet"])) == pytest.approx(float(pet.attrib["value"]), abs=STEP_S)
    there, rows = rows_of(pair, conflict)
    theirs, ours = numbers(conflict, "PPETSpan")[there], pair.evaluate_measure(MEASURES["ppet"])[rows]
    steady = np.abs(np.gradient(pair.host.state[:, 2]))[rows] < 1e-6  # SUMO's time of arrival foresees a braking
    judged = np.isfinite(theirs) & steady
    assert judged.sum() > 40
    # SUMO goes on below 0 where both would be there at once
    np.testing.assert_allclose(ours[judged], np.maximum(theirs[judged], 0.0), rtol=0.0, atol=STEP_S)
    ttc = numbers(conflict, "TTCSpan")[there]
    both = np.isfinite(ttc) & np.isfinite(pair.evaluate_measure(MEASURES["ttc"])[rows])
    np.testing.assert_allclose(
        pair.evaluate_measure(MEASURES["ttc"])[rows][both], ttc[both], rtol=0.0, atol=BOUNDS["ttc"]
    )


def test_two_that_pass_each_other() -> None:
    pair, conflicts = seen("opposite")
    assert np.isnan(pair.evaluate_measure(MEASURES["ttc"])).all()
    for conflict in conflicts:
        assert np.isnan(numbers(conflict, "TTCSpan")).all()


def test_there_are_ten() -> None:
    assert len(SCENES) == 10
    assert {*FOLLOWING, *CROSSING, "opposite"} == {*SCENES}
