"""Result of the estimator: a track, and a report on the measurements of each source."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field

import numpy as np
import numpy.typing as npt

from cwcli.estimation.contradiction import Contradiction
from cwcli.estimation.correction import Correction
from cwcli.estimation.imu import ImuMounting
from cwcli.estimation.latency import UNSEARCHED_LATENCY, Latency
from cwcli.estimation.measurements import Kind
from cwcli.estimation.parameter import NO_PARAMETER, NO_SLOW_ERROR, NO_STAMP_ERROR, Parameter, SlowError
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray, Int64Array, Strings, repeat_string


@dataclass(frozen=True)
class SourceReport:
    """Report on the measurements of one source and kind: counts, noise, latency and errors found.

    Attributes:
        source: Name of the source.
        kind: Measured quantity; an IMU appears as ACCEL and as YAW_RATE.
        n_read: Rows handed in.
        n_used: Rows that changed the estimate.
        n_gated: Rows that the chi-square gate rejected.
        n_not_finite: Rows left out because a value or stamp was not finite.
        n_interpolated: Rows left out because they were interpolated before the log was made.
        n_repeated: Rows left out because they repeat the value before them while the vehicle moves.
        n_held_back: Rows left out because they came in a burst and are older than their stamps.
        n_resets: Times that the gate gave in after too many rejections in a row (for ACCEL and YAW_RATE: after two,
            because an inertial sensor that stays off for longer shows a manoeuvre).
        nis_mean: Mean normalised innovation squared over the used rows; expectation `nis_dof`.
        nis_dof: Degrees of freedom of one row.
        nis_bounds: 95 % chi-square bounds of the mean for as many independent rows as the autocorrelation of
            the series leaves (`consistency.effective_sample_count`).
        nis_inside: True if the mean lies inside the bounds; None with fewer than 20 rows.
        sigma: One-sigma measurement noise used (root mean variance over rows and axes).
        scatter: One sigma of the white noise on each axis by neighbouring rows alone; NaN: unknown, or inertial.
        log_likelihood: Of its rows, each after all before it; without constants.
        noise_origin: "message", "message, scaled" (raised until the innovations agree), "log" (found from the
            innovations) or "default".
        noise_scale: Factor on the variance that the messages state; NaN where they state none.
        stamp_error: POSITION: one sigma, s, of the random error of its stamps; 0: none was found.
        interval_s: Median time between two rows.
        latency: Latency that was found or given, its sigma and status.
        latency_to_reference: Latency relative to the reference source of the search, whichever clock the states use.
        bias: Additive bias at the middle of the log in the unit of the kind, NaN where none is modelled.
        bias_sigma: One sigma of the bias.
        scale: SPEED: ratio of measured to true speed; it is above 1 for a wheel that is smaller than assumed.
        lever_arm_m: SPEED: height of the estimated point (the IMU) above the point whose speed is measured: the source
            reads scale * (v - lever arm * pitch rate), the pitch rate positive nose down.
        ahead_m: POSITION, VELOCITY, ACCEL: lever arm ahead of the point whose course is the heading.
        slow_error: POSITION: the coloured part of the noise, m, of each axis. ACCEL: gravity through the road's grade,
            m/s^2 (divided by 9.80665 m/s^2 it is radians).
        follows_pitch_rate: ACCEL: whether gravity was compensated with the pitch gyroscope.
        mounting: ACCEL, YAW_RATE: how the IMU was levelled, or None.
        is_checked: Whether another source clearly agrees with it, or there is none to compare it with.
        gap_s_and_hidden_jump_m: The gap behind which the largest jump of the only fixes would not show, and that jump;
            NaN: no long gap.
    """

    source: str
    kind: Kind
    n_read: int = 0
    n_used: int = 0
    n_gated: int = 0
    n_not_finite: int = 0
    n_interpolated: int = 0
    n_repeated: int = 0
    n_held_back: int = 0
    n_resets: int = 0
    nis_mean: float = float("nan")
    nis_dof: int = 1
    nis_bounds: tuple[float, float] = (float("nan"), float("nan"))
    nis_inside: bool | None = None
    sigma: float = float("nan")
    scatter: float = float("nan")
    log_likelihood: float = 0.0
    noise_origin: str = "default"
    noise_scale: float = float("nan")
    stamp_error: Parameter = NO_STAMP_ERROR
    interval_s: float = float("nan")
    latency: Latency = UNSEARCHED_LATENCY
    latency_to_reference: Latency = UNSEARCHED_LATENCY
    bias: float = float("nan")
    bias_sigma: float = float("nan")
    scale: Parameter = NO_PARAMETER
    lever_arm_m: Parameter = NO_PARAMETER
    ahead_m: Parameter = NO_PARAMETER
    slow_error: SlowError = NO_SLOW_ERROR
    follows_pitch_rate: bool = False
    mounting: ImuMounting | None = None
    is_checked: bool = True
    gap_s_and_hidden_jump_m: tuple[float, float] = (float("nan"), float("nan"))


@dataclass(frozen=True)
class GatedMeasurements:
    """Measurements that the chi-square gate rejected, k rows in the order of their stamps.

    Attributes:
        stamp_ns: Shape (k,): as measured, latencies included.
        topic, quantity: The source and what it measures.
        nis, bound: Shape (k,): the normalised innovation squared, and the bound of the gate.
    """

    stamp_ns: Int64Array
    topic: Strings
    quantity: Strings
    nis: FloatArray
    bound: FloatArray

    def __len__(self) -> int:
        return len(self.stamp_ns)


@dataclass(frozen=True)
class TrackSummary:
    """Summary of a track without its arrays.

    Attributes:
        n_states, span_s, max_speed_mps: Its size.
        median_sigma_m: Median of the horizontal one-sigma per axis, NaN without states.
        n_flagged: States with each `StateFlag`, by its name.
        sources, notes, contradictions, corrections: As in `Track`.
    """

    n_states: int
    span_s: float
    max_speed_mps: float
    median_sigma_m: float
    n_flagged: Mapping[str, int]
    sources: tuple[SourceReport, ...]
    notes: tuple[str, ...]
    contradictions: tuple[Contradiction, ...] = ()
    corrections: tuple[Correction, ...] = ()


NO_GATED_MEASUREMENTS = GatedMeasurements(
    np.zeros(0, np.int64), repeat_string("", 0), repeat_string("", 0), np.zeros(0), np.zeros(0)
)
"""Empty list of rejected measurements."""


@dataclass(frozen=True)
class Track:
    """An estimated track.

    Attributes:
        stamp_ns: Shape (m,), int64: the output stamps asked for, on the reference source's clock (on the
            position's where that one leads the reference: see `notes`).
        state: Shape (m, 8), order `vehicle_state.STATE_NAMES`; the heading is unwrapped (continuous).
        covariance: Shape (m, 8, 8), symmetric, positive semi-definite; grows where nothing is measured.
        flags: Shape (m,): `StateFlag`s.
        sources: One report per source and kind.
        log_likelihood: Of the innovations of the forward pass.
        notes: One-line remarks for the user (resets, what could not be observed).
        manoeuvre_sigmas: Name of a manoeuvre sigma of `model.MotionParameters` -> value that was found or given.
        gated: Rows that the gate rejected; empty for the paper's filter, which has no gate.
        contradictions: Sources that contradict each other, the most important first.
        corrections: Sources whose values were wrong in a known way and were corrected.
    """

    stamp_ns: Int64Array
    state: FloatArray
    covariance: FloatArray
    flags: npt.NDArray[np.uint8]
    sources: tuple[SourceReport, ...] = ()
    log_likelihood: float = float("nan")
    notes: tuple[str, ...] = field(default=())
    manoeuvre_sigmas: Mapping[str, float] = field(default_factory=dict)
    gated: GatedMeasurements = NO_GATED_MEASUREMENTS
    contradictions: tuple[Contradiction, ...] = ()
    corrections: tuple[Correction, ...] = ()
