"""Headline metrics of the data: messages read, used, rejected and repaired."""

from __future__ import annotations

from typing import Any

from cwcli.channels.published import OWN_PREFIX
from cwcli.logs.read.reader import Log
from cwcli.metrics.headline import Headline
from cwcli.pipeline.records import json_entry, number, run_records
from cwcli.signals.units import NS_PER_S


def add_data(headline: Headline, log: Log) -> None:
    """Add the message counts of all stages' inputs, each topic once per role, without cwcli's own channels."""
    headline.count("data.duration_s", max(log.end_ns - log.start_ns, 0) / NS_PER_S)
    inputs: dict[tuple[str, str], dict[str, Any]] = {}
    for record in run_records(log).values():
        for entry in json_entry(record, "counts", list):
            if isinstance(entry, dict) and not str(entry.get("topic")).startswith(OWN_PREFIX):
                inputs.setdefault((str(entry.get("topic")), str(entry.get("role"))), entry)
    if inputs:
        read = sum(number(entry, "read") for entry in inputs.values())
        rejected = sum(_sum(entry.get("rejected")) for entry in inputs.values())
        headline.count("data.read_count", read)
        headline.count("data.used_count", sum(number(entry, "used") for entry in inputs.values()))
        headline.count("data.rejected_count", rejected)
        headline.count("data.repaired_count", sum(_sum(entry.get("repaired")) for entry in inputs.values()))
        if read > 0:
            headline.add("data.rejected_share", rejected, read)
    headline.count("data.faults_count", sum(count > 0 for count in log.faults.counts().values()))


def _sum(counts: Any) -> float:
    return sum(number(counts, reason) for reason in counts) if isinstance(counts, dict) else 0.0
