"""A small package that adds to cwcli, installed as pip would leave it: modules beside a `dist-info` folder."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

RULE = """
import numpy as np
from cwcli.warning.rules.base import Decision, Rule


def decide(measures, onset, config, persistence_s):
    near = measures.distance_m < 30.0
    return Decision(near, near, near, measures.min_time_s, measures.min_distance_m)


RULE = Rule(summary="centres nearer than 30 m", persistence_s=0.0, decide=decide)
"""
MODEL = """
import numpy as np
from cwcli.prediction.models.base import Model, Responses, full_trust


def responses(time_s, prior):
    none = np.zeros_like(time_s)
    return Responses(0.5 * time_s, none, none, none)


MODEL = Model(
    summary="half of the acceleration", uses=(True, False, False, False), responses=responses, trust=full_trust
)
"""
METHOD = """
from cwcli.vision.boundary import Boundary
from cwcli.vision.method import LaneFit, Method


class Middle:
    def __init__(self, seed):
        self.seed = seed

    def step(self, frame):
        sides = [Boundary(0.0, 0.0, place * frame.camera.width_px, 1.0, 0.9, True) for place in (0.25, 0.75)]
        return LaneFit(*sides)


METHOD = Method(summary="two upright lines", search_size=lambda width_px, height_px: (160, 90), make=Middle)
"""
INPUT = """
from cwcli.signals.canonical import SpeedSignal
from cwcli.signals.builders.base import Input
from cwcli.signals.role import Role


def build(columns, reading):
    import numpy as np
    from cwcli.signals.clocks import repair_and_order_times
    from cwcli.signals.leaf_fields import read_numbers, read_stamps
    from cwcli.signals.limits import reject_rows_beyond_limit
    from cwcli.signals.quality import RowLedger

    ledger = RowLedger(columns, reading.role)
    speed_mps = read_numbers(columns, "knots") * 1852.0 / 3600.0
    reject_rows_beyond_limit(ledger, speed_mps, 100.0)
    timeline = repair_and_order_times(ledger, *read_stamps(columns), reading.clock, [speed_mps])
    rows = timeline.rows
    nan = np.full(len(rows), np.nan)
    signal = SpeedSignal(
        columns.topic, timeline.stamp_ns, columns.log_time_ns[rows], speed_mps[rows], nan, nan, nan
    )
    return signal, ledger.quality


INPUT = Input(Role.EGO_SPEED, {"json": ("timestamp.sec", "timestamp.nsec", "knots")}, build)
"""
MEASURE = """
from cwcli.measures.base import Measure


def tenth(pair):
    return pair.distance_m / 10.0


MEASURE = Measure(
    summary="tenth of the distance",
    symbol="q",
    column="tenth_m",
    critical="low",
    formula="d_c / 10",
    source="made up",
    compute=tenth,
    threshold=0.5,
    with_warnings=True,
)
"""
MODULES = {"rule": RULE, "model": MODEL, "measure": MEASURE, "method": METHOD, "speed": INPUT}
ENTRY_POINTS = {
    "cwcli.rules": {"near": "extra.rule:RULE"},
    "cwcli.motion_models": {"half": "extra.model:MODEL"},
    "cwcli.measures": {"tenth": "extra.measure:MEASURE"},
    "cwcli.lane_methods": {"middle": "extra.method:METHOD"},
    "cwcli.inputs": {"ship_msgs/msg/Log": "extra.speed:INPUT"},
}


def install(
    folder: Path,
    entry_points: Mapping[str, Mapping[str, str]] = ENTRY_POINTS,
    modules: Mapping[str, str] = MODULES,
    package: str = "extra",
) -> Path:
    """Write the package and its metadata to a folder, which is returned: for `PYTHONPATH`."""
    (folder / package).mkdir(parents=True)
    (folder / package / "__init__.py").touch()
    for name, text in modules.items():
        (folder / package / f"{name}.py").write_text(text)
    info = folder / f"{package}-1.2.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.2\n")
    lines = [
        line
        for group, entries in entry_points.items()
        for line in (f"[{group}]", *(f"{name} = {target}" for name, target in entries.items()), "")
    ]
    (info / "entry_points.txt").write_text("\n".join(lines))
    return folder
