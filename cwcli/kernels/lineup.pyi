import numpy as np
import numpy.typing as npt

def matching_factor(
    nu2: npt.NDArray[np.float64],
    prior: npt.NDArray[np.float64],
    noise: npt.NDArray[np.float64],
    most: float,
    n_steps: int,
    limit: float,
) -> float: ...
def count_steps(
    update_s: npt.NDArray[np.float64],
    output_s: npt.NDArray[np.float64],
    start_s: float,
    max_step_s: float,
    max_pieces: int,
) -> int: ...
def lay_steps(
    update_s: npt.NDArray[np.float64],
    output_s: npt.NDArray[np.float64],
    start_s: float,
    max_step_s: float,
    max_pieces: int,
    time_s: npt.NDArray[np.float64],
    first: npt.NDArray[np.int32],
    out_row: npt.NDArray[np.int32],
) -> None: ...
