"""Every model against what then happened, from the same starts; constant velocity is always among them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from cwcli.prediction.calibrate import Calibration, calibrated, outcomes
from cwcli.prediction.driver import DriverPrior
from cwcli.prediction.models import MODELS
from cwcli.prediction.outcome import (
    ELLIPSE_50,
    ELLIPSE_90,
    HorizonErrors,
    actual_positions,
    horizon_errors,
    needed_points,
    tiled,
)
from cwcli.prediction.paths import stacked
from cwcli.prediction.rollout import Discretisation, rollout, time_grid
from cwcli.signals.columns import FloatArray, Int64Array

BASELINE = "cv"
PATHS_AT_ONCE = 2048  # a short track's models are judged together: each alone takes longer to begin than to judge

__all__ = ["BASELINE", "HorizonErrors", "compare_models", "horizon_errors", "horizon_table"]


def compare_models(
    models: Sequence[str],
    state: FloatArray,
    covariance: FloatArray | None,
    start_stamp_ns: Int64Array,
    track_stamp_ns: Int64Array,
    track_xy: FloatArray,
    *,
    horizons_s: Sequence[float] = (0.5, 1.0, 1.5, 2.0, 2.5),
    step_s: float = 0.05,
    max_gap_s: float = 0.5,
    discretisation: Discretisation = "exact",
    prior: DriverPrior | None = None,
    calibrate: bool = True,
) -> dict[str, HorizonErrors]:
    """`horizon_errors` of each model from the same starts; constant velocity comes first, asked for or not.

    The starts are of one vehicle in time order. "paper" applies to the models that the paper has; the others stay
    exact. With `calibrate` each model's covariance follows its own record (`prediction.calibrate`).
    """
    errors: dict[str, HorizonErrors] = {}
    actual = actual_positions(start_stamp_ns, track_stamp_ns, track_xy, horizons_s, max_gap_s)
    time_s = time_grid(max(horizons_s), step_s)
    outcome = outcomes(float(time_s[-1]), start_stamp_ns, state[:, :2]) if calibrate else None
    points = needed_points(time_s, [*horizons_s, min(Calibration.horizon_s, float(time_s[-1]))])
    names = list(dict.fromkeys([BASELINE, *models]))
    n = len(state)
    at_once = max(PATHS_AT_ONCE // max(n, 1), 1)
    for first in range(0, len(names), at_once):
        some = names[first : first + at_once]
        paths = stacked(
            [
                rollout(
                    name,
                    state,
                    covariance,
                    horizon_s=max(horizons_s),
                    step_s=step_s,
                    discretisation=discretisation if name not in MODELS or MODELS[name].in_paper else "exact",
                    prior=prior,
                    points=points,
                )
                for name in some
            ]
        )
        if calibrate:
            paths = calibrated(paths, start_stamp_ns, state[:, :2], outcome=outcome)
        starts_ns = np.tile(start_stamp_ns, len(some))
        together = horizon_errors(
            paths, starts_ns, track_stamp_ns, track_xy, horizons_s, max_gap_s, tiled(actual, len(some))
        )
        for k, name in enumerate(some):
            errors[name] = together.rows(slice(k * n, (k + 1) * n))
    return errors


def horizon_table(errors: Mapping[str, HorizonErrors]) -> dict[str, FloatArray | Int64Array | list[str]]:
    """One row per model and horizon.

    Columns: model, horizon_s, n (starts whose outcome is known), mean_m, median_m, rms_m, p95_m, max_m of the
    distance; along_mean_m, along_rms_m, cross_mean_m, cross_rms_m; inside_50, inside_90: share of outcomes within
    the 50 and 90 % ellipses; change_percent: of the mean against constant velocity on the same starts.

    Raises:
        ValueError: The constant-velocity row is missing.
    """
    if BASELINE not in errors:
        raise ValueError("the constant-velocity model is missing from the comparison")
    names: list[str] = []
    rows: list[list[float]] = []
    for name, error in errors.items():
        for column, horizon in enumerate(error.horizon_s):
            names.append(name)
            rows.append(_row(error, errors[BASELINE], column, float(horizon)))
    table: dict[str, FloatArray | Int64Array | list[str]] = {"model": names}
    for index, key in enumerate(_COLUMNS):
        values = np.array([row[index] for row in rows], dtype=np.float64)
        table[key] = values.astype(np.int64) if key == "n" else values
    return table


_COLUMNS = (
    "horizon_s",
    "n",
    "mean_m",
    "median_m",
    "rms_m",
    "p95_m",
    "max_m",
    "along_mean_m",
    "along_rms_m",
    "cross_mean_m",
    "cross_rms_m",
    "inside_50",
    "inside_90",
    "change_percent",
)


def _row(error: HorizonErrors, baseline: HorizonErrors, column: int, horizon_s: float) -> list[float]:
    known = error.is_known[:, column]
    n = int(known.sum())
    if n == 0:
        return [horizon_s, 0.0, *([np.nan] * (len(_COLUMNS) - 2))]
    distance, along, cross = (values[known, column] for values in (error.distance_m, error.along_m, error.cross_m))
    squared = error.mahalanobis2[known, column]
    has_ellipse = np.isfinite(squared)
    inside = squared[has_ellipse]
    base = baseline.distance_m[known & baseline.is_known[:, column], column]
    base_mean = _mean(base) if len(base) else np.nan
    mean = _mean(distance)
    ordered = np.sort(distance)
    return [
        horizon_s,
        n,
        mean,
        _quantile(ordered, 0.5),
        math.sqrt(_mean(distance**2)),
        _quantile(ordered, 0.95),
        float(ordered[-1]),
        _mean(along),
        math.sqrt(_mean(along**2)),
        _mean(cross),
        math.sqrt(_mean(cross**2)),
        np.count_nonzero(inside <= ELLIPSE_50) / len(inside) if len(inside) else np.nan,
        np.count_nonzero(inside <= ELLIPSE_90) / len(inside) if len(inside) else np.nan,
        100.0 * (mean / base_mean - 1.0) if base_mean > 0.0 else np.nan,
    ]


def _mean(values: FloatArray) -> float:
    """What `values.mean()` gives, at a quarter of its cost for so few values."""
    return float(np.add.reduce(values)) / len(values)


def _quantile(ordered: FloatArray, share: float) -> float:
    """What `np.quantile` gives for sorted, finite values, at a tenth of its cost: there are a hundred rows a log."""
    position = share * (len(ordered) - 1)
    below = int(position)
    low, high = float(ordered[below]), float(ordered[min(below + 1, len(ordered) - 1)])
    part = position - below
    return high - (high - low) * (1.0 - part) if part >= 0.5 else low + (high - low) * part
