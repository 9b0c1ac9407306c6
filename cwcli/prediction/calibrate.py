"""Ellipses that hold what they promise: scaled by how well the vehicle's own earlier ones did.

The filter's covariance and the driver prior are models; on a given drive they may be too sure (a GNSS receiver with
coloured errors) or not sure enough (a platoon). What is known at any moment is how the predictions made a horizon ago
turned out. The scale follows them, in the manner of adaptive conformal inference (Gibbs & Candes 2021, "Adaptive
conformal inference under distribution shift"), with time instead of counts:

    d(log s^2)/dt = rate * (outside - 0.1),    outside = 1 if the latest outcome fell outside its 90 % ellipse,

so the log stays put exactly when a tenth of the time is spent outside. It uses only outcomes that were known by then.
The scale applies in full at the horizon and not at all at the start, where the filter's own covariance stands:
P(tau) is multiplied by s^(2 tau / horizon).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from cwcli.kernels.paths import adapt_scale
from cwcli.prediction.driver import DriverPrior
from cwcli.prediction.outcome import ELLIPSE_90, Actual, actual_positions, horizon_errors, tiled
from cwcli.prediction.paths import Paths
from cwcli.prediction.rollout import Discretisation, rollout
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.row_order import rows_by_stamp
from cwcli.signals.units import NS_PER_S

MISS_SHARE = 0.1


@dataclass(frozen=True)
class Calibration:
    """How fast and how far the scale may go.

    Attributes:
        rate_1ps: Of the log variance while outside, per second: 3 s outside (one manoeuvre) raise it 2.2-fold, and it
            takes 27 s inside to come back.
        limit: Largest factor on the variance, and the inverse of the smallest.
        horizon_s: Outcomes this far ahead steer it.
        max_gap_s: Track gaps longer than this give no outcome; the scale keeps its value meanwhile.
    """

    rate_1ps: float = 0.3
    limit: float = 16.0
    horizon_s: float = 2.5
    max_gap_s: float = 0.5


def calibrated(
    paths: Paths,
    stamp_ns: Int64Array,
    position_m: FloatArray,
    calibration: Calibration | None = None,
    outcome: Actual | None = None,
) -> Paths:
    """The paths of one vehicle with their covariance scaled by its own record.

    Args:
        paths: n paths, one from each stamp; or several such sets, one below the other, each with a record of its own.
        stamp_ns: Shape (n,), strictly increasing.
        position_m: Shape (n, 2): where the vehicle was at its stamps: the outcomes.
        calibration: None: the default.
        outcome: `outcomes` of the same starts; None: they are looked up.
    """
    scale = variance_scale(paths, stamp_ns, position_m, calibration, outcome)
    horizon_s = _horizon(paths, calibration or Calibration())
    power = np.minimum(paths.time_s / horizon_s, 1.0)
    factor = scale[:, None] ** power[None, :]
    return replace(paths, position_covariance_m2=paths.position_covariance_m2 * factor[..., None])


def outcomes(
    horizon_s: float, stamp_ns: Int64Array, position_m: FloatArray, calibration: Calibration | None = None
) -> Actual:
    """Where the vehicle was when its paths of `horizon_s` are judged: the same for every model."""
    settings = calibration or Calibration()
    judged_s = min(settings.horizon_s, horizon_s)
    return actual_positions(stamp_ns, stamp_ns, position_m, [judged_s], settings.max_gap_s)


def variance_scale(
    paths: Paths,
    stamp_ns: Int64Array,
    position_m: FloatArray,
    calibration: Calibration | None = None,
    outcome: Actual | None = None,
) -> FloatArray:
    """The factor s^2 on the variance at the horizon for each path, shape (n,); 1 until there is an outcome.

    Args: as of `calibrated`.
    """
    settings = calibration or Calibration()
    n = len(stamp_ns)
    if n < 2:
        return np.ones(len(paths))
    sets = len(paths) // n
    horizon_s = _horizon(paths, settings)
    if outcome is None:
        outcome = outcomes(horizon_s, stamp_ns, position_m, settings)
    errors = horizon_errors(
        paths, np.tile(stamp_ns, sets), stamp_ns, position_m, [horizon_s], settings.max_gap_s, tiled(outcome, sets)
    )
    squared = np.where(errors.is_known[:, 0], errors.mahalanobis2[:, 0], np.nan).reshape(sets, n)
    known_ns = stamp_ns + round(horizon_s * NS_PER_S)
    # for each start: the first start whose outcome is not yet known
    n_known = np.searchsorted(known_ns, stamp_ns, side="right")
    step_s = np.minimum(np.diff(stamp_ns, prepend=stamp_ns[0]) / NS_PER_S, settings.max_gap_s)
    log_scale = adapt_scale(
        np.log(np.maximum(squared, 1e-300) / ELLIPSE_90),
        np.isfinite(squared),
        n_known,
        step_s,
        rate_1ps=settings.rate_1ps,
        bound=float(np.log(settings.limit)),
        miss_share=MISS_SHARE,
    )
    return np.asarray(np.exp(log_scale.ravel()))


def _horizon(paths: Paths, settings: Calibration) -> float:
    return min(settings.horizon_s, float(paths.time_s[-1]))


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
) -> Paths:
    """`rollout` of all rows, then each vehicle's covariance `calibrated` by its own record.

    Args:
        vehicle: Shape (n,): which vehicle a row is of.
        stamp_ns: Shape (n,), any order; of equal stamps of a vehicle the first counts as its record.
        state, covariance, horizon_s, step_s, discretisation, prior: As in `rollout`.
        calibration: None: the default.
    """
    paths = rollout(
        model,
        state,
        covariance,
        horizon_s=horizon_s,
        step_s=step_s,
        discretisation=discretisation,
        prior=prior,
    )
    settings = calibration or Calibration()
    power = np.minimum(paths.time_s / _horizon(paths, settings), 1.0)
    for one in np.unique(vehicle):
        rows = np.flatnonzero(vehicle == one)
        own = rows_by_stamp(stamp_ns, rows)
        kept = stamp_ns[own]
        scale = variance_scale(paths.take(own), kept, state[own, :2], settings)
        each = scale[np.searchsorted(kept, stamp_ns[rows])]
        paths.position_covariance_m2[rows] *= (each[:, None] ** power)[..., None]
    return paths
