"""The gain of each derivative, measured: what followed, at each horizon, on what the vehicle's states had said.

Constant velocity takes a car v h along its heading. Acceleration a and yaw rate w add a h^2/2 along it and, as an
angle of the chord, w h/2 across, if they go on and if they are right. How much of that followed is a linear
regression, by each axis and knot of `fleet.KNOTS_S`: y = x' g, x the displacement that each part of the derivative
promises (`parts_of`), y what happened. With outcomes weighted by q its ridge estimate is

    g = (sum q x x' + N e^2 I)^-1 (sum q x y + N e^2 g0),    q = (dt / h) / (1 + |y - x' g_fleet| / e),

e the fleet's mean error and N the weight of the prior, in independent outcomes of that size. dt/h counts independent
outcomes, whatever the rate of the states; the denominator makes it an estimate of the mean error rather than of
the mean square (iteratively reweighted least squares with one step). Three levels follow each other, each the prior
g0 of the next: the fleet's gain (scaled as the vehicle's own gain at the shorter knot, whose outcomes come sooner,
turned out against the fleet's), that of the log's other vehicles, the vehicle's own. A vehicle whose derivatives say
nothing is then predicted with constant velocity, whatever its filter claims.

Everything at a moment comes from states that were known by then (log time).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from cwcli.prediction.fleet import KNOTS_S, FleetPrior, acted_s, fleet_prior
from cwcli.prediction.outcome import actual_positions
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import ACCEL, HEADING, SPEED, YAW_RATE

CLEAR_SIGMAS = 5.0  # filters on real drives are too sure by a factor of up to 3
CLEAR_POWER = 8
LOOK_BACK_SHARE = 0.5
MIN_LOOK_BACK_S = 0.3
MIN_TRACK_S = 0.15
MAX_GAP_S = 0.5
MIN_CHORD_M = 1.0
MAX_CHORD_ANGLE_RAD = 2.0
PRIOR_OUTCOMES = np.array([4.0, 1.0, 1.0])
POSITIVE_PART = 1.0 / np.sqrt(2.0 * np.pi)  # mean of max(z, 0), z standard normal
NEVER_NS = np.iinfo(np.int64).max

N_SUMS = 9  # of a regression with three parts: xx' above the diagonal, and x y
Rows = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Track:
    """One vehicle's states in the order in which they became known; one that a newer one overtook is no part of it.

    Attributes:
        rows: Shape (n,): which rows of the whole they are.
        stamp_ns, known_ns: Shape (n,): strictly increasing; non-decreasing.
        state: Shape (n, 8).
        clear: Shape (n, 2): see `clearness`.
    """

    rows: Rows
    stamp_ns: Int64Array
    known_ns: Int64Array
    state: FloatArray
    clear: FloatArray


def clearness(state: FloatArray, covariance: FloatArray | None) -> FloatArray:
    """How far acceleration and yaw rate stand out of what the filter says of their noise: 0 to 1, shape (n, 2)."""
    if covariance is None:
        return np.ones((len(state), 2))
    columns = [ACCEL, YAW_RATE]
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        noise = CLEAR_SIGMAS**2 * np.maximum(covariance[:, columns, columns], 0.0)
        power = (noise / state[:, columns] ** 2) ** (CLEAR_POWER // 2)
        return np.asarray(np.nan_to_num(1.0 / (1.0 + power), nan=1.0))


def known_tracks(
    vehicle: npt.NDArray[np.integer],
    stamp_ns: Int64Array,
    log_time_ns: Int64Array,
    state: FloatArray,
    covariance: FloatArray | None,
) -> list[Track]:
    """The tracks of all vehicles; rows whose state is not finite are left out, and whoever has no other."""
    is_finite = np.isfinite(state[:, : YAW_RATE + 1]).all(axis=1)
    clear = clearness(state, covariance)
    tracks = []
    for one in np.unique(vehicle):
        rows = np.flatnonzero((vehicle == one) & is_finite)
        rows = rows[np.lexsort((stamp_ns[rows], log_time_ns[rows]))]
        newest = np.maximum.accumulate(stamp_ns[rows])
        rows = rows[np.concatenate([[True], stamp_ns[rows][1:] > newest[:-1]])[: len(rows)]]
        if len(rows):
            tracks.append(Track(rows, stamp_ns[rows], log_time_ns[rows], state[rows], clear[rows]))
    return tracks


def parts_of(track: Track) -> FloatArray:
    """How acceleration and yaw rate divide into parts, by knot, shape (n, 2, k, 3): shares that add up to 1.

    unclear: within what may be noise. lasting: clear, and the mean over the last h/2 before a horizon h was as large:
    what lasts that long ahead has mostly lasted some time. new: the rest, a manoeuvre that has just begun.
    """
    age_s = (track.stamp_ns - track.stamp_ns[:1]) / NS_PER_S
    now = np.stack([track.state[:, ACCEL], track.state[:, YAW_RATE]], axis=1)
    was = (track.state[:, SPEED], np.unwrap(track.state[:, HEADING]))
    out = np.empty((len(age_s), 2, len(KNOTS_S), 3))
    for k, knot_s in enumerate(KNOTS_S.tolist()):
        then_s = np.maximum(age_s - max(LOOK_BACK_SHARE * knot_s, MIN_LOOK_BACK_S), 0.0)
        passed_s = age_s - then_s
        for axis in (0, 1):
            change = was[axis] - np.interp(then_s, age_s, was[axis])
            promised = now[:, axis] * passed_s
            is_told = (passed_s >= MIN_TRACK_S) & (promised != 0.0)
            share = np.where(is_told, np.clip(change / np.where(is_told, promised, 1.0), 0.0, 1.0), 0.0)
            clear = track.clear[:, axis]
            out[:, axis, k, 0] = 1.0 - clear
            out[:, axis, k, 1] = clear * share
            out[:, axis, k, 2] = clear * (1.0 - share)
    return out


def promised_m(state: FloatArray) -> FloatArray:
    """What acceleration and yaw rate would add to constant velocity by each knot, shape (n, 2, k).

    A car that comes to a stand stays there.
    """
    speed, accel = state[:, SPEED, None], state[:, ACCEL, None]
    brakes = speed * accel < 0.0
    stop_s = np.where(brakes, np.abs(speed) / np.where(brakes, np.abs(accel), 1.0), np.inf)
    acts_s = np.minimum(KNOTS_S, stop_s)
    along = accel * acts_s**2 / 2.0 - np.where(brakes, speed, 0.0) * (KNOTS_S - acts_s)
    across = np.abs(speed) * state[:, YAW_RATE, None] * KNOTS_S**2 / 2.0
    return np.stack([along, across], axis=1)


def followed_m(track: Track) -> FloatArray:
    """What was added to constant velocity by each knot, shape (n, 2, k); NaN where it is not known.

    Along: the arc's length beyond v h; across: the angle of its chord times |v| h.
    """
    found, is_known = actual_positions(track.stamp_ns, track.stamp_ns, track.state[:, :2], KNOTS_S.tolist(), MAX_GAP_S)
    moved = found - track.state[:, None, :2]
    speed, heading = track.state[:, SPEED, None], track.state[:, HEADING, None]
    forward = np.where(speed < 0.0, -1.0, 1.0)
    cosine, sine = forward * np.cos(heading), forward * np.sin(heading)
    ahead, left = cosine * moved[..., 0] + sine * moved[..., 1], cosine * moved[..., 1] - sine * moved[..., 0]
    chord = np.hypot(ahead, left)
    angle = np.where(chord > MIN_CHORD_M, np.arctan2(left, ahead), 0.0)
    arc = np.where(chord > MIN_CHORD_M, chord / np.sinc(angle / np.pi), ahead)
    straight_m = np.abs(speed) * KNOTS_S
    out = np.stack([forward * (arc - straight_m), angle * straight_m], axis=1)
    is_arc = is_known & (np.abs(angle) < MAX_CHORD_ANGLE_RAD)
    return np.where(is_arc[:, None, :], out, np.nan)


def known_with(track: Track) -> Rows:
    """The state with which each start's outcome at each knot became known, shape (n, k); never: n."""
    at_ns = track.stamp_ns[:, None] + np.rint(KNOTS_S * NS_PER_S).astype(np.int64)
    return np.asarray(np.searchsorted(track.stamp_ns, at_ns))


def known_at_ns(track: Track) -> Int64Array:
    """When each start's outcome at each knot became known, shape (n, k); never: `NEVER_NS`."""
    return np.append(track.known_ns, NEVER_NS)[known_with(track)]


def measured_acted(
    vehicle: npt.NDArray[np.integer],
    stamp_ns: Int64Array,
    log_time_ns: Int64Array | None,
    state: FloatArray,
    covariance: FloatArray | None,
    prior: FleetPrior | None = None,
) -> FloatArray:
    """For how long acceleration and yaw rate of each row act by each knot, shape (n, 2, k); see `fleet.acted_s`.

    Args:
        vehicle: Shape (n,): which vehicle a row is of.
        stamp_ns, log_time_ns: Shape (n,), any order: time of the states; when they were known (None: at their stamps).
        state, covariance: Shapes (n, 8) and (n, 8, 8) or None.
        prior: None: the fleet's.
    """
    chosen = prior or fleet_prior()
    log_ns = stamp_ns if log_time_ns is None else log_time_ns
    share = np.einsum("nai,aki->nak", _unrecorded(clearness(state, covariance)), chosen.gain)
    tracks = [track for track in known_tracks(vehicle, stamp_ns, log_ns, state, covariance) if len(track.rows) > 1]
    for track, gain in zip(tracks, measured_gains(tracks, chosen), strict=True):
        share[track.rows] = np.einsum("naki,naki->nak", parts_of(track), gain)
    return acted_s(np.clip(share, 0.0, 1.0))


def _unrecorded(clear: FloatArray) -> FloatArray:
    """The parts (n, 2, 3) of states without a track: what is clear counts as lasting, as nothing speaks against it."""
    return np.stack([1.0 - clear, clear, np.zeros_like(clear)], axis=-1)


def measured_gains(tracks: Sequence[Track], prior: FleetPrior) -> list[FloatArray]:
    """The gain of each part, by axis and knot, for each state of each track: (n, 2, k, 3)."""
    promised = [promised_m(track.state)[..., None] * parts_of(track) for track in tracks]
    sums = [_running_sums(track, x, prior) for track, x in zip(tracks, promised, strict=True)]
    known_ns = [known_at_ns(track) for track in tracks]
    # Of several states that became known at once a later one tells an earlier one nothing.
    own = [
        _gathered(s, [np.searchsorted(with_row, np.arange(len(track.rows)), side="right") for with_row in with_rows.T])
        for track, s, with_rows in zip(tracks, sums, map(known_with, tracks), strict=True)
    ]
    others = _others(tracks, sums, known_ns) if len(tracks) > 1 else [None] * len(tracks)
    return [_posterior(mine, rest, prior) for mine, rest in zip(own, others, strict=True)]


def _running_sums(track: Track, promised: FloatArray, prior: FleetPrior) -> FloatArray:
    """q x x' (above the diagonal) and q x y of the first 0, 1, ..., n outcomes, shape (k, n + 1, 2, 9)."""
    followed = followed_m(track)
    is_known = np.isfinite(followed)
    y = np.where(is_known, followed, 0.0)
    left = np.abs(y - np.einsum("naki,aki->nak", promised, prior.gain))
    step_s = np.minimum(np.diff(track.stamp_ns, prepend=track.stamp_ns[:1]) / NS_PER_S, MAX_GAP_S)
    weight = np.where(is_known, step_s[:, None, None] / KNOTS_S / (1.0 + left / prior.error_m), 0.0)
    out = np.zeros((len(y) + 1, *y.shape[1:], N_SUMS))
    x = np.moveaxis(promised, -1, 0)
    pairs = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    for column, (i, j) in enumerate(pairs):
        out[1:, ..., column] = weight * x[i] * x[j]
    for i in range(3):
        out[1:, ..., 6 + i] = weight * x[i] * y
    return np.ascontiguousarray(np.moveaxis(np.cumsum(out, axis=0, out=out), 2, 0))


def _gathered(sums: FloatArray, counts: Sequence[npt.NDArray[np.intp]]) -> FloatArray:
    """The sums over the first so many outcomes, which differ by knot: (k, n, 2, 9)."""
    return np.stack([of_knot[count] for of_knot, count in zip(sums, counts, strict=True)])


def _others(
    tracks: Sequence[Track], sums: Sequence[FloatArray], known_ns: Sequence[Int64Array]
) -> list[FloatArray | None]:
    """What was known of the log's other vehicles at each state of each track: their sums, (k, n, 2, 9)."""
    steps = np.concatenate([np.diff(each, axis=1) for each in sums], axis=1)
    when_ns = np.concatenate(known_ns).T
    order = np.argsort(when_ns, axis=1, kind="stable")
    total = np.zeros((len(KNOTS_S), steps.shape[1] + 1, *steps.shape[2:]))
    for k in range(len(KNOTS_S)):
        np.cumsum(steps[k, order[k]], axis=0, out=total[k, 1:])
    when_ns = np.take_along_axis(when_ns, order, axis=1)
    out: list[FloatArray | None] = []
    for track, mine, known in zip(tracks, sums, known_ns, strict=True):
        every, own = (
            _gathered(each, [np.searchsorted(then_ns, track.known_ns, side="right") for then_ns in when])
            for each, when in ((total, when_ns), (mine, known.T))
        )
        out.append(every - own)
    return out


def _posterior(own: FloatArray, others: FloatArray | None, prior: FleetPrior) -> FloatArray:
    """The gains (n, 2, k, 3), from the shortest knot to the longest."""
    n = own.shape[1]
    out = np.empty((n, 2, len(KNOTS_S), 3))
    for k in range(len(KNOTS_S)):
        gain = np.broadcast_to(prior.gain[:, k], (n, 2, 3))
        if k:
            gain = _carried_on(out[:, :, k - 1], prior, k)
        ridge = PRIOR_OUTCOMES * prior.error_m[:, k, None] ** 2
        for sums in (others, own):
            if sums is not None:
                gain = np.clip(_ridge_solution(sums[k], ridge, gain), 0.0, 1.0)
        out[:, :, k] = gain
    return out


def _carried_on(gain: FloatArray, prior: FleetPrior, k: int) -> FloatArray:
    """What gains (n, 2, 3) at the knot before k let expect at k: the fleet's fall from knot to knot.

    What is unclear falls like what lasts. Where the fleet's gain was 0 at the knot before, it is taken as it is at k.
    """
    before, now = prior.gain[:, k - 1], prior.gain[:, k]
    ratio = np.where(before > 0.0, now / np.where(before > 0.0, before, 1.0), np.nan)
    ratio[:, 0] = ratio[:, 1]
    return np.asarray(np.where(np.isfinite(ratio), np.clip(gain * ratio, 0.0, 1.0), now))


def _ridge_solution(sums: FloatArray, ridge: FloatArray, prior: FloatArray) -> FloatArray:
    """(A + diag(ridge))^-1 (b + ridge prior) for sums (..., 9), by Cholesky's factors written out; (..., 3).

    The unclear part comes last in the elimination: 1 / l22^2 is the variance of its gain over that of an outcome.
    What it has more than its prior is less what a gain of 0 would show on average.
    """
    a22, a12, a02, a11, a01, a00, b2, b1, b0 = np.moveaxis(sums, -1, 0)
    b0, b1, b2 = (b + ridge[..., 2 - i] * prior[..., 2 - i] for i, b in enumerate((b0, b1, b2)))
    l00 = np.sqrt(a00 + ridge[..., 2])
    l10, l20 = a01 / l00, a02 / l00
    l11 = np.sqrt(a11 + ridge[..., 1] - l10**2)
    l21 = (a12 - l20 * l10) / l11
    l22 = np.sqrt(a22 + ridge[..., 0] - l20**2 - l21**2)
    c0 = b0 / l00
    c1 = (b1 - l10 * c0) / l11
    c2 = (b2 - l20 * c0 - l21 * c1) / l22
    g2 = c2 / l22
    g1 = (c1 - l21 * g2) / l11
    g0 = (c0 - l10 * g1 - l20 * g2) / l00
    error_m = np.sqrt(ridge[..., 0] / PRIOR_OUTCOMES[0])
    doubted = np.maximum(g2 - POSITIVE_PART * error_m / l22, np.minimum(g2, prior[..., 0]))
    return np.stack([doubted, g1, g0], axis=-1)
