"""Is the default ever worse than the raw sensor? `python -m tests.studies.never_worse [--runs N] [SCENARIO ...]`.

Each seed's log of a bundled scenario is estimated as the command line does without options. At the truth's stamps
the errors of position, speed and heading are compared with those of the raw sensor, interpolated to the same stamps:
one pair a seed. A table tells in how many seeds the default is worse, in how many by more than 2 %, and by how much at
most; the exit code is 1 when more than 5 % of the seeds of a scenario and quantity are worse by more than 2 %.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cwcli.logs.read.reader import Log
from cwcli.pipeline.call import run_stage
from cwcli.simulate.sensor_log import write_log
from cwcli.simulation.drive import simulate
from cwcli.simulation.scenario import load_scenario
from cwcli.stages import STAGES
from cwcli.stages.estimate import EstimateConfig

SCENARIOS = ("straight", "curve", "rear-end", "intersection", "city", "following", "cut-in", "brake-and-release")
QUANTITIES = ("position", "speed", "heading")
FIRST_SEED = 2000
WORSE, MAX_SHARE = 1.02, 0.05


def ratios(scenario: str, seed: int) -> dict[str, float]:
    """Quantity -> the default's error over the raw sensor's (root mean squares); those that both have."""
    with tempfile.TemporaryDirectory() as folder:
        log_path = Path(folder) / "drive.mcap"
        write_log(simulate(load_scenario(scenario), seed), log_path)
        with Log.open(log_path) as log:
            summary = run_stage(STAGES["estimate"], log, EstimateConfig()).summary
    errors = next(section for section in summary.sections if section.key == "errors")
    rows = [dict(zip(errors.columns, row, strict=True)) for row in errors.rows]
    return {
        str(row["error of"]): float(row["estimated"]) / float(row["measured"])
        for row in rows
        if row["error of"] in QUANTITIES and np.isfinite(float(row["measured"]))
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenarios", nargs="*", default=SCENARIOS)
    parser.add_argument("--runs", type=int, default=10)
    given = parser.parse_args(arguments)
    print("| scenario | error of | seeds | worse | by more than 2 % | default / raw: median | largest |")
    print("|---|---|---|---|---|---|---|")
    is_worse = False
    for scenario in given.scenarios:
        runs = [ratios(scenario, FIRST_SEED + k) for k in range(given.runs)]
        for quantity in QUANTITIES:
            own = np.array([run[quantity] for run in runs if quantity in run])
            if not len(own):
                continue
            n_worse, n_clearly = int((own > 1.0).sum()), int((own > WORSE).sum())
            is_worse |= n_clearly > MAX_SHARE * len(own)
            shown = f"{len(own)} | {n_worse} | {n_clearly} | {np.median(own):.3f} | {own.max():.3f}"
            print(f"| {scenario} | {quantity} | {shown} |", flush=True)
    return int(is_worse)


if __name__ == "__main__":
    sys.exit(main())
