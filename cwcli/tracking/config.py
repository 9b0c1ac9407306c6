"""Settings of the filters and of the tracker. Registries are literal dicts: a motion model is one line here."""

from __future__ import annotations

import operator
from typing import Annotated, Literal

from cwcli.errors import UsageError
from cwcli.kernels import track as kernel
from cwcli.lazy_dataclass import dataclass
from cwcli.metrics.chi_square import nis_gate_limit
from cwcli.option import Option


@dataclass(frozen=True)
class MotionModel:
    """A motion model of the kernel.

    Attributes:
        kernel_model: What the kernel computes.
        states: Names of the states, SI units.
        noise: Default density of the driving noise: acceleration in m/s^1.5, or jerk in m/s^2.5 for `ca`.
        turn_noise: Default density of the turn-rate noise, rad/s^1.5, 0 where the model has none.
        start_sigma: Default 1-sigma at the start of what comes after vx, vy.
        doc: One line for `--help`.
    """

    kernel_model: kernel.Model
    states: tuple[str, ...]
    noise: float
    turn_noise: float
    start_sigma: float
    doc: str


_CV_STATES = ("x_m", "y_m", "vx_mps", "vy_mps")
"""States of the constant-velocity model, which the other models extend."""
MOTION_MODELS: dict[str, MotionModel] = {
    "cv": MotionModel(
        kernel.Model.CV, _CV_STATES, 1.0, 0.0, 0.0, "constant velocity, accelerations as noise (xiang2019 eq. 15)"
    ),
    "ca": MotionModel(kernel.Model.CA, (*_CV_STATES, "ax_mps2", "ay_mps2"), 1.0, 0.0, 2.0, "constant acceleration"),
    "ctrv": MotionModel(
        kernel.Model.CTRV, (*_CV_STATES, "turn_rate_radps"), 0.3, 0.2, 0.3, "constant turn rate and velocity"
    ),
}
"""Name -> motion model. The noises are chosen by hand; `--tune` fits them to a log."""
FilterName = Literal["ukf", "ekf"]
IS_UNSCENTED_BY_FILTER: dict[FilterName, bool] = {"ukf": True, "ekf": False}
"""Name of a filter -> whether it is the unscented one."""


def _check_share_of_range(share: float) -> float:
    """Check that a share of the range is 0 or more, and return it.

    Raises:
        UsageError: It is negative or NaN.
    """
    if not share >= 0.0:
        raise UsageError(
            f"--cartesian-below {share:g} is not a share of the range", hint="give 0 or more; 0 means never"
        )
    return share


@dataclass(frozen=True)
class FilterConfig:
    """Settings of the filter of one target.

    Attributes:
        filter: `ukf` or `ekf`.
        model: A key of `MODELS`.
        noise, turn_noise: Process noise densities (see `MotionModel`); None takes the model's default.
        start_speed_mps: 1-sigma of each velocity component before anything is known of it.
        start_sigma: The same for turn rate or acceleration; None takes the model's default.
        kappa: Sigma points lie at sqrt(n + kappa) sigma. At 0 or more all weights are positive.
        cartesian_below: A radar detection is taken in Cartesian form while the predicted position's sigma is more
            than this fraction of the range: there the bearing is no line, and at range 0 it does not exist. 0 = never.
        gate_probability: A detection outside this chi-square region is rejected. 1 = none is rejected.
        restart_after: The filter starts anew after this many rejections in a row. 0 = never.
        max_gap_s: A longer gap without detections is not bridged.
        smooth: Smooth after filtering.
        tune: Estimate process and measurement noise by maximum likelihood first.
    """

    filter: Annotated[Literal["ukf", "ekf"], Option("--filter", "Unscented or extended Kalman filter (xiang2019).")] = (
        "ukf"
    )
    model: Annotated[
        Literal["ctrv", "ca", "cv"],
        Option(
            "--model",
            "Motion of a target: constant turn rate and velocity, constant acceleration, or constant velocity "
            "(the paper's).",
        ),
    ] = "ctrv"
    noise: Annotated[
        float | None,
        Option(
            "--noise",
            "Process noise: acceleration in m/s^1.5, or jerk in m/s^2.5 for ca. --tune starts from it.",
            metavar="DENSITY",
            default="the model's own",
            above=0.0,
            at_most=1000.0,
        ),
    ] = None
    turn_noise: float | None = None
    start_speed_mps: float = 10.0
    start_sigma: float | None = None
    kappa: float = 0.0
    cartesian_below: Annotated[
        float,
        Option(
            "--cartesian-below",
            "Radar detections are taken in Cartesian form while the position's sigma is above this share of the range; "
            "0: never, as in the paper.",
            metavar="SHARE",
            default="0.3",
            at_most=1.0,
            parse=_check_share_of_range,
        ),
    ] = 0.3
    gate_probability: Annotated[
        float,
        Option(
            "--gate",
            "Probability that a good detection passes the gate; 1 turns the gate off.",
            metavar="P",
            above=0.0,
            at_most=1.0,
        ),
    ] = 0.9999
    restart_after: int = 10
    max_gap_s: float = 5.0
    smooth: Annotated[
        bool,
        Option("--causal", "Do not smooth: no state uses a later detection.", parse=operator.not_),
    ] = True
    tune: Annotated[
        bool,
        Option(
            "--tune/--no-tune",
            "Find process and measurement noise from the detections by maximum likelihood, without the truth.",
        ),
    ] = False

    def __post_init__(self) -> None:
        if self.filter not in IS_UNSCENTED_BY_FILTER:
            raise ValueError(f"unknown filter {self.filter!r}; known: {', '.join(IS_UNSCENTED_BY_FILTER)}")
        if self.model not in MOTION_MODELS:
            raise ValueError(f"unknown motion model {self.model!r}; known: {', '.join(MOTION_MODELS)}")
        if self.kappa < 0.0:
            raise ValueError("kappa must be 0 or more: negative weights can make a covariance negative")
        if not 0.0 < self.gate_probability <= 1.0:
            raise ValueError(f"gate_probability {self.gate_probability} is not in (0, 1]")

    @property
    def motion_model(self) -> MotionModel:
        """The motion model."""
        return MOTION_MODELS[self.model]

    def build_kernel_filter(self, *, gated: bool = True) -> kernel.Filter:
        """Build the kernel's filter; without `gated` no detection is rejected."""
        motion, probability = self.motion_model, self.gate_probability if gated else 1.0
        return kernel.Filter(
            {
                "model": motion.kernel_model,
                "d": len(motion.states),
                "unscented": IS_UNSCENTED_BY_FILTER[self.filter],
                "main_noise": (motion.noise if self.noise is None else self.noise) ** 2,
                "turn_noise": (motion.turn_noise if self.turn_noise is None else self.turn_noise) ** 2,
                "speed_variance": self.start_speed_mps**2,
                "extra_variance": (motion.start_sigma if self.start_sigma is None else self.start_sigma) ** 2,
                "kappa": self.kappa,
                "cartesian_below": self.cartesian_below,
                "gate_nis": [0.0, *(nis_gate_limit(probability, dof) for dof in (1, 2, 3))],
                "max_gap_s": self.max_gap_s,
                "restart_after": self.restart_after,
            }
        )


@dataclass(frozen=True)
class TrackerConfig:
    """Settings of a tracker of many targets: the filter of each, and when tracks begin, are confirmed and end.

    Attributes:
        single: The filter of each track. Its `gate_probability` is the association gate.
        new_target_ratio: Expected new targets per expected false detection: the prior odds of a new track.
        confirm_probability: A track is confirmed when its probability of existence passes this.
        delete_probability: A confirmed track ends below this.
        tentative_misses: A track that is not confirmed ends after this many misses in a row.
        mean_life_s: Mean lifetime of a target; existence fades by exp(-dt / mean_life_s).
        max_coast_s: A track without detections for longer ends.
        max_tracks: Largest number of tracks at a time; further births are refused and counted.
        max_scan: Largest number of detections of one scan; further ones are rejected and counted.
    """

    single: FilterConfig = FilterConfig()
    new_target_ratio: float = 0.01
    confirm_probability: float = 0.95
    delete_probability: float = 0.05
    tentative_misses: int = 2
    mean_life_s: float = 60.0
    max_coast_s: float = 2.0
    max_tracks: int = 500
    max_scan: int = 20_000
