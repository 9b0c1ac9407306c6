"""Is the default ever worse? `python -m tests.studies.never_worse [--runs N] [--logs FOLDER] [SCENARIO ...]`.

Each seed's log of a bundled scenario is estimated as the command line does without options, and with `--latency none`.
At the truth's stamps the errors of position, speed and heading are compared with those of the raw sensor, interpolated
to the same stamps, and with those of `--latency none`: one pair a seed. A table tells in how many seeds the default is
worse, in how many by more than 2 %, and by how much at most; the exit code is 1 when more than 5 % of the seeds of a
scenario and quantity are worse by more than 2 %. With `--logs` the real logs that have a truth are in the table, too.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from cwcli.estimation import EstimatorConfig
from cwcli.evaluation.truth import QUANTITY_LABELS
from cwcli.logs.read.reader import Log
from cwcli.pipeline.call import run_stage
from cwcli.simulate.sensor_log import write_simulated_log
from cwcli.simulation.drive import simulate_scenario
from cwcli.simulation.scenario import load_scenario
from cwcli.stages import STAGES
from cwcli.stages.estimate import EstimateConfig
from cwcli.stages.inputs.sources import SourceConfig

SCENARIOS = ("straight", "curve", "rear-end", "intersection", "city", "following", "cut-in", "brake-and-release")
QUANTITIES = {QUANTITY_LABELS["position"]: "position", "speed": "speed", "heading": "heading"}
"""What the summary calls an error -> what the table here does."""
FIRST_SEED = 2000
WORSE, MAX_SHARE = 1.02, 0.05
RAW, NONE = "raw sensor", "--latency none"
REAL: Mapping[str, EstimateConfig] = {
    "kitti-2011-10-03-drive-0027.first240s.mcap": EstimateConfig(
        sources=SourceConfig(topics={"truth": "/truth/pose_imu"}), truth_origin=(48.9825, 8.3904, 116.4)
    ),
}
"""The logs with a truth of the ego's motion: which channel it is, and where its origin lies."""

Ratios = dict[tuple[str, str], float]
"""(quantity, compared with) -> the default's error over the other's (root mean squares); those that both have."""


def ratios(path: Path, config: EstimateConfig) -> Ratios:
    """Compare the default with the raw sensor and with `--latency none`."""
    default, trusting = (
        _errors(path, replace(config, estimator=EstimatorConfig(latency=mode))) for mode in ("auto", "none")
    )
    found = {}
    for quantity, (own, raw) in default.items():
        for against, other in ((RAW, raw), (NONE, trusting[quantity][0])):
            if np.isfinite(other):
                found[quantity, against] = own / other
    return found


def _errors(path: Path, config: EstimateConfig) -> dict[str, tuple[float, float]]:
    """Quantity -> the errors of the estimate and of the raw sensor, NaN where there is none."""
    with Log.open(path) as log:
        summary = run_stage(STAGES["estimate"], log, config).summary
    errors = next(section for section in summary.sections if section.key == "errors")
    rows = [dict(zip(errors.names, row, strict=True)) for row in errors.rows]
    return {
        QUANTITIES[row["error of"]]: (float(row["estimated"]), float(row["measured"]))
        for row in rows
        if row["error of"] in QUANTITIES
    }


def seed_ratios(scenario: str, seed: int) -> Ratios:
    """Those of one seed."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "drive.mcap"
        write_simulated_log(simulate_scenario(load_scenario(scenario), seed), path)
        return ratios(path, EstimateConfig())


def show(name: str, runs: Sequence[Ratios]) -> bool:
    """Print the rows of one scenario or log; whether the bound holds."""
    holds = True
    for key in dict.fromkeys(key for run in runs for key in run):
        own = np.array([run[key] for run in runs if key in run])
        n_worse, n_clearly = int((own > 1.0).sum()), int((own > WORSE).sum())
        holds &= n_clearly <= MAX_SHARE * len(own)
        shown = f"{len(own)} | {n_worse} | {n_clearly} | {np.median(own):.3f} | {own.max():.3f}"
        print(f"| {name} | {key[0]} | {key[1]} | {shown} |", flush=True)
    return holds


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenarios", nargs="*", default=SCENARIOS)
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--logs", type=Path, help="folder with the real logs")
    given = parser.parse_args(arguments)
    print("| log | error of | against | seeds | worse | by more than 2 % | default / other: median | largest |")
    print("|---|---|---|---|---|---|---|---|")
    holds = [
        show(scenario, [seed_ratios(scenario, FIRST_SEED + k) for k in range(given.runs)])
        for scenario in given.scenarios
    ]
    if given.logs is not None:
        holds += [show(name.split(".")[0], [ratios(given.logs / name, config)]) for name, config in REAL.items()]
    return int(not all(holds))


if __name__ == "__main__":
    sys.exit(main())
