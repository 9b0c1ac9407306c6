"""Headline metrics of `measure`: the most critical value of each measure, over all pairs of a log."""

from __future__ import annotations

import numpy as np

from cwcli.channels.measures import measured
from cwcli.channels.published import MEASURED
from cwcli.evaluation.knowledge import read_by
from cwcli.evaluation.subject import Subject
from cwcli.measures import MEASURES
from cwcli.pipeline.records import run_records
from cwcli.signals.leaf_fields import numbers


def add_metrics(subject: Subject) -> None:
    """Add the metrics of the measures; nothing if the log has no such channel, or a measure has no value in it."""
    log = subject.log
    if all(channel.topic != MEASURED.topic for channel in log.channels):
        return
    columns = log.columns(MEASURED.topic, measured())
    records = run_records(log)
    knows = read_by(records, records.get("measure", {}))
    for measure in MEASURES.values():
        if measure.column not in measured():
            continue
        values = numbers(columns, measure.column)
        known = values[~np.isnan(values)]
        if len(known):
            worst = float(known.min() if measure.critical == "low" else known.max())
            with subject.headline.of(knows):
                subject.headline.add(f"measures.{measure.extreme_column}", worst, 1.0, n=len(known))
