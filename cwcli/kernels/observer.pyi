import numpy as np
import numpy.typing as npt

_F = npt.NDArray[np.float64]
_I = npt.NDArray[np.int32]
_B = npt.NDArray[np.int8]

KIND_LANE: int
KIND_YAW_RATE: int
KIND_STEER: int
NOT_STARTED: int
USED: int
PREDICTED: int
REJECTED: int
RESTARTED: int

def blended(
    low: _I,
    weight: _F,
    begin: _B,
    periods: _I,
    inputs: _F,
    measured: _F,
    phi: _F,
    gamma: _F,
    gain: _F,
    out: _F,
) -> None: ...
def follow(
    dt_s: _F,
    speed: _F,
    kind: _B,
    begin: _B,
    values: _F,
    sigmas: _F,
    model: _F,
    out_x: _F,
    out_p: _F,
    status: _B,
) -> None: ...
