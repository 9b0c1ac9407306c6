"""Probability of contact within the horizon, by the covariances of both states.

Each vehicle keeps its acceleration and its yaw rate until it stands. The covariance of its position is that of the
state, propagated along the path to first order. The probability is that of `collision_probability`, which states its
errors; it is the mean over both choices of the host.
"""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.collision_probability import UncertainPaths, collision_probability, is_touch_improbable
from cwcli.measures.pair import Pair, RatiosAtStamps
from cwcli.signals.columns import FloatArray

CONTACT_HORIZON_S = 2.5
"""Time ahead within which a contact counts, s: song2016's horizon."""
PATH_TIME_STEP_S = 0.05
"""Step of the paths, s. Chosen by hand."""
PATH_TIMES_S = np.arange(round(CONTACT_HORIZON_S / PATH_TIME_STEP_S) + 1) * PATH_TIME_STEP_S
"""Times of the paths' points, s."""
N_STATE_VARIABLES_MOVING_PATH = 6
"""Number of states that move a path: x, y, speed, heading, acceleration, yaw rate."""
MOMENTS_PER_BATCH = 256
"""Number of moments in a batch; it bounds the memory. Chosen by hand."""
MAX_STANDSTILL_SPEED_MPS = 1e-9
"""Speed in m/s below which a vehicle stands; smaller values are rounding."""


def contact_probability_within_horizon(pair: Pair) -> RatiosAtStamps:
    """Probability of contact within the horizon at each stamp, (n,); NaN where a covariance is not known."""
    near = pair.near_rows
    found = np.full(len(near), np.nan)
    own = np.concatenate([pair.host.state[near, :4], pair.host_accel_yaw_rate_jerk[near, :2]], axis=1)
    theirs = np.concatenate([pair.other_states[near], pair.other_derivatives[near, :2]], axis=1)
    own[:, :2], theirs[:, :2] = 0.0, theirs[:, :2] - own[:, :2]
    for first in range(0, len(near), MOMENTS_PER_BATCH):
        rows = slice(first, first + MOMENTS_PER_BATCH)
        covariances = (
            each[:, :N_STATE_VARIABLES_MOVING_PATH, :N_STATE_VARIABLES_MOVING_PATH]
            for each in pair.state_covariances(near[rows])
        )
        (x, y, heading, spread), (to_x, to_y, to_heading, to_spread) = (
            propagate_to_x_y_heading_and_xy_covariance(state[rows], covariance)
            for state, covariance in zip((own, theirs), covariances, strict=True)
        )
        dx, dy = to_x - x, to_y - y
        variance = (spread + to_spread)[..., [0, 2]].sum(axis=2).max(axis=1)
        values = np.where(np.isnan(variance), np.nan, 0.0)
        with np.errstate(invalid="ignore"):
            far = is_touch_improbable(_centre_distance_lower_bound_m(dx, dy), variance, pair.host_size, pair.other_size)
        at = np.flatnonzero(~far & ~np.isnan(variance))
        host = UncertainPaths(heading[at], spread[at], pair.host_size)
        other = UncertainPaths(to_heading[at], to_spread[at], pair.other_size)
        both = collision_probability(dx[at], dy[at], host, other) + collision_probability(-dx[at], -dy[at], other, host)
        values[at] = 0.5 * both[:, 0]
        found[rows] = values
    return pair.expand_near_rows_to_all_rows(found)


def propagate_to_x_y_heading_and_xy_covariance(
    state: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Propagate states (m, 6) and covariances (m, 6, 6) to paths: x, y, heading, (m, q), and xx, xy, yy, (m, q, 3)."""
    x, y, speed, heading, accel, yaw_rate = (column[:, None] for column in state.T)
    with np.errstate(divide="ignore", invalid="ignore"):
        ahead = np.where(speed < -MAX_STANDSTILL_SPEED_MPS, -accel, accel)  # one that stands does not set off backwards
        stops_s = np.where(ahead < 0.0, np.abs(speed / accel), np.inf)
    turns_s = np.where((np.abs(speed) < MAX_STANDSTILL_SPEED_MPS) & (accel == 0.0), 0.0, stops_s)
    middle_s = PATH_TIMES_S[:-1] + 0.5 * PATH_TIME_STEP_S
    moves = np.clip((stops_s - PATH_TIMES_S[:-1]) / PATH_TIME_STEP_S, 0.0, 1.0)  # share of each step until it stands
    turn = heading + yaw_rate * np.minimum(middle_s, turns_s)
    rate = np.where(moves > 0.0, speed + accel * (PATH_TIMES_S[:-1] + 0.5 * moves * PATH_TIME_STEP_S), 0.0)
    cosine, sine = np.cos(turn), np.sin(turn)
    along = {  # per second of a step: the way, and its slopes by speed, acceleration and yaw rate
        "way": (rate * cosine, rate * sine),
        "speed": (cosine, sine),
        "accel": (middle_s * cosine, middle_s * sine),
        "yaw_rate": (-rate * middle_s * sine, rate * middle_s * cosine),
    }
    gone = {
        name: [_cumulative_sum_from_zero(part * moves * PATH_TIME_STEP_S) for part in parts]
        for name, parts in along.items()
    }
    way_x, way_y = gone["way"]
    one, zero = np.ones_like(way_x), np.zeros_like(way_x)
    slopes = np.stack(
        [
            np.stack([one, zero, gone["speed"][0], -way_y, gone["accel"][0], gone["yaw_rate"][0]]),
            np.stack([zero, one, gone["speed"][1], way_x, gone["accel"][1], gone["yaw_rate"][1]]),
        ]
    )  # (2, 6, m, q)
    spread = np.einsum("aimq,mij,bjmq->mqab", slopes, covariance, slopes, optimize=True)
    packed = np.stack([spread[..., 0, 0], spread[..., 0, 1], spread[..., 1, 1]], axis=-1)
    return x + way_x, y + way_y, heading + yaw_rate * np.minimum(PATH_TIMES_S, turns_s), packed


def _cumulative_sum_from_zero(steps: FloatArray) -> FloatArray:
    """The cumulative sum of the steps (m, q - 1) from 0 on, (m, q)."""
    return np.concatenate([np.zeros((len(steps), 1)), np.cumsum(steps, axis=1)], axis=1)


def _centre_distance_lower_bound_m(dx: FloatArray, dy: FloatArray) -> FloatArray:
    """A lower bound of the distance of the centres along the paths, m, (m,): between points they may come nearer."""
    between = np.hypot(np.diff(dx, axis=1), np.diff(dy, axis=1)).max(axis=1)
    return np.asarray(np.hypot(dx, dy).min(axis=1) - 0.5 * between)


MEASURE = Measure(
    summary="probability of contact within 2.5 s by the covariances of both states",
    symbol="P_c",
    column="p_contact",
    critical="high",
    formula=(
        "P(the rectangles overlap at any t in [0, 2.5 s]), along paths of constant acceleration and yaw rate, "
        "normal errors of both states, each carried along its path to first order"
    ),
    source="cwcli; of circles at one time: Alfano 2005",
    compute=contact_probability_within_horizon,
    undefined="the covariance of a state is not known, or the centres are more than 200 m apart",
    misleads=(
        "where drivers react, which these paths do not; where covariances are too small: an acceleration or "
        "a yaw rate that a sensor's track does not have counts as exactly 0"
    ),
    is_pointwise=True,
    is_stepped=True,
    needs_covariance=True,
)
