"""Evaluation of `predict`: errors of every motion model and of the published paths against the later tracks."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cwcli.channels.predicted_path import AnyPaths
from cwcli.channels.published import EGO_ONLINE, EGO_PATH, EGO_STATE, REMOTE_ONLINE, REMOTE_PATH, REMOTE_STATE
from cwcli.channels.vehicle_state import VehicleStates, read_states
from cwcli.evaluation.happened import recorded
from cwcli.evaluation.knowledge import TRUTH, against, estimated, read_by
from cwcli.evaluation.subject import Subject
from cwcli.logs.read.reader import Log
from cwcli.metrics.headline import Headline, metric_of
from cwcli.metrics.table import Table, TableColumn
from cwcli.pipeline.paths import all_paths
from cwcli.pipeline.records import json_entry, run_records
from cwcli.pipeline.result import Cell, Section, StageResult
from cwcli.prediction.calibrate import stream_beginnings
from cwcli.prediction.horizon import BASELINE, compare_models, horizon_table
from cwcli.prediction.models import DEFAULT_MODEL, MODELS
from cwcli.prediction.outcome import ELLIPSE_90, HorizonErrors, horizon_errors
from cwcli.prediction.paths import Paths
from cwcli.prediction.record import measured_acted
from cwcli.prediction.rollout import Discretisation
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.row_order import rows_by_id, tracks_of
from cwcli.signals.vehicle_state import EGO_ID
from cwcli.stages.predict import PredictConfig

ERROR_HORIZONS_S = (0.5, 1.0, 1.5, 2.0, 2.5)
"""Times ahead at which errors of paths are reported, s."""
MAX_GAP_S = 0.5
"""Longest gap of a track that is interpolated, s. Chosen by hand; not fitted."""
MAX_TRUTH_GAP_S = 1.0
"""Longest gap of a truth that is interpolated, s. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class Asked:
    """Settings of compared paths: horizon and step (s), and how they are integrated."""

    horizon_s: float
    step_s: float
    discretisation: Discretisation


def judge_result(log: Log, config: PredictConfig, result: StageResult) -> StageResult:
    """Add the errors of every motion model to the result, each vehicle against its own later track in hindsight."""
    asked = Asked(config.horizon_s, config.step_s, config.discretisation)
    records = []
    for role, states in result.made.items():
        records += model_errors(states, asked, recorded(log, config, role))
    return result.judged(sections=(_section(records, config.horizon_s),), tables={"prediction": _table(records)})


def add_metrics(subject: Subject) -> None:
    """Add the metrics of the published paths; nothing if the log has none."""
    headline, log, ego = subject.headline, subject.log, subject.ego
    records = run_records(log)
    knows, outcome = read_by(records, records.get("predict", {})), estimated(records)
    topics = {channel.topic for channel in log.channels}
    if EGO_PATH.topic not in topics or ego.states is None:
        return
    states = {"ego": ego.states}
    paths = {"ego": all_paths(log, EGO_PATH.topic, EGO_STATE.role)[0]}
    if REMOTE_STATE.topic in topics and REMOTE_PATH.topic in topics:
        states["remote"] = read_states(log.columns(REMOTE_STATE.topic))
        paths["remote"], _ = all_paths(log, REMOTE_PATH.topic, REMOTE_STATE.role)
    for who, published in paths.items():
        with headline.of(against(knows, outcome)):
            _add_published(headline, who, published, states[who])
        if who == "ego" and ego.truth is not None:
            truth = ego.truth
            every = published.some(np.arange(len(published))).take(np.arange(len(published)))
            errors = against_track(every, published.stamp_ns, truth.stamp_ns, truth.xy, MAX_TRUTH_GAP_S)
            with headline.of(against(knows, TRUTH)):
                add_horizons(headline, "prediction.ego.truth_", [errors])
    table = subject.tables.get("prediction")
    if table is None:
        asked = _asked(log)
        table = _table(
            [record for who, each in states.items() for record in model_errors(_starts(log, who) or each, asked, each)]
        )
    with headline.of(against(knows, outcome)):
        _add_models(headline, table)


def _add_published(headline: Headline, who: str, published: AnyPaths, states: VehicleStates) -> None:
    """Add the errors of the published paths against the vehicles' own later states."""
    tracks = dict(tracks_of(states.ids, states.stamp_ns))
    found = []
    for vehicle, rows in rows_by_id(published.ids):
        if vehicle not in tracks:
            continue
        own = tracks[vehicle]
        paths, stamp_ns = published.some(rows).take(np.arange(len(rows))), published.stamp_ns[rows]
        found.append(against_track(paths, stamp_ns, states.stamp_ns[own], states.state[own, :2], MAX_GAP_S))
    if found:
        add_horizons(headline, f"prediction.{who}.", found)


def against_track(
    paths: Paths, start_ns: Int64Array, stamp_ns: Int64Array, xy: FloatArray, max_gap_s: float
) -> HorizonErrors:
    """Return the errors of paths that start at `start_ns` (n,) at every step up to the last horizon.

    The track is given by stamps (m,) and positions (m, 2), m.
    """
    steps = paths.time_s[(paths.time_s > 0.0) & (paths.time_s <= ERROR_HORIZONS_S[-1] + 1e-9)]
    return horizon_errors(paths, start_ns, stamp_ns, xy, steps.tolist(), max_gap_s)


def add_horizons(headline: Headline, prefix: str, found: list[HorizonErrors]) -> None:
    """Add errors at each horizon that is a step of the paths; only starts with a known outcome count."""
    step_s = found[0].horizon_s
    distance = np.concatenate([each.distance_m for each in found])
    is_known = np.concatenate([each.is_known for each in found])
    squared = np.concatenate([each.mahalanobis2 for each in found])
    for horizon_s in ERROR_HORIZONS_S:
        at = np.flatnonzero(np.abs(step_s - horizon_s) < 1e-6)
        if not len(at):
            continue
        k = int(at[0])
        headline.errors(f"{prefix}fde_{horizon_s:.1f}s_m", distance[is_known[:, k], k])
        whole = is_known[:, : k + 1].all(axis=1)
        if metric_of(f"{prefix}ade_{horizon_s:.1f}s_m") is not None:
            headline.errors(f"{prefix}ade_{horizon_s:.1f}s_m", distance[whole, : k + 1].mean(axis=1))
        judged = squared[is_known[:, k], k]
        if metric_of(f"{prefix}inside_90_{horizon_s:.1f}s_share") is not None:
            headline.share(f"{prefix}inside_90_{horizon_s:.1f}s_share", judged[np.isfinite(judged)] <= ELLIPSE_90)


def _asked(log: Log) -> Asked:
    """Return horizon, step and integration from the record of the stage, or the defaults."""
    used: Mapping[str, object] = json_entry(run_records(log).get("predict", {}), "configuration", dict)
    default = PredictConfig()
    horizon_s, step_s = (
        float(value) if isinstance(value, int | float) else usual
        for value, usual in ((used.get("horizon_s"), default.horizon_s), (used.get("step_s"), default.step_s))
    )
    return Asked(horizon_s, step_s, "paper" if used.get("discretisation") == "paper" else "exact")


def _add_models(headline: Headline, table: Table) -> None:
    """Add the errors of every motion model at the horizons, of all remote vehicles together."""
    sums: dict[tuple[str, str, str], list[float]] = {}
    for row in table.records():
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
        headline.add(f"prediction.{who}.{model}.fde_{horizon}s_m", distance, n)
        headline.add(f"prediction.{who}.{model}.inside_90_{horizon}s_share", inside, n)


def error_horizons(horizon_s: float) -> list[float]:
    """Return the times ahead (s) at which errors are reported: every half second up to the horizon, and the horizon."""
    horizons = [h for h in ERROR_HORIZONS_S if h <= horizon_s + 1e-9]
    if not horizons or abs(horizons[-1] - horizon_s) > 1e-9:
        horizons.append(horizon_s)
    return horizons


def _starts(log: Log, who: str) -> VehicleStates | None:
    """Read the online states of the ego or the remote vehicles, if the log's paths start from them."""
    used = json_entry(run_records(log).get("predict", {}), "configuration", dict)
    topic = (EGO_ONLINE if who == "ego" else REMOTE_ONLINE).topic
    if used.get("states") != "online" or all(channel.topic != topic for channel in log.channels):
        return None
    return read_states(log.columns(topic))


def model_errors(states: VehicleStates, asked: Asked, happened: VehicleStates | None = None) -> list[dict[str, Any]]:
    """Compute the errors of every model from the same starts: one record per vehicle, model and horizon.

    Args:
        states: Start states.
        asked: Settings of the paths.
        happened: Actual states of the vehicles; None: the start states.
    """
    tracks = {} if happened is None else dict(tracks_of(happened.ids, happened.stamp_ns))
    horizons = error_horizons(asked.horizon_s)
    acted = measured_acted(states.ids.codes, states.stamp_ns, states.log_time_ns, states.state, states.covariance)
    begin = stream_beginnings(
        DEFAULT_MODEL,
        states.ids.codes,
        states.stamp_ns,
        states.log_time_ns,
        states.state,
        states.covariance,
        acted,
        horizon_s=max(horizons),
        step_s=asked.step_s,
    )
    records = []
    for vehicle, rows in tracks_of(states.ids, states.stamp_ns):
        stamp_ns = states.stamp_ns[rows]
        track_ns, track_xy = stamp_ns, states.state[rows, :2]
        if happened is not None and vehicle in tracks:
            track_ns, track_xy = happened.stamp_ns[tracks[vehicle]], happened.state[tracks[vehicle], :2]
        compared = compare_models(
            list(MODELS),
            states.state[rows],
            states.covariance[rows],
            stamp_ns,
            track_ns,
            track_xy,
            horizons_s=horizons,
            step_s=asked.step_s,
            max_gap_s=MAX_GAP_S,
            discretisation=asked.discretisation,
            acted=acted[rows],
            begin=begin[rows],
        )
        columns = horizon_table(compared)
        for i in range(len(columns["model"])):
            record: dict[str, Any] = {name: values[i] for name, values in columns.items()}
            records.append({"vehicle": vehicle, **record})
    return records


def _table(records: list[dict[str, Any]]) -> Table:
    names = list(records[0]) if records else ["vehicle", "model", "horizon_s", "n"]
    columns: dict[str, TableColumn] = {}
    for name in names:
        values = [record[name] for record in records]
        columns[name] = values if name in {"vehicle", "model"} else np.array(values)
    return Table("prediction", columns)


def _section(records: list[dict[str, Any]], horizon_s: float) -> Section:
    """Build the section with errors at the horizon: each model, for the ego and for all remote vehicles together."""
    rows: list[tuple[Cell, ...]] = []
    for group, is_member in (("ego", True), ("remote", False)):
        chosen = [
            r for r in records if (r["vehicle"] == EGO_ID) == is_member and abs(r["horizon_s"] - horizon_s) < 1e-9
        ]
        baseline = _pooled([r for r in chosen if r["model"] == BASELINE], "mean_m")
        for model in dict.fromkeys(r["model"] for r in chosen):
            own = [r for r in chosen if r["model"] == model and r["n"] > 0]
            if not own:
                continue
            mean = _pooled(own, "mean_m")
            rows.append(
                (
                    group,
                    model,
                    sum(int(r["n"]) for r in own),
                    mean,
                    max(float(r["p95_m"]) for r in own),
                    100.0 * (mean / baseline - 1.0) if baseline > 0.0 else math.nan,
                    100.0 * _pooled(own, "inside_90"),
                )
            )
    title = f"Position error {horizon_s:g} s ahead, against the vehicle's own track"
    columns = ("vehicle", "model", "starts", "mean [m]", "worst p95 [m]", "vs cv [%]", "in 90 % ellipse [%]")
    return Section("prediction", title, columns, tuple(rows))


def _pooled(records: list[dict[str, Any]], name: str) -> float:
    """Return the mean of a column over vehicles, weighted by their numbers of starts; NaN without any."""
    n = sum(int(r["n"]) for r in records)
    return sum(float(r[name]) * int(r["n"]) for r in records if r["n"]) / n if n else math.nan
