"""Scale the ellipses of predicted paths at each horizon so that they hold the stated share of outcomes.

The filter's covariance and the driver prior are models; on a given drive they may be too sure (a GNSS receiver with
coloured errors) or not sure enough (a platoon). What is known at any moment is how the predictions made a horizon ago
turned out. The scale follows them, in the manner of adaptive conformal inference (Gibbs & Candes 2021, "Adaptive
conformal inference under distribution shift"), with time instead of counts:

    d(log s^2)/dt = rate * (outside - 0.1),    outside = 1 if the latest outcome fell outside its 90 % ellipse,

so the log stays put exactly when a tenth of the time is spent outside. It uses only outcomes that were known by then.
Outcomes have heavier tails than a normal distribution, so the 50 % ellipse follows a scale of its own, with 0.5.
Each knot of `fleet.HORIZON_KNOTS_S` has its scales; between them the logarithm is linear in time, at the start of a
path it is
0: there the filter's own covariance P0 stands. What a vehicle learns online of its paths is how far it went, not where
it was: errors of its position that last, it has at the start as at the outcome. So a scale below 1 leaves P0 as it is
and scales what the path added: P0 + s^2 (P - P0).

The default model begins with quantiles of what is known of others: the fleet's distribution of squared Mahalanobis
distances, which counts as `FLEET_WEIGHT_IN_OUTCOMES` outcomes, and the outcomes so far of the log's other vehicles. The
other models begin with 1.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cwcli.kernels.paths import adapt_scale, stream_quantiles
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.prediction.fleet import FLEET_QUANTILE_LEVELS, HORIZON_KNOTS_S, load_fleet_prior
from cwcli.prediction.models import MODELS
from cwcli.prediction.outcome import (
    ELLIPSE_50_SQUARED_RADIUS,
    ELLIPSE_90_SQUARED_RADIUS,
    ActualPositions,
    actual_positions,
    horizon_errors,
    indices_of_needed_points,
    repeat_actual_positions_for_path_sets,
)
from cwcli.prediction.outcome_history import (
    OUTCOME_NEVER_KNOWN_NS,
    PathStarts,
    StateHistory,
    concatenate_histories,
    measure_acting_time_s,
    outcome_known_times_ns,
    state_histories_by_vehicle,
)
from cwcli.prediction.paths import Paths
from cwcli.prediction.plan import PathPlan
from cwcli.prediction.rollout import DEFAULT_ROLLOUT_SETTINGS, RolloutSettings
from cwcli.prediction.scales import LogScales, horizon_knots_of_scales_s, scale_path_covariance_in_place
from cwcli.signals.columns import EastNorthRows, FloatArray, Int64Array
from cwcli.signals.units import NS_PER_S

ELLIPSE_PROBABILITIES = np.array([0.5, 0.9])
"""Shares of outcomes that the two ellipses should hold; a path's covariance is that of the last."""
ELLIPSE_SQUARED_RADII = np.array([ELLIPSE_50_SQUARED_RADIUS, ELLIPSE_90_SQUARED_RADIUS])
"""The squared Mahalanobis distances of the borders of both ellipses (chi-square quantiles, two degrees of freedom)."""
FLEET_WEIGHT_IN_OUTCOMES = 6.0
"""The fleet's distribution counts as much as this many outcomes. Chosen: a 90 % quantile from 6 errs by about 1 in the
logarithm, as much as logs differ from each other."""
LOG_SQUARED_DISTANCE_CELL_WIDTH, FIRST_LOG_SQUARED_DISTANCE, N_LOG_SQUARED_DISTANCE_CELLS = 0.1, -10.0, 200
"""The histogram of log squared distances has 200 cells of width 0.1 from -10 on; what is beyond is clipped. Chosen by
hand."""
LOG_SQUARED_DISTANCE_TAIL_WIDTH = 2.0
"""The fleet's distribution ends this far beyond its outermost quantiles, in log squared distance. Chosen by hand."""


@dataclass(frozen=True)
class ScaleAdaptation:
    """How fast and how far the scale of a path's covariance adapts to outcomes.

    Attributes:
        rate_1ps: Change of the log variance per second while outcomes fall outside: 3 s outside (one manoeuvre) raise
            the variance 2.2-fold, and it takes 27 s inside to come back.
        limit: Largest factor on the variance, and the inverse of the smallest.
        max_gap_s: Track gaps longer than this give no outcome; the scale keeps its value meanwhile.
    """

    rate_1ps: float = 0.3
    limit: float = 16.0
    max_gap_s: float = 0.5


def scale_covariance_by_outcomes(
    paths: Paths,
    stamp_ns: Int64Array,
    position_m: EastNorthRows,
    calibration: ScaleAdaptation | None = None,
    outcome: ActualPositions | None = None,
    begin_log_scale: LogScales | None = None,
) -> Paths:
    """Scale the covariance of one vehicle's paths by its own earlier outcomes.

    Args:
        paths: n paths, one from each stamp; or several such sets, one below the other, each with a record of its own.
        stamp_ns: Shape (n,), strictly increasing.
        position_m: Shape (n, 2): where the vehicle was at its stamps: the outcomes.
        calibration: None: the default.
        outcome: `actual_positions_at_knots` of the same starts; None: they are looked up.
        begin_log_scale: Shape (sets, n, k, 2): log scales without a record, by knot and level;
            None: zeros.
    """
    log_scale = log_variance_scale_from_outcomes(paths, stamp_ns, position_m, calibration, outcome, begin_log_scale)
    return scale_path_covariance_in_place(
        replace(paths, position_covariance_m2=paths.position_covariance_m2.copy()), log_scale, True
    )


def _fleet_log_distance_quantiles(knots_s: FloatArray) -> FloatArray:
    """Quantiles of the log squared distance at k knots and the fleet's l levels, (k, l); normal at a path's start."""
    normal = np.log(-2.0 * np.log1p(-FLEET_QUANTILE_LEVELS))
    fleet = np.concatenate([normal[None], load_fleet_prior().log_squared])
    return np.stack([np.interp(knots_s, [0.0, *HORIZON_KNOTS_S], column) for column in fleet.T], axis=1)


def initial_log_scale_at_knots(model: str, horizon_s: float) -> LogScales:
    """The logarithms of the scales without any outcome at `horizon_knots_of_scales_s`, shape (k, 2)."""
    knots = horizon_knots_of_scales_s(horizon_s)
    if not (model in MODELS and MODELS[model].learns):
        return np.zeros((len(knots), len(ELLIPSE_PROBABILITIES)))
    return np.asarray(
        _fleet_log_distance_quantiles(knots)[:, np.searchsorted(FLEET_QUANTILE_LEVELS, ELLIPSE_PROBABILITIES)]
        - np.log(ELLIPSE_SQUARED_RADII)
    )


def log_scale_from_other_vehicles(track: StateHistory, squared_distance: FloatArray, knots_s: FloatArray) -> LogScales:
    """The logarithms of the scales that the log's other vehicles and the fleet suggest at each row, (n, k, 2).

    Args:
        track: All vehicles of the log, n rows.
        squared_distance: Shape (n, k): Mahalanobis distances before any scale; NaN where unknown.
        knots_s: Shape (k,): see `horizon_knots_of_scales_s`.
    """
    known_ns, index, step_s = outcome_known_times_ns(track, knots_s), track.vehicle_indices(), track.step_s()
    by_now = np.argsort(track.known_ns, kind="stable")
    edges = FIRST_LOG_SQUARED_DISTANCE + LOG_SQUARED_DISTANCE_CELL_WIDTH * np.arange(N_LOG_SQUARED_DISTANCE_CELLS + 1)
    out = np.empty((*squared_distance.shape, len(ELLIPSE_PROBABILITIES)))
    for k, quantiles in enumerate(_fleet_log_distance_quantiles(knots_s)):
        shares = np.interp(
            edges,
            [
                quantiles[0] - LOG_SQUARED_DISTANCE_TAIL_WIDTH,
                *quantiles,
                quantiles[-1] + LOG_SQUARED_DISTANCE_TAIL_WIDTH,
            ],
            [0.0, *FLEET_QUANTILE_LEVELS, 1.0],
        )
        rows = np.flatnonzero(np.isfinite(squared_distance[:, k]) & (known_ns[:, k] < OUTCOME_NEVER_KNOWN_NS))
        rows = rows[np.argsort(known_ns[rows, k], kind="stable")]
        cell = (
            np.log(np.maximum(squared_distance[rows, k], 1e-300)) - FIRST_LOG_SQUARED_DISTANCE
        ) / LOG_SQUARED_DISTANCE_CELL_WIDTH
        found = stream_quantiles(
            np.clip(cell, 0, N_LOG_SQUARED_DISTANCE_CELLS - 1).astype(np.intp),
            step_s[rows] / knots_s[k],
            index[rows],
            np.searchsorted(known_ns[rows, k], track.known_ns[by_now], side="right"),
            index[by_now],
            FLEET_WEIGHT_IN_OUTCOMES * np.diff(shares),
            ELLIPSE_PROBABILITIES,
        )
        out[by_now, k] = (
            FIRST_LOG_SQUARED_DISTANCE + LOG_SQUARED_DISTANCE_CELL_WIDTH * found - np.log(ELLIPSE_SQUARED_RADII)
        )
    return out


def actual_positions_at_knots(
    horizon_s: float, stamp_ns: Int64Array, position_m: EastNorthRows, calibration: ScaleAdaptation | None = None
) -> ActualPositions:
    """The vehicle's actual positions at the knots of paths of `horizon_s`, the same for every model; see
    `ActualPositions`."""
    settings = calibration or ScaleAdaptation()
    return actual_positions(
        stamp_ns, stamp_ns, position_m, horizon_knots_of_scales_s(horizon_s).tolist(), settings.max_gap_s
    )


def log_variance_scale_from_outcomes(
    paths: Paths,
    stamp_ns: Int64Array,
    position_m: EastNorthRows,
    calibration: ScaleAdaptation | None = None,
    outcome: ActualPositions | None = None,
    begin_log_scale: LogScales | None = None,
) -> LogScales:
    """The logarithms of the factors s^2 on the variance of each path, (n, k, 2); `begin_log_scale` until an outcome.

    The arguments are those of `scale_covariance_by_outcomes`.
    """
    settings = calibration or ScaleAdaptation()
    n, knots = len(stamp_ns), horizon_knots_of_scales_s(float(paths.time_s[-1]))
    squared = squared_mahalanobis_distances(paths, stamp_ns, position_m, settings, outcome)
    begin_log_scale = (
        np.zeros((*squared.shape, len(ELLIPSE_PROBABILITIES))) if begin_log_scale is None else begin_log_scale
    )
    return _adapt_log_scale(squared, begin_log_scale, stamp_ns, knots, settings).reshape(
        len(squared) * n, len(knots), len(ELLIPSE_PROBABILITIES)
    )


def squared_mahalanobis_distances(
    paths: Paths,
    stamp_ns: Int64Array,
    position_m: EastNorthRows,
    settings: ScaleAdaptation,
    outcome: ActualPositions | None = None,
) -> FloatArray:
    """Squared Mahalanobis distances of the outcomes at the knots, (sets, n, k); NaN where none is known."""
    n, knots = len(stamp_ns), horizon_knots_of_scales_s(float(paths.time_s[-1]))
    sets = len(paths) // n if n else 0
    if outcome is None:
        outcome = actual_positions_at_knots(float(paths.time_s[-1]), stamp_ns, position_m, settings)
    errors = horizon_errors(
        paths,
        np.tile(stamp_ns, sets),
        stamp_ns,
        position_m,
        knots.tolist(),
        settings.max_gap_s,
        repeat_actual_positions_for_path_sets(outcome, sets),
    )
    return np.where(errors.is_known, errors.mahalanobis2, np.nan).reshape(sets, n, len(knots))


def _adapt_log_scale(
    squared_distance: FloatArray,
    begin_log_scale: LogScales,
    stamp_ns: Int64Array,
    knots_s: FloatArray,
    settings: ScaleAdaptation,
) -> LogScales:
    """Adapt the log scales `begin_log_scale` (sets, n, k, 2) to the vehicle's own squared distances (sets, n, k)."""
    if len(stamp_ns) < 2:
        return begin_log_scale
    excess = np.log(np.maximum(squared_distance, 1e-300))[..., None] - np.log(ELLIPSE_SQUARED_RADII) - begin_log_scale
    is_known = np.isfinite(squared_distance)
    step_s = np.minimum(np.diff(stamp_ns, prepend=stamp_ns[0]) / NS_PER_S, settings.max_gap_s)
    out = np.empty_like(excess)
    for k, knot_s in enumerate(knots_s.tolist()):
        # for each start: the first start whose outcome is not yet known
        n_known = np.searchsorted(stamp_ns + round(knot_s * NS_PER_S), stamp_ns, side="right")
        known = np.ascontiguousarray(is_known[..., k])
        for level, share in enumerate(ELLIPSE_PROBABILITIES.tolist()):
            out[..., k, level] = adapt_scale(
                np.ascontiguousarray(excess[..., k, level]),
                known,
                n_known,
                step_s,
                rate_1ps=settings.rate_1ps,
                bound=float(np.log(settings.limit)),
                miss_share=1.0 - share,
            )
    return np.asarray(out + begin_log_scale)


def plan_vehicle_paths(
    model: str, starts: PathStarts, settings: RolloutSettings = DEFAULT_ROLLOUT_SETTINGS
) -> PathPlan:
    """Plan the paths of all rows, with their measured gains and each vehicle's covariance scaled by its own outcomes.

    Args:
        starts: The rows; what is known first counts as the record (`outcome_history.state_histories_by_vehicle`).
    """
    learns = model in MODELS and MODELS[model].learns
    acting_s = measure_acting_time_s(starts) if learns else None
    plan = PathPlan(model, settings, starts.state, starts.covariance, acting_s)
    adaptation, knots = ScaleAdaptation(), horizon_knots_of_scales_s(float(plan.time_s[-1]))
    tracks = state_histories_by_vehicle(replace(starts, covariance=None))
    squared = [_squared_outcome_distances_before_scaling(plan, track, adaptation) for track in tracks]
    log_scale = _log_scale_before_own_outcomes(plan, tracks, squared if learns else [])
    for track, distances in zip(tracks, squared, strict=True):
        own = _adapt_log_scale(distances[None], log_scale[track.rows][None], track.stamp_ns, knots, adaptation)[0]
        # a state that a newer one overtook takes the scale of the newest state before it
        rows = np.flatnonzero(starts.vehicle == starts.vehicle[track.rows[0]])
        if len(rows) > len(track.rows):
            newest = np.searchsorted(track.known_ns, starts.known_ns[rows], side="right") - 1
            log_scale[rows] = np.where((newest >= 0)[:, None, None], own[np.maximum(newest, 0)], log_scale[rows])
        log_scale[track.rows] = own
    return replace(plan, log_scale=log_scale)


def _log_scale_before_own_outcomes(
    plan: PathPlan, tracks: Sequence[StateHistory], squared_distances: Sequence[FloatArray]
) -> LogScales:
    """The log scales of all rows before each vehicle's own outcomes, (n, k, 2); those of other vehicles count if there
    are any."""
    horizon_s = float(plan.time_s[-1])
    log_scale = np.tile(initial_log_scale_at_knots(plan.model, horizon_s), (len(plan), 1, 1))
    if len(squared_distances) > 1:
        every = concatenate_histories(tracks)
        log_scale[every.rows] = log_scale_from_other_vehicles(
            every, np.concatenate(squared_distances), horizon_knots_of_scales_s(horizon_s)
        )
    return log_scale


def _squared_outcome_distances_before_scaling(
    plan: PathPlan, track: StateHistory, settings: ScaleAdaptation
) -> FloatArray:
    """Squared distances of one vehicle's outcomes before any scale, (n, k)."""
    points = indices_of_needed_points(plan.time_s, horizon_knots_of_scales_s(float(plan.time_s[-1])).tolist())
    planned_paths = plan.paths_of_rows(track.rows, points=points)
    return np.asarray(squared_mahalanobis_distances(planned_paths, track.stamp_ns, track.state[:, :2], settings)[0])


def initial_log_scale_of_each_row(
    model: str, starts: PathStarts, acting_s: FloatArray, settings: RolloutSettings
) -> LogScales:
    """The log scales with which the ellipses of a model that learns begin at each row, (n, k, 2).

    The arguments are those of `plan_vehicle_paths`; `acting_s` comes from `outcome_history.measure_acting_time_s`.
    """
    plan = PathPlan(model, settings, starts.state, starts.covariance, acting_s)
    tracks = state_histories_by_vehicle(replace(starts, covariance=None))
    several = tracks if len(tracks) > 1 else []
    squared = [_squared_outcome_distances_before_scaling(plan, track, ScaleAdaptation()) for track in several]
    return _log_scale_before_own_outcomes(plan, several, squared)
