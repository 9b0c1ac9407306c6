"""Gains of acceleration and yaw rate on earlier drives: the prior of each vehicle's own history
(`prediction.outcome_history`).

It ships as `fleet_prior.toml`, which says what it was learned from; `python -m tests.studies.fleet_prior` makes it.
"""

from __future__ import annotations

import tomllib
from functools import lru_cache
from importlib.resources import files

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray

FLEET_PRIOR_FILE = "fleet_prior.toml"
"""Name of the shipped file with the fleet's prior; `python -m tests.studies.fleet_prior` writes it."""
HORIZON_KNOTS_S = np.array([0.5, 1.0, 2.5, 5.0])
"""Horizons (s) at which gains and ellipses are measured; between them they are interpolated. Chosen by hand."""
DERIVATIVE_PART_NAMES = ("unclear", "lasting", "new")
"""The parts that a derivative is divided into, see
`prediction.outcome_history.unclear_lasting_new_shares_of_derivatives`."""
FLEET_QUANTILE_LEVELS = np.array([0.05, 0.25, 0.5, 0.75, 0.9, 0.97])
"""Levels of the quantiles in `fleet_prior.toml`. Chosen: they hold both levels of the ellipses and the tails."""


@dataclass(frozen=True)
class FleetPrior:
    """The gains that a vehicle's history begins with; the axes are along (acceleration) and across (yaw rate).

    Attributes:
        gain: Shape (2, k, 3): the share of each part that moves the car, by each knot of `HORIZON_KNOTS_S`.
        error_m: Shape (2, k): mean absolute error that is left over.
        log_squared: Shape (k, l): quantiles at `FLEET_QUANTILE_LEVELS` of the logarithm of the squared Mahalanobis
        distance
            of the outcomes of `auto`, before any scale.
    """

    gain: FloatArray
    error_m: FloatArray
    log_squared: FloatArray


@lru_cache(maxsize=1)
def load_fleet_prior() -> FleetPrior:
    """Load the prior that ships with the package."""
    table = tomllib.loads(files("cwcli.prediction").joinpath(FLEET_PRIOR_FILE).read_text(encoding="utf-8"))
    axes = (table["along"], table["across"])
    return FleetPrior(
        gain=np.array([[axis[part] for part in DERIVATIVE_PART_NAMES] for axis in axes], dtype=np.float64).transpose(
            0, 2, 1
        ),
        error_m=np.array([axis["error_m"] for axis in axes], dtype=np.float64),
        log_squared=np.log(np.array(table["ellipse"]["squared"], dtype=np.float64)),
    )


def acting_time_from_displacement_share_s(displacement_share: FloatArray) -> FloatArray:
    """The time by each knot for which a derivative must act in full so that it moves the car by `share` t^2/2.

    The derivative changes speed (heading) at a rate that is constant between knots and at most its own. It may fade and
    reverse: an acceleration until the speed is again that of the start; a yaw rate at most as fast as it began, and
    beyond the heading of the start, as in a change of lanes. A share that needs more is not reached.

    Args:
        displacement_share: Shape (..., 2, k), in [0, 1]: of the displacement that the derivative would cause if it
            went on.

    Returns:
        Shape (..., 2, k), seconds: change of speed over acceleration, of heading over yaw rate. Linear between 0 and
        the knots, constant after the last.
    """
    out = np.empty_like(displacement_share)
    displacement_share_so_far = acted = np.zeros(displacement_share.shape[:-1])
    before_s = 0.0
    for k, knot_s in enumerate(HORIZON_KNOTS_S.tolist()):
        step_s = knot_s - before_s
        missing = displacement_share[..., k] * knot_s**2 / 2.0 - displacement_share_so_far - acted * step_s
        least = np.stack([-acted[..., 0] / step_s, np.full(acted.shape[:-1], -1.0)], axis=-1)
        rate = np.clip(2.0 * missing / step_s**2, least, 1.0)
        displacement_share_so_far = displacement_share_so_far + acted * step_s + rate * step_s**2 / 2.0
        acted = acted + rate * step_s
        out[..., k] = acted
        before_s = knot_s
    return out


def interpolate_acting_time_s(acting_s: FloatArray, time_s: FloatArray) -> FloatArray:
    """Interpolate acting times between the knots.

    Acting times (k,) give the shape of `time_s`; (m, k) with times (1 or m, ...) give (m, ...).
    """
    if acting_s.ndim == 1:
        return np.asarray(np.interp(time_s, [0.0, *HORIZON_KNOTS_S], [0.0, *acting_s]))
    slopes = acting_slopes_between_knots(acting_s)
    if len(time_s) == 1:  # the same times for all cars: one product
        inside = time_between_knots_s(time_s.reshape(-1))
        return multiply_rows_reproducibly(slopes, inside).reshape(len(acting_s), *time_s.shape[1:])
    shape = (-1,) + (1,) * (time_s.ndim - 1)
    out = np.zeros(time_s.shape)
    for k, inside in enumerate(time_between_knots_s(time_s)):
        out += slopes[:, k].reshape(shape) * inside
    return out


def acting_slopes_between_knots(acting_s: FloatArray) -> FloatArray:
    """Return the growth of acting times (m, k) in a second before each knot, (m, k)."""
    out = acting_s.copy()
    out[:, 1:] -= acting_s[:, :-1]
    return np.asarray(out / np.diff(HORIZON_KNOTS_S, prepend=0.0))


def time_between_knots_s(time_s: FloatArray) -> FloatArray:
    """Return for how long each time has been between each knot and the one before it, (k, ...)."""
    before_s = np.concatenate([[0.0], HORIZON_KNOTS_S[:-1]])
    return np.stack(
        [
            np.clip(time_s - start_s, 0.0, knot_s - start_s)
            for start_s, knot_s in zip(before_s.tolist(), HORIZON_KNOTS_S.tolist(), strict=True)
        ]
    )


def multiply_rows_reproducibly(weights: FloatArray, rows: FloatArray) -> FloatArray:
    """`weights @ rows`, (n, k) times (k, m), for a small k.

    BLAS adds in an order that depends on the number of rows. The last bit of a path would then depend on what comes
    after it in the log.
    """
    out = np.multiply(weights[:, :1], rows[0])
    for k in range(1, len(rows)):
        out += weights[:, k : k + 1] * rows[k]
    return np.asarray(out, np.float64)
