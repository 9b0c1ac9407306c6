"""Stage `measure`: states in, how critical the ego and each other vehicle were to each other out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated

import numpy as np

from cwcli.channels.binding import bind_roles
from cwcli.channels.measures import make_measures_channel
from cwcli.channels.published import EGO_STATE
from cwcli.control.preventable import JudgedConflict, judge_preventability, preventability_table
from cwcli.errors import MissingSignalError
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log
from cwcli.measures import MEASURES
from cwcli.measures.base import Measure
from cwcli.measures.evaluate import (
    WHOLE_TIME_ENCOUNTER,
    ExtremeValue,
    MeasuredPair,
    measure_extremes_table,
    measure_pair,
    measure_series_table,
)
from cwcli.measures.pair import MAX_CENTRE_DISTANCE_OF_COMPARED_OUTLINES_M
from cwcli.option import Option
from cwcli.pipeline.result import Cell, StageResult, StageSummary, SummaryTable
from cwcli.pipeline.run_record import build_run_record
from cwcli.pipeline.states import ChosenStates, StatesSelection, choose_state_topics
from cwcli.signals.units import NS_PER_S
from cwcli.stages.inputs.tracks import (
    OTHER_VEHICLE_ROLES,
    TracksOfLog,
    add_sigmas_of_extremes,
    read_ego_and_other_tracks,
)
from cwcli.text import split_distinct_names
from cwcli.warning.types import DEFAULT_VEHICLE_LENGTH_M, DEFAULT_VEHICLE_WIDTH_M

EXAMPLES = (
    "cwcli measure estimated.mcap -o measured.mcap --metrics measures.parquet",
    "cwcli measure tracked.mcap --measures ttc,pet,drac --json",
)
"""Command lines that the help of `cwcli measure` shows."""
HEADING_BY_SHOWN_MEASURE = {
    "gap": "gap [m]",
    "ttc": "TTC [s]",
    "pet": "PET [s]",
    "drac": "DRAC [m/s^2]",
    "thw": "THW [s]",
    "ttr": "TTR [s]",
    "delta-v": "Delta v [m/s]",
}
"""Measure -> its heading with unit in the table of encounters."""
MAX_ENCOUNTERS_IN_TABLE = 20
"""Greatest number of encounters, or conflicts, that a table of the summary shows; chosen by hand."""
MAX_TTC_OF_CONFLICT_S = 1.0
"""Time to collision in s below which an encounter is judged as a conflict. Chosen by hand."""


@dataclass(frozen=True)
class MeasureConfig(StatesSelection):
    """Settings of the stage.

    Attributes:
        states: Of the ego and the others; what really happened is in those of hindsight.
        measures: Names of measures; empty: those of `cheap_measure_names`.
        with_sigma: Give the most critical values a sigma, by the states' covariances.
    """

    states: ChosenStates = "hindsight"
    measures: Annotated[
        tuple[str, ...],
        Option(
            "--measures",
            "Which measures: {names} (docs/measures.md).",
            metavar="NAME[,NAME]",
            default="all but p-mc and p-contact",
            kind=str | None,
            parse=split_distinct_names,
            choices="cwcli.measures:MEASURES",
        ),
    ] = ()
    with_sigma: Annotated[
        bool,
        Option("--sigma/--no-sigma", "Add a sigma to the most critical values, from the covariances of the states."),
    ] = True

    def __post_init__(self) -> None:
        """Check what can be checked without a log.

        Raises:
            UsageError: An unknown measure.
        """
        for name in self.measures:
            MEASURES.require(name)


def measure(log: Log, config: MeasureConfig) -> StageResult:
    """Measure how critical the ego and each other vehicle were to each other, at each state of the ego.

    Needs the states of `cwcli estimate`, and those of remote vehicles or the targets of `cwcli track`. A pair is
    measured where the centres are within 200 m; an encounter is a stretch within 50 m. Where the two were less than 1 s
    from contact, four driver models drive it again: who would have avoided it, and until when.

    Raises:
        MissingSignalError: The log lacks the ego's states, or has neither remote vehicles nor targets.
    """
    topics = choose_state_topics(config.topics, config.states, log.channels, (EGO_STATE.role, *OTHER_VEHICLE_ROLES))
    bound = bind_roles(
        log.channels,
        topics,
        required=(EGO_STATE.role,),
        optional=OTHER_VEHICLE_ROLES,
        where=log.name,
        command="measure",
    )
    if not set(OTHER_VEHICLE_ROLES) & set(bound.by_role):
        raise MissingSignalError(
            "no channel holds remote vehicles or targets (needed by `cwcli measure`)",
            where=log.name,
            hint="run `cwcli estimate` or `cwcli track` first",
        )
    chosen = {name: entry for name, entry in MEASURES.items() if name in (config.measures or cheap_measure_names())}
    with_covariance = any(entry.needs_covariance for entry in chosen.values())
    tracks, counts = read_ego_and_other_tracks(log, bound, config, with_covariance=with_covariance)
    pairs, notes = _measure_pairs_and_note(tracks, chosen)
    if config.with_sigma:
        pairs = add_sigmas_of_extremes(log, tracks, pairs, chosen)
    series = measure_series_table(tracks.ego_id, pairs, chosen)
    judged_conflicts = _judge_conflicts(tracks, pairs)
    sections = (_encounters_table(pairs, log.start_ns), *_driver_models_table(judged_conflicts, log.start_ns))
    summary = StageSummary("measure", sections, counts, (*bound.notes, *notes))
    return StageResult(
        stage="measure",
        channels=(make_measures_channel(tracks.ego, series.columns),),
        tables={
            "measures": series,
            "extremes": measure_extremes_table(tracks.ego_id, pairs, chosen),
            "preventability": preventability_table(tracks.ego_id, judged_conflicts),
        },
        summary=summary,
        metadata=build_run_record("measure", log, config, summary),
    )


def cheap_measure_names() -> tuple[str, ...]:
    """Return the names of the measures that are cheap to compute, the default."""
    return tuple(name for name, entry in MEASURES.items() if not entry.is_expensive)


def _measure_pairs_and_note(tracks: TracksOfLog, chosen: Mapping[str, Measure]) -> tuple[list[MeasuredPair], list[str]]:
    """Measure the pairs that come near each other; return them, and notes."""
    pairs, n_far, n_assumed = [], 0, int(not np.isfinite(tracks.ego.length_m).any())
    for other_id, other in tracks.others.items():
        pair = tracks.pair_with_ego(other_id)
        if not len(pair.near_rows):
            n_far += 1
            continue
        n_assumed += int(not np.isfinite(other.length_m).any())
        pairs.append(measure_pair(other_id, pair, chosen))
    notes = []
    if n_assumed:
        size = f"{DEFAULT_VEHICLE_LENGTH_M:g} x {DEFAULT_VEHICLE_WIDTH_M:g} m"
        notes.append(f"vehicles without a size, for which {size} is assumed: {n_assumed}")
    if n_far:
        notes.append(
            f"vehicles that never came within {MAX_CENTRE_DISTANCE_OF_COMPARED_OUTLINES_M:g} m, "
            f"and are not measured: {n_far}"
        )
    return pairs, notes


def _judge_conflicts(tracks: TracksOfLog, pairs: Sequence[MeasuredPair]) -> list[JudgedConflict]:
    """Judge each encounter in which the outlines touched or the time to collision was below `MAX_TTC_OF_CONFLICT_S`."""
    judged_conflicts = []
    for pair in pairs:
        if not {"gap", "ttc"} <= set(pair.values):
            continue
        for extreme in pair.extremes:
            if (
                extreme.encounter == WHOLE_TIME_ENCOUNTER
                or extreme.measure != "ttc"
                or not extreme.value < MAX_TTC_OF_CONFLICT_S
            ):
                continue
            rows = (pair.stamp_ns >= extreme.begin_ns) & (pair.stamp_ns <= extreme.end_ns)
            touching = pair.stamp_ns[rows & (pair.values["gap"] <= 0.0)]
            at_ns = int(touching[0]) if len(touching) else extreme.stamp_ns
            verdicts = tuple(judge_preventability(tracks.pair_with_ego(pair.other_id), at_ns))
            judged_conflicts.append(JudgedConflict(pair.other_id, at_ns, verdicts))
    return sorted(judged_conflicts, key=lambda each: each.conflict_ns)


def _driver_models_table(judged: Sequence[JudgedConflict], start_ns: int) -> tuple[SummaryTable, ...]:
    """Return the table of the outcomes of the conflicts with each driver model; () without conflicts."""
    rows: list[tuple[Cell, ...]] = []
    for conflict in judged[:MAX_ENCOUNTERS_IN_TABLE]:
        at_s = (conflict.conflict_ns - start_ns) / NS_PER_S
        for each in conflict.verdicts:
            outcome = "avoids it" if each.avoided else "crashes"
            brakes_s, chance_s = at_s - each.braked_s, at_s - each.last_chance_s
            rows.append((conflict.other_id, at_s, each.driver, outcome, brakes_s, each.impact_mps, chance_s))
    if not rows:
        return ()
    columns = (
        "vehicle",
        "conflict at [s]",
        "driver model",
        "outcome",
        "starts to brake at [s]",
        "relative speed at crash [m/s]",
        "latest start of braking that avoids the crash [s]",
    )
    names = ("vehicle", "at [s]", "driver", "outcome", "brakes at [s]", columns[5], "last chance [s]")
    return (
        SummaryTable(
            "preventability",
            "The same conflicts, if a model of a driver had driven the ego (times from the log's start)",
            columns,
            tuple(rows),
            names=names,
        ),
    )


def _encounters_table(pairs: Sequence[MeasuredPair], start_ns: int) -> SummaryTable:
    """Return the table of encounters, those with the least time to collision first, then the nearest."""
    found = [row for pair in pairs for row in _encounter_rows(pair, start_ns)]
    order = [row for _, row in sorted(found, key=lambda each: each[0])]
    columns = ("vehicle", "start [s]", "end [s]", "outlines touched", *HEADING_BY_SHOWN_MEASURE.values())
    names = ("vehicle", "from [s]", "to [s]", "crash", *HEADING_BY_SHOWN_MEASURE.values())
    title = (
        "Most critical encounters (within 50 m; times from the log's start), with the worst value of each measure: "
        "gap of the outlines (negative: overlap), TTC time to collision, PET post-encroachment time, DRAC deceleration "
        "that avoids the crash, THW time headway, TTR time to react, Delta v change of speed in a crash "
        "(docs/measures.md)"
    )
    if len(order) > MAX_ENCOUNTERS_IN_TABLE:
        title = title.replace("Most critical", f"{MAX_ENCOUNTERS_IN_TABLE} most critical of {len(order)}")
    return SummaryTable("encounters", title, columns, tuple(order[:MAX_ENCOUNTERS_IN_TABLE]), names=names)


def _encounter_rows(pair: MeasuredPair, start_ns: int) -> list[tuple[tuple[float, ...], tuple[Cell, ...]]]:
    """Return the sort key and the table row of each encounter of a pair."""
    by_number: dict[int, dict[str, ExtremeValue]] = {}
    for extreme in pair.extremes:
        if extreme.encounter != WHOLE_TIME_ENCOUNTER:
            by_number.setdefault(extreme.encounter, {})[extreme.measure] = extreme
    rows: list[tuple[tuple[float, ...], tuple[Cell, ...]]] = []
    for extremes in by_number.values():
        first = next(iter(extremes.values()))
        span = ((each - start_ns) / NS_PER_S for each in (first.begin_ns, first.end_ns))
        values = {name: extremes[name].value if name in extremes else math.nan for name in HEADING_BY_SHOWN_MEASURE}
        has_crash = None if math.isnan(values["gap"]) else values["gap"] <= 0.0
        order = tuple(math.inf if math.isnan(values[name]) else values[name] for name in ("ttc", "gap"))
        rows.append(((*order, float(first.begin_ns)), (pair.other_id, *span, has_crash, *values.values())))
    return rows
