"""Hand-made vehicles for the tests of this folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from cwcli.evaluation.scored_warnings import ScoredWarnings, score_warnings
from cwcli.measures.pair import ActualTrack
from cwcli.prediction.rollout import RolloutSettings, roll_out_paths
from cwcli.warning.evaluate import find_warnings
from cwcli.warning.types import VehicleTrack, WarningConfig

FloatArray = npt.NDArray[np.float64]
T0_NS = 1_700_000_000_000_000_000


def stamps(time_s: np.ndarray) -> npt.NDArray[np.int64]:
    return T0_NS + np.rint(time_s * 1e9).astype(np.int64)


def seconds(stamp_ns: npt.NDArray[np.int64]) -> list[float]:
    return [round(float(stamp - T0_NS) * 1e-9, 6) for stamp in stamp_ns]


def evaluate(
    host: VehicleTrack,
    others: Sequence[VehicleTrack],
    config: WarningConfig | None = None,
    *,
    actual: Mapping[str, ActualTrack] | None = None,
) -> ScoredWarnings:
    """The warnings, and what really happened."""
    return score_warnings(find_warnings(host, others, config), actual=actual)


def straight(
    name: str,
    *,
    x_m: float = 0.0,
    y_m: float = 0.0,
    speed_mps: float,
    heading_rad: float = 0.0,
    accel_mps2: float = 0.0,
    duration_s: float = 10.0,
    rate_hz: float = 20.0,
    delay_s: float = 0.0,
    horizon_s: float = 2.5,
    sigma_m: float = 0.01,
    model: str = "ca",
    length_m: float | None = None,
    width_m: float | None = None,
) -> VehicleTrack:
    """A car on a straight line whose states are exact and whose paths come from `model`."""
    time = np.arange(round(duration_s * rate_hz) + 1) / rate_hz
    moving = time if accel_mps2 >= 0.0 else np.minimum(time, -speed_mps / accel_mps2)
    way = speed_mps * moving + 0.5 * accel_mps2 * moving**2
    state = np.zeros((len(time), 8))
    state[:, 0], state[:, 1] = x_m + way * np.cos(heading_rad), y_m + way * np.sin(heading_rad)
    state[:, 2], state[:, 3] = speed_mps + accel_mps2 * moving, heading_rad
    state[:, 4] = np.where(moving == time, accel_mps2, 0.0)
    covariance = np.tile(np.diag([sigma_m**2, sigma_m**2, *[0.0] * 6]), (len(time), 1, 1))
    return VehicleTrack(
        id=name,
        stamp_ns=stamps(time),
        log_time_ns=stamps(time + delay_s),
        state=state,
        paths=roll_out_paths(model, state, covariance, settings=RolloutSettings(horizon_s=horizon_s)),
        length_m=length_m,
        width_m=width_m,
    )
