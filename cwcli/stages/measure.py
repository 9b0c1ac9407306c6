"""Stage `measure`: states in, how critical the ego and each other vehicle were to each other out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from cwcli.channels.binding import bind
from cwcli.channels.measures import write_measures
from cwcli.channels.published import EGO_STATE, REMOTE_STATE, TARGETS
from cwcli.channels.target import read_targets
from cwcli.channels.vehicle_state import VehicleStates
from cwcli.errors import MissingSignalError
from cwcli.logs.read.reader import Log
from cwcli.measures import MEASURES
from cwcli.measures.base import Measure
from cwcli.measures.evaluate import Covariances, MeasuredPair, measure_pair
from cwcli.measures.pair import OUTLINE_RANGE_M, ActualTrack, Pair
from cwcli.option import Option
from cwcli.pipeline.call import Selection
from cwcli.pipeline.result import InputCount, StageResult, Summary
from cwcli.pipeline.run_record import run_record
from cwcli.signals.columns import Columns
from cwcli.signals.row_order import tracks_of
from cwcli.stages.inputs.sources import read_bound
from cwcli.stages.inputs.vehicles import chosen_states
from cwcli.stages.summaries.measure import encounters_section, extremes_table, series_table
from cwcli.warning.types import DEFAULT_LENGTH_M, DEFAULT_WIDTH_M, outline_of

EXAMPLES = (
    "cwcli measure estimated.mcap -o measured.mcap --metrics measures.parquet",
    "cwcli measure tracked.mcap --measures ttc,pet,drac --json",
)
MAX_GAP_S = 0.5
OTHERS = (REMOTE_STATE.role, TARGETS.role)


def _names(text: str) -> tuple[str, ...]:
    return tuple(dict.fromkeys(name.strip() for name in text.split(",")))


@dataclass(frozen=True)
class MeasureConfig(Selection):
    """Settings of the stage.

    Attributes:
        measures: Names of measures; empty: all that are not sampled.
        with_sigma: Give the most critical values a sigma, by the states' covariances.
    """

    measures: Annotated[
        tuple[str, ...],
        Option(
            "--measures",
            "Which measures: {names} (docs/measures.md).",
            metavar="NAME[,NAME]",
            default="all that are not sampled",
            kind=str | None,
            parse=_names,
            choices="cwcli.measures:MEASURES",
        ),
    ] = ()
    with_sigma: Annotated[
        bool, Option("--sigma/--no-sigma", "Give the most critical values a sigma, by the states' covariances.")
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
    measured where the centres are within 200 m; an encounter is a stretch within 50 m.

    Raises:
        MissingSignalError: The log lacks the ego's states, or has neither remote vehicles nor targets.
    """
    bound = bind(
        log.channels, config.topics, required=(EGO_STATE.role,), optional=OTHERS, where=log.name, command="measure"
    )
    columns = read_bound(log, bound)
    if not set(OTHERS) & set(columns):
        raise MissingSignalError(
            "no channel holds remote vehicles or targets (needed by `cwcli measure`)",
            where=log.name,
            hint="run `cwcli estimate` or `cwcli track` first",
        )
    states, count = chosen_states(log, columns[EGO_STATE.role], EGO_STATE.role, config)
    ego = states.by_stamp()
    others, counts = _others(log, columns, config)
    chosen = {name: entry for name, entry in MEASURES.items() if name in (config.measures or usual())}
    pairs, notes = _measured(ego, others, chosen, with_sigma=config.with_sigma)
    ego_id = ego.ids.values[ego.ids.codes[0]]
    series = series_table(ego_id, pairs, chosen)
    summary = Summary("measure", (encounters_section(pairs, log.start_ns),), (count, *counts), (*bound.notes, *notes))
    return StageResult(
        stage="measure",
        channels=(write_measures(ego, series.columns),),
        tables={"measures": series, "extremes": extremes_table(ego_id, pairs, chosen)},
        summary=summary,
        metadata=run_record("measure", log, config, summary),
    )


def usual() -> tuple[str, ...]:
    """The measures that are not sampled."""
    return tuple(name for name, entry in MEASURES.items() if not entry.is_sampled)


def _others(
    log: Log, columns: Mapping[str, Columns], config: MeasureConfig
) -> tuple[list[VehicleStates], list[InputCount]]:
    """The states of the remote vehicles and of the targets."""
    found, counts = [], []
    for role in OTHERS:
        if role not in columns:
            continue
        if role == TARGETS.role:
            everything = read_targets(columns[role])
            states = everything.logged_within(config.start_ns, config.end_ns)
            count = InputCount(columns[role].topic, role, len(everything), len(states))
        else:
            states, count = chosen_states(log, columns[role], role, config)
        found.append(states)
        counts.append(count)
    return found, counts


def _measured(
    ego: VehicleStates, others: Sequence[VehicleStates], chosen: Mapping[str, Measure], *, with_sigma: bool
) -> tuple[list[MeasuredPair], list[str]]:
    """The pairs that come near each other, and notes."""
    pairs, n_far, n_assumed = [], 0, int(not np.isfinite(ego.length_m).any())
    for states in others:
        for other_id, rows in tracks_of(states.ids, states.stamp_ns):
            theirs = states.rows(rows)
            pair = _pair(ego, theirs)
            if not len(pair.near):
                n_far += 1
                continue
            n_assumed += int(not np.isfinite(theirs.length_m).any())
            covariances = Covariances(ego.covariance, theirs.covariance) if with_sigma else None
            pairs.append(measure_pair(other_id, pair, chosen, covariances))
    notes = []
    if n_assumed:
        size = f"{DEFAULT_LENGTH_M:g} x {DEFAULT_WIDTH_M:g} m"
        notes.append(f"vehicles without a size, for which {size} is assumed: {n_assumed}")
    if n_far:
        notes.append(f"vehicles that never came within {OUTLINE_RANGE_M:g} m, and are not measured: {n_far}")
    return pairs, notes


def _pair(ego: VehicleStates, theirs: VehicleStates) -> Pair:
    return Pair(
        ActualTrack(ego.stamp_ns, ego.state),
        ActualTrack(theirs.stamp_ns, theirs.state),
        outline_of(ego.length_m, ego.width_m),
        outline_of(theirs.length_m, theirs.width_m),
        MAX_GAP_S,
    )
