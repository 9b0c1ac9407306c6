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


@pytest.mark.parametrize(
    ("name", "span", "bound"), [("ttc", "TTC", 0.02), ("drac", "DRAC", 0.01), ("mdrac", "MDRAC", 0.01)]
)
def test_following_until_the_other_stands(
    conflict: ET.Element, followed: Pair, name: str, span: str, bound: float
) -> None:
    theirs = numbers(conflict, f"{span}Span")
    ttc = numbers(conflict, "TTCSpan")
    judged = np.isfinite(theirs) & (np.nan_to_num(ttc, nan=np.inf) < MAX_TTC_S)
    ours = followed.value(MEASURES[name])
    assert judged.sum() > 100
    # Speeds are written with two decimals: near the end of the approach they don't decide TTC to the bound.
    closing = followed.host.state[:, 2] - followed.other.state[:, 2]
    rounding = ttc * 0.01 / closing if name == "ttc" else np.zeros(len(ttc))
    assert (np.abs(ours - theirs) <= np.maximum(bound, rounding))[judged].all()
    assert (rounding[judged] <= bound).sum() >= 80


def test_no_value_where_sumo_has_none(conflict: ET.Element, followed: Pair) -> None:
    apart = np.isnan(numbers(conflict, "TTCSpan")) & (np.diff(followed.host.state[:, 2], append=np.nan) != 0.0)
    closing = followed.host.state[:, 2] - followed.other.state[:, 2]
    assert apart.any()
    assert np.isnan(followed.value(MEASURES["ttc"])[apart & (closing <= 0.0)]).all()
