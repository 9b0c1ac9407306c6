import numpy as np
import numpy.typing as npt

_F = npt.NDArray[np.float64]
_I = npt.NDArray[np.int32]
_B = npt.NDArray[np.int8]

def forward(
    time_s: _F,
    first: _I,
    out_row: _I,
    series: _I,
    z: _F,
    r: _F,
    kind: _I,
    bias: _I,
    lag: _I,
    gate: _F,
    reset_after: _I,
    model: _F,
    q_matrix: _F,
    q_walk: _F,
    x: _F,
    p: _F,
    x_post: _F,
    flip: _B,
    yaw_decay: _F,
    gain: _F,
    partials: _F,
    innovation: _F,
    status: _B,
    nis: _F,
    out_x: _F,
    out_p: _F,
    streak: _I,
    believed: _F,
) -> float: ...
def backward(
    time_s: _F,
    first: _I,
    out_row: _I,
    series: _I,
    kind: _I,
    bias: _I,
    lag: _I,
    model: _F,
    x_post: _F,
    flip: _B,
    yaw_decay: _F,
    gain: _F,
    partials: _F,
    innovation: _F,
    status: _B,
    out_x: _F,
    out_p: _F,
) -> None: ...
