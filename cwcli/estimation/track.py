"""The estimator's front door: measurements in, a track with diagnostics out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from cwcli.estimation.config import EstimatorConfig
from cwcli.estimation.measurements import Kind, Measurements
from cwcli.signals.columns import FloatArray, Int64Array

STATE_NAMES = (
    "x_m",
    "y_m",
    "speed_mps",
    "heading_rad",
    "accel_mps2",
    "yaw_rate_radps",
    "jerk_mps3",
    "yaw_accel_radps2",
)


@dataclass(frozen=True)
class SourceReport:
    """What became of one source's measurements of one kind.

    Attributes:
        source: Name of the source.
        kind: What it measures; an IMU appears as ACCEL and as YAW_RATE.
        n_read: Rows handed in.
        n_used: Rows that changed the estimate.
        n_gated: Rows that the chi-square gate rejected.
        n_not_finite: Rows left out because a value or stamp was not finite.
        n_resets: Times that the gate gave in after too many rejections in a row.
        nis_mean: Mean normalised innovation squared over n_used + n_gated rows; expectation `nis_dof`.
        nis_dof: Degrees of freedom of one row.
        nis_bounds: 95 % bounds of the mean.
        nis_inside: True if the mean lies inside the bounds; None with fewer than 20 rows.
        sigma: One-sigma measurement noise used (root mean variance over rows and axes).
        noise_origin: "message", "log" (found from the innovations) or "default".
        latency_s: Latency that was corrected, positive = late.
        latency_sigma_s: One sigma; NaN where it was not estimated.
        latency_status: "reference", "estimated", "given", "not observable" or "off".
        bias: Additive bias at the middle of the log in the unit of the kind, NaN where none is modelled.
        bias_sigma: One sigma of the bias.
    """

    source: str
    kind: Kind
    n_read: int = 0
    n_used: int = 0
    n_gated: int = 0
    n_not_finite: int = 0
    n_resets: int = 0
    nis_mean: float = float("nan")
    nis_dof: int = 1
    nis_bounds: tuple[float, float] = (float("nan"), float("nan"))
    nis_inside: bool | None = None
    sigma: float = float("nan")
    noise_origin: str = "default"
    latency_s: float = 0.0
    latency_sigma_s: float = float("nan")
    latency_status: str = "off"
    bias: float = float("nan")
    bias_sigma: float = float("nan")


@dataclass(frozen=True)
class Track:
    """An estimated track.

    Attributes:
        stamp_ns: Shape (m,), int64: the output stamps asked for, on the reference source's clock.
        state: Shape (m, 8), order `STATE_NAMES`; the heading is unwrapped (continuous).
        covariance: Shape (m, 8, 8), symmetric, positive semi-definite. Rows outside the data grow as the model says.
        sources: One report per source and kind.
        log_likelihood: Of the innovations of the forward pass.
        notes: One-line remarks for the user (resets, what could not be observed).
    """

    stamp_ns: Int64Array
    state: FloatArray
    covariance: FloatArray
    sources: tuple[SourceReport, ...] = ()
    log_likelihood: float = float("nan")
    notes: tuple[str, ...] = field(default=())


def estimate_track(
    measurements: Sequence[Measurements],
    config: EstimatorConfig,
    output_stamp_ns: Int64Array | None = None,
) -> Track:
    """Estimate one vehicle's track.

    Args:
        measurements: Any mix of sources and kinds; at least one POSITION.
        config: Settings.
        output_stamp_ns: Shape (m,), increasing: where the state is wanted. None: a grid of `config.rate_hz` over the
            span of the measurements.

    Returns:
        The track at the output stamps.

    Raises:
        DataError: If no position is finite.
    """
    raise NotImplementedError


def estimate_tracks(
    groups: Sequence[tuple[Sequence[Measurements], Int64Array | None]],
    config: EstimatorConfig,
) -> list[Track]:
    """Estimate many vehicles' tracks: `estimate_track` for each (measurements, output stamps)."""
    return [estimate_track(measurements, config, stamps) for measurements, stamps in groups]
