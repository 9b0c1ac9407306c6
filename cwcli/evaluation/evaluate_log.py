"""Headline metrics of one annotated log.

Everything is computed from the log itself: its channels, its truth channels if it has any, and the records
`cwcli.run.<stage>`. Tables of stages that have just run save work; the result is the same without them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cwcli.channels.published import OWN_TOPIC_PREFIX
from cwcli.errors import UsageError
from cwcli.evaluation.doubts import find_doubts
from cwcli.evaluation.evaluation_context import TRUTH_AUTO, TRUTH_NONE, EvaluationContext
from cwcli.evaluation.reference import add_online_state_errors
from cwcli.evaluation.system.metrics import add_metrics_of_other_system
from cwcli.evaluation.system_topics import OtherSystemTopics
from cwcli.logs.read.reader import Log
from cwcli.metrics.headline import HeadlineCollector
from cwcli.metrics.table import Table
from cwcli.pipeline.records import parse_json_entry_or_empty, read_finite_number_or_nan, read_run_records
from cwcli.signals.units import NS_PER_S
from cwcli.stages import STAGES

STAGES_LISTED_FIRST_IN_METRICS_TABLE = ("estimate", "predict", "warn", "track")
"""Stages whose rows come first in the table, in this order; the other stages follow in the order of `run`."""


def evaluate_log(
    log: Log,
    *,
    truth: str = TRUTH_AUTO,
    tables: Mapping[str, Table] | None = None,
    system: OtherSystemTopics | None = None,
) -> Table:
    """Compute the headline metrics of a log (`cwcli.metrics.headline.METRICS`) for which it has the channels.

    Args:
        log: An annotated log, on disk or in memory.
        truth: `auto`: the ego's truth channel, if the log has one (and only one); `none`: no truth is used; else the
            topic of the ego's truth.
        tables: Tables by name of the stages that made the channels, or None.
        system: Another system in the log, which is evaluated too, or None.

    Returns:
        The table `metrics`, in long form: stage, metric, value, unit, n, low, high, and pool, total and weight, from
        which several logs are pooled (`cwcli.metrics.pooling`). Its metadata holds the `truth` option and notes for the
        user.

    Raises:
        UsageError: A topic of the truth or of another system is not in the log or has the wrong type.
        MissingSignalError: There is nothing to compare another system with, or its channel is empty.
        DataError: A channel was written by another version, or no message of another system can be used.
    """
    if truth not in (TRUTH_AUTO, TRUTH_NONE) and not truth.startswith("/"):
        raise UsageError(f"--truth {truth!r} is neither a topic nor auto nor none")
    subject = EvaluationContext(log, truth, tables or {}, system=system or OtherSystemTopics())
    subject.system.require_topics_in_log(log)
    evaluators = (
        STAGES[name].evaluation_module for name in dict.fromkeys((*STAGES_LISTED_FIRST_IN_METRICS_TABLE, *STAGES))
    )
    for evaluator in dict.fromkeys(evaluators):
        add_metrics = getattr(evaluator, "add_metrics", None)
        if add_metrics is not None:
            add_metrics(subject)
    add_online_state_errors(subject)
    add_metrics_of_other_system(subject)
    add_input_message_counts(subject.headline, log)
    if read_run_records(log):
        subject.headline.add_count("doubts.count", len(find_doubts(log)))
    notes = "\n".join((*subject.ego.notes, *subject.notes))
    return subject.headline.to_table(truth=truth, **({"notes": notes} if notes else {}))


def add_input_message_counts(headline: HeadlineCollector, log: Log) -> None:
    """Add the message counts of all stages' inputs, each topic once per role, without cwcli's own channels."""
    headline.add_count("data.duration_s", max(log.end_ns - log.start_ns, 0) / NS_PER_S)
    inputs: dict[tuple[str, str], dict[str, Any]] = {}
    for record in read_run_records(log).values():
        for entry in parse_json_entry_or_empty(record, "counts", list):
            if isinstance(entry, dict) and not str(entry.get("topic")).startswith(OWN_TOPIC_PREFIX):
                inputs.setdefault((str(entry.get("topic")), str(entry.get("role"))), entry)
    if inputs:
        read = sum(read_finite_number_or_nan(entry, "read") for entry in inputs.values())
        rejected = sum(_sum_counts_of_reasons(entry.get("rejected")) for entry in inputs.values())
        headline.add_count("data.read_count", read)
        headline.add_count(
            "data.used_count", sum(read_finite_number_or_nan(entry, "used") for entry in inputs.values())
        )
        headline.add_count("data.rejected_count", rejected)
        headline.add_count(
            "data.repaired_count", sum(_sum_counts_of_reasons(entry.get("repaired")) for entry in inputs.values())
        )
        if read > 0:
            headline.add_from_sums("data.rejected_share", rejected, read)
    headline.add_count("data.faults_count", sum(count > 0 for count in log.faults.counts_by_reason().values()))


def _sum_counts_of_reasons(counts: Any) -> float:
    return sum(read_finite_number_or_nan(counts, reason) for reason in counts) if isinstance(counts, dict) else 0.0
