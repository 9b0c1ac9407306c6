"""Every model against what then happened, from the same starts; constant velocity is always among them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cwcli.prediction.calibrate import calibrated
from cwcli.prediction.driver import DriverPrior
from cwcli.prediction.models import MODELS
from cwcli.prediction.outcome import ELLIPSE_50, ELLIPSE_90, HorizonErrors, actual_positions, horizon_errors
from cwcli.prediction.rollout import Discretisation, rollout
from cwcli.signals.columns import FloatArray, Int64Array

BASELINE = "cv"

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
    for name in dict.fromkeys([BASELINE, *models]):
        form: Discretisation = discretisation if name not in MODELS or MODELS[name].in_paper else "exact"
        paths = rollout(
            name,
            state,
            covariance,
            horizon_s=max(horizons_s),
            step_s=step_s,
            discretisation=form,
            prior=prior,
        )
        if calibrate:
            paths = calibrated(paths, start_stamp_ns, state[:, :2])
        errors[name] = horizon_errors(paths, start_stamp_ns, track_stamp_ns, track_xy, horizons_s, max_gap_s, actual)
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
    base_mean = float(base.mean()) if len(base) else np.nan
    mean = float(distance.mean())
    ordered = np.sort(distance)
    return [
        horizon_s,
        n,
        mean,
        _quantile(ordered, 0.5),
        float(np.sqrt(np.mean(distance**2))),
        _quantile(ordered, 0.95),
        float(ordered[-1]),
        float(along.mean()),
        float(np.sqrt(np.mean(along**2))),
        float(cross.mean()),
        float(np.sqrt(np.mean(cross**2))),
        float(np.mean(inside <= ELLIPSE_50)) if len(inside) else np.nan,
        float(np.mean(inside <= ELLIPSE_90)) if len(inside) else np.nan,
        100.0 * (mean / base_mean - 1.0) if base_mean > 0.0 else np.nan,
    ]


def _quantile(ordered: FloatArray, share: float) -> float:
    """What `np.quantile` gives for sorted, finite values, at a tenth of its cost: there are a hundred rows a log."""
    position = share * (len(ordered) - 1)
    below = int(position)
    low, high = float(ordered[below]), float(ordered[min(below + 1, len(ordered) - 1)])
    part = position - below
    return high - (high - low) * (1.0 - part) if part >= 0.5 else low + (high - low) * part
