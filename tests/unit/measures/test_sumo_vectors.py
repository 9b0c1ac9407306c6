"""What SUMO 1.28's device `ssm` measured of one car that follows another until it stands; in ../shared/oracles/sumo."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from cwcli.measures import MEASURES
from cwcli.measures.pair import ActualTrack, Pair

FILE = Path(__file__).parents[4] / "shared" / "oracles" / "sumo" / "ssm.xml"
CAR_M = (4.5, 1.8)  # of its route file
STEP_NS = 100_000_000
MAX_TTC_S = 40.0


@pytest.fixture(scope="module")
def conflict() -> ET.Element:
    if not FILE.exists():
        pytest.skip(f"no SUMO run at {FILE}")
    found = ET.parse(FILE).getroot().find("conflict")
    assert found is not None
    return found


def numbers(conflict: ET.Element, name: str) -> np.ndarray:
    """A series; NaN where SUMO has no value."""
    element = conflict.find(name)
    assert element is not None
    cells = [cell.split(",") for cell in element.attrib["values"].split()]
    return np.array([[np.nan if each == "NA" else float(each) for each in cell] for cell in cells]).squeeze()


@pytest.fixture(scope="module")
def followed(conflict: ET.Element) -> Pair:
    """Its places are those of the front bumpers, on a road to the east."""
    tracks = []
    for name in ("ego", "foe"):
        front, velocity = numbers(conflict, f"{name}Position"), numbers(conflict, f"{name}Velocity")
        speed = np.hypot(*velocity.T)
        state = np.column_stack([front[:, 0] - 0.5 * CAR_M[0], front[:, 1], speed, np.zeros(len(speed))])
        tracks.append(ActualTrack(np.arange(len(state)) * STEP_NS, state))
    return Pair(tracks[0], tracks[1], CAR_M, CAR_M, max_gap_s=0.5)


HALF = 0.005  # of the last of the two decimals that SUMO writes
Interval = tuple[np.ndarray, np.ndarray]


def over(one: Interval, other: Interval) -> Interval:
    """The quotients of positive intervals."""
    return one[0] / other[1], one[1] / other[0]


def possible(followed: Pair, name: str) -> Interval:
    """From where to where a measure may lie, by what SUMO wrote of places and speeds: interval arithmetic."""
    host, other = followed.host.state, followed.other.state
    gap, closing = other[:, 0] - host[:, 0] - CAR_M[0], host[:, 2] - other[:, 2]
    gaps, speeds = ((each - 2.0 * HALF, each + 2.0 * HALF) for each in (gap, closing))
    if name == "ttc":
        return over(gaps, speeds)
    if name == "drac":
        return over((speeds[0] ** 2, speeds[1] ** 2), (2.0 * gaps[0], 2.0 * gaps[1]))
    low, high = over(gaps, speeds)
    return over(speeds, (2.0 * (low - 1.0), 2.0 * (high - 1.0)))


@pytest.mark.parametrize(
    ("name", "span", "bound"), [("ttc", "TTC", 0.02), ("drac", "DRAC", 0.01), ("mdrac", "MDRAC", 0.01)]
)
def test_following_until_the_other_stands(
    conflict: ET.Element, followed: Pair, name: str, span: str, bound: float
) -> None:
    """Within the bound, or as far off as the decimals of SUMO's places and speeds leave open, which is then more."""
    theirs = numbers(conflict, f"{span}Span")
    ttc = numbers(conflict, "TTCSpan")
    judged = np.isfinite(theirs) & (np.nan_to_num(ttc, nan=np.inf) < MAX_TTC_S)
    ours = followed.evaluate_measure(MEASURES[name])
    assert judged.sum() > 100
    low, high = (each[judged] for each in possible(followed, name))
    ours, theirs = ours[judged], theirs[judged]
    assert (low <= ours).all()
    assert (ours <= high).all()
    assert (low - HALF <= theirs).all()
    assert (theirs <= high + HALF).all()
    off = np.abs(ours - theirs) > bound
    assert (np.maximum(high - ours, ours - low)[off] > bound).all()
    assert off.sum() == (8 if name == "ttc" else 0)  # of 106, near the end of the approach: by up to 0.089 s


def test_no_value_where_sumo_has_none(conflict: ET.Element, followed: Pair) -> None:
    apart = np.isnan(numbers(conflict, "TTCSpan")) & (np.diff(followed.host.state[:, 2], append=np.nan) != 0.0)
    closing = followed.host.state[:, 2] - followed.other.state[:, 2]
    assert apart.any()
    assert np.isnan(followed.evaluate_measure(MEASURES["ttc"])[apart & (closing <= 0.0)]).all()
