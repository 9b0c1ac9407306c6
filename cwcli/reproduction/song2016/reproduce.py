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
from cwcli.reproduction.song2016.sensitivity import MAX_SEEDS as MAX_SEEDS_OF_CHOICES
from cwcli.reproduction.song2016.sensitivity import sensitivity_part
from cwcli.reproduction.song2016.warning import TRAPS, false_warnings, figure_part, trap_part, warning_moments

Tick = Callable[[str], None]


@dataclass(frozen=True)
class ReproduceConfig:
    """Settings of the study.

    Attributes:
        seeds: Seeds per scenario of the warnings, of the control and of the traps. Table 1 and the prediction figures
            take at most 20 of them, the tables of moved choices at most 10.
        jobs: Processes; the result does not depend on it.
        only: Figures that are wanted; none: all.
    """

    seeds: int = 100
    jobs: int = 2
    only: Collection[str] = ()


MAX_SEEDS_OF_FIGURES = 20
"""The greatest number of seeds of table 1 and the prediction figures, whose intervals are narrow with so few."""
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
"""Kind of task and scenario -> the figures and tables that it makes."""
MAX_SEEDS_OF = {
    "table 1": MAX_SEEDS_OF_FIGURES,
    "prediction": MAX_SEEDS_OF_FIGURES,
    "sensitivity": MAX_SEEDS_OF_CHOICES,
}
"""Kind of task -> the greatest number of seeds that it takes, where there is one."""
WORDS_OF = {
    "warnings": "warnings and control",
    "traps": "traps",
    "table 1": "table 1",
    "prediction": "predicted paths",
    "sensitivity": "moved choices",
}
"""Kind of task -> its name in notes, in the order of the notes."""


def reproduce_song2016(config: ReproduceConfig, tick: Tick = lambda what: None) -> Reproduction:
    """Run the study. `tick` is called with the name of each part that is done."""
    tasks = [
        (kind, each, min(config.seeds, MAX_SEEDS_OF.get(kind, config.seeds)))
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
    return reproduction("song2016", parts, seed_note(tasks), sections=sections, only=config.only)


def seed_note(tasks: Collection[tuple[str, str, int]]) -> str:
    """Format how many seeds each kind of task took: "100 seeds of warnings and control; 20 seeds of table 1".

    Args:
        tasks: Kind, scenario and number of seeds.
    """
    n_seeds = {kind: n for kind, _, n in tasks}
    kinds_by_seeds: dict[int, list[str]] = {}
    for kind, words in WORDS_OF.items():
        if kind in n_seeds:
            kinds_by_seeds.setdefault(n_seeds[kind], []).append(words)
    return "; ".join(f"{n} seeds of {', '.join(words)}" for n, words in kinds_by_seeds.items())


def _run(kind: str, name: str, n_seeds: int) -> tuple[list[Part], list[Section]]:
    """Run one task of the study, in a process of its own."""

    def ignore_tick() -> None:
        return None

    match kind:
        case "table 1":
            return [table1_part(name, n_seeds, ignore_tick)], []
        case "prediction":
            errors = prediction_errors(name, n_seeds, ignore_tick)
            return [prediction_part(name, errors), horizon_part(errors) if name == "straight" else path_part()], []
        case "warnings":
            moments = warning_moments(name, n_seeds, ignore_tick)
            return [figure_part(name, moments), control_part(name, moments)], []
        case "sensitivity":
            part, section = sensitivity_part(name, n_seeds)
            return [part], [section]
        case _:
            return [trap_part(name, false_warnings(name, n_seeds, ignore_tick), n_seeds)], []
