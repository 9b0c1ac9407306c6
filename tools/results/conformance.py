"""How often the default passes the trials of clauses over many seeds: the numbers behind docs/conformance.md."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from cwcli.metrics.intervals import proportion_interval

SEEDS_BY_CLAUSE = {
    "nhtsa-fcw": 50,
    "iso-15623": 50,
    "un-r131": 50,
    "un-r152": 30,
    "un-r130": 100,
    "iso-17361": 30,
}
"""Clause that the default shall pass -> number of seeds, which the time of the measurement allowed."""
Runs = Sequence[tuple[bool, float]]
"""Repetitions of a trial: whether it passed, and its margin, NaN where there is none."""


def run_clause_over_seeds(name: str, seeds: int) -> dict[str, Runs]:
    """Run a clause; trial -> its repetitions."""
    from cwcli.conformance.run import ConformConfig, run_clauses

    (result,) = run_clauses([name], ConformConfig(seeds, jobs=1))
    return {
        trial.trial.name: [(each.verdict.is_pass, each.verdict.margin) for each in trial.repetitions if each.verdict]
        for trial in result.trials
    }


def values_of_runs(runs: Mapping[str, Runs]) -> dict[str, tuple[float, float, float]]:
    """Share of passes with its interval, by trial and of all, and the least margin; NaN bounds: nothing is random."""
    values = {f"trial {trial}": _share([passed for passed, _ in each]) for trial, each in runs.items()}
    everything = [run for each in runs.values() for run in each]
    worst = min(runs.values(), key=lambda each: sum(passed for passed, _ in each) / len(each))
    margins = [margin for _, margin in everything if math.isfinite(margin)]
    return {
        **values,
        "all runs": _share([passed for passed, _ in everything]),
        "worst trial": _share([passed for passed, _ in worst]),
        "least margin": (min(margins), math.nan, math.nan),
        "trials": (float(len(runs)), math.nan, math.nan),
    }


def _share(passed: Sequence[bool]) -> tuple[float, float, float]:
    """Share of passes with its 95 % interval."""
    return sum(passed) / len(passed), *proportion_interval(sum(passed), len(passed))
