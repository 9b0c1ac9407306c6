"""Does anything online know what comes later? `python -m tests.studies.causality [LOG...]`.

Each log is cut at moments by chance (`--cuts`, 50) by the official library, and run through `estimate`, `track`,
`predict`, `warn` and `warn-targets`: every online state, path and warning that the whole log gives before the cut must
be there, byte for byte, with `--latency none` (`track --no-tune --targets many`), or with `--calibrated` with a
calibration, here made from the log itself. Without arguments: the logs of ../shared/logs and twenty simulated ones.
The exit code is 1 where a message changed.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from itertools import cycle, islice
from pathlib import Path

import numpy as np

from cwcli.errors import CwcliError
from cwcli.estimation.calibration import Calibration
from cwcli.estimation.pooling import DriveEvidence, calibrate_from_drives
from cwcli.logs.read.reader import Log
from cwcli.simulate.sensor_log import write_simulated_log
from cwcli.simulation.catalogue import scenario_names
from cwcli.simulation.drive import simulate_scenario
from cwcli.simulation.scenario import load_scenario
from cwcli.stages.estimate import EstimateConfig, estimate
from cwcli.stages.inputs.sources import SourceConfig
from tests.cut_logs import Change, cut_log, cut_times, first_change, online_messages, stages_of

LOGS = Path(__file__).parents[2].parent / "shared" / "logs"
N_SIMULATED = 20
EGO_STATIONS = {"psu-testtrack-1obu": "2a3c600d", "wydot-bsm": "31325433"}


def simulated(folder: Path) -> Iterator[Path]:
    """Twenty logs of the bundled scenarios, seed by seed."""
    for k, name in enumerate(islice(cycle(scenario_names()), N_SIMULATED)):
        seed = 1 + k // len(scenario_names())
        path = folder / f"{name}-{seed}.mcap"
        write_simulated_log(simulate_scenario(load_scenario(name, ()), seed), path)
        yield path


def calibration_of(path: Path, ego_station: str | None) -> Calibration | None:
    """A calibration of the log's car from the log itself; None where it has no position."""
    with Log.open(str(path)) as log:
        try:
            result = estimate(log, EstimateConfig(SourceConfig(ego_station=ego_station)))
        except CwcliError:
            return None
    return calibrate_from_drives([DriveEvidence(path.name, result.evaluation_inputs.ego)], path.name)


def changes_of(path: Path, n_cuts: int, *, is_calibrated: bool) -> tuple[list[Change], int]:
    """What cutting a log changed, and how many online messages the whole log gives."""
    station = EGO_STATIONS.get(path.stem)
    calibration = calibration_of(path, station) if is_calibrated else None
    stages = stages_of(calibration, station)
    found = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        whole = online_messages(path, stages, folder)
        n_messages = sum(map(len, whole.values()))
        for at_ns in cut_times(path, n_cuts, np.random.default_rng(0)) if n_messages else ():
            cut_log(path, at_ns, folder / "cut.mcap")
            change = first_change(whole, online_messages(folder / "cut.mcap", stages, folder), at_ns)
            found += [] if change is None else [change]
    return found, n_messages


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a line for each log."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="*", type=Path)
    parser.add_argument("--cuts", type=int, default=50)
    parser.add_argument("--calibrated", action="store_true")
    asked = parser.parse_args(arguments)
    n_changed = 0
    with tempfile.TemporaryDirectory() as folder:
        logs = asked.logs or [*sorted(LOGS.glob("*.mcap")), *simulated(Path(folder))]
        for path in logs:
            begin = time.perf_counter()
            changes, n_messages = changes_of(path, asked.cuts, is_calibrated=asked.calibrated)
            n_changed += len(changes)
            seconds = time.perf_counter() - begin
            print(
                f"{path.stem}: {n_messages} messages, {len(changes)} of {asked.cuts} cuts change one, {seconds:.0f} s"
            )
            for change in changes[:3]:
                early_s = (change.at_ns - change.log_time_ns) / 1e9
                print(f"  {change.topic}: {change.words}, {early_s:.3f} s before the cut at {change.at_ns}")
            sys.stdout.flush()
    return 1 if n_changed else 0


if __name__ == "__main__":
    sys.exit(main())
