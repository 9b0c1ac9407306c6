"""Options of the observers."""

from __future__ import annotations

import math
from dataclasses import field, fields
from typing import Annotated, Literal

from cwcli.dynamics.samples import DEFAULT_PREVIEW_POINT_DISTANCE_M
from cwcli.errors import UsageError
from cwcli.lazy_dataclass import dataclass
from cwcli.option import Option


@dataclass(frozen=True)
class FilterNoise:
    """The standard deviations and gates that the default filter assumes.

    A `*_walk_*` is the standard deviation of a random walk after one second.

    Attributes:
        lateral_speed_walk_mps, yaw_rate_walk_radps: Errors of the single-track model: wind, banked road, tyres.
        steer_walk_rad: How the driver steers.
        curvature_walk_1pm: Change of the road's curvature over one metre (not second): after 100 m ten times as much.
        load_sigma, load_walk: Standard deviation and walk of nominal mass / mass, if the load is estimated.
        gyro_bias_radps, gyro_bias_walk_radps: Bias of the measured yaw rate and its walk.
        camera_yaw_rad, camera_yaw_walk_rad: Yaw of the camera's mounting and its walk.
        lateral_sigma_m, heading_sigma_rad, curvature_sigma_1pm: Sigmas of frames that carry none.
        lateral_floor_m, heading_floor_rad, curvature_floor_1pm: Errors that frames share in addition to their sigmas: a
            parabola does not fit a road whose curvature changes, and the errors of one frame's values are correlated.
        floor_share: Share of the floors that is added to every frame's sigmas (as squares), as if it were new in each
            frame. Most of the error lasts, and a lasting error hardly disturbs the changes between frames.
        curvature_share: Share of the curvature that is added to its sigma in the same way: lane methods draw bends too
            flat, and an error of the camera's pitch or height scales them.
        yaw_rate_sigma_radps, steer_sigma_rad: Sigmas of sensors that carry none.
        start_lateral_speed_mps, start_yaw_rate_radps, start_steer_rad, start_curvature_1pm: Sigmas at the first frame,
            around a car that follows the road steadily.
        gate: Innovations beyond this many sigmas are gated.
        restart_after: Number of gated frames in a row that starts the filter anew, or the lane alone if a yaw rate is
            measured.
    """

    lateral_speed_walk_mps: float = 0.05
    yaw_rate_walk_radps: float = 0.01
    steer_walk_rad: float = 0.003
    curvature_walk_1pm: float = 4e-5
    load_sigma: float = 0.2
    load_walk: float = 1e-4
    gyro_bias_radps: float = 0.002
    gyro_bias_walk_radps: float = 2e-5
    camera_yaw_rad: float = 0.002
    camera_yaw_walk_rad: float = 1e-5
    lateral_sigma_m: float = 0.10
    heading_sigma_rad: float = 0.005
    curvature_sigma_1pm: float = 3e-4
    lateral_floor_m: float = 0.03
    heading_floor_rad: float = 0.0015
    curvature_floor_1pm: float = 2e-4
    floor_share: float = 0.5
    curvature_share: float = 0.3
    yaw_rate_sigma_radps: float = 0.002
    steer_sigma_rad: float = 0.002
    start_lateral_speed_mps: float = 1.0
    start_yaw_rate_radps: float = 0.3
    start_steer_rad: float = 0.05
    start_curvature_1pm: float = 3e-3
    gate: float = 5.0
    restart_after: int = 4


@dataclass(frozen=True)
class ObserverConfig:
    """Options of `observe`.

    Attributes:
        method: A key of `METHODS`.
        preview_m: Distance of the preview point ahead of the camera.
        estimate_load: "cwcli": also estimate the car's mass.
        max_coast_s: Without boundaries for longer than this there is no state.
        max_gap_s: A pause of the frames longer than this starts the observer anew.
        max_speed_gap_s: The speed is not interpolated or kept over a longer gap.
        noise: "cwcli": see `FilterNoise`.
        period_s: "zhang2011": the observers' sampling time; None: the median time between frames.
        steer_rate: "zhang2011": a key of `steering.HEADING_RATE_METHODS`.
        process_noise, lane_noise: "zhang2011": R1 and R2, printed as 0.01 and 0.01 I.
        noise_reading: "zhang2011": "continuous": R1 belongs to eq. 21 and is discretised with it; "discrete": it is
            added as it stands in eq. 16.
    """

    method: Annotated[
        Literal["cwcli", "zhang2011"],
        Option(
            "--method",
            "cwcli: one Kalman filter over frames and sensors at their own times; zhang2011: the paper's observers for "
            "multiples of 10 km/h, two of them blended.",
        ),
    ] = "cwcli"
    preview_m: float = DEFAULT_PREVIEW_POINT_DISTANCE_M
    estimate_load: Annotated[
        bool, Option("--estimate-load", "Also estimate the car's mass, which only turns show (method cwcli).")
    ] = False
    max_coast_s: Annotated[
        float,
        Option(
            "--coast",
            "Predict the state for at most this long without boundaries.",
            metavar="SECONDS",
            above=0.0,
            at_most=60.0,
        ),
    ] = 2.0
    max_gap_s: float = 1.0
    max_speed_gap_s: float = 0.5
    noise: FilterNoise = field(default_factory=FilterNoise)
    period_s: float | None = None
    steer_rate: Annotated[
        Literal["raw", "robust"],
        Option(
            "--steer-rate",
            "How zhang2011 computes the rate of the heading deviation (eq. 10): raw from two frames, robust as the "
            "median slope of five.",
        ),
    ] = "raw"
    process_noise: float = 0.01
    lane_noise: float = 0.01
    noise_reading: Literal["continuous", "discrete"] = "continuous"

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            UsageError: A value is not positive, or not a number.
        """
        may_be_zero = {
            *("load_walk", "gyro_bias_radps", "gyro_bias_walk_radps", "camera_yaw_rad", "camera_yaw_walk_rad"),
            *("lateral_floor_m", "heading_floor_rad", "curvature_floor_1pm", "floor_share", "curvature_share"),
        }
        values = {name: getattr(self, name) for name in _POSITIVE_FIELDS}
        values |= {f"noise.{each.name}": getattr(self.noise, each.name) for each in fields(self.noise)}
        for name, value in values.items():
            if value is None:
                continue
            low_ok = value >= 0.0 if name.removeprefix("noise.") in may_be_zero else value > 0.0
            if not (math.isfinite(value) and low_ok):
                raise UsageError(f"{name} is {value!r}; permitted: a positive number", where="observer")


_POSITIVE_FIELDS = (
    "preview_m",
    "max_coast_s",
    "max_gap_s",
    "max_speed_gap_s",
    "period_s",
    "process_noise",
    "lane_noise",
)
"""Fields of `ObserverConfig` that must be positive numbers."""
