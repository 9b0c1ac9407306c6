"""The scenes of CommonRoad-CriMe as tracks. They lie beside the checkout, in ../shared/oracles/crime."""

from __future__ import annotations

import lzma
import xml.etree.ElementTree as ET
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from cwcli.measures.pair import ActualTrack, Pair

FOLDER = Path(__file__).parents[4] / "shared" / "oracles" / "crime"
STEP_NS = 100_000_000
N_STATIC = 400


@lru_cache
def scene(name: str) -> dict[int, tuple[ActualTrack, tuple[float, float]]]:
    """Obstacle -> its track and size; skips the test where the scenes are absent."""
    path = FOLDER / f"{name}.xml.xz"
    if not path.exists():
        pytest.skip(f"no scenes of CommonRoad-CriMe at {FOLDER}")
    with lzma.open(path) as file:
        root = ET.parse(file).getroot()
    return {int(each.attrib["id"]): _obstacle(each) for each in root if "bstacle" in each.tag}


def _obstacle(each: ET.Element) -> tuple[ActualTrack, tuple[float, float]]:
    def number(parent: ET.Element, path: str) -> float:
        return float(parent.findtext(path) or "nan")

    states = [*each.iterfind("initialState"), *each.iterfind("trajectory/state")]
    rows = {
        int(number(state, "time/exact")): [
            number(state, "position/point/x"),
            number(state, "position/point/y"),
            number(state, "velocity/exact"),
            number(state, "orientation/exact"),
        ]
        for state in states
    }
    steps = sorted(rows)
    state = np.array([rows[step] for step in steps])
    if len(steps) == 1:
        steps, state = list(range(N_STATIC)), np.repeat(state, N_STATIC, axis=0)
    size = number(each, "shape/rectangle/length"), number(each, "shape/rectangle/width")
    return ActualTrack(np.array(steps, np.int64) * STEP_NS, state), size


def pair(name: str, ego: int, other: int) -> Pair:
    """The two as they are in the scene."""
    (host, host_size), (theirs, other_size) = scene(name)[ego], scene(name)[other]
    return Pair(host, theirs, host_size, other_size, max_gap_s=0.5)


def along_x(whole: Pair) -> Pair:
    """Laid along a lane that runs along x, as CriMe projects them there."""

    def laid(track: ActualTrack) -> ActualTrack:
        return replace(track, state=track.state * [1.0, 1.0, 1.0, 0.0])

    return replace(whole, host=laid(whole.host), other=laid(whole.other))


def until(whole: Pair, n: int) -> Pair:
    """The first n steps."""
    return replace(whole, host=ActualTrack(whole.host.stamp_ns[:n], whole.host.state[:n]))
