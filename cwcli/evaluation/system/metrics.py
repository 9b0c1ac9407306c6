"""Headline metrics of another system in the same log."""

from __future__ import annotations

from cwcli.errors import MissingSignalError
from cwcli.evaluation.actual_outcomes import find_actual_outcomes
from cwcli.evaluation.evaluation_context import EvaluationContext
from cwcli.evaluation.knowledge import OTHER_SYSTEM, comparison_label, online_or_hindsight_of_ego_states
from cwcli.evaluation.system.flag import read_flag_from_topic
from cwcli.evaluation.system.path import add_planned_path_errors_at_horizons
from cwcli.evaluation.system.state import add_ego_state_errors_and_place_frame
from cwcli.evaluation.system.warnings import judge_flag_warnings
from cwcli.evaluation.warn import add_warning_scores
from cwcli.pipeline.records import read_run_records


def add_metrics_of_other_system(context: EvaluationContext) -> None:
    """Add the metrics of another system: of those of its warnings, state and path whose topics are named.

    Raises:
        UsageError: A field does not exist, or holds nothing that can be compared.
        MissingSignalError: There is nothing to compare it with, or its channel is empty.
        DataError: No message of its channel can be used.
    """
    system = context.system
    if system.condition is not None:
        _add_warning_metrics(context)
    frame_placement = add_ego_state_errors_and_place_frame(context, system.ego_state) if system.ego_state else None
    if system.ego_path:
        add_planned_path_errors_at_horizons(context, system.ego_path, frame_placement)


def _add_warning_metrics(context: EvaluationContext) -> None:
    log, system = context.log, context.system
    assert system.condition is not None
    real = find_actual_outcomes(log)
    if real is None:
        raise MissingSignalError(
            f"the warnings of {system.warning} can't be judged: the log holds no states of the ego and the others",
            where=log.name,
            hint="annotate it first: `cwcli run LOG -o annotated.mcap`",
        )
    flag = read_flag_from_topic(log, system.warning, system.condition)
    context.notes.extend(flag.notes)
    with context.headline.label_rows_with_states(
        comparison_label(OTHER_SYSTEM, online_or_hindsight_of_ego_states(read_run_records(log)))
    ):
        add_warning_scores(
            context.headline, "system.warnings", judge_flag_warnings(flag.warning_spans_ns(), real).scores
        )
