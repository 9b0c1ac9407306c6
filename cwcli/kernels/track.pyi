from enum import IntEnum
from typing import TypedDict

import numpy as np
import numpy.typing as npt

_F = npt.NDArray[np.float64]
_I8 = npt.NDArray[np.int8]
_I64 = npt.NDArray[np.int64]

class Model(IntEnum):
    """Constant velocity, constant acceleration, constant turn rate and velocity: see
    `cwcli.tracking.config.MOTION_MODELS`."""

    CV = ...
    CA = ...
    CTRV = ...

class RowKind(IntEnum):
    """What a row's values are.

    Attributes:
        NOTHING: There are none: predict only.
        POSITION: x, y.
        RADAR_WITHOUT_RATE: Range, azimuth.
        RADAR: Range, azimuth, range rate.
    """

    NOTHING = ...
    POSITION = ...
    RADAR_WITHOUT_RATE = ...
    RADAR = ...

class RowStatus(IntEnum):
    """What became of a row.

    Attributes:
        USED, GATED: It updated the state, or lay outside the gate.
        STARTED: The state begins with it.
        SINGULAR: Its innovation had no covariance.
        PREDICTED, EMPTY: It had no values, and there is a state, or none.
    """

    USED = ...
    GATED = ...
    STARTED = ...
    SINGULAR = ...
    PREDICTED = ...
    EMPTY = ...

class Tuning(TypedDict):
    """The struct of this name in track_motion.pxd."""

    model: Model
    d: int
    unscented: bool
    main_noise: float
    turn_noise: float
    speed_variance: float
    extra_variance: float
    kappa: float
    cartesian_below: float
    gate_nis: list[float]
    max_gap_s: float
    restart_after: int

class Filter:
    """A filter with its numbers."""

    def __init__(self, tuning: Tuning) -> None: ...

class Rows:
    """Detections: see `cwcli.tracking.prepare.DetectionRows`."""

    def __init__(self, *, kind: _I8, z: _F, r: _F, origin: _F) -> None: ...

class Filtered:
    """What `run` found: see `cwcli.tracking.single_target.FilterOutput`."""

    state: _F
    covariance: _F
    innovation: _F
    nis: _F
    n_values: _I8
    status: _I8
    log_likelihood: float

def run(filter: Filter, dt_s: _F, rows: Rows, *, smooth: bool) -> Filtered:
    """Filter one target's rows in time order, dt_s (n,) seconds after the row before; then smooth, if asked to."""

def log_likelihood(filter: Filter, dt_s: _F, rows: Rows) -> float:
    """The log-likelihood alone, without keeping the states."""

def predict_many(filter: Filter, x: _F, p: _F, dt_s: float) -> None:
    """Bring all tracks x (m, d), p (m, d, d) forward, in place."""

def score_many(filter: Filter, x: _F, p: _F, rows: Rows, first: int, last: int) -> _F:
    """Log-likelihood of the rows from `first` to before `last` under every track, (m, rows); -inf outside the gate."""

def update_many(filter: Filter, x: _F, p: _F, track: _I64, rows: Rows, taken: _I64) -> None:
    """Update track track[i] with row taken[i], in place; without a gate."""

def start_many(filter: Filter, x: _F, p: _F, rows: Rows, taken: _I64) -> None:
    """Overwrite x (k, d) and p (k, d, d) with the first state of one new track for each of the k rows `taken`."""
