"""zhang2011, first half: the share of frames whose boundaries are found (conclusion 1), and the times of table 4."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.metrics.intervals import clustered_proportion_interval
from cwcli.pipeline.result import Cell, SummaryTable
from cwcli.process_pool import process_pool_killed_on_error
from cwcli.reproduction.classes import MeasuredNumber
from cwcli.reproduction.findings import Curve, Plot, StudyPart
from cwcli.reproduction.findings_report import PROCESSOR_TIMES_SECTION_KEY
from cwcli.reproduction.zhang2011.lane_drives import (
    N_FRAMES_BEFORE_STABLE_PHASE,
    N_JUDGED_FRAMES,
    MethodResults,
    run_methods_on_drives,
)
from cwcli.signals.columns import BoolArray
from cwcli.vision.methods import methods_without_model

CONCLUSION_FIGURE = "conclusion 1"
"""The paper's conclusion on the lanes, as the expectations name it."""
ROAD_SET_NAMES = ("good", "complex", "hard")
"""Names of the rendered sets of roads."""
PAPER_CORRECT_FRAMES_PERCENT_BY_ROAD_SET = {"good": 100.0, "complex": 90.0}
"""Set -> per cent of frames whose boundaries are found (zhang2011, conclusion 1)."""
FRAME_RANGES_OF_LANE_SEARCH_PHASES = (
    ("frame 1", 0, 1),
    ("frames 2-6", 1, N_FRAMES_BEFORE_STABLE_PHASE),
    ("later", N_FRAMES_BEFORE_STABLE_PHASE, None),
)
"""Name of a search phase, its first frame and the frame after its last (table 4)."""
PAPER_SEARCH_TIME_PER_FRAME_BY_PHASE_MS = {"frame 1": 210.0, "frames 2-6": 150.0, "later": 30.0}
"""Phase -> what a frame takes on the paper's machine, in ms (zhang2011, table 4)."""
HELD_OUT_SEED = 2011
"""Seed of the judged sets, drawn once and held out: sets and methods were made with seeds 0, 1 and 2."""
DRIVES_PER_WORKER_PROCESS_TASK = 5
"""Number of drives that one task of a process runs. Chosen by hand; not fitted."""

Results = Mapping[str, Mapping[str, MethodResults]]


@dataclass(frozen=True)
class LaneStudy:
    """The results of the lane methods.

    Attributes:
        shares_part: Shares and plots; the same for the same numbers of frames and drives.
        times: Processor times; different in every run.
        n_judged: Frames of each set.
    """

    shares_part: StudyPart
    times: SummaryTable
    n_judged: int


def run_lane_study(
    n_frames: int, *, jobs: int = 1, seed: int = HELD_OUT_SEED, tick: Callable[[str], None] = lambda what: None
) -> LaneStudy:
    """Run all methods on all sets.

    Args:
        n_frames: To judge in each set; rounded up to whole drives.
        jobs: Processes; the result does not depend on it, the times do.
        seed: Of the sets and of random searches.
        tick: Called with the name of each set that is done.
    """
    n_drives = -(-n_frames // N_JUDGED_FRAMES)
    results = _run_methods_on_all_sets(n_drives, jobs, seed, tick)
    measured = [
        each
        for name in ROAD_SET_NAMES
        for key in methods_without_model()
        for each in _correct_share_numbers(name, key, results)
    ]
    plots = tuple(_correct_share_plot(name, results[name]) for name in ROAD_SET_NAMES)
    return LaneStudy(StudyPart(tuple(measured), plots), _times_section(results), n_drives * N_JUDGED_FRAMES)


def _run_methods_on_all_sets(n_drives: int, jobs: int, seed: int, tick: Callable[[str], None]) -> Results:
    """Run all methods on all sets, in processes if wanted."""
    tasks = [
        (name, first, min(first + DRIVES_PER_WORKER_PROCESS_TASK, n_drives))
        for name in ROAD_SET_NAMES
        for first in range(0, n_drives, DRIVES_PER_WORKER_PROCESS_TASK)
    ]
    found: dict[str, list[dict[str, MethodResults]]] = {name: [] for name in ROAD_SET_NAMES}

    def collect_results(task: tuple[str, int, int], results_by_set: dict[str, MethodResults]) -> None:
        found[task[0]].append(results_by_set)
        if task[2] == n_drives:
            tick(f"lanes: {task[0]}")

    if jobs > 1:
        with process_pool_killed_on_error(jobs) as pool:
            running = [(task, pool.submit(run_methods_on_drives, *task, seed=seed)) for task in tasks]
            for task, future in running:
                collect_results(task, future.result())
    else:
        for task in tasks:
            collect_results(task, run_methods_on_drives(*task, seed=seed))
    return {
        name: {key: _concatenate_results([part[key] for part in parts]) for key in methods_without_model()}
        for name, parts in found.items()
    }


def _concatenate_results(parts: Sequence[MethodResults]) -> MethodResults:
    """Concatenate the results of several tasks."""
    return MethodResults(
        is_correct=np.concatenate([part.is_correct for part in parts]),
        is_correct_by_centre=np.concatenate([part.is_correct_by_centre for part in parts]),
        search_ms=np.concatenate([part.search_ms for part in parts]),
        prepare_ms=np.concatenate([part.prepare_ms for part in parts]),
    )


def _correct_share_numbers(name: str, key: str, results: Results) -> list[MeasuredNumber]:
    """Return the shares of frames in which a method finds both boundaries."""
    method_results = results[name][key]
    return [
        _correct_frames_pct_with_interval(
            f"{key}, {name}: both boundaries right", method_results.is_correct[:, N_FRAMES_BEFORE_STABLE_PHASE:]
        ),
        _correct_frames_pct_with_interval(
            f"{key}, {name}: the same in the first six frames",
            method_results.is_correct[:, :N_FRAMES_BEFORE_STABLE_PHASE],
        ),
        _correct_frames_pct_with_interval(
            f"{key}, {name}: the same by the stripe's centre",
            method_results.is_correct_by_centre[:, N_FRAMES_BEFORE_STABLE_PHASE:],
        ),
    ]


def _correct_frames_pct_with_interval(what: str, is_right: BoolArray) -> MeasuredNumber:
    """Return a share of frames in per cent; its interval accounts for the likeness of a drive's frames."""
    n_frames = is_right.shape[1]
    low, high = clustered_proportion_interval(is_right.sum(axis=1).tolist(), [n_frames] * len(is_right))
    return MeasuredNumber(CONCLUSION_FIGURE, what, 100.0 * float(is_right.mean()), 100.0 * low, 100.0 * high)


def _correct_share_plot(name: str, methods: Mapping[str, MethodResults]) -> Plot:
    """Plot the share of correct frames over the frames of a drive."""
    curves = [
        Curve(
            key,
            np.arange(1.0, method_results.is_correct.shape[1] + 1.0),
            100.0 * method_results.is_correct.mean(axis=0),
        )
        for key, method_results in methods.items()
    ]
    level = (
        ("the paper's", PAPER_CORRECT_FRAMES_PERCENT_BY_ROAD_SET[name])
        if name in PAPER_CORRECT_FRAMES_PERCENT_BY_ROAD_SET
        else None
    )
    return Plot(
        f"lanes {name}",
        f"frames of the set '{name}' with both boundaries right",
        "frame of the drive",
        "share [%]",
        curves,
        marks={"statistics begin": N_FRAMES_BEFORE_STABLE_PHASE + 0.5},
        level=level,
        y_range=(0.0, 105.0),
    )


def _times_section(results: Results) -> SummaryTable:
    """Return the processor time of a frame, both boundaries, as medians over all sets, beside the paper's."""
    rows: list[tuple[Cell, ...]] = []
    for key in methods_without_model():
        for phase, first, last in FRAME_RANGES_OF_LANE_SEARCH_PHASES:
            of_sets = [each[key] for each in results.values()]
            search, prepare = (
                float(np.median(np.concatenate([times[:, first:last].ravel() for times in of_kind])))
                for of_kind in ([each.search_ms for each in of_sets], [each.prepare_ms for each in of_sets])
            )
            rows.append(
                (
                    key,
                    phase,
                    search,
                    prepare,
                    PAPER_SEARCH_TIME_PER_FRAME_BY_PHASE_MS[phase] if key == "zhang2011" else None,
                )
            )
    columns = ("method", "phase", "search [ms]", "before it [ms]", "the paper's [ms]")
    return SummaryTable(
        PROCESSOR_TIMES_SECTION_KEY,
        "Processor time of a frame on this machine, which is no class",
        columns,
        tuple(rows),
    )
