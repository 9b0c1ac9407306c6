from enum import IntEnum
from typing import TypedDict

import numpy as np
import numpy.typing as npt

_F = npt.NDArray[np.float64]
_I = npt.NDArray[np.int32]

class Sensor(IntEnum):
    """What a source measures: see `cwcli.estimation.measurements.Kind`."""

    POSITION = ...
    VELOCITY = ...
    SPEED = ...
    HEADING = ...
    ACCEL = ...
    YAW_RATE = ...

class UpdateStatus(IntEnum):
    """What became of a row.

    Attributes:
        GATED: Rejected.
        USED: Used as it is.
        USED_AFTER_RESET: Used after many rejections; the state was widened.
        USED_IN_MANOEUVRE: Contradicts the state, but belongs to a message that agrees with itself and with the last
            believed one of its sender; the state was widened.
    """

    GATED = ...
    USED = ...
    USED_AFTER_RESET = ...
    USED_IN_MANOEUVRE = ...

class DampedMotion(TypedDict):
    """The struct of this name in ekf_motion.pxd; rates in 1/s."""

    accel_rate: float
    jerk_rate: float
    jerk_noise: float
    yaw_rate_rate: float
    yaw_accel_rate: float
    yaw_accel_noise: float
    standstill_speed: float
    standstill_floor: float
    xy_noise: float
    along_share: float
    heading_noise: float
    reverse_speed: float

class ProcessModel:
    """What the state does between measurements: a motion model with its numbers."""

    @staticmethod
    def damped(numbers: DampedMotion, walk_noise: _F, turn_noise: _F, time_constant_s: _F) -> ProcessModel:
        """Eight states and parameters, see `cwcli.estimation.model.MotionParameters`.

        Args:
            numbers: As the struct says.
            walk_noise: (n,): white noise behind the parameter states, variance per second (first eight unused).
            turn_noise: (n,): the same by radian turned.
            time_constant_s: (n,): of parameters that fade to zero (Gauss-Markov); 0: it walks (first eight unused).

        Raises:
            ValueError: More than 24 states.
        """

    @staticmethod
    def song2016(step_noise: _F) -> ProcessModel:
        """Six states, acceleration and yaw rate stay over a step (eq. 2, 6); step_noise: (6, 6), Q."""

class Events:
    """All steps and updates in time order: T steps, U updates.

    Args:
        time_s: (T,), increasing.
        first: (T + 1,): the updates of step k are first[k]..first[k + 1] - 1.
        out_row: (T,): row of the output that step k fills, or -1.
        source: (U,): index into the arrays of `SourceTable`.
        values: (U, 2), scalars in the first column; beside a speed the pitch rate at its time, rad/s.
        noise: (U, 3): r00, r01, r11.
    """

    def __init__(self, *, time_s: _F, first: _I, out_row: _I, source: _I, values: _F, noise: _F) -> None: ...

class Restarts:
    """Where the filter takes the motion from elsewhere, before the updates of a step: R restarts.

    Args:
        step: (R,), increasing.
        state, variance: (R, 8): the motion there and its variances; what was known of it before is given up. The
            smoother carries what it knows of later states through a restart, so that states before it are bridged.
    """

    def __init__(self, *, step: _I, state: _F, variance: _F) -> None: ...

class SourceTable:
    """What the filter has to know of each of S sources, (S,) each if nothing else is said.

    Args:
        sensor: A `Sensor`.
        parameters: (S, 6): indices of the states of its bias, slow error (a position's are two), scale, lever arm,
            place ahead and latency; -1 = none. A bias is for rates, a slow error for all but speeds and velocities,
            scale and lever arm for speeds alone, the place ahead for positions, velocities and accelerations.
        place_m: (S, 2): where it stands, ahead and to the left of the estimated point; the place ahead adds to it.
        stamp_sigma_s: One sigma of a position's stamps, which adds sigma^2 v v' to its noise; v: as predicted.
        gate_nis: Limit of the squared normalised innovation; <= 0 switches the gate off.
        patience: After so many gated updates in a row the next one is used, if they took 2 s as well; a position that
            jumped once while speed and turn were measured waits as long as it had agreed before, 15 s at most.
        sender: Number of the sender whose messages hold the source's rows, together with those of the same time of its
            other sources; -1: none.
    """

    def __init__(
        self, *, sensor: _I, parameters: _I, place_m: _F, stamp_sigma_s: _F, gate_nis: _F, patience: _I, sender: _I
    ) -> None: ...

class Pass:
    """What a pass found.

    Attributes:
        state, covariance: (m, n), (m, n, n): filtered or smoothed, at the output rows.
        last_state, last_covariance: (n,), (n, n): of the filter after the last step.
        nis: (U, 5): squared normalised innovation, mean nu^2 over the axes, mean h P h' over the axes with what the
            error of the stamps adds, determinant of the innovation's covariance; of a position the slope of the
            log-likelihood by the variance of the stamps' errors, 1/s^2, less that by as much across the way.
        status: (U,): an `UpdateStatus`.
        log_likelihood: Of the used innovations.
    """

    state: _F
    covariance: _F
    last_state: _F
    last_covariance: _F
    nis: _F
    status: npt.NDArray[np.int8]
    log_likelihood: float

def run(
    events: Events,
    sources: SourceTable,
    motion: ProcessModel,
    start_state: _F,
    start_covariance: _F,
    n_output: int,
    *,
    smooth: bool,
    restarts: Restarts | None = None,
) -> Pass:
    """Filter all events from the state (n,) and covariance (n, n) at the first step on; then smooth, if asked to.

    Raises:
        ValueError: If the start has not as many states as the motion model.
    """
