"""How often the default passes the trials of clauses over many seeds: the numbers behind docs/conformance.md."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from cwcli.metrics.intervals import proportion_interval

SEEDS_BY_CLAUSE = {
    "nhtsa-fcw": 100,
    "iso-15623": 100,
    "un-r131": 100,
    "un-r152": 100,
    "un-r130": 100,
    "iso-17361": 100,
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


FALSE_ACTIVATION_SEEDS = 50
"""Number of seeds of each scene without danger, which the time of the measurement allowed."""


def trials_without_danger() -> dict[str, tuple[str, int]]:
    """Every trial of two vehicles in which a warning is false: title -> clause and place of the trial in it.

    The plate that a radar sees is none: to a radar without height it is a car (docs/conformance.md).
    """
    from cwcli.conformance.clause import clause_names, load_clause

    return {
        f"{name}: {trial.name}": (name, k)
        for name in clause_names()
        for k, trial in enumerate(load_clause(name).trials)
        if trial.judge == "no-warning" and trial.scene not in ("lane-drift", "radar-return")
    }


def run_trials_without_danger(seeds: int) -> dict[str, Runs]:
    """Run the trials in which a warning is false; title -> its repetitions."""
    from cwcli.conformance.run import ConformConfig, run_trial

    return {
        title: [
            (each.verdict.is_pass, each.verdict.margin)
            for each in run_trial(*place, tuple(range(seeds)), ConformConfig(jobs=1))
            if each.verdict
        ]
        for title, place in trials_without_danger().items()
    }


def values_of_false_activations(runs: Mapping[str, Runs]) -> dict[str, tuple[float, float, float]]:
    """Share of runs without a warning by scene, number of all runs, and share of them with a warning."""
    everything = [passed for each in runs.values() for passed, _ in each]
    n_false = everything.count(False)
    return {
        **{title: _share([passed for passed, _ in each]) for title, each in runs.items()},
        "scenes": (float(len(runs)), math.nan, math.nan),
        "runs": (float(len(everything)), math.nan, math.nan),
        "false warnings": (float(n_false), math.nan, math.nan),
        "share": (n_false / len(everything), *proportion_interval(n_false, len(everything))),
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
