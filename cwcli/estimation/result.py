"""What the estimator finds: a track, and what became of each source's measurements."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from cwcli.estimation.contradiction import Contradiction
from cwcli.estimation.imu import ImuMounting
from cwcli.estimation.latency import NO_LATENCY, Latency
from cwcli.estimation.measurements import Kind
from cwcli.estimation.parameter import EXACT_STAMPS, NO_PARAMETER, NO_SLOW_ERROR, Parameter, SlowError
from cwcli.signals.columns import FloatArray, Int64Array, Strings, constant_strings


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
        n_interpolated: IMU rows left out because they were interpolated before the log was made.
        n_held_back: Rows left out because they came in a burst, older than their stamps say.
        n_resets: Times that the gate gave in after too many rejections in a row (for ACCEL and YAW_RATE: after two,
            because an inertial sensor that stays off for longer shows a manoeuvre).
        nis_mean: Mean normalised innovation squared over the used rows; expectation `nis_dof`.
        nis_dof: Degrees of freedom of one row.
        nis_bounds: 95 % chi-square bounds of the mean for as many independent rows as the autocorrelation of
            the series leaves (`consistency.effective_count`).
        nis_inside: True if the mean lies inside the bounds; None with fewer than 20 rows.
        sigma: One-sigma measurement noise used (root mean variance over rows and axes).
        noise_origin: "message", "message, scaled" (raised until the innovations agree), "log" (found from the
            innovations) or "default".
        noise_scale: What the variance that the messages state was multiplied by; NaN where they state none.
        stamp_error: POSITION: one sigma, s, by which its stamps err from row to row; 0: nothing shows that they do.
        interval_s: Between two rows, as a rule.
        latency: What was found or given, its sigma, and what was made of it.
        compared: What was found against the source that all were compared with, whichever clock counts in the end.
        bias: Additive bias at the middle of the log in the unit of the kind, NaN where none is modelled.
        bias_sigma: One sigma of the bias.
        scale: SPEED: what the source reads for a true 1; a wheel that is taken for larger than it is reads above 1.
        lever_arm_m: SPEED: by how much the estimated point (the IMU) is higher than the point whose speed is measured:
            the source reads scale * (v - lever arm * pitch rate), the pitch rate positive nose down.
        ahead_m: POSITION, VELOCITY, ACCEL: by how much it stands ahead of the point whose course is the heading.
        slow_error: POSITION: the coloured part of the noise, m, of each axis. ACCEL: gravity through the road's grade,
            m/s^2 (divided by 9.80665 m/s^2 it is radians).
        follows_pitch_rate: ACCEL: gravity through what the pitch gyroscope turns was taken out first.
        mounting: ACCEL, YAW_RATE: how the IMU was levelled, or None.
    """

    source: str
    kind: Kind
    n_read: int = 0
    n_used: int = 0
    n_gated: int = 0
    n_not_finite: int = 0
    n_interpolated: int = 0
    n_held_back: int = 0
    n_resets: int = 0
    nis_mean: float = float("nan")
    nis_dof: int = 1
    nis_bounds: tuple[float, float] = (float("nan"), float("nan"))
    nis_inside: bool | None = None
    sigma: float = float("nan")
    noise_origin: str = "default"
    noise_scale: float = float("nan")
    stamp_error: Parameter = EXACT_STAMPS
    interval_s: float = float("nan")
    latency: Latency = NO_LATENCY
    compared: Latency = NO_LATENCY
    bias: float = float("nan")
    bias_sigma: float = float("nan")
    scale: Parameter = NO_PARAMETER
    lever_arm_m: Parameter = NO_PARAMETER
    ahead_m: Parameter = NO_PARAMETER
    slow_error: SlowError = NO_SLOW_ERROR
    follows_pitch_rate: bool = False
    mounting: ImuMounting | None = None


@dataclass(frozen=True)
class Gated:
    """Measurements that the chi-square gate rejected, k rows in the order of their stamps.

    Attributes:
        stamp_ns: Shape (k,): as measured, latencies included.
        topic, quantity: The source and what it measures.
        nis, bound: Shape (k,): the normalised innovation squared, and the largest that is believed.
    """

    stamp_ns: Int64Array
    topic: Strings
    quantity: Strings
    nis: FloatArray
    bound: FloatArray

    def __len__(self) -> int:
        return len(self.stamp_ns)


NOTHING_GATED = Gated(np.zeros(0, np.int64), constant_strings("", 0), constant_strings("", 0), np.zeros(0), np.zeros(0))


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
        manoeuvre: Sigma of the motion model -> what was found or given; of `model.ModelParameters`.
        gated: What the gate rejected, one by one; nothing of the paper's filter, which has no gate.
        contradictions: Sources that can't both be right, the one that matters most first.
    """

    stamp_ns: Int64Array
    state: FloatArray
    covariance: FloatArray
    flags: npt.NDArray[np.uint8]
    sources: tuple[SourceReport, ...] = ()
    log_likelihood: float = float("nan")
    notes: tuple[str, ...] = field(default=())
    manoeuvre: Mapping[str, float] = field(default_factory=dict)
    gated: Gated = NOTHING_GATED
    contradictions: tuple[Contradiction, ...] = ()
