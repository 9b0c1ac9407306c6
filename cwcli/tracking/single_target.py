"""Filter and smooth the detections of one target, and check the innovations. The loop is a kernel."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.kernels import track as kernel
from cwcli.kernels.track import RowStatus
from cwcli.lazy_dataclass import dataclass
from cwcli.metrics.chi_square import chi_square_mean_bounds
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.tracking.config import FilterConfig
from cwcli.tracking.prepare import DetectionRows

Int8Array = npt.NDArray[np.int8]


@dataclass(frozen=True)
class NisConsistency:
    """Mean NIS of one source: whether its innovations fit the filter's own covariance.

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
    def is_within_bounds(self) -> bool:
        """True when the mean lies inside its bounds."""
        return self.low <= self.nis_mean <= self.high


@dataclass(frozen=True)
class FilterOutput:
    """Output of the filter, one row per row of the input.

    Attributes:
        state: Shape (n, d), SI units, tracking frame; NaN before the start. d and the order: `MODELS[model].states`.
        covariance: Shape (n, d, d).
        innovation: Shape (n, 3), NaN where not measured.
        nis: Shape (n,), NaN where there was no update.
        n_values: Shape (n,), int8: values in the innovation.
        status: Shape (n,), int8: a `RowStatus`.
        log_likelihood: Log-likelihood of all updates.
    """

    state: FloatArray
    covariance: FloatArray
    innovation: FloatArray
    nis: FloatArray
    n_values: Int8Array
    status: Int8Array
    log_likelihood: float


def _time_steps_s(stamp_ns: Int64Array) -> FloatArray:
    """Time since the row before, s, (n,); 0 at the first row."""
    out = np.zeros(len(stamp_ns))
    np.subtract(stamp_ns[1:], stamp_ns[:-1], out=out[1:], casting="unsafe")
    out *= 1e-9
    out[out < 0.0] = np.inf  # more than 292 years: the difference overflowed
    return out


def filter_single_target(rows: DetectionRows, config: FilterConfig, *, smooth: bool | None = None) -> FilterOutput:
    """Filter rows that all belong to one target, and smooth them when `smooth` (default: `config.smooth`).

    The state at a row is after its update; with `smooth=False` it uses nothing later than the row.
    """
    smooth = config.smooth if smooth is None else smooth
    out = kernel.run(config.build_kernel_filter(), _time_steps_s(rows.stamp_ns), rows.to_kernel_rows(), smooth=smooth)
    return FilterOutput(
        out.state, out.covariance, out.innovation, out.nis, out.n_values, out.status, out.log_likelihood
    )


def log_likelihood_of_rows(rows: DetectionRows, config: FilterConfig) -> float:
    """Log-likelihood of the rows under the filter, without keeping the states. No gate: every row counts."""
    return kernel.log_likelihood(
        config.build_kernel_filter(gated=False), _time_steps_s(rows.stamp_ns), rows.to_kernel_rows()
    )


def nis_consistency_by_source(
    sources: tuple[str, ...],
    source: Int64Array,
    nis: FloatArray,
    n_values: Int8Array,
    status: Int8Array,
) -> dict[str, NisConsistency]:
    """The mean NIS of each source with its 95 % bounds (Bar-Shalom et al., Estimation with Applications, 5.4.2).

    Args:
        source: Shape (n,), index into `sources`, -1 = no detection.
        nis, n_values, status: Shape (n,), as in `FilterOutput`.
    """
    out = {}
    for k, name in enumerate(sources):
        mine = (source == k) & np.isfinite(nis)
        n = int(mine.sum())
        dof = float(n_values[mine].mean()) if n else np.nan
        low, high = chi_square_mean_bounds(dof, n)
        out[name] = NisConsistency(
            n_used=int((mine & (status == RowStatus.USED)).sum()),
            n_gated=int((mine & (status != RowStatus.USED)).sum()),
            nis_mean=float(nis[mine].mean()) if n else np.nan,
            dof=dof,
            low=low,
            high=high,
        )
    return out
