"""Ellipses that hold what they promise: scaled at each horizon by how well the vehicle's own earlier ones did.

The filter's covariance and the driver prior are models; on a given drive they may be too sure (a GNSS receiver with
coloured errors) or not sure enough (a platoon). What is known at any moment is how the predictions made a horizon ago
turned out. The scale follows them, in the manner of adaptive conformal inference (Gibbs & Candes 2021, "Adaptive
conformal inference under distribution shift"), with time instead of counts:

    d(log s^2)/dt = rate * (outside - 0.1),    outside = 1 if the latest outcome fell outside its 90 % ellipse,

so the log stays put exactly when a tenth of the time is spent outside. It uses only outcomes that were known by then.
Each knot of `fleet.KNOTS_S` has a scale of its own; between them the logarithm is linear in time, at the start of a
path it is 0: there the filter's own covariance stands. The default model begins with the fleet's scale, the others
with 1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from cwcli.kernels.paths import adapt_scale
from cwcli.prediction.driver import DriverPrior
from cwcli.prediction.fleet import KNOTS_S, fleet_prior
from cwcli.prediction.models import MODELS
from cwcli.prediction.outcome import ELLIPSE_90, Actual, actual_positions, horizon_errors, needed_points, tiled
from cwcli.prediction.paths import Paths
from cwcli.prediction.record import known_tracks, measured_acted
from cwcli.prediction.rollout import Discretisation, rollout
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.units import NS_PER_S

MISS_SHARE = 0.1


@dataclass(frozen=True)
class Calibration:
    """How fast and how far the scale may go.

    Attributes:
        rate_1ps: Of the log variance while outside, per second: 3 s outside (one manoeuvre) raise it 2.2-fold, and it
            takes 27 s inside to come back.
        limit: Largest factor on the variance, and the inverse of the smallest.
        max_gap_s: Track gaps longer than this give no outcome; the scale keeps its value meanwhile.
    """

    rate_1ps: float = 0.3
    limit: float = 16.0
    max_gap_s: float = 0.5


def calibrated(
    paths: Paths,
    stamp_ns: Int64Array,
    position_m: FloatArray,
    calibration: Calibration | None = None,
    outcome: Actual | None = None,
    begin: FloatArray | None = None,
) -> Paths:
    """The paths of one vehicle with their covariance scaled by its own record.

    Args:
        paths: n paths, one from each stamp; or several such sets, one below the other, each with a record of its own.
        stamp_ns: Shape (n,), strictly increasing.
        position_m: Shape (n, 2): where the vehicle was at its stamps: the outcomes.
        calibration: None: the default.
        outcome: `outcomes` of the same starts; None: they are looked up.
        begin: Shape (sets, k): the logarithms of the scale without a record, by knot of `knots_s`; None: zeros.
    """
    log_scale = log_variance_scale(paths, stamp_ns, position_m, calibration, outcome, begin)
    factor = np.exp(between_knots(log_scale, paths.time_s))
    return replace(paths, position_covariance_m2=paths.position_covariance_m2 * factor[..., None])


def knots_s(horizon_s: float) -> FloatArray:
    """Where the scale of paths of this length is measured, shape (k,): the last is their end if that comes first."""
    return np.asarray([*(knot for knot in KNOTS_S if knot < horizon_s - 1e-9), min(horizon_s, float(KNOTS_S[-1]))])


def beginning(model: str, horizon_s: float) -> FloatArray:
    """The logarithm of the scale without a record at `knots_s`, shape (k,)."""
    knots = knots_s(horizon_s)
    if not (model in MODELS and MODELS[model].learns):
        return np.zeros(len(knots))
    return np.asarray(np.interp(knots, [0.0, *KNOTS_S], [0.0, *fleet_prior().log_scale]))


def between_knots(log_scale: FloatArray, time_s: FloatArray) -> FloatArray:
    """The logarithm of the scale at the times of paths: (n, k) at their knots to (n, times)."""
    knots = np.concatenate([[0.0], knots_s(float(time_s[-1]))])
    hats = np.stack([np.interp(time_s, knots, row) for row in np.eye(len(knots))[1:]])
    return np.asarray(log_scale @ hats)


def outcomes(
    horizon_s: float, stamp_ns: Int64Array, position_m: FloatArray, calibration: Calibration | None = None
) -> Actual:
    """Where the vehicle was when its paths of `horizon_s` are judged: the same for every model."""
    settings = calibration or Calibration()
    return actual_positions(stamp_ns, stamp_ns, position_m, knots_s(horizon_s).tolist(), settings.max_gap_s)


def log_variance_scale(
    paths: Paths,
    stamp_ns: Int64Array,
    position_m: FloatArray,
    calibration: Calibration | None = None,
    outcome: Actual | None = None,
    begin: FloatArray | None = None,
) -> FloatArray:
    """The logarithm of the factor s^2 on the variance at each knot for each path, (n, k); `begin` until an outcome.

    Args: as of `calibrated`.
    """
    settings = calibration or Calibration()
    n = len(stamp_ns)
    knots = knots_s(float(paths.time_s[-1]))
    sets = len(paths) // n if n else 0
    begin = np.zeros((sets, len(knots))) if begin is None else begin
    if n < 2:
        return np.repeat(begin, n, axis=0)
    if outcome is None:
        outcome = outcomes(float(paths.time_s[-1]), stamp_ns, position_m, settings)
    errors = horizon_errors(
        paths, np.tile(stamp_ns, sets), stamp_ns, position_m, knots.tolist(), settings.max_gap_s, tiled(outcome, sets)
    )
    squared = np.where(errors.is_known, errors.mahalanobis2, np.nan).reshape(sets, n, len(knots))
    excess = np.log(np.maximum(squared, 1e-300) / ELLIPSE_90) - begin[:, None, :]
    step_s = np.minimum(np.diff(stamp_ns, prepend=stamp_ns[0]) / NS_PER_S, settings.max_gap_s)
    out = np.empty_like(excess)
    for k, knot_s in enumerate(knots.tolist()):
        # for each start: the first start whose outcome is not yet known
        n_known = np.searchsorted(stamp_ns + round(knot_s * NS_PER_S), stamp_ns, side="right")
        out[..., k] = adapt_scale(
            np.ascontiguousarray(excess[..., k]),
            np.ascontiguousarray(np.isfinite(squared[..., k])),
            n_known,
            step_s,
            rate_1ps=settings.rate_1ps,
            bound=float(np.log(settings.limit)),
            miss_share=MISS_SHARE,
        )
    return np.asarray((out + begin[:, None, :]).reshape(sets * n, len(knots)))


def predict_vehicles(
    model: str,
    vehicle: npt.NDArray[np.integer],
    stamp_ns: Int64Array,
    state: FloatArray,
    covariance: FloatArray | None,
    *,
    horizon_s: float = 2.5,
    step_s: float = 0.05,
    discretisation: Discretisation = "exact",
    prior: DriverPrior | None = None,
    calibration: Calibration | None = None,
    log_time_ns: Int64Array | None = None,
) -> Paths:
    """`rollout` of all rows with their measured gains, then each vehicle's covariance `calibrated` by its own record.

    Args:
        vehicle: Shape (n,): which vehicle a row is of.
        stamp_ns: Shape (n,), any order; what is known first counts as the record (`record.known_tracks`).
        state, covariance, horizon_s, step_s, discretisation, prior: As in `rollout`.
        calibration: None: the default.
        log_time_ns: Shape (n,): when the states were known; None: at their stamps.
    """
    learns = model in MODELS and MODELS[model].learns
    paths = rollout(
        model,
        state,
        covariance,
        horizon_s=horizon_s,
        step_s=step_s,
        discretisation=discretisation,
        prior=prior,
        acted=measured_acted(vehicle, stamp_ns, log_time_ns, state, covariance) if learns else None,
    )
    begin = beginning(model, float(paths.time_s[-1]))[None]
    known_ns = stamp_ns if log_time_ns is None else log_time_ns
    judged = paths.at(needed_points(paths.time_s, knots_s(float(paths.time_s[-1])).tolist()))
    log_scale = np.repeat(begin, len(state), axis=0)
    for track in known_tracks(vehicle, stamp_ns, known_ns, state, None):
        own = log_variance_scale(judged.take(track.rows), track.stamp_ns, track.state[:, :2], calibration, None, begin)
        rows = np.flatnonzero(vehicle == vehicle[track.rows[0]])  # one that was overtaken goes by the newest before it
        newest = np.searchsorted(track.known_ns, known_ns[rows], side="right") - 1
        log_scale[rows] = np.where((newest >= 0)[:, None], own[np.maximum(newest, 0)], begin)
        log_scale[track.rows] = own
    paths.position_covariance_m2[...] *= np.exp(between_knots(log_scale, paths.time_s))[..., None]
    return paths
