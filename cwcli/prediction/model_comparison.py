"""Compare the motion models with the actual positions, from the same starts; constant velocity is always included."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass, replace
from cwcli.prediction.calibrate import (
    actual_positions_at_knots,
    initial_log_scale_at_knots,
    scale_covariance_by_outcomes,
)
from cwcli.prediction.models import MODELS
from cwcli.prediction.outcome import (
    ELLIPSE_50_SQUARED_RADIUS,
    ELLIPSE_90_SQUARED_RADIUS,
    HorizonErrors,
    actual_positions,
    horizon_errors,
    indices_of_needed_points,
    repeat_actual_positions_for_path_sets,
)
from cwcli.prediction.paths import stack_paths
from cwcli.prediction.rollout import Discretisation, RolloutSettings, roll_out_paths
from cwcli.prediction.scales import LogScales, horizon_knots_of_scales_s
from cwcli.signals.columns import FloatArray, Int64Array

BASELINE_MODEL = "cv"
"""The model that the others are compared with: constant velocity."""
PATHS_PER_BATCH = 2048
"""Number of paths in a batch: models of a short track are judged together, as each call costs more than its paths.
Chosen by hand."""


@dataclass(frozen=True)
class ComparedStarts:
    """The starts of one vehicle's paths in time order, and where the vehicle was in fact.

    Attributes:
        stamp_ns, state, covariance: Shapes (n,), (n, 8), and (n, 8, 8) or None.
        track_stamp_ns, track_xy_m: Shapes (m,) and (m, 2): the actual positions.
        acting_s, log_scale: For how long the derivatives of the starts act, and the scales with which their ellipses
            begin, for a model that learns (`outcome_history.measure_acting_time_s`,
            `calibrate.initial_log_scale_of_each_row`); None: no record, the fleet's.
    """

    stamp_ns: Int64Array
    state: FloatArray
    covariance: FloatArray | None
    track_stamp_ns: Int64Array
    track_xy_m: FloatArray
    acting_s: FloatArray | None = None
    log_scale: FloatArray | None = None


def compare_models_at_horizons(
    models: Sequence[str],
    starts: ComparedStarts,
    *,
    horizons_s: Sequence[float] = (0.5, 1.0, 1.5, 2.0, 2.5),
    step_s: float = 0.05,
    max_gap_s: float = 0.5,
    discretisation: Discretisation = "exact",
    calibrate: bool = True,
) -> dict[str, HorizonErrors]:
    """Compute `horizon_errors` of each model from the same starts; constant velocity always comes first.

    "paper" applies to the models that the paper has; the others stay exact. With `calibrate` each model's covariance
    follows its own record (`prediction.calibrate`).
    """
    errors: dict[str, HorizonErrors] = {}
    stamp_ns, state, track_ns, track_xy = starts.stamp_ns, starts.state, starts.track_stamp_ns, starts.track_xy_m
    actual = actual_positions(stamp_ns, track_ns, track_xy, horizons_s, max_gap_s)
    settings = RolloutSettings(max(horizons_s), step_s, "exact")
    time_s = settings.time_s
    outcome = actual_positions_at_knots(float(time_s[-1]), stamp_ns, state[:, :2]) if calibrate else None
    points = indices_of_needed_points(time_s, [*horizons_s, *horizon_knots_of_scales_s(float(time_s[-1]))])
    names = list(dict.fromkeys([BASELINE_MODEL, *models]))
    n = len(state)
    at_once = max(PATHS_PER_BATCH // max(n, 1), 1)
    for first in range(0, len(names), at_once):
        some = names[first : first + at_once]
        paths = stack_paths(
            [
                roll_out_paths(
                    name,
                    state,
                    starts.covariance,
                    replace(settings, discretisation=discretisation)
                    if name not in MODELS or MODELS[name].in_paper
                    else settings,
                    points=points,
                    acting_s=starts.acting_s,
                )
                for name in some
            ]
        )
        if calibrate:
            begins = [_initial_log_scales(name, float(time_s[-1]), n, starts.log_scale) for name in some]
            paths = scale_covariance_by_outcomes(
                paths, stamp_ns, state[:, :2], outcome=outcome, begin_log_scale=np.stack(begins)
            )
        starts_ns = np.tile(stamp_ns, len(some))
        together = horizon_errors(
            paths,
            starts_ns,
            track_ns,
            track_xy,
            horizons_s,
            max_gap_s,
            repeat_actual_positions_for_path_sets(actual, len(some)),
        )
        for k, name in enumerate(some):
            errors[name] = together.select_starts(slice(k * n, (k + 1) * n))
    return errors


def _initial_log_scales(model: str, horizon_s: float, n: int, calibrated: FloatArray | None) -> LogScales:
    """The log scales with which a model's ellipses begin: the learned ones, or its own for all n starts, (n, k, 2)."""
    if calibrated is not None and MODELS[model].learns:
        return calibrated
    return np.tile(initial_log_scale_at_knots(model, horizon_s), (n, 1, 1))


def horizon_error_table(errors: Mapping[str, HorizonErrors]) -> dict[str, FloatArray | Int64Array | list[str]]:
    """One row per model and horizon.

    Columns: model, horizon_s, n (starts whose outcome is known), mean_m, median_m, rms_m, p95_m, max_m of the
    distance; along_mean_m, along_rms_m, cross_mean_m, cross_rms_m; inside_50, inside_90: share of outcomes within
    the 50 and 90 % ellipses; change_percent: of the mean against constant velocity on the same starts.

    Raises:
        ValueError: The constant-velocity row is missing.
    """
    if BASELINE_MODEL not in errors:
        raise ValueError("the constant-velocity model is missing from the comparison")
    baseline = errors[BASELINE_MODEL]
    n_horizons = len(baseline.horizon_s)
    rows: dict[tuple[str, int], list[float]] = {}
    for column in range(n_horizons):
        by_starts: dict[bytes, list[str]] = {}
        for name, error in errors.items():
            by_starts.setdefault(error.is_known[:, column].tobytes(), []).append(name)
        for names in by_starts.values():
            for name, row in zip(
                names, _table_rows_at_horizon([errors[name] for name in names], baseline, column), strict=True
            ):
                rows[name, column] = row
    order = [(name, column) for name in errors for column in range(n_horizons)]
    table: dict[str, FloatArray | Int64Array | list[str]] = {"model": [name for name, _ in order]}
    for index, key in enumerate(_COLUMNS_OF_HORIZON_ERROR_TABLE):
        values = np.array([rows[each][index] for each in order], dtype=np.float64)
        table[key] = values.astype(np.int64) if key == "n" else values
    return table


_COLUMNS_OF_HORIZON_ERROR_TABLE = (
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
"""Names of the columns of `horizon_error_table` after the model, in order."""


def _table_rows_at_horizon(
    errors: Sequence[HorizonErrors], baseline: HorizonErrors, horizon_index: int
) -> list[list[float]]:
    """The table's rows at one horizon for models whose outcomes are known for the same starts."""
    known = errors[0].is_known[:, horizon_index]
    n = np.count_nonzero(known)
    horizon_s = float(errors[0].horizon_s[horizon_index])
    if n == 0:
        return [[horizon_s, 0.0, *([np.nan] * (len(_COLUMNS_OF_HORIZON_ERROR_TABLE) - 2))] for _ in errors]
    distance = np.stack([error.distance_m[known, horizon_index] for error in errors])
    along = np.stack([error.along_m[known, horizon_index] for error in errors])
    cross = np.stack([error.cross_m[known, horizon_index] for error in errors])
    squared = np.stack([error.mahalanobis2[known, horizon_index] for error in errors])
    has_ellipse = np.isfinite(squared)
    core = np.stack([error.core_mahalanobis2[known, horizon_index] for error in errors])
    inside_50, inside_90 = (
        has_ellipse & (core <= ELLIPSE_50_SQUARED_RADIUS),
        has_ellipse & (squared <= ELLIPSE_90_SQUARED_RADIUS),
    )
    base = baseline.distance_m[known & baseline.is_known[:, horizon_index], horizon_index]
    base_mean = float(_row_means_with_nan(base[None])[0]) if len(base) else np.nan
    mean = _row_means_with_nan(distance)
    ordered = np.sort(distance, axis=1)
    measures = [
        np.full(len(errors), horizon_s),
        np.full(len(errors), float(n)),
        mean,
        _quantile_of_sorted_rows(ordered, 0.5),
        np.sqrt(_row_means_with_nan(distance**2)),
        _quantile_of_sorted_rows(ordered, 0.95),
        ordered[:, -1],
        _row_means_with_nan(along),
        np.sqrt(_row_means_with_nan(along**2)),
        _row_means_with_nan(cross),
        np.sqrt(_row_means_with_nan(cross**2)),
        _share_inside_ellipse(inside_50, has_ellipse),
        _share_inside_ellipse(inside_90, has_ellipse),
        100.0 * (mean / base_mean - 1.0) if base_mean > 0.0 else np.full(len(errors), np.nan),
    ]
    rows: list[list[float]] = np.column_stack(measures).tolist()
    return rows


def _row_means_with_nan(values: FloatArray) -> FloatArray:
    """The mean of each row: `values.mean(axis=1)` at a quarter of its cost for short rows."""
    return np.asarray(np.add.reduce(values, axis=1) / values.shape[1])


def _share_inside_ellipse(inside: npt.NDArray[np.bool_], has_ellipse: npt.NDArray[np.bool_]) -> FloatArray:
    """Share of a model's outcomes with an ellipse that lie inside it; NaN if there is none."""
    n = np.count_nonzero(has_ellipse, axis=1)
    return np.asarray(np.where(n, np.count_nonzero(inside, axis=1) / np.maximum(n, 1), np.nan))


def _quantile_of_sorted_rows(ordered: FloatArray, share: float) -> FloatArray:
    """A quantile of each row of sorted, finite values: `np.quantile` at a tenth of its cost."""
    position = share * (ordered.shape[1] - 1)
    below = int(position)
    low, high = ordered[:, below], ordered[:, min(below + 1, ordered.shape[1] - 1)]
    part = position - below
    return np.asarray(high - (high - low) * (1.0 - part) if part >= 0.5 else low + (high - low) * part)
