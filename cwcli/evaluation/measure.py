"""Headline metrics of `measure`: the most critical value of each measure, over all pairs of a log."""

from __future__ import annotations

import numpy as np

from cwcli.channels.measures import published_measure_names
from cwcli.channels.published import PAIR_MEASURES
from cwcli.evaluation.evaluation_context import EvaluationContext
from cwcli.evaluation.knowledge import online_or_hindsight_of_stage_input
from cwcli.measures import MEASURES
from cwcli.pipeline.records import read_run_records
from cwcli.signals.leaf_fields import read_numbers


def add_metrics(context: EvaluationContext) -> None:
    """Add the metrics of the measures; nothing if the log has no such channel, or a measure has no value in it."""
    log = context.log
    if all(channel.topic != PAIR_MEASURES.topic for channel in log.channels):
        return
    columns = log.columns(PAIR_MEASURES.topic, published_measure_names())
    records = read_run_records(log)
    knows = online_or_hindsight_of_stage_input(records, records.get("measure", {}))
    for measure in MEASURES.values():
        if measure.column not in published_measure_names():
            continue
        values = read_numbers(columns, measure.column)
        known = values[~np.isnan(values)]
        if len(known):
            worst = float(known.min() if measure.critical == "low" else known.max())
            with context.headline.label_rows_with_states(knows):
                context.headline.add_from_sums(f"measures.{measure.extreme_column_name}", worst, 1.0, n=len(known))
