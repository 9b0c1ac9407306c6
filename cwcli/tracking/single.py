"""One target: filter, smooth, consistency. The loop is a kernel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cwcli.kernels import track as kernel
from cwcli.metrics.chi_square import mean_bounds
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.tracking.config import FILTERS, FilterConfig
from cwcli.tracking.prepare import Rows

USED, GATED, STARTED, SINGULAR, PREDICTED, EMPTY = range(6)
Int8Array = npt.NDArray[np.int8]


@dataclass(frozen=True)
class Consistency:
    """Innovations of one source: do their sizes fit the filter's own covariance?

    Attributes:
        n_used, n_gated: Detections that updated the filter, and those outside the gate.
        nis_mean: Mean normalised innovation squared of all of them.
        dof: Mean number of measured values, which `nis_mean` should be.
        low, high: 95 % bounds of `nis_mean`.
    """

    n_used: int
    n_gated: int
    nis_mean: float
    dof: float
    low: float
    high: float

    @property
    def is_inside(self) -> bool:
        """True when the mean lies inside its bounds."""
        return self.low <= self.nis_mean <= self.high


@dataclass(frozen=True)
class FilterOutput:
    """What the kernel leaves, one row per row of the input.

    Attributes:
        state: Shape (n, d), SI units, tracking frame; NaN before the start. d and the order: `MODELS[model].states`.
        covariance: Shape (n, d, d).
        innovation: Shape (n, 3), NaN where not measured.
        nis: Shape (n,), NaN where there was no update.
        n_values: Shape (n,), int8: values in the innovation.
        status: Shape (n,), int8: USED, GATED, STARTED, SINGULAR, PREDICTED or EMPTY.
        log_likelihood: Sum over the updates.
    """

    state: FloatArray
    covariance: FloatArray
    innovation: FloatArray
    nis: FloatArray
    n_values: Int8Array
    status: Int8Array
    log_likelihood: float


def _elapsed_s(stamp_ns: Int64Array) -> FloatArray:
    out = np.zeros(len(stamp_ns))
    np.subtract(stamp_ns[1:], stamp_ns[:-1], out=out[1:], casting="unsafe")
    out *= 1e-9
    out[out < 0.0] = np.inf  # more than 292 years: the difference overflowed
    return out


def run_filter(rows: Rows, config: FilterConfig, *, smooth: bool | None = None) -> FilterOutput:
    """Filter rows that all belong to one target, and smooth them when `smooth` (default: `config.smooth`).

    The state at a row is after its update: with `smooth=False` nothing later than the row went into it.
    """
    n = len(rows)
    code = config.motion.code
    d = kernel.n_states(code)
    state, predicted = np.empty((n, d)), np.empty((n, d))
    covariance, predicted_covariance, jacobian = np.empty((n, d, d)), np.empty((n, d, d)), np.empty((n, d, d))
    innovation, nis, each = np.empty((n, 3)), np.empty(n), np.empty(n)
    n_values, status = np.empty(n, np.int8), np.empty(n, np.int8)
    total = kernel.filter_one(
        _elapsed_s(rows.stamp_ns), rows.kind, rows.z, rows.r, rows.origin, code, FILTERS[config.filter],
        config.kernel_params(), config.gates(), state, covariance, predicted, predicted_covariance, jacobian,
        innovation, nis, each, n_values, status,
    )  # fmt: skip
    if config.smooth if smooth is None else smooth:
        kernel.smooth_one(state, covariance, predicted, predicted_covariance, jacobian)
    return FilterOutput(state, covariance, innovation, nis, n_values, status, total)


def log_likelihood(rows: Rows, config: FilterConfig) -> float:
    """Log-likelihood of the rows under the filter, without keeping the states. No gate: every row counts."""
    n, code = len(rows), config.motion.code
    d = kernel.n_states(code)
    one, square = np.empty((1, d)), np.empty((1, d, d))
    return kernel.filter_one(
        _elapsed_s(rows.stamp_ns), rows.kind, rows.z, rows.r, rows.origin, code, FILTERS[config.filter],
        config.kernel_params(), np.zeros(4), one, square, one.copy(), square.copy(), square.copy(),
        np.empty((n, 3)), np.empty(n), np.empty(n), np.empty(n, np.int8), np.empty(n, np.int8),
    )  # fmt: skip


def consistency(
    sources: tuple[str, ...],
    source: Int64Array,
    nis: FloatArray,
    n_values: Int8Array,
    status: Int8Array,
) -> dict[str, Consistency]:
    """Mean NIS of each source with its 95 % bounds (Bar-Shalom et al., Estimation with Applications, 5.4.2).

    Args:
        sources: Names.
        source: Shape (n,), index into `sources`, -1 = no detection.
        nis, n_values, status: Shape (n,), as in `FilterOutput`.
    """
    out = {}
    for k, name in enumerate(sources):
        mine = (source == k) & np.isfinite(nis)
        n = int(mine.sum())
        dof = float(n_values[mine].mean()) if n else np.nan
        low, high = mean_bounds(dof, n)
        out[name] = Consistency(
            n_used=int((mine & (status == USED)).sum()),
            n_gated=int((mine & (status != USED)).sum()),
            nis_mean=float(nis[mine].mean()) if n else np.nan,
            dof=dof,
            low=low,
            high=high,
        )
    return out
