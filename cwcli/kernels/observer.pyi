from collections.abc import Sequence
from enum import IntEnum
from typing import TypedDict

import numpy as np
import numpy.typing as npt

_F = npt.NDArray[np.float64]
_I = npt.NDArray[np.int32]
_B = npt.NDArray[np.int8]

# Index of each state of `observe`: see observer.pxd.
VY: int
G: int
YL: int
EL: int
STEER: int
KL: int
ETA: int
GYRO: int
CAM: int
N: int

class EventKind(IntEnum):
    """What an event measures: a lane's y_L, e_L and K_L, or one number."""

    LANE = ...
    YAW_RATE = ...
    STEERING_ANGLE = ...

class Begin(IntEnum):
    """Before an event the state goes on, or all but load and biases is forgotten, or there is none until ANEW."""

    GO_ON = ...
    ANEW = ...
    STOP = ...

class EventStatus(IntEnum):
    """What became of an event."""

    NOT_STARTED = ...
    USED = ...
    PREDICTED = ...
    GATED = ...
    STARTED = ...

def blend(
    phi: _F,
    gamma: _F,
    gain: _F,
    *,
    low: _I,
    weight: _F,
    begin: _B,
    periods: _I,
    inputs: _F,
    measured: _F,
) -> _F:
    """Run the observers `low[i]` and `low[i] + 1` on each of n frames and blend them.

    Args:
        phi, gamma, gain: (s, 4, 4), (s, 4, 2), (s, 4, 2): of each observer.
        low, weight: (n,): the lower neighbour and the upper one's weight.
        begin: (n,): a `Begin`; ANEW starts from the frame's measurement with v_y = gamma = 0.
        periods: (n,): frame periods since the frame before; all but the last are predicted without correction.
        inputs: (n, 2): steering angle and curvature.
        measured: (n, 2): y_L and e_L, NaN for none.

    Returns:
        (n, 4): v_y, gamma, y_L, e_L; NaN where there is no state.
    """

class Model(TypedDict):
    """The struct of this name in observer_model.pxd."""

    side_force: float
    moment_force: float
    front_force: float
    moment: float
    yaw_damping: float
    front_moment: float
    camera_forward_m: float
    wheelbase_m: float
    rear_axle_m: float
    slip: float
    understeer: float
    min_speed: float
    still_mps: float
    max_step_s: float
    eta_low: float
    eta_high: float
    gate_sigmas: float
    restart_after: int
    gyro_recent_s: float
    chosen_mps: float
    slowest_mps: float
    walk_noise: Sequence[float]
    start_sigma: Sequence[float]

class Events:
    """Frames and sensor readings in the order of their times, n of them.

    Args:
        dt_s: (n,): since the event before.
        speed_mps: (n,): over that time.
        kind: (n,): an `EventKind`.
        begin: (n,): a `Begin`; STOP: no state at this event.
        values, sigmas: (n, 3): y_L, e_L, K_L, or one number in column 0; NaN for none.
        preview_m: (n,): from the camera to the preview point of a frame; without e_L it does not count.
        change_1pm2: (n,): of K_L in a metre ahead, as a frame tells it, until the next frame.
    """

    def __init__(
        self,
        *,
        dt_s: _F,
        speed_mps: _F,
        kind: _B,
        begin: _B,
        values: _F,
        sigmas: _F,
        preview_m: _F,
        change_1pm2: _F,
    ) -> None: ...

def observe(events: Events, model: Model) -> tuple[_F, _F, _B, _F]:
    """Filter all events: states (n, 9), covariances (n, 9, 9), an `EventStatus` (n,), and how far ahead of the camera
    (n,) the preview point of y_L, e_L and K_L is; NaN where there is no state."""
