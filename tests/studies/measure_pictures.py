"""The pictures of docs/measures.md: `python -m tests.studies.measure_pictures [FOLDER]`.

Writes measures-intersection.png and the like to docs/images: measures over time in the bundled scenarios in which two
vehicles touch, with their thresholds, where each is most critical, and the moment of contact.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np

from cwcli.cli.main import run_command_line
from cwcli.logs.read.reader import Log
from cwcli.measures import MEASURES
from cwcli.signals.columns import FloatArray

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs" / "images"
SCENARIOS = ("intersection", "rear-end", "cut-in", "oncoming-left-turn", "stopped-behind-curve")
SHOWN = ("gap", "ttc", "mttc", "ttr", "thw", "drac", "mdrac", "btn", "stn", "contact-psd", "delta-v", "cfs")
BEFORE_S, AFTER_S = 5.0, 2.0
LEAST_MOMENTS = 10
"""A measure that has a value for fewer has no panel."""
MOST = 30.0
"""Greater values are cut off in the picture: before a contact the needed braking grows without bound."""


@dataclass(frozen=True)
class Measured:
    """A scenario: seconds (n,) from its start, column -> values (n,), and when the outlines first touched."""

    time_s: FloatArray
    columns: dict[str, FloatArray]
    contact_s: float

    def peak_s(self, name: str) -> float:
        """When a measure is most critical; NaN where it has no value."""
        values, measure = self.columns.get(MEASURES[name].column), MEASURES[name]
        if values is None or np.isnan(values).all():
            return float("nan")
        row = np.nanargmin(values) if measure.critical == "low" else np.nanargmax(values)
        return float(self.time_s[row])


def measured(scenario: str) -> Measured:
    """The measures of a bundled log, or of one that its scenario makes, from the states in hindsight."""
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "measured.mcap"
        source = ROOT / "sample_logs" / f"{scenario}.mcap"
        if not source.exists():
            source = Path(folder) / f"{scenario}.mcap"
            assert run_command_line(["simulate", scenario, "-o", str(source), "--quiet"]) == 0
        code = run_command_line(["run", str(source), "--stage", "estimate,measure", "-o", str(target), "--quiet"])
        assert code == 0
        with Log.open(target) as log:
            fields = log.columns("/cwcli/measures").fields
    stamps = fields["stamp_ns"]
    assert isinstance(stamps, np.ndarray)
    columns = {name: np.asarray(each, np.float64) for name, each in fields.items() if isinstance(each, np.ndarray)}
    time_s = (stamps - stamps[0]) / 1e9
    return Measured(time_s, columns, float(time_s[columns["gap_m"] <= 0.0][0]))


def draw(scenario: str, target: Path) -> None:
    """A panel for each measure, those without a value here left out."""
    mpl.use("Agg")
    from matplotlib import pyplot as plt

    found = measured(scenario)
    shown = (found.time_s >= found.contact_s - BEFORE_S) & (found.time_s <= found.contact_s + AFTER_S)
    names = [name for name in SHOWN if np.isfinite(found.columns[MEASURES[name].column][shown]).sum() >= LEAST_MOMENTS]
    figure, axes = plt.subplots((len(names) + 2) // 3, 3, figsize=(9.0, 6.0), sharex=True, layout="constrained")
    for axis in axes.flat[len(names) :]:
        axis.axis("off")
    for axis, name in zip(axes.flat, names, strict=False):
        measure = MEASURES[name]
        values = found.columns[measure.column]
        axis.plot(found.time_s, np.clip(values, -MOST, MOST), color="tab:blue", linewidth=1.2)
        axis.axvline(found.contact_s, color="black", linewidth=0.8)
        axis.axvline(found.peak_s(name), color="tab:red", linewidth=0.8, linestyle=":")
        if measure.threshold is not None:
            axis.axhline(measure.threshold, color="tab:orange", linewidth=0.8, linestyle="--")
        axis.set_title(f"{measure.symbol} ({measure.unit})" if measure.unit else measure.symbol, fontsize=8)
        axis.tick_params(labelsize=7)
    for axis in axes.flat[
        max(len(names) - 3, 0) : len(names)
    ]:  # the lowest of each column, where the last row is not full
        axis.tick_params(labelbottom=True)
    axes.flat[0].set_xlim(found.contact_s - BEFORE_S, found.contact_s + AFTER_S)
    figure.supxlabel("time [s]", fontsize=8)
    figure.savefig(target, dpi=90, metadata={"Software": None})
    plt.close(figure)


def main() -> None:
    """Draw them all."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else DOCS
    for scenario in SCENARIOS:
        draw(scenario, folder / f"measures-{scenario}.png")


if __name__ == "__main__":
    main()
