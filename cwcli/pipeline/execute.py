"""Stages on one opened log, one after the other in memory."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field
from typing import TYPE_CHECKING

from cwcli.errors import DataError, MissingSignalError
from cwcli.lazy_dataclass import dataclass
from cwcli.pipeline.call import Call, Selection
from cwcli.pipeline.channel_choice import ChannelChoice
from cwcli.pipeline.missing import MissingSignals
from cwcli.signals.units import NS_PER_S
from cwcli.work_share import part_of_work

if TYPE_CHECKING:
    from cwcli.logs.read.reader import Log
    from cwcli.metrics.table import Table
    from cwcli.pipeline.result import StageResult

USUAL_RELATIVE_RUN_TIME_BY_STAGE = {"estimate": 40.0, "lanes": 12.0, "predict": 10.0, "warn": 4.0}
"""Stage -> the time that it usually takes, in that of a stage that is not listed; chosen by hand after a profile of the
scenario `city`. Only the progress that is shown depends on it."""
DEFAULT_CHOICE_OF_ALL_WRITTEN_CHANNELS = ChannelChoice()
"""The default choice of a run: every channel that its stages make is written."""
Missed = Callable[[str, "Log", Selection], "MissingSignals | None"]


@dataclass
class RunOutcome:
    """The outcome of the stages on one log.

    Attributes:
        name: Name of the input, for messages.
        results: One per stage that ran, in order.
        left_out: Stage -> why it did not run.
        faults: What is wrong with the input file, as counts.
        written: Files, in the order in which they were written.
        unmade: Chosen channels that no stage published.
        left_profile: The input's MCAP profile, if the annotated log could not keep it.
    """

    name: str
    results: list[StageResult] = field(default_factory=list)
    left_out: dict[str, str] = field(default_factory=dict)
    faults: dict[str, int] = field(default_factory=dict)
    written: list[str] = field(default_factory=list)
    unmade: tuple[str, ...] = ()
    left_profile: str = ""

    def tables_by_name(self) -> dict[str, Table]:
        """Return all tables by name; the stage's name is appended to a table's name that is taken."""
        found: dict[str, Table] = {}
        for result in self.results:
            for name, table in result.tables.items():
                found[f"{name}_{result.stage.replace('-', '_')}" if name in found else name] = table
        return found


@dataclass(frozen=True)
class SkipRules:
    """Which stages of a run are left out.

    Attributes:
        missing: Called before each stage; returns the reason for leaving the stage out, or None.
        lenient: A stage that finds no signal when it runs is left out too; it is an error only if no stage can run.
    """

    missing: Missed = lambda name, log, selection: None
    lenient: bool = False


SKIP_RULES_THAT_SKIP_NO_STAGE = SkipRules()
"""No stage is left out: one that misses a signal is an error."""


@dataclass(frozen=True)
class RunRules:
    """What a run leaves out, refuses and writes; see `run_stages`."""

    skip: SkipRules = SKIP_RULES_THAT_SKIP_NO_STAGE
    strict: bool = False
    choice: ChannelChoice = DEFAULT_CHOICE_OF_ALL_WRITTEN_CHANNELS


def run_stages(
    log: Log,
    stages: Mapping[str, Call],
    selection: Selection,
    *,
    skip: SkipRules = SKIP_RULES_THAT_SKIP_NO_STAGE,
    strict: bool = False,
    choice: ChannelChoice = DEFAULT_CHOICE_OF_ALL_WRITTEN_CHANNELS,
    step: Callable[[str], None] = lambda text: None,
) -> tuple[RunOutcome, Log]:
    """Run stages on a log; each sees the channels of those before it as if they had been in the file.

    Args:
        stages: Name -> stage, in order.
        skip: Which stages are left out.
        strict: Rejected, repaired or lost data, corrected sources and contradictions are an error.
        choice: The channels that will be written, for the records.
        step: Called with a text on each step, for a progress display.

    Returns:
        The outcome, and the log with all channels.

    Raises:
        MissingSignalError: No stage could run.
        UsageError: No stage publishes a channel that was chosen.
        CwcliError: As the stages do.
    """
    outcome = RunOutcome(log.name)
    current = log
    first: MissingSignalError | None = None
    work = [USUAL_RELATIVE_RUN_TIME_BY_STAGE.get(name, 1.0) for name in stages]
    share_done = 0.0
    for k, (name, stage) in enumerate(stages.items(), 1):
        lack = skip.missing(name, current, selection)
        if lack is None:
            step(f"{name} {log.name}" + (f", stage {k} of {len(stages)}" if len(stages) > 1 else ""))
            share_after = share_done + (1.0 - share_done) * work[k - 1] / sum(work[k - 1 :])
            try:
                with part_of_work(share_done, share_after):
                    result = stage(current, selection)
                share_done = share_after
            except MissingSignalError as error:
                if not skip.lenient:
                    raise
                lack = MissingSignals(error.what, error)
        if lack is not None:
            outcome.left_out[name] = lack.reason
            first = first or lack.error
            continue
        outcome.results.append(result)
        current = current.with_channels(
            result.channels, {f"cwcli.run.{name}": choice.record_with_written_topics(result)}
        )
    if first is not None and not outcome.results:
        raise first
    choice.check_patterns_match_topics(
        written_topics := [channel.topic for result in outcome.results for channel in result.channels]
    )
    outcome.unmade = choice.patterns_that_match_no_topic(written_topics)
    outcome.faults = log.faults.counts_by_reason()
    if strict:
        raise_on_data_faults_or_contradictions(outcome, log.start_ns)
    return outcome, current


def raise_on_data_faults_or_contradictions(outcome: RunOutcome, start_ns: int) -> None:
    """Raise an error for rejected, repaired or lost data, corrected sources and contradictions (`--strict`).

    The message gives the time of a fault from the log's start.

    Raises:
        DataError: There is a fault.
    """
    found = [f"{reason}: {count}" for reason, count in outcome.faults.items()]
    for result in outcome.results:
        found += result.summary.corrections
        found += result.summary.contradictions
        for entry in result.summary.inputs:
            for kind, counts in (("rejected", entry.rejected), ("repaired", entry.repaired)):
                for reason, count in counts.items():
                    first_ns = entry.first_fault_ns.get(reason)
                    at = "" if first_ns is None else f", the first at {(first_ns - start_ns) / NS_PER_S:.3f} s"
                    found += [f"{entry.topic} {kind}: {count} {reason}{at}"] if count else []
    if found:
        raise DataError(
            "the data has faults, and --strict allows none",
            where=outcome.name,
            found=tuple(dict.fromkeys(found)),
            hint="run without --strict to have them counted and left out",
        )
