import numpy as np
import numpy.typing as npt

_F = npt.NDArray[np.float64]
_I8 = npt.NDArray[np.int8]
_I64 = npt.NDArray[np.int64]

def n_states(model: int) -> int: ...
def filter_one(
    dt: _F,
    kind: _I8,
    z: _F,
    r: _F,
    origin: _F,
    model: int,
    unscented: bool,
    params: _F,
    gates: _F,
    x: _F,
    p: _F,
    xp: _F,
    pp: _F,
    f: _F,
    innovation: _F,
    nis: _F,
    loglik: _F,
    rows: _I8,
    status: _I8,
) -> float: ...
def smooth_one(x: _F, p: _F, xp: _F, pp: _F, f: _F) -> None: ...
def predict_many(x: _F, p: _F, dt: float, model: int, unscented: bool, params: _F) -> None: ...
def score_many(
    x: _F,
    p: _F,
    kind: _I8,
    z: _F,
    r: _F,
    origin: _F,
    model: int,
    unscented: bool,
    params: _F,
    gates: _F,
    loglik: _F,
) -> None: ...
def update_many(
    x: _F,
    p: _F,
    track: _I64,
    detection: _I64,
    kind: _I8,
    z: _F,
    r: _F,
    origin: _F,
    model: int,
    unscented: bool,
    params: _F,
    no_gates: _F,
) -> None: ...
def start_many(kind: _I8, z: _F, r: _F, origin: _F, model: int, params: _F, x: _F, p: _F) -> None: ...
