"""Stage `reproduce song2016`: all of the paper's table and figures, on seeds 0, 1, 2, ..."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

from cwcli.reproduction.findings import Part
from cwcli.reproduction.findings_report import Reproduction, reproduction
from cwcli.reproduction.song2016.control import control_part
from cwcli.reproduction.song2016.estimation import table1_part
from cwcli.reproduction.song2016.prediction import horizon_part, prediction_errors, prediction_part
from cwcli.reproduction.song2016.warning import TRAPS, false_warnings, figure_part, trap_part, warning_moments

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
    return reproduction("song2016", chosen, f"{config.seeds} seeds")


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
