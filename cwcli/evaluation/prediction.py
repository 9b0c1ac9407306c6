"""Headline metrics of `predict`: the published paths against what then happened, and every motion model."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from cwcli.channels.predicted_path import PredictedPaths, read_paths
from cwcli.channels.published import EGO_PATH, REMOTE_PATH, REMOTE_STATE
from cwcli.channels.vehicle_state import VehicleStates, read_states
from cwcli.errors import UsageError
from cwcli.evaluation.estimate import Ego
from cwcli.logs.read.reader import Log
from cwcli.metrics.headline import Headline, metric_of
from cwcli.metrics.table import Table
from cwcli.prediction.models import MODELS
from cwcli.prediction.outcome import ELLIPSE_90, HorizonErrors, horizon_errors
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.rows import rows_by_id, tracks_of
from cwcli.signals.vehicle_state import EGO_ID
from cwcli.stages.predict import ERROR_HORIZONS_S, MAX_GAP_S, PredictConfig, prediction_table
from cwcli.stages.records import json_entry, run_records

MAX_TRUTH_GAP_S = 1.0


def add_prediction(headline: Headline, log: Log, ego: Ego, table: Table | None) -> None:
    """Add the metrics of the published paths; nothing if the log has none.

    Args:
        headline: Gets the rows.
        log: The log.
        ego: From `add_estimate`.
        table: The stage's table `prediction`, or None: the models are then predicted again.
    """
    topics = {channel.topic for channel in log.channels}
    if EGO_PATH.topic not in topics or ego.states is None:
        return
    states = {"ego": ego.states}
    paths = {"ego": read_paths(log.columns(EGO_PATH.topic))}
    if REMOTE_STATE.topic in topics and REMOTE_PATH.topic in topics:
        columns = log.load({REMOTE_STATE.topic: None, REMOTE_PATH.topic: None})
        states["remote"], paths["remote"] = (
            read_states(columns[REMOTE_STATE.topic]),
            read_paths(columns[REMOTE_PATH.topic]),
        )
    for who, published in paths.items():
        _add_published(headline, who, published, states[who])
        if who == "ego" and ego.truth is not None:
            errors = _against(published, np.arange(len(published)), ego.truth.stamp_ns, ego.truth.xy, MAX_TRUTH_GAP_S)
            _add_horizons(headline, "prediction.ego.truth_", [errors])
    if table is None:
        table = prediction_table(list(states.values()), _config(log))
    _add_models(headline, table)


def _add_published(headline: Headline, who: str, published: PredictedPaths, states: VehicleStates) -> None:
    """The published paths against the vehicles' own later states."""
    tracks = dict(tracks_of(states.ids, states.stamp_ns))
    found = []
    for vehicle, rows in rows_by_id(published.ids):
        if vehicle in tracks:
            own = tracks[vehicle]
            found.append(_against(published, rows, states.stamp_ns[own], states.state[own, :2], MAX_GAP_S))
    if found:
        _add_horizons(headline, f"prediction.{who}.", found)


def _against(
    published: PredictedPaths, rows: npt.NDArray[np.intp], stamp_ns: Int64Array,
    xy: FloatArray, max_gap_s: float,
) -> HorizonErrors:  # fmt: skip
    """Errors at every step of the paths up to the last horizon."""
    times_s = published.paths.time_s
    steps = times_s[(times_s > 0.0) & (times_s <= ERROR_HORIZONS_S[-1] + 1e-9)]
    paths = published.paths.take(rows)
    return horizon_errors(paths, published.stamp_ns[rows], stamp_ns, xy, steps.tolist(), max_gap_s)


def _add_horizons(headline: Headline, prefix: str, found: list[HorizonErrors]) -> None:
    """Rows at each horizon that is a step of the paths; starts whose outcome is known count."""
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
        headline.share(f"{prefix}inside_90_{horizon_s:.1f}s_share", judged[np.isfinite(judged)] <= ELLIPSE_90)


def _config(log: Log) -> PredictConfig:
    """What matters of the stage's configuration for the models' errors."""
    used: Mapping[str, object] = json_entry(run_records(log).get("predict", {}), "configuration", dict)
    default = PredictConfig()
    horizon_s, step_s = used.get("horizon_s"), used.get("step_s")
    try:
        return PredictConfig(
            horizon_s=float(horizon_s) if isinstance(horizon_s, int | float) else default.horizon_s,
            step_s=float(step_s) if isinstance(step_s, int | float) else default.step_s,
            discretisation="paper" if used.get("discretisation") == "paper" else "exact",
        )
    except UsageError:
        return default


def _add_models(headline: Headline, table: Table) -> None:
    """Every motion model at the horizons, the remote vehicles together."""
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
