"""Is the default ever worse than trusting the stamps? `python -m tests.studies.latency_default`.

The bundled scenarios have no latency. Each seed's log is estimated twice, by default and with `--latency none`; the
default must not have the larger position error (by more than 2 %) in more than a tenth of the runs, else the exit code
is 1.

With `--planted 50 100 300` the other side: how many of the seeds have a latency of so many milliseconds corrected, how
far off it is, and in how many the position is then worse than without.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from cwcli.estimation import EstimatorConfig
from cwcli.logs.read.reader import Log
from cwcli.pipeline.call import run_stage
from cwcli.simulate.sensor_log import write_simulated_log
from cwcli.simulation.drive import simulate_scenario
from cwcli.simulation.scenario import load_scenario
from cwcli.stages import STAGES
from cwcli.stages.estimate import EstimateConfig

SCENARIOS = ("straight", "curve", "rear-end", "city")
QUANTITIES = {"gnss": "position", "speed": "speed", "gnss_heading": "heading", "imu": "yaw_rate"}
"""Sensor of a scenario -> the quantity that shows its latency."""
WORSE = 1.02
MAX_SHARE = 0.1


@dataclass(frozen=True)
class Run:
    """One seed.

    Attributes:
        ratio: The default's position error over the one of `--latency none`.
        applied_ms: Quantity -> the latency that the default corrects, milliseconds; those that it does not are missing.
    """

    ratio: float
    applied_ms: dict[str, float]

    @property
    def is_worse(self) -> bool:
        """By more than what does not matter."""
        return self.ratio > WORSE


def one_run(scenario: str, seed: int, overrides: tuple[str, ...] = ()) -> Run:
    """Simulate a log and estimate it in both ways."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.mcap"
        write_simulated_log(simulate_scenario(load_scenario(scenario, overrides), seed), path)
        default_m, applied_ms = _estimated(path, EstimatorConfig())
        none_m, _ = _estimated(path, EstimatorConfig(latency="none"))
    return Run(default_m / none_m, applied_ms)


def _estimated(path: Path, config: EstimatorConfig) -> tuple[float, dict[str, float]]:
    """The position's error (1 sigma, metres) and the latencies that were applied (milliseconds)."""
    with Log.open(path) as log:
        result = run_stage(STAGES["estimate"], log, EstimateConfig(estimator=config))
    errors = next(section for section in result.summary.sections if section.key == "errors")
    row = next(dict(zip(errors.names, row, strict=True)) for row in errors.rows if row[0] == "position on one axis")
    sources = json.loads(result.metadata["sources"])
    applied = {
        s["quantity"]: 1e3 * s["latency_s"]
        for s in sources
        if s["vehicle"] == "ego" and s["latency_status"] == "applied"
    }
    return float(row["estimated"]), applied


def runs(scenario: str, seeds: Sequence[int], overrides: tuple[str, ...] = (), processes: int = 1) -> list[Run]:
    """One run a seed."""
    one = partial(one_run, scenario, overrides=overrides)
    if processes == 1:
        return [one(seed) for seed in seeds]
    with ProcessPoolExecutor(processes) as pool:
        return list(pool.map(one, seeds))


def without_latency(seeds: Sequence[int], processes: int) -> bool:
    """Print the table of the scenarios as they are; whether the bound holds."""
    print("| scenario | seeds | worse by 2 % | position error, default / none: median | largest | wrongly corrected |")
    print("|---|---|---|---|---|---|")
    n_worse = 0
    for scenario in SCENARIOS:
        found = runs(scenario, seeds, processes=processes)
        ratio = np.array([run.ratio for run in found])
        worse, wrong = sum(run.is_worse for run in found), sum(bool(run.applied_ms) for run in found)
        n_worse += worse
        print(
            f"| {scenario} | {len(found)} | {worse} | {np.median(ratio):.3f} | {ratio.max():.3f} | {wrong} |",
            flush=True,
        )
    most = int(MAX_SHARE * len(seeds) * len(SCENARIOS))
    print(f"\nworse in {n_worse} of {len(seeds) * len(SCENARIOS)} runs (bound {most})")
    return n_worse <= most


def planted(latencies_ms: Sequence[float], seeds: Sequence[int], processes: int) -> None:
    """Print how often planted latencies are corrected."""
    print(
        "| scenario | late sensor | by [ms] | corrected | error of it [ms] | position error, default / none | worse |"
    )
    print("|---|---|---|---|---|---|---|")
    for scenario in SCENARIOS:
        for sensor, quantity in QUANTITIES.items():
            for latency_ms in latencies_ms:
                override = (f"sensors.{sensor}.latency_s={latency_ms / 1e3}",)
                found = runs(scenario, seeds, override, processes)
                error = [r.applied_ms[quantity] - latency_ms for r in found if quantity in r.applied_ms]
                rms = f"{np.sqrt(np.mean(np.square(error))):.0f}" if error else ""
                ratio, worse = np.median([r.ratio for r in found]), sum(r.is_worse for r in found)
                print(
                    f"| {scenario} | {sensor} | {latency_ms:g} | {len(error)} of {len(found)} | {rms} | {ratio:.2f} "
                    f"| {worse} |",
                    flush=True,
                )


def main() -> int:
    """Print the table; 1 when the bound is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10, help="of each scenario")
    parser.add_argument("--first-seed", type=int, default=1000)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument(
        "--planted", type=float, nargs="+", metavar="MS", help="latencies to plant, one sensor at a time"
    )
    options = parser.parse_args()
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    if options.planted:
        planted(options.planted, seeds, options.processes)
        return 0
    return 0 if without_latency(seeds, options.processes) else 1


if __name__ == "__main__":
    sys.exit(main())
