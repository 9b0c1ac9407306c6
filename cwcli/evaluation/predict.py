"""Evaluation of `predict`: errors of every motion model and of the published paths against the later tracks."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from cwcli.channels.predicted_path import AnyPaths
from cwcli.channels.published import EGO_ONLINE, EGO_PATH, EGO_STATE, REMOTE_ONLINE, REMOTE_PATH, REMOTE_STATE
from cwcli.channels.vehicle_state import VehicleStates, read_vehicle_states
from cwcli.evaluation.actual_outcomes import read_actual_states
from cwcli.evaluation.evaluation_context import EvaluationContext
from cwcli.evaluation.knowledge import (
    TRUTH,
    comparison_label,
    online_or_hindsight_of_ego_states,
    online_or_hindsight_of_stage_input,
)
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log
from cwcli.metrics.headline import HeadlineCollector, find_metric
from cwcli.metrics.table import Table, TableColumn
from cwcli.pipeline.paths import path_starts_from_states, replanned_or_logged_paths_and_notes
from cwcli.pipeline.records import parse_json_entry_or_empty, read_run_records
from cwcli.pipeline.result import Cell, StageResult, SummaryTable
from cwcli.prediction.calibrate import initial_log_scale_of_each_row
from cwcli.prediction.model_comparison import (
    BASELINE_MODEL,
    ComparedStarts,
    compare_models_at_horizons,
    horizon_error_table,
)
from cwcli.prediction.models import DEFAULT_MODEL, MODELS
from cwcli.prediction.outcome import ELLIPSE_90_SQUARED_RADIUS, HorizonErrors, horizon_errors
from cwcli.prediction.outcome_history import measure_acting_time_s
from cwcli.prediction.paths import Paths
from cwcli.prediction.rollout import Discretisation, RolloutSettings
from cwcli.signals.columns import EastNorthRows, Int64Array
from cwcli.signals.row_order import iter_rows_by_id, iter_track_rows
from cwcli.signals.vehicle_state import EGO_ID
from cwcli.stages.predict import PredictConfig
from cwcli.work_share import part_of_work, report_work

ERROR_HORIZONS_S = (0.5, 1.0, 1.5, 2.0, 2.5)
"""Times ahead at which errors of paths are reported, s."""
MAX_INTERPOLATED_TRACK_GAP_S = 0.5
"""Longest gap of a track that is interpolated, s. Chosen by hand; not fitted."""
MAX_INTERPOLATED_TRUTH_GAP_S = 1.0
"""Longest gap of a truth that is interpolated, s. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class PathErrorSettings:
    """Settings of compared paths: horizon and step (s), and how they are integrated."""

    horizon_s: float
    step_s: float
    discretisation: Discretisation


def add_scores_to_result(log: Log, config: PredictConfig, result: StageResult) -> StageResult:
    """Add the errors of every motion model to the result, each vehicle against its own later track in hindsight."""
    settings = PathErrorSettings(config.horizon_s, config.step_s, config.discretisation)
    records = []
    n_states, n_done = max(sum(map(len, result.evaluation_inputs.values())), 1), 0
    for role, states in result.evaluation_inputs.items():
        with part_of_work(n_done / n_states, (n_done + len(states)) / n_states, "tracks"):
            records += model_error_records_by_horizon(states, settings, read_actual_states(log, config, role))
        n_done += len(states)
    return result.with_evaluation(
        sections=(_build_prediction_section(records, config.horizon_s),),
        tables={"prediction": _build_prediction_table(records)},
    )


def add_metrics(context: EvaluationContext) -> None:
    """Add the metrics of the published paths; nothing if the log has none."""
    headline, log, ego = context.headline, context.log, context.ego
    records = read_run_records(log)
    knows, outcome = (
        online_or_hindsight_of_stage_input(records, records.get("predict", {})),
        online_or_hindsight_of_ego_states(records),
    )
    topics = {channel.topic for channel in log.channels}
    if EGO_PATH.topic not in topics or ego.states is None:
        return
    states = {"ego": ego.states}
    paths = {"ego": replanned_or_logged_paths_and_notes(log, EGO_PATH.topic, EGO_STATE.role)[0]}
    if REMOTE_STATE.topic in topics and REMOTE_PATH.topic in topics:
        states["remote"] = read_vehicle_states(log.columns(REMOTE_STATE.topic))
        paths["remote"], _ = replanned_or_logged_paths_and_notes(log, REMOTE_PATH.topic, REMOTE_STATE.role)
    for who, published in paths.items():
        with headline.label_rows_with_states(comparison_label(knows, outcome)):
            _add_published_path_errors(headline, who, published, states[who])
        if who == "ego" and ego.truth is not None:
            truth = ego.truth
            every = published.select_paths(np.arange(len(published))).paths_of_rows(np.arange(len(published)))
            errors = path_errors_against_track(
                every, published.stamp_ns, truth.stamp_ns, truth.xy, MAX_INTERPOLATED_TRUTH_GAP_S
            )
            with headline.label_rows_with_states(comparison_label(knows, TRUTH)):
                add_errors_at_horizons(headline, "prediction.ego.truth_", [errors])
    table = context.tables.get("prediction")
    if table is None:
        settings = _path_error_settings_from_record(log)
        table = _build_prediction_table(
            [
                record
                for who, each in states.items()
                for record in model_error_records_by_horizon(
                    _read_online_start_states(log, who) or each, settings, each
                )
            ]
        )
    with headline.label_rows_with_states(comparison_label(knows, outcome)):
        _add_model_errors(headline, table)


def _add_published_path_errors(
    headline: HeadlineCollector, vehicle_label: str, published: AnyPaths, states: VehicleStates
) -> None:
    """Add the errors of the published paths against the vehicles' own later states."""
    tracks = dict(iter_track_rows(states.ids, states.stamp_ns))
    found = []
    for vehicle, rows in iter_rows_by_id(published.ids):
        if vehicle not in tracks:
            continue
        own = tracks[vehicle]
        paths, stamp_ns = published.select_paths(rows).paths_of_rows(np.arange(len(rows))), published.stamp_ns[rows]
        found.append(
            path_errors_against_track(
                paths, stamp_ns, states.stamp_ns[own], states.state[own, :2], MAX_INTERPOLATED_TRACK_GAP_S
            )
        )
    if found:
        add_errors_at_horizons(headline, f"prediction.{vehicle_label}.", found)


def path_errors_against_track(
    paths: Paths, start_ns: Int64Array, stamp_ns: Int64Array, xy: EastNorthRows, max_gap_s: float
) -> HorizonErrors:
    """Return the errors of paths that start at `start_ns` (n,) at every step up to the last horizon.

    The track is given by stamps (m,) and positions (m, 2), m.
    """
    steps = paths.time_s[(paths.time_s > 0.0) & (paths.time_s <= ERROR_HORIZONS_S[-1] + 1e-9)]
    return horizon_errors(paths, start_ns, stamp_ns, xy, steps.tolist(), max_gap_s)


def add_errors_at_horizons(headline: HeadlineCollector, prefix: str, errors_of_vehicles: list[HorizonErrors]) -> None:
    """Add errors at each horizon that is a step of the paths; only starts with a known outcome count."""
    step_s = errors_of_vehicles[0].horizon_s
    distance = np.concatenate([each.distance_m for each in errors_of_vehicles])
    is_known = np.concatenate([each.is_known for each in errors_of_vehicles])
    squared = np.concatenate([each.mahalanobis2 for each in errors_of_vehicles])
    for horizon_s in ERROR_HORIZONS_S:
        at = np.flatnonzero(np.abs(step_s - horizon_s) < 1e-6)
        if not len(at):
            continue
        k = int(at[0])
        headline.add_errors(f"{prefix}fde_{horizon_s:.1f}s_m", distance[is_known[:, k], k])
        whole = is_known[:, : k + 1].all(axis=1)
        if find_metric(f"{prefix}ade_{horizon_s:.1f}s_m") is not None:
            headline.add_errors(f"{prefix}ade_{horizon_s:.1f}s_m", distance[whole, : k + 1].mean(axis=1))
        known_squared = squared[is_known[:, k], k]
        if find_metric(f"{prefix}inside_90_{horizon_s:.1f}s_share") is not None:
            headline.add_share(
                f"{prefix}inside_90_{horizon_s:.1f}s_share",
                known_squared[np.isfinite(known_squared)] <= ELLIPSE_90_SQUARED_RADIUS,
            )


def _path_error_settings_from_record(log: Log) -> PathErrorSettings:
    """Return horizon, step and integration from the record of the stage, or the defaults."""
    used: Mapping[str, object] = parse_json_entry_or_empty(
        read_run_records(log).get("predict", {}), "configuration", dict
    )
    default = PredictConfig()
    horizon_s, step_s = (
        float(value) if isinstance(value, int | float) else usual
        for value, usual in ((used.get("horizon_s"), default.horizon_s), (used.get("step_s"), default.step_s))
    )
    return PathErrorSettings(horizon_s, step_s, "paper" if used.get("discretisation") == "paper" else "exact")


def _add_model_errors(headline: HeadlineCollector, table: Table) -> None:
    """Add the errors of every motion model at the horizons, of all remote vehicles together."""
    sums: dict[tuple[str, str, str], list[float]] = {}
    for row in table.rows_as_dicts():
        horizon = f"{row['horizon_s']:.1f}"
        if not row["n"] or abs(float(horizon) - row["horizon_s"]) > 1e-6 or row["model"] not in MODELS:
            continue
        who = "ego" if row["vehicle"] == EGO_ID else "remote"
        own = sums.setdefault((who, row["model"], horizon), [0.0, 0.0, 0.0])
        n = float(row["n"])
        own[0] += n
        own[1] += n * row["mean_m"]
        own[2] += n * row["inside_90"]  # NaN where a model has no covariance
    for (who, model, horizon), (n, distance, inside) in sums.items():
        if float(horizon) not in ERROR_HORIZONS_S:
            continue
        headline.add_from_sums(f"prediction.{who}.{model}.fde_{horizon}s_m", distance, n)
        headline.add_from_sums(f"prediction.{who}.{model}.inside_90_{horizon}s_share", inside, n)


def error_horizons_s(horizon_s: float) -> list[float]:
    """Return the times ahead (s) at which errors are reported: every half second up to the horizon, and the horizon."""
    horizons = [h for h in ERROR_HORIZONS_S if h <= horizon_s + 1e-9]
    if not horizons or abs(horizons[-1] - horizon_s) > 1e-9:
        horizons.append(horizon_s)
    return horizons


def _read_online_start_states(log: Log, vehicle_label: str) -> VehicleStates | None:
    """Read the online states of the ego or the remote vehicles, if the log's paths start from them."""
    used = parse_json_entry_or_empty(read_run_records(log).get("predict", {}), "configuration", dict)
    topic = (EGO_ONLINE if vehicle_label == "ego" else REMOTE_ONLINE).topic
    if used.get("states") != "online" or all(channel.topic != topic for channel in log.channels):
        return None
    return read_vehicle_states(log.columns(topic))


def model_error_records_by_horizon(
    states: VehicleStates, settings: PathErrorSettings, actual_states: VehicleStates | None = None
) -> list[dict[str, Any]]:
    """Compute the errors of every model from the same starts: one record per vehicle, model and horizon.

    Args:
        states: Start states.
        settings: Settings of the paths.
        actual_states: Actual states of the vehicles; None: the start states.
    """
    tracks = {} if actual_states is None else dict(iter_track_rows(actual_states.ids, actual_states.stamp_ns))
    horizons = error_horizons_s(settings.horizon_s)
    starts = path_starts_from_states(states)
    acting_s = measure_acting_time_s(starts)
    log_scale = initial_log_scale_of_each_row(
        DEFAULT_MODEL, starts, acting_s, RolloutSettings(max(horizons), settings.step_s)
    )
    records = []
    tracks_of_starts = list(iter_track_rows(states.ids, states.stamp_ns))
    for k, (vehicle, rows) in enumerate(tracks_of_starts):
        report_work("tracks", k, len(tracks_of_starts))
        stamp_ns = states.stamp_ns[rows]
        track_ns, track_xy = stamp_ns, states.state[rows, :2]
        if actual_states is not None and vehicle in tracks:
            track_ns, track_xy = actual_states.stamp_ns[tracks[vehicle]], actual_states.state[tracks[vehicle], :2]
        compared = compare_models_at_horizons(
            list(MODELS),
            ComparedStarts(
                stamp_ns,
                states.state[rows],
                states.covariance[rows],
                track_ns,
                track_xy,
                acting_s[rows],
                log_scale[rows],
            ),
            horizons_s=horizons,
            step_s=settings.step_s,
            max_gap_s=MAX_INTERPOLATED_TRACK_GAP_S,
            discretisation=settings.discretisation,
        )
        columns = horizon_error_table(compared)
        for i in range(len(columns["model"])):
            record: dict[str, Any] = {name: values[i] for name, values in columns.items()}
            records.append({"vehicle": vehicle, **record})
    return records


def _build_prediction_table(records: list[dict[str, Any]]) -> Table:
    names = list(records[0]) if records else ["vehicle", "model", "horizon_s", "n"]
    columns: dict[str, TableColumn] = {}
    for name in names:
        values = [record[name] for record in records]
        columns[name] = values if name in {"vehicle", "model"} else np.array(values)
    return Table("prediction", columns)


def _build_prediction_section(records: list[dict[str, Any]], horizon_s: float) -> SummaryTable:
    """Build the section with errors at the horizon: each model, for the ego and for all remote vehicles together."""
    rows: list[tuple[Cell, ...]] = []
    for group, is_member in (("ego", True), ("remote", False)):
        chosen = [
            r for r in records if (r["vehicle"] == EGO_ID) == is_member and abs(r["horizon_s"] - horizon_s) < 1e-9
        ]
        baseline = _mean_weighted_by_starts([r for r in chosen if r["model"] == BASELINE_MODEL], "mean_m")
        for model in dict.fromkeys(r["model"] for r in chosen):
            own = [r for r in chosen if r["model"] == model and r["n"] > 0]
            if not own:
                continue
            mean = _mean_weighted_by_starts(own, "mean_m")
            rows.append(
                (
                    group,
                    model,
                    sum(int(r["n"]) for r in own),
                    mean,
                    max(float(r["p95_m"]) for r in own),
                    100.0 * (mean / baseline - 1.0) if baseline > 0.0 else math.nan,
                    100.0 * _mean_weighted_by_starts(own, "inside_90"),
                )
            )
    title = (
        f"Errors of positions predicted {horizon_s:g} s ahead, against the later position (remote: all other vehicles, "
        "the 95 % those of the one with the greatest errors; cv: the model of constant velocity)"
    )
    error_columns = (
        "mean error [m]",
        "95 % of errors below [m]",
        "change of mean error from cv [%]",
        "later positions inside the 90 % ellipse [%]",
    )
    columns = ("vehicle", "motion model", "predicted paths", *error_columns)
    names = ("vehicle", "model", "starts", "mean [m]", "worst p95 [m]", "vs cv [%]", "in 90 % ellipse [%]")
    return SummaryTable("prediction", title, columns, tuple(rows), names=names)


def _mean_weighted_by_starts(records: list[dict[str, Any]], column: str) -> float:
    """Return the mean of a column over vehicles, weighted by their numbers of starts; NaN without any."""
    n = sum(int(r["n"]) for r in records)
    return sum(float(r[column]) * int(r["n"]) for r in records if r["n"]) / n if n else math.nan
