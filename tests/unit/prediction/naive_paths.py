"""Plain twins of `cwcli.kernels.paths`: whole arrays instead of a walk over the nodes, a loop over Python's floats."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.signals.vehicle_state import ACCEL, HEADING, JERK, SPEED, YAW_ACCEL, YAW_RATE, X, Y

FloatArray = npt.NDArray[np.float64]


def quadrature(
    state: FloatArray,
    weight: FloatArray,
    responses: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    uses: tuple[bool, bool, bool, bool],
) -> FloatArray:
    """The derivatives of x and y to the state after 0, 1, ... all steps, shape (2, m, s + 1, 8)."""
    accel, jerk, yaw_rate, yaw_accel = responses
    columns = state[:, None, None, :]
    speed = columns[..., SPEED] + columns[..., ACCEL] * accel + columns[..., JERK] * jerk
    heading = columns[..., HEADING] + columns[..., YAW_RATE] * yaw_rate + columns[..., YAW_ACCEL] * yaw_accel
    cosine, sine = np.cos(heading) * weight, np.sin(heading) * weight
    moved_x, moved_y = speed * cosine, speed * sine
    jacobian = np.zeros((2, len(state), weight.shape[2] + 1, 8))
    jacobian[0, :, :, X] = jacobian[1, :, :, Y] = 1.0
    jacobian[0, :, :, HEADING], jacobian[1, :, :, HEADING] = -running(moved_y), running(moved_x)
    jacobian[0, :, :, SPEED], jacobian[1, :, :, SPEED] = running(cosine), running(sine)
    for used, index, response in zip(uses[:2], (ACCEL, JERK), (accel, jerk), strict=True):
        if used:
            jacobian[0, :, :, index], jacobian[1, :, :, index] = running(cosine * response), running(sine * response)
    for used, index, response in zip(uses[2:], (YAW_RATE, YAW_ACCEL), (yaw_rate, yaw_accel), strict=True):
        if used:
            jacobian[0, :, :, index] = -running(moved_y * response)
            jacobian[1, :, :, index] = running(moved_x * response)
    return jacobian


def running(nodes: FloatArray) -> FloatArray:
    """Running sum over the steps of (m, q, s), from 0: shape (m, s + 1)."""
    total = nodes[:, 0]
    for k in range(1, nodes.shape[1]):
        total = total + nodes[:, k]
    return np.concatenate([np.zeros((len(nodes), 1)), np.cumsum(total, axis=1)], axis=1)


def position_covariance(
    jacobian: FloatArray, heading: FloatArray, covariance: FloatArray, trust: FloatArray, driver_m2: FloatArray
) -> FloatArray:
    """J P J' and the driver's variances along and across the heading, driver_m2 (2, m, k), as (m, k, 2, 2)."""
    root = np.ones((len(heading), 8))
    root[:, [ACCEL, JERK, YAW_RATE, YAW_ACCEL]] = np.sqrt(trust)
    both = root[:, :, None] * root[:, None, :]
    scaled = np.where(both == 0.0, 0.0, covariance * both)
    turn = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
    driver = np.einsum("iank,ank,jank->nkij", turn, driver_m2, turn)
    return np.einsum("inka,nab,jnkb->nkij", jacobian, scaled, jacobian) + driver


def adapt_scale(
    log_excess: FloatArray,
    is_known: npt.NDArray[np.bool_],
    n_known: npt.NDArray[np.intp],
    step_s: FloatArray,
    *,
    rate_1ps: float,
    bound: float,
    miss_share: float,
) -> FloatArray:
    """The log of the scale at each start of one set of paths, shape (n,)."""
    log_scale: list[float] = []
    current, seen = 0.0, 0
    for count in n_known.tolist():
        while seen < count:
            if is_known[seen]:
                outside = 1.0 if log_excess[seen] > log_scale[seen] else 0.0
                current += rate_1ps * step_s[seen] * (outside - miss_share)
                current = min(max(current, -bound), bound)
            seen += 1
        log_scale.append(current)
    return np.array(log_scale)


def on_track(
    at_ns: npt.NDArray[np.int64], stamp_ns: npt.NDArray[np.int64], xy: FloatArray, max_gap_ns: float
) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Track position at the given times, shape (..., 2), NaN where unknown; and where it is known."""
    position = np.full((*at_ns.shape, 2), np.nan)
    after = np.clip(np.searchsorted(stamp_ns, at_ns), 1, len(stamp_ns) - 1)
    gap_ns = stamp_ns[after] - stamp_ns[after - 1]
    known = (at_ns >= stamp_ns[0]) & (at_ns <= stamp_ns[-1]) & (gap_ns <= max_gap_ns)
    known |= (at_ns == stamp_ns[after]) | (at_ns == stamp_ns[after - 1])
    share = ((at_ns - stamp_ns[after - 1]) / np.maximum(gap_ns, 1))[..., None]
    found = xy[after - 1] + share * (xy[after] - xy[after - 1])
    known &= np.isfinite(found).all(axis=-1)
    position[known] = found[known]
    return position, known
