"""Stage `reproduce song2016`: all of the paper's table and figures, on seeds 0, 1, 2, ..."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np

from cwcli.metrics.table import ColumnDoc, Table
from cwcli.stages.findings import Finding, Part, Plot
from cwcli.stages.result import Cell, Section, Summary
from cwcli.stages.song2016.control import control_part
from cwcli.stages.song2016.estimation import table1_part
from cwcli.stages.song2016.prediction import horizon_part, prediction_errors, prediction_part
from cwcli.stages.song2016.warning import TRAPS, false_warnings, figure_part, trap_part, warning_moments

Tick = Callable[[str], None]


@dataclass(frozen=True)
class ReproduceConfig:
    """Settings.

    Attributes:
        seeds: Seeds per scenario of the warnings; table 1 and the prediction figures take at most 20 of them.
        jobs: Processes; the result does not depend on it.
    """

    seeds: int = 100
    jobs: int = 2


@dataclass(frozen=True)
class Reproduction:
    """What came out.

    Attributes:
        findings: One line each.
        plots: The redrawn figures.
        table: The findings as columns.
        summary: For people and `--json`.
    """

    findings: tuple[Finding, ...]
    plots: tuple[Plot, ...]
    table: Table
    summary: Summary

    @property
    def failed(self) -> tuple[Finding, ...]:
        """The findings that are worse where they must not be."""
        return tuple(finding for finding in self.findings if finding.has_failed)


MAX_SEEDS_OF_FIGURES = 20


def reproduce_song2016(config: ReproduceConfig, tick: Tick = lambda what: None) -> Reproduction:
    """Run the whole study. `tick` is called with the name of each part that is done."""
    few = min(config.seeds, MAX_SEEDS_OF_FIGURES)
    tasks: list[tuple[str, str, int]] = [
        *(("traps", trap, config.seeds) for trap in TRAPS),
        *(("warnings", name, config.seeds) for name in ("rear-end", "intersection")),
        *(("table 1", name, few) for name in ("straight", "curve")),
        *(("prediction", name, few) for name in ("straight", "curve")),
    ]
    parts: dict[tuple[str, str], list[Part]] = {}
    if config.jobs > 1:
        with ProcessPoolExecutor(config.jobs) as pool:
            running = [(task, pool.submit(_run, *task)) for task in tasks]
            for task, future in running:
                parts[task[:2]] = future.result()
                tick(f"{task[0]}: {task[1]}")
    else:
        for task in tasks:
            parts[task[:2]] = _run(*task)
            tick(f"{task[0]}: {task[1]}")
    order = ("table 1", "prediction", "warnings", "traps")
    chosen = [part for kind in order for key, found in parts.items() if key[0] == kind for part in found]
    findings = tuple(finding for part in chosen for finding in part.findings)
    plots = tuple(plot for part in chosen for plot in part.plots)
    return Reproduction(findings, plots, _table(findings), _summary(findings, config))


def _run(kind: str, name: str, n_seeds: int) -> list[Part]:
    """One task of the study, in a process of its own."""

    def nothing() -> None:
        return None

    match kind:
        case "table 1":
            return [table1_part(name, n_seeds, nothing)]
        case "prediction":
            errors = prediction_errors(name, n_seeds, nothing)
            return [prediction_part(name, errors), *([horizon_part(errors)] if name == "straight" else [])]
        case "warnings":
            moments = warning_moments(name, n_seeds, nothing)
            return [figure_part(name, moments), control_part(name, moments)]
        case _:
            return [trap_part(name, false_warnings(name, n_seeds, nothing), n_seeds)]


def _table(findings: tuple[Finding, ...]) -> Table:
    texts = ("figure", "what", "unit", "verdict")
    numbers = ("paper", "ours", "low", "high")
    return Table(
        "song2016",
        {
            **{name: [str(getattr(f, name)) for f in findings] for name in texts},
            **{name: np.array([getattr(f, name) for f in findings], dtype=np.float64) for name in numbers},
            "is_required": np.array([f.is_required for f in findings], dtype=np.bool_),
        },
        docs={
            "paper": ColumnDoc(doc="the paper's number; NaN where it prints none"),
            "low": ColumnDoc(doc="95 % interval over the seeds"),
            "high": ColumnDoc(doc="95 % interval over the seeds"),
        },
    )


def _summary(findings: tuple[Finding, ...], config: ReproduceConfig) -> Summary:
    sections = []
    for figure in dict.fromkeys(finding.figure for finding in findings):
        rows: list[tuple[Cell, ...]] = [
            (f.what, f.unit, _number(f.paper), _number(f.ours), _interval(f), f.verdict)
            for f in findings
            if f.figure == figure
        ]
        key = figure.replace(" ", "_")
        columns = ("what", "unit", "paper", "ours", "95 % interval", "verdict")
        sections.append(Section(key, figure, columns, tuple(rows)))
    failed = [f"{f.figure}: {f.what}: {f.verdict}" for f in findings if f.has_failed]
    notes = [f"{config.seeds} seeds; a finding that differs where it must not makes the exit code 1", *failed]
    return Summary("reproduce song2016", tuple(sections), (), tuple(notes))


def _number(value: float) -> Cell:
    return None if math.isnan(value) else value


def _interval(finding: Finding) -> str:
    return "" if math.isnan(finding.low) else f"{finding.low:.4g} to {finding.high:.4g}"
