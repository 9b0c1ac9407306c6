"""How often the default passes the trials of clauses over many seeds: the numbers behind docs/conformance.md."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from cwcli.metrics.intervals import proportion_interval

WARNING_CLAUSES = ("nhtsa-fcw", "iso-15623", "un-r131", "un-r152")
"""Clauses about collisions that the default shall pass."""
LANE_CLAUSES = ("un-r130", "iso-17361")
"""Clauses about leaving the lane that it shall pass."""
Runs = Sequence[tuple[bool, float]]
"""Repetitions of a trial: whether it passed, and its margin, NaN where there is none."""


def run_clauses_over_seeds(names: Sequence[str], seeds: int) -> dict[tuple[str, str], Runs]:
    """Run the clauses; (clause, trial) -> its repetitions."""
    from cwcli.conformance.run import ConformConfig, run_clauses

    found = {}
    for result in run_clauses(names, ConformConfig(seeds, jobs=1)):
        for trial in result.trials:
            verdicts = [each.verdict for each in trial.repetitions if each.verdict is not None]
            found[result.clause.name, trial.trial.name] = [(each.is_pass, each.margin) for each in verdicts]
    return found


def values_of_runs(runs: Mapping[tuple[str, str], Runs]) -> dict[str, tuple[float, float, float]]:
    """Share of passes with its interval, by trial and clause, and the least margin; NaN bounds: nothing is random."""
    values: dict[str, tuple[float, float, float]] = {}
    clauses: dict[str, list[Runs]] = {}
    for (clause, trial), each in runs.items():
        values[f"{clause}: {trial}"] = _share([passed for passed, _ in each])
        clauses.setdefault(clause, []).append(each)
    for clause, trials in clauses.items():
        everything = [run for each in trials for run in each]
        values[f"{clause}: all runs"] = _share([passed for passed, _ in everything])
        worst = min(trials, key=lambda each: sum(passed for passed, _ in each) / len(each))
        values[f"{clause}: worst trial"] = _share([passed for passed, _ in worst])
        margins = [margin for _, margin in everything if math.isfinite(margin)]
        values[f"{clause}: least margin"] = (min(margins), math.nan, math.nan)
        values[f"{clause}: trials"] = (float(len(trials)), math.nan, math.nan)
    return values


def _share(passed: Sequence[bool]) -> tuple[float, float, float]:
    """Share of passes with its 95 % interval."""
    return sum(passed) / len(passed), *proportion_interval(sum(passed), len(passed))
