"""Evaluation of `observe`: errors of the lateral motion against a truth, in its result and as headline metrics."""

from __future__ import annotations

import math

import numpy as np

from cwcli.channels.binding import bind_roles
from cwcli.channels.lateral_state import (
    read_lateral_truth_stamps_and_states,
    read_observed_drive,
    true_lateral_and_heading_deviations_at_preview,
)
from cwcli.channels.published import OBSERVER
from cwcli.dynamics.samples import STATE_NAMES, FrameStatus, LateralTrack
from cwcli.evaluation.evaluation_context import EvaluationContext
from cwcli.evaluation.knowledge import ONLINE, TRUTH, comparison_label
from cwcli.logs.read.reader import Log
from cwcli.metrics.table import ColumnDoc, Table, TableColumn
from cwcli.pipeline.result import StageResult, SummaryTable
from cwcli.signals.columns import Columns, FloatArray
from cwcli.signals.normal_distribution import SIGMAS_HOLDING_90_PERCENT
from cwcli.signals.resample import interpolate_signal_at_times
from cwcli.signals.role import Role
from cwcli.stages.observe import ObserveConfig, ObserverEvidence

MAX_INTERPOLATED_TRUTH_GAP_S = 0.5
"""Longest gap of the truth that is interpolated, s. Chosen by hand; not fitted."""
UNEVALUATED_TIME_AFTER_START_S = 2.0
"""Time in s after each start of the observer whose frames are not evaluated. Chosen by hand; not fitted."""
METRIC_AND_FACTOR_BY_STATE: dict[str, tuple[str, float]] = {
    "lateral_speed_mps": ("observer.lateral_speed_rmse_mps", 1.0),
    "yaw_rate_radps": ("observer.yaw_rate_rmse_degps", math.degrees(1.0)),
    "lateral_deviation_m": ("observer.lateral_deviation_rmse_m", 1.0),
    "heading_deviation_rad": ("observer.heading_deviation_rmse_deg", math.degrees(1.0)),
}
"""State -> metric, with the factor from the state's unit to that of the metric."""
PREVIEW_STATES = ("lateral_deviation_m", "heading_deviation_rad")
"""Names of the observed states that are compared at the preview point; they are the last columns of a row."""


def add_scores_to_result(log: Log, config: ObserveConfig, result: StageResult) -> StageResult:
    """Add the errors to the result, if the log has a truth of the lateral motion."""
    evidence: ObserverEvidence = result.evaluation_inputs
    if evidence.truth is None or not len(evidence.truth):
        return result.with_evaluation()
    errors = build_error_statistics_table(evidence.track, evidence.truth)
    return result.with_evaluation(
        sections=(build_truth_errors_section(errors, evidence.truth.topic),),
        tables={errors.name: errors},
        notes=_left_out_notes(errors),
    )


def add_metrics(context: EvaluationContext) -> None:
    """Add the errors of the observer; nothing if the log has no observer, or no truth of the lateral motion."""
    log, headline = context.log, context.headline
    bound = bind_roles(log.channels, {}, required=(), optional=(OBSERVER.role, Role.LATERAL_TRUTH), where=log.name)
    observer, truth = bound.first_topic_of_role(OBSERVER.role), bound.first_topic_of_role(Role.LATERAL_TRUTH)
    if observer is None or truth is None or not context.uses_truth:
        return
    columns = log.load_topics({observer: None, truth: None})
    if not len(columns[observer]) or not len(columns[truth]):
        return
    for row in build_error_statistics_table(
        read_observed_drive(columns[observer]).track, columns[truth]
    ).rows_as_dicts():
        name, scale = METRIC_AND_FACTOR_BY_STATE.get(row["state"], ("", 1.0))
        if name and row["n"]:
            with headline.label_rows_with_states(comparison_label(ONLINE, TRUTH)):
                headline.add_from_sums(name, (scale * row["rms"]) ** 2 * row["n"], row["n"])


def build_error_statistics_table(track: LateralTrack, truth: Columns) -> Table:
    """Build a table with one row per state: statistics of observed minus true over the settled frames.

    Deviations from the lane are compared at the observer's preview point; frames without a truth there are left out and
    counted.
    """
    true_ns, true_state = read_lateral_truth_stamps_and_states(truth)
    settled = _settled_frame_mask(track)
    true = interpolate_signal_at_times(true_ns, true_state, track.stamp_ns, max_gap_s=MAX_INTERPOLATED_TRUTH_GAP_S)
    at_preview = true_lateral_and_heading_deviations_at_preview(
        truth, track.stamp_ns, track.preview_m, MAX_INTERPOLATED_TRUTH_GAP_S
    )
    is_covered = np.isfinite(true[:, : -len(PREVIEW_STATES)]).any(axis=1)
    true[:, -len(PREVIEW_STATES) :] = at_preview
    rows: list[tuple[str, int, int, float, float, float, float, float]] = []
    for k, name in enumerate(STATE_NAMES):
        error = track.state[:, k] - true[:, k]
        known = np.isfinite(error) & settled
        left_out = (
            np.isfinite(track.state[:, k]) & settled & is_covered & ~known if name in PREVIEW_STATES else known[:0]
        )
        scores = _count_rms_mean_p95_max_and_share_inside_90(
            error[known], np.sqrt(np.abs(track.covariance[known, k, k]))
        )
        rows.append((name, scores[0], int(np.count_nonzero(left_out)), *scores[1:]))
    names, n_known, n_left_out, rms, bias, p95, largest, inside = zip(*rows, strict=True)
    columns: dict[str, TableColumn] = {
        "state": list(names),
        "n": np.array(n_known, dtype=np.int64),
        "left_out": np.array(n_left_out, dtype=np.int64),
        "rms": np.array(rms),
        "bias": np.array(bias),
        "p95": np.array(p95),
        "max": np.array(largest),
        "inside_90": np.array(inside),
    }
    docs = {
        "n": ColumnDoc(
            doc="frames with a state and a truth, "
            f"from {UNEVALUATED_TIME_AFTER_START_S:g} s after each start of the observer"
        ),
        "left_out": ColumnDoc(doc="frames with a state whose truth has no lane at their preview point"),
        "rms": ColumnDoc(doc="root mean square of observed minus true, in the unit of the state, as bias, p95 and max"),
        "inside_90": ColumnDoc(doc="share of the errors within 1.645 of the observer's sigmas"),
    }
    return Table("observer_errors", columns, docs)


def build_truth_errors_section(errors: Table, topic: str) -> SummaryTable:
    """Build the section with the errors against a truth channel."""
    rows = tuple(
        (
            str(row["state"]),
            row["n"],
            row["left_out"],
            row["rms"],
            row["bias"],
            row["p95"],
            row["max"],
            100.0 * row["inside_90"],
        )
        for row in errors.rows_as_dicts()
    )
    columns = (
        "state",
        "frames compared",
        "frames without a true lane",
        "RMS error",
        "mean error",
        "95 % of errors below",
        "largest error",
        "true values inside the 90 % band [%]",
    )
    names = ("state", "frames", "left out", "rms", "bias", "p95", "max", "in 90 % band [%]")
    title = f"Errors of the observed lateral motion against the truth of {topic}"
    return SummaryTable("observer_errors", title, columns, rows, names=names)


def _left_out_notes(errors: Table) -> tuple[str, ...]:
    left_out = max(row["left_out"] for row in errors.rows_as_dicts())
    if not left_out:
        return ()
    return (f"{left_out} frames are not compared with the lane: the truth has no lane at their preview point",)


def _settled_frame_mask(track: LateralTrack) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Return a mask (n,) of the frames at least `SETTLED_S` after a start of the observer."""
    began = np.where(track.status == FrameStatus.STARTED, track.stamp_ns, np.iinfo(np.int64).min)
    began = np.maximum.accumulate(began) if len(began) else began
    has_begun = began > np.iinfo(np.int64).min
    age_ns = np.where(has_begun, track.stamp_ns - np.where(has_begun, began, 0), -1)
    return np.asarray(age_ns >= UNEVALUATED_TIME_AFTER_START_S * 1e9, dtype=np.bool_)


def _count_rms_mean_p95_max_and_share_inside_90(
    error: FloatArray, sigma: FloatArray
) -> tuple[int, float, float, float, float, float]:
    if not len(error):
        nan = float("nan")
        return 0, nan, nan, nan, nan, nan
    size = np.abs(error)
    inside = float(np.mean(size <= SIGMAS_HOLDING_90_PERCENT * sigma)) if np.isfinite(sigma).all() else float("nan")
    rms = float(np.sqrt(np.mean(error**2)))
    return len(error), rms, float(error.mean()), float(np.percentile(size, 95)), float(size.max()), inside
