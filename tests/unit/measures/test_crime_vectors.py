"""What CommonRoad-CriMe 0.4.5 (BSD-3) gives on its own scenes: what is reproduced, and what is not and why.

The values are those of its published tests and, for TTC, MSD and a_long,req of the scene Zip, of a run of it. A value
is reproduced to one unit of the last digit that is given. CriMe measures along lanelets; the lane of the scene Urban
runs along x, so that its vehicles are laid along x first.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from cwcli.measures import MEASURES
from cwcli.measures.pair import Pair
from tests.unit.measures.crime_scenes import along_x, pair, until

URBAN, GAR, ZIP, JUNCTION = "ZAM_Urban-3_3_Repair", "DEU_Gar-1_1_T-1", "ZAM_Zip-1_56_T-1", "ZAM_Tjunction-1_97_T-1"
NONE = math.nan
"""Where CriMe gives infinity, minus infinity, or 0 because no vehicle is ahead in the lane."""

REPRODUCED = [
    (URBAN, 8, 6, 0, "ttc", 2.31, 0.01),
    (URBAN, 8, 6, 0, "headway", 20.75, 0.01),
    (URBAN, 8, 6, 0, "thw", 2.4, 0.1),
    (URBAN, 8, 6, 10, "thw", 1.4, 0.1),
    (URBAN, 8, 7, 0, "thw", NONE, 0.0),
    (URBAN, 8, 6, 0, "ttb", 2.0, 0.1),
    (URBAN, 8, 6, 0, "ttk", NONE, 0.0),
    (URBAN, 8, 6, 0, "ttr", 2.0, 0.1),
    (GAR, 200, 201, 0, "dst", NONE, 0.0),
    (GAR, 200, 202, 0, "a-long-req", -0.81, 0.01),
    (GAR, 200, 202, 0, "thw", 1.4, 0.1),
    (GAR, 200, 202, 0, "wttc", 1.2, 0.1),
    (ZIP, 2, 3, 0, "ttc", 4.28, 0.01),
    (ZIP, 2, 3, 0, "btn", 0.1043, 1e-4),
    (ZIP, 2, 1, 0, "btn", NONE, 0.0),
    (ZIP, 2, 3, 0, "a-long-req", -1.20, 0.01),
    (ZIP, 2, 3, 0, "msd", 8.86, 0.01),
    (ZIP, 2, 3, 0, "wttc", 1.6, 0.1),
    (ZIP, 2, 3, 0, "long-jerk", 0.0, 0.01),
    (ZIP, 2, 3, 40, "long-jerk", 1.71, 0.01),
    (ZIP, 2, 3, 0, "lat-jerk", 0.0, 0.01),
    (ZIP, 2, 3, 40, "lat-jerk", 0.01, 0.01),
]
ALONG_THE_RECORDING = [
    (URBAN, 8, 6, "DCE", 0.0, 0.01),
    (URBAN, 8, 7, "DCE", 0.98, 0.01),
    (URBAN, 8, 6, "TTCE", 2.4, 0.1),
    (URBAN, 8, 7, "TTCE", 2.4, 0.1),
    (URBAN, 8, 6, "TTC*", 2.4, 0.1),
    (ZIP, 2, 3, "DCE", 1.68, 0.01),
]
DIFFERENT = [
    (URBAN, 8, 6, 0, "tts", None, "CriMe steers by 0.8 m at most; here a car steers as long as it helps"),
    (URBAN, 8, 6, 0, "wttc", 1.3, "CriMe lets a static obstacle stay; a log does not say that one will"),
    (GAR, 200, 202, 0, "ttc", 3.70, "CriMe's headway is along a smoothed lanelet that bends, 22.16 m for 22.26 m"),
    (GAR, 200, 202, 0, "headway", 22.16, "along a smoothed lanelet, with half the length added to x and to y"),
    (GAR, 200, 202, 0, "dst", 24.86, "its headway, less 20 m"),
    (GAR, 200, 202, 0, "a-lat-req", 0.06, "CriMe takes the ego's position twice, so that the offset is 0"),
    (GAR, 200, 202, 0, "a-req", 0.81, "its a_lat,req"),
    (GAR, 200, 202, 0, "dce", 10.9, "along the recording, with another end of it"),
    (ZIP, 2, 3, 0, "headway", 44.02, "along a smoothed lanelet, with half the length added to x and to y"),
    (ZIP, 2, 3, 0, "stn", 0.0238, "its a_lat,req"),
    (ZIP, 2, 3, 0, "cpi", 4.4345e-06, "CriMe counts a vehicle in the same lanelet, behind a bend of it, as ahead"),
    (ZIP, 2, 3, 0, "ci", 0.0, "CriMe asks for an intersection on the map"),
    (JUNCTION, 1, 5, 0, "et", 1.1, "CriMe's conflict area is that of the lanelets, not of the outlines"),
    (JUNCTION, 5, 1, 0, "pet", 3.2, "CriMe's conflict area is that of the lanelets, not of the outlines"),
    (JUNCTION, 5, 1, 0, "ci", 2688.3, "its PET, and an arctangent that lacks brackets"),
]


def laid(name: str, ego: int, other: int) -> Pair:
    whole = pair(name, ego, other)
    return along_x(whole) if name == URBAN else whole


def value(name: str, ego: int, other: int, step: int, measure: str) -> float:
    entry = MEASURES[measure]
    found = laid(name, ego, other).evaluate_measure(entry)
    return float(found[step] if entry.is_series else found)


@pytest.mark.parametrize(("name", "ego", "other", "step", "measure", "expected", "digit"), REPRODUCED)
def test_values_that_are_reproduced(
    name: str, ego: int, other: int, step: int, measure: str, expected: float, digit: float
) -> None:
    assert value(name, ego, other, step, measure) == pytest.approx(expected, abs=digit, nan_ok=True)


@pytest.mark.parametrize(("name", "ego", "other", "measure", "expected", "digit"), ALONG_THE_RECORDING)
def test_values_along_the_recording(
    name: str, ego: int, other: int, measure: str, expected: float, digit: float
) -> None:
    # CriMe's DCE is the least gap of the recorded trajectories, TTCE when it is, TTC* when it is first 0.
    gap = np.maximum(pair(name, ego, other).evaluate_measure(MEASURES["gap"]), 0.0)
    found = {
        "DCE": gap.min(),
        "TTCE": 0.1 * gap.argmin(),
        "TTC*": 0.1 * (gap <= 0.0).argmax(),
    }[measure]
    assert found == pytest.approx(expected, abs=digit)


def test_time_exposed_until_the_crash() -> None:
    whole = laid(URBAN, 8, 6)
    crash = int((whole.evaluate_measure(MEASURES["gap"]) <= 0.0).argmax())
    assert float(until(whole, crash).evaluate_measure(MEASURES["tet"])) == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize(("name", "ego", "other", "step", "measure", "theirs", "why"), DIFFERENT)
def test_values_that_differ_are_still_different(
    name: str, ego: int, other: int, step: int, measure: str, theirs: float | None, why: str
) -> None:
    assert why
    found = value(name, ego, other, step, measure)
    assert math.isfinite(found) if theirs is None else found != pytest.approx(theirs, rel=1e-4)


def test_as_many_are_reproduced_as_promised() -> None:
    assert len(REPRODUCED) + len(ALONG_THE_RECORDING) + 1 >= 24
