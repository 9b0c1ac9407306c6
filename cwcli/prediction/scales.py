"""Scales of the ellipses along a path: given at knots, log-linear between them, 1 at the start."""

from __future__ import annotations

import numpy as np

from cwcli.lazy_dataclass import replace
from cwcli.prediction.fleet import HORIZON_KNOTS_S, multiply_rows_reproducibly
from cwcli.prediction.paths import Paths
from cwcli.prediction.rollout import ROWS_PER_BATCH
from cwcli.signals.columns import FloatArray

LogScales = FloatArray
"""Logarithms of the scales of the ellipses at the knots, shape (..., k, 2): of the core and of the whole."""


def horizon_knots_of_scales_s(horizon_s: float) -> FloatArray:
    """Times (s) at which the scale of paths of this horizon is measured, shape (k,): the knots up to the path's end."""
    return np.asarray(
        [*(knot for knot in HORIZON_KNOTS_S if knot < horizon_s - 1e-9), min(horizon_s, float(HORIZON_KNOTS_S[-1]))]
    )


def interpolate_log_scale(log_scale: LogScales, time_s: FloatArray) -> FloatArray:
    """Interpolate the log scale from the knots (n, k) to the times of the paths, (n, times)."""
    knots = np.concatenate([[0.0], horizon_knots_of_scales_s(float(time_s[-1]))])
    hats = np.stack([np.interp(time_s, knots, row) for row in np.eye(len(knots))[1:]])
    return multiply_rows_reproducibly(log_scale, hats)


def scale_path_covariance_in_place(paths: Paths, log_scale: LogScales, has_core: bool) -> Paths:
    """Scale the covariance of the paths in place; with `has_core` the result has the factor for the 50 % ellipse."""
    core_factor = np.empty(paths.x_m.shape) if has_core else None
    for first in range(0, len(paths), ROWS_PER_BATCH):
        rows = slice(first, first + ROWS_PER_BATCH)
        covariance, whole = (
            paths.position_covariance_m2[rows],
            interpolate_log_scale(log_scale[rows, :, 1], paths.time_s),
        )
        factor = np.exp(whole)
        remaining_covariance = np.maximum(1.0 - factor, 0.0)[..., None] * covariance[:, :1]
        covariance *= factor[..., None]
        covariance += remaining_covariance
        if core_factor is not None:
            core_factor[rows] = np.exp(interpolate_log_scale(log_scale[rows, :, 0], paths.time_s) - whole)
    return replace(paths, core_factor=core_factor)
