"""The study of song2016: all of the paper's table and figures, on seeds 0, 1, 2, ..."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass

from cwcli.pipeline.result import Section
from cwcli.reproduction.findings import Part
from cwcli.reproduction.findings_report import Reproduction, reproduction
from cwcli.reproduction.processes import processes
from cwcli.reproduction.song2016.control import control_part
from cwcli.reproduction.song2016.estimation import table1_part
from cwcli.reproduction.song2016.prediction import horizon_part, path_part, prediction_errors, prediction_part
from cwcli.reproduction.song2016.sensitivity import sensitivity_part
from cwcli.reproduction.song2016.warning import TRAPS, false_warnings, figure_part, trap_part, warning_moments

Tick = Callable[[str], None]


@dataclass(frozen=True)
class ReproduceConfig:
    """Settings.

    Attributes:
        seeds: Seeds per scenario of the warnings; table 1 and the prediction figures take at most 20 of them.
        jobs: Processes; the result does not depend on it.
        only: Figures that are wanted; none: all.
    """

    seeds: int = 100
    jobs: int = 2
    only: Collection[str] = ()


MAX_SEEDS_OF_FIGURES = 20
MADE_BY: dict[tuple[str, str], tuple[str, ...]] = {
    ("traps", ""): ("traps",),
    ("warnings", "rear-end"): ("fig 8", "fig 9", "fig 12", "fig 13"),
    ("warnings", "intersection"): ("fig 10", "fig 11", "fig 14", "fig 15"),
    ("sensitivity", "rear-end"): ("fig 9",),
    ("sensitivity", "intersection"): ("fig 11",),
    ("table 1", "straight"): ("table 1", "fig 1", "fig 2"),
    ("table 1", "curve"): ("table 1",),
    ("prediction", "straight"): ("fig 3", "fig 7"),
    ("prediction", "curve"): ("fig 4", "fig 5"),
}
"""Task -> the figures and tables that it makes."""


def reproduce_song2016(config: ReproduceConfig, tick: Tick = lambda what: None) -> Reproduction:
    """Run the study. `tick` is called with the name of each part that is done."""
    few = min(config.seeds, MAX_SEEDS_OF_FIGURES)
    tasks = [
        (kind, each, few if kind in ("table 1", "prediction") else config.seeds)
        for (kind, name), figures in MADE_BY.items()
        if not config.only or set(config.only) & set(figures)
        for each in (TRAPS if kind == "traps" else (name,))
    ]
    made: list[tuple[list[Part], list[Section]]] = []
    if config.jobs > 1:
        with processes(config.jobs) as pool:
            running = [(task, pool.submit(_run, *task)) for task in tasks]
            for task, future in running:
                made.append(future.result())
                tick(f"{task[0]}: {task[1]}")
    else:
        for task in tasks:
            made.append(_run(*task))
            tick(f"{task[0]}: {task[1]}")
    parts = [part for found, _ in made for part in found]
    sections = [section for _, found in made for section in found]
    return reproduction("song2016", parts, f"{config.seeds} seeds", sections=sections, only=config.only)


def _run(kind: str, name: str, n_seeds: int) -> tuple[list[Part], list[Section]]:
    """One task of the study, in a process of its own."""

    def nothing() -> None:
        return None

    match kind:
        case "table 1":
            return [table1_part(name, n_seeds, nothing)], []
        case "prediction":
            errors = prediction_errors(name, n_seeds, nothing)
            return [prediction_part(name, errors), horizon_part(errors) if name == "straight" else path_part()], []
        case "warnings":
            moments = warning_moments(name, n_seeds, nothing)
            return [figure_part(name, moments), control_part(name, moments)], []
        case "sensitivity":
            part, section = sensitivity_part(name, n_seeds)
            return [part], [section]
        case _:
            return [trap_part(name, false_warnings(name, n_seeds, nothing), n_seeds)], []
