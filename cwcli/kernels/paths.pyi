import numpy as np
import numpy.typing as npt

def quadrature(
    state: npt.NDArray[np.float64],
    cosine: npt.NDArray[np.float64],
    sine: npt.NDArray[np.float64],
    weight: npt.NDArray[np.float64],
    to_accel: npt.NDArray[np.float64],
    to_jerk: npt.NDArray[np.float64],
    to_yaw_rate: npt.NDArray[np.float64],
    to_yaw_accel: npt.NDArray[np.float64],
    uses: npt.NDArray[np.int8],
    points: npt.NDArray[np.intp],
    jacobian: npt.NDArray[np.float64],
) -> None: ...
def follow(
    log_excess: npt.NDArray[np.float64],
    is_known: npt.NDArray[np.uint8],
    n_known: npt.NDArray[np.intp],
    step_s: npt.NDArray[np.float64],
    rate_1ps: float,
    bound: float,
    miss_share: float,
    log_scale: npt.NDArray[np.float64],
) -> None: ...
def on_track(
    at_ns: npt.NDArray[np.int64],
    stamp_ns: npt.NDArray[np.int64],
    xy: npt.NDArray[np.float64],
    max_gap_ns: float,
    found: npt.NDArray[np.float64],
    is_known: npt.NDArray[np.uint8],
) -> None: ...
