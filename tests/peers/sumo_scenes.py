"""Ten small scenes for SUMO: its device `ssm` measures them while its cars drive, and writes where they were.

Lanes are as wide as the cars: SUMO's conflict areas are those of lanes, cwcli's those of cars. Cars drive at one speed,
and don't give way. All outputs have six decimals.
"""

from __future__ import annotations

import subprocess
import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import sumo

from cwcli.measures.pair import ActualTrack, Pair

CAR_M = (4.5, 1.8)
PROGRAMS = Path(sumo.SUMO_HOME) / "bin"
MEASURES = "TTC DRAC MDRAC PET PPET"
TYPE = (
    '<vType id="{name}" length="4.5" width="1.8" sigma="0" tau="0.1" minGap="0.5" decel="4.5" emergencyDecel="9" '
    'maxSpeed="{speed}" speedFactor="1" jmIgnoreFoeProb="1" jmIgnoreFoeSpeed="100" jmIgnoreJunctionFoeProb="1"/>'
)
DEVICE = "".join(
    f'<param key="{key}" value="{value}"/>'
    for key, value in (
        ("has.ssm.device", "true"),
        ("device.ssm.measures", MEASURES),
        ("device.ssm.thresholds", "8 1.0 1.0 5 5"),
        ("device.ssm.trajectories", "true"),
        ("device.ssm.file", "ssm.xml"),
        ("device.ssm.range", "300"),
    )
)


@dataclass(frozen=True)
class Car:
    """Where a car begins on its way, m, its speed, m/s, and where it waits, or None."""

    way: str
    place_m: float
    speed_mps: float
    stop: tuple[str, float] | None = None


@dataclass(frozen=True)
class Scene:
    """A net of roads, and two cars on it.

    Attributes:
        nodes: Name -> place, m.
        roads: Names of two nodes each, as one word.
        links: Road to road over a junction.
        ego, foe: The cars; the ego measures.
        lanes: Of each road.
    """

    nodes: dict[str, tuple[float, float]]
    roads: tuple[str, ...]
    ego: Car
    foe: Car
    links: tuple[tuple[str, str], ...] = ()
    lanes: int = 1


STRAIGHT = Scene({"A": (0, 0), "B": (900, 0)}, ("AB",), Car("AB", 60, 25), Car("AB", 150, 12))
CROSS = Scene(
    {"W": (-200, 0), "E": (200, 0), "S": (0, -200), "N": (0, 200), "C": (0, 0)},
    ("WC", "CE", "SC", "CN"),
    Car("WC CE", 100, 10),
    Car("SC CN", 104, 8),
    (("WC", "CE"), ("SC", "CN")),
)
MERGE = Scene(
    {"W": (-200, 0), "E": (400, 0), "S": (-190, -62), "C": (0, 0)},
    ("WC", "CE", "SC"),
    Car("WC CE", 20, 12),
    Car("SC CE", 80, 10, ("CE_0", 250.0)),
    (("WC", "CE"), ("SC", "CE")),
)
OPPOSITE = Scene({"A": (0, 0), "B": (500, 0)}, ("AB", "BA"), Car("AB", 60, 15), Car("BA", 60, 12))
SCENES = {
    "following": STRAIGHT,
    "following one that waits": replace(STRAIGHT, ego=Car("AB", 60, 20), foe=Car("AB", 120, 15, ("AB_0", 500.0))),
    "following slowly": replace(STRAIGHT, ego=Car("AB", 60, 15), foe=Car("AB", 110, 10)),
    "overtaking": replace(STRAIGHT, foe=Car("AB", 180, 10), lanes=2),
    "crossing behind": CROSS,
    "crossing before": replace(CROSS, ego=Car("WC CE", 80, 12), foe=Car("SC CN", 60, 12)),
    "crossing late": replace(CROSS, ego=Car("WC CE", 100, 15), foe=Car("SC CN", 120, 9)),
    "crossing a fast one": replace(CROSS, ego=Car("WC CE", 120, 8), foe=Car("SC CN", 60, 16)),
    "merging": MERGE,
    "opposite": OPPOSITE,
}


def driven(scene: Scene, folder: Path) -> tuple[Pair, list[ET.Element]]:
    """The two cars as a pair, the ego first, and SUMO's conflicts."""
    nodes = "".join(f'<node id="{n}" x="{x}" y="{y}" type="priority"/>' for n, (x, y) in scene.nodes.items())
    roads = "".join(
        f'<edge id="{r}" from="{r[0]}" to="{r[1]}" numLanes="{scene.lanes}" speed="40" width="{CAR_M[1]}"/>'
        for r in scene.roads
    )
    links = "".join(f'<connection from="{a}" to="{b}" fromLane="0" toLane="0"/>' for a, b in scene.links)
    for name, tag, content in (("nod", "nodes", nodes), ("edg", "edges", roads), ("con", "connections", links)):
        (folder / f"{name}.xml").write_text(f"<{tag}>{content}</{tag}>")
    cars = {"ego": scene.ego, "foe": scene.foe}
    types = "".join(TYPE.format(name=name, speed=car.speed_mps) for name, car in cars.items())
    ways = "".join(f'<route id="{name}" edges="{car.way}"/>' for name, car in cars.items())
    (folder / "rou.xml").write_text(
        f"<routes>{types}{ways}{''.join(_vehicle(*each) for each in cars.items())}</routes>"
    )
    _run(folder, "netconvert", "-n=nod.xml", "-e=edg.xml", "-x=con.xml", "-o=net.xml", "--no-turnarounds")
    _run(folder, "sumo", "-n=net.xml", "-r=rou.xml", "--step-length=0.1", "--end=40", "--fcd-output=fcd.xml",
         "--collision.action=none", "--xml-validation=never", "--no-step-log")  # fmt: skip
    tracks = _tracks(folder / "fcd.xml")
    pair = Pair(tracks["ego"], tracks["foe"], CAR_M, CAR_M, max_gap_s=0.5)
    return pair, list(ET.parse(folder / "ssm.xml").getroot().iter("conflict"))


def _vehicle(name: str, car: Car) -> str:
    stop = "" if car.stop is None else f'<stop lane="{car.stop[0]}" endPos="{car.stop[1]}" duration="20"/>'
    begin = f'depart="0" departPos="{car.place_m}" departSpeed="{car.speed_mps}" departLane="0"'
    device = DEVICE if name == "ego" else ""
    return f'<vehicle id="{name}" type="{name}" route="{name}" {begin}>{device}{stop}</vehicle>'


def _run(folder: Path, program: str, *options: str) -> None:
    subprocess.run(
        [PROGRAMS / program, "--precision=6", *options], cwd=folder, check=True, capture_output=True, timeout=600
    )


def _tracks(path: Path) -> dict[str, ActualTrack]:
    """Both cars' centres; SUMO tells the middle of the front bumper, and the compass angle."""
    rows: dict[str, list[list[float]]] = {"ego": [], "foe": []}
    for step in ET.parse(path).getroot().iter("timestep"):
        for each in step.iter("vehicle"):
            numbers = [float(each.attrib[key]) for key in ("x", "y", "angle", "speed")]
            rows[each.attrib["id"]].append([float(step.attrib["time"]), *numbers])
    tracks = {}
    for name, found in rows.items():
        time_s, x_m, y_m, angle_deg, speed = np.array(found).T
        heading = np.radians(90.0 - angle_deg)
        half = 0.5 * CAR_M[0]
        state = np.column_stack([x_m - half * np.cos(heading), y_m - half * np.sin(heading), speed, heading])
        tracks[name] = ActualTrack(np.rint(time_s * 1e9).astype(np.int64), state)
    return tracks
