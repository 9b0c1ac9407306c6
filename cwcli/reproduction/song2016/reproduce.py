"""The study of song2016: all of the paper's table and figures, on seeds 0, 1, 2, ..."""

from __future__ import annotations

from collections.abc import Collection

from cwcli.pipeline.result import SummaryTable
from cwcli.process_pool import process_pool_killed_on_error
from cwcli.reproduction.findings import StudyPart
from cwcli.reproduction.findings_report import Reproduction, assemble_reproduction
from cwcli.reproduction.request import ReproductionRequest
from cwcli.reproduction.song2016.control import braking_control_part
from cwcli.reproduction.song2016.estimation import reproduce_table_1_of_scenario
from cwcli.reproduction.song2016.fitted_noise import fitted_noise_part, slope_window_part
from cwcli.reproduction.song2016.prediction import (
    compute_prediction_errors,
    filtered_path_part,
    prediction_errors_part,
    prediction_horizons_part,
)
from cwcli.reproduction.song2016.sensitivity import MAX_SENSITIVITY_SEEDS as MAX_SEEDS_OF_CHOICES
from cwcli.reproduction.song2016.sensitivity import moment_bands_over_variants
from cwcli.reproduction.song2016.warning import (
    COLLISION_FREE_SCENARIOS_THAT_MUST_NOT_WARN,
    count_false_warnings,
    false_warning_trap_part,
    simulate_warning_moments,
    warning_moments_part,
)

MAX_SEEDS_OF_FIGURES = 20
"""The greatest number of seeds of table 1 and the prediction figures, whose intervals are narrow with so few."""
FIGURES_BY_TASK: dict[tuple[str, str], tuple[str, ...]] = {
    ("traps", ""): ("traps",),
    ("warnings", "rear-end"): ("fig 8", "fig 9", "fig 12", "fig 13"),
    ("warnings", "intersection"): ("fig 10", "fig 11", "fig 14", "fig 15"),
    ("sensitivity", "rear-end"): ("fig 9",),
    ("sensitivity", "intersection"): ("fig 11",),
    ("table 1", "straight"): ("table 1", "fig 1", "fig 2"),
    ("table 1", "curve"): ("table 1",),
    ("prediction", "straight"): ("fig 3", "fig 7"),
    ("prediction", "curve"): ("fig 4", "fig 5"),
    ("fitted", ""): ("q", "fig 7"),
}
"""Kind of task and scenario -> the figures and tables that it makes."""
MAX_SEEDS_BY_TASK_KIND = {
    "table 1": MAX_SEEDS_OF_FIGURES,
    "prediction": MAX_SEEDS_OF_FIGURES,
    "fitted": MAX_SEEDS_OF_FIGURES,
    "sensitivity": MAX_SEEDS_OF_CHOICES,
}
"""Kind of task -> the greatest number of seeds that it takes, where there is one."""
TASK_KIND_LABELS = {
    "warnings": "warnings and control",
    "traps": "traps",
    "table 1": "table 1",
    "prediction": "predicted paths",
    "fitted": "the fitted Q",
    "sensitivity": "moved choices",
}
"""Kind of task -> its name in notes, in the order of the notes."""


def reproduce_song2016(request: ReproductionRequest) -> Reproduction:
    """Run the study."""
    tasks = [
        (kind, each, min(request.seeds, MAX_SEEDS_BY_TASK_KIND.get(kind, request.seeds)))
        for (kind, name), figures in FIGURES_BY_TASK.items()
        if request.wants_any_of(figures)
        for each in (COLLISION_FREE_SCENARIOS_THAT_MUST_NOT_WARN if kind == "traps" else (name,))
    ]
    parts_and_tables: list[tuple[list[StudyPart], list[SummaryTable]]] = []
    if request.jobs > 1:
        with process_pool_killed_on_error(request.jobs) as pool:
            running = [(task, pool.submit(_run_task, *task)) for task in tasks]
            for task, future in running:
                parts_and_tables.append(future.result())
                request.tick(f"{task[0]}: {task[1]}")
    else:
        for task in tasks:
            parts_and_tables.append(_run_task(*task))
            request.tick(f"{task[0]}: {task[1]}")
    parts = [part for found, _ in parts_and_tables for part in found]
    sections = [section for _, found in parts_and_tables for section in found]
    return assemble_reproduction("song2016", parts, format_seed_note(tasks), sections=sections, only=request.only)


def format_seed_note(tasks: Collection[tuple[str, str, int]]) -> str:
    """Format how many seeds each kind of task took: "100 seeds of warnings and control; 20 seeds of table 1"."""
    n_seeds = {kind: n for kind, _, n in tasks}
    kinds_by_seeds: dict[int, list[str]] = {}
    for kind, words in TASK_KIND_LABELS.items():
        if kind in n_seeds:
            kinds_by_seeds.setdefault(n_seeds[kind], []).append(words)
    return "; ".join(f"{n} seeds of {', '.join(words)}" for n, words in kinds_by_seeds.items())


def _run_task(kind: str, name: str, n_seeds: int) -> tuple[list[StudyPart], list[SummaryTable]]:
    """Run one task of the study, in a process of its own."""

    def ignore_tick() -> None:
        return None

    match kind:
        case "table 1":
            return [reproduce_table_1_of_scenario(name, n_seeds, ignore_tick)], []
        case "prediction":
            errors = compute_prediction_errors(name, n_seeds, ignore_tick)
            return [
                prediction_errors_part(name, errors),
                prediction_horizons_part(errors) if name == "straight" else filtered_path_part(),
            ], []
        case "fitted":
            return [fitted_noise_part(n_seeds, ignore_tick), slope_window_part(n_seeds, ignore_tick)], []
        case "warnings":
            moments = simulate_warning_moments(name, n_seeds, ignore_tick)
            return [warning_moments_part(name, moments), braking_control_part(name, moments)], []
        case "sensitivity":
            part, section = moment_bands_over_variants(name, n_seeds)
            return [part], [section]
        case _:
            return [false_warning_trap_part(name, count_false_warnings(name, n_seeds, ignore_tick), n_seeds)], []
