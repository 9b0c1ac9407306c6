"""Headline metrics of the data: messages read, used, rejected and repaired."""

from __future__ import annotations

from typing import Any

from cwcli.channels.published import OWN_TOPIC_PREFIX
from cwcli.logs.read.reader import Log
from cwcli.metrics.headline import HeadlineCollector
from cwcli.pipeline.records import parse_json_entry_or_empty, read_finite_number_or_nan, read_run_records
from cwcli.signals.units import NS_PER_S


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
