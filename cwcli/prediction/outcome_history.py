"""Measure the gain of acceleration and yaw rate: how much of what the states promised followed at each horizon.

Constant velocity takes a car v h along its heading. Acceleration a and yaw rate w add a h^2/2 along it and, as an
angle of the chord, w h/2 across, if they go on and if they are right. How much of that followed is a linear
regression, by each axis and knot of `fleet.HORIZON_KNOTS_S`: y = x' g, x the displacement that each part of the
derivative promises (`unclear_lasting_new_shares_of_derivatives`), y the outcome. With outcomes weighted by q the ridge
estimate is

    g = (sum q x x' + N e^2 I)^-1 (sum q x y + N e^2 g0),    q = (dt / h) / (1 + min(|y - x' g_fleet|, |y|) / e),

e the fleet's mean error and N the weight of the prior, in independent outcomes of that size. dt/h counts independent
outcomes, whatever the rate of the states; the denominator makes it an estimate of the mean error rather than of
the mean square (iteratively reweighted least squares with one step), from the nearer of what the fleet and constant
velocity expect: with the fleet's alone, outcomes that agree with it would count most. Three levels follow each other,
each the prior g0 of the next: the fleet's gain (scaled as the vehicle's own gain at the shorter knot, whose outcomes
come sooner, turned out against the fleet's), that of the log's other vehicles, the vehicle's own. A vehicle whose
derivatives say nothing is then predicted with constant velocity, whatever its filter claims.

Everything at a moment comes from states that were known by then (log time).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, pairwise

import numpy as np
import numpy.typing as npt

from cwcli.kernels import record as kernel
from cwcli.lazy_dataclass import dataclass
from cwcli.prediction.fleet import HORIZON_KNOTS_S, FleetPrior, acting_time_from_displacement_share_s, load_fleet_prior
from cwcli.prediction.outcome import actual_positions
from cwcli.signals.columns import FloatArray, Int64Array, StateRows, sort_distinct_values
from cwcli.signals.packed_covariances import Covariances, variances_of_states
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import ACCEL, HEADING, SPEED, YAW_RATE

PartShares = FloatArray
"""Shares or gains of the parts of acceleration and yaw rate, by axis and knot, shape (n, 2, k, 3)."""

SIGMAS_OF_HALF_CLEARNESS = 5.0
"""Size of a derivative, in stated sigmas, at which its clearness is one half. Chosen: filters on real drives are too
sure by up to 3."""
CLEARNESS_EXPONENT = 8
"""Exponent p of the clearness 1 / (1 + (5 sigma / d)^p): how sharp its edge is. Chosen by hand; not fitted."""
LOOK_BACK_SHARE_OF_HORIZON = 0.5
"""Share of the horizon before now over which the mean of a derivative is its lasting part. Chosen by hand; not
fitted."""
MIN_DERIVATIVE_AVERAGING_TIME_S = 0.3
"""Shortest time in s over which that mean is taken. Chosen by hand; not fitted."""
MIN_LOOK_BACK_DATA_S = 0.15
"""Shortest history in s of a derivative that has a lasting part. Chosen by hand; not fitted."""
MAX_INTERPOLATED_GAP_S = 0.5
"""Longest gap in s across which outcomes are interpolated, and longest time that a row stands for. Chosen by hand."""
MIN_CHORD_OF_DRIVEN_ARC_M = 1.0
"""Shortest chord of a driven arc, m, whose angle to the heading is used; the angle of a shorter chord is mostly noise
and counts as 0. Chosen by hand; not fitted."""
MAX_CHORD_TO_HEADING_RAD = 2.0
"""Greatest angle of a chord to the heading, rad, that an arc can have. Chosen by hand; not fitted."""
PRIOR_WEIGHT_IN_OUTCOMES_BY_PART = np.array([4.0, 1.0, 1.0])
"""Weight of the prior in independent outcomes for the parts unclear, lasting and new (docs/prediction.md)."""
OUTCOME_NEVER_KNOWN_NS = np.iinfo(np.int64).max
"""The time of an outcome that never becomes known."""

Rows = npt.NDArray[np.intp]


@dataclass(frozen=True)
class PathStarts:
    """States of vehicles in any order, n rows; each can be the start of a path.

    Attributes:
        vehicle: Shape (n,): which vehicle a row is of.
        stamp_ns: Shape (n,): time of the states.
        state, covariance: Shapes (n, 8) and (n, 8, 8) or None.
        log_time_ns: Shape (n,): when the states were known; None: at their stamps.
    """

    vehicle: npt.NDArray[np.integer]
    stamp_ns: Int64Array
    state: FloatArray
    covariance: Covariances | None
    log_time_ns: Int64Array | None = None

    @property
    def known_ns(self) -> Int64Array:
        """When the states were known, shape (n,)."""
        return self.stamp_ns if self.log_time_ns is None else self.log_time_ns


@dataclass(frozen=True)
class StateHistory:
    """States of vehicles in the order in which they became known; states overtaken by a newer one are left out.

    Attributes:
        rows: Shape (n,): their rows in the input.
        stamp_ns, known_ns: Shape (n,): per vehicle strictly increasing, and non-decreasing.
        state: Shape (n, 8).
        clear: Shape (n, 2): see `accel_and_yaw_rate_clearness_0_to_1`.
        first: First row of each vehicle; the vehicles follow each other.
    """

    rows: Rows
    stamp_ns: Int64Array
    known_ns: Int64Array
    state: FloatArray
    clear: FloatArray
    first: tuple[int, ...] = (0,)

    def row_slices_of_vehicles(self) -> list[slice]:
        """The rows of each vehicle."""
        return [slice(a, b) for a, b in pairwise((*self.first, len(self.rows)))]

    def vehicle_indices(self) -> Rows:
        """Which vehicle each row is of, from 0, shape (n,)."""
        return np.repeat(np.arange(len(self.first)), np.diff((*self.first, len(self.rows))))

    def step_s(self) -> FloatArray:
        """The time since the row before, at most `MAX_INTERPOLATED_GAP_S`, shape (n,); 0 at a vehicle's first row."""
        step_s = np.minimum(np.diff(self.stamp_ns, prepend=self.stamp_ns[:1]) / NS_PER_S, MAX_INTERPOLATED_GAP_S)
        step_s[list(self.first)] = 0.0
        return step_s


def concatenate_histories(tracks: Sequence[StateHistory]) -> StateHistory:
    """Concatenate the histories of several vehicles."""
    if len(tracks) == 1:
        return tracks[0]
    starts = accumulate((len(track.rows) for track in tracks[:-1]), initial=0)
    return StateHistory(
        np.concatenate([track.rows for track in tracks]),
        np.concatenate([track.stamp_ns for track in tracks]),
        np.concatenate([track.known_ns for track in tracks]),
        np.concatenate([track.state for track in tracks]),
        np.concatenate([track.clear for track in tracks]),
        tuple(starts),
    )


def accel_and_yaw_rate_clearness_0_to_1(state: StateRows, covariance: Covariances | None) -> FloatArray:
    """How clearly acceleration and yaw rate exceed their stated noise, 0 to 1, shape (n, 2)."""
    if covariance is None:
        return np.ones((len(state), 2))
    columns = [ACCEL, YAW_RATE]
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        noise = SIGMAS_OF_HALF_CLEARNESS**2 * np.maximum(variances_of_states(covariance, columns), 0.0)
        power = (noise / state[:, columns] ** 2) ** (CLEARNESS_EXPONENT // 2)
        return np.asarray(np.nan_to_num(1.0 / (1.0 + power), nan=1.0))


def state_histories_by_vehicle(starts: PathStarts) -> list[StateHistory]:
    """The history of each vehicle; rows whose state is not finite are left out, and vehicles without other rows too."""
    stamp_ns, known_ns, state = starts.stamp_ns, starts.known_ns, starts.state
    is_finite = np.isfinite(state[:, : YAW_RATE + 1]).all(axis=1)
    clear = accel_and_yaw_rate_clearness_0_to_1(state, starts.covariance)
    tracks = []
    for one in sort_distinct_values(starts.vehicle):
        rows = np.flatnonzero((starts.vehicle == one) & is_finite)
        rows = rows[np.lexsort((stamp_ns[rows], known_ns[rows]))]
        newest = np.maximum.accumulate(stamp_ns[rows])
        rows = rows[np.concatenate([[True], stamp_ns[rows][1:] > newest[:-1]])[: len(rows)]]
        if len(rows):
            tracks.append(StateHistory(rows, stamp_ns[rows], known_ns[rows], state[rows], clear[rows]))
    return tracks


def unclear_lasting_new_shares_of_derivatives(track: StateHistory) -> PartShares:
    """Divide acceleration and yaw rate into `fleet.DERIVATIVE_PART_NAMES`, by knot, (n, 2, k, 3): shares with sum 1.

    Unclear is what may be noise. Lasting is what is clear and was as large on average over the last h/2, for a horizon
    h: what lasts that long has mostly lasted some time. New is the rest: a manoeuvre that has just begun.
    """
    begins = np.array(track.first, dtype=np.intp)[track.vehicle_indices()]
    age_s = (track.stamp_ns - track.stamp_ns[begins]) / NS_PER_S
    heading = np.concatenate([np.unwrap(track.state[rows, HEADING]) for rows in track.row_slices_of_vehicles()])
    look_back_s = np.maximum(LOOK_BACK_SHARE_OF_HORIZON * HORIZON_KNOTS_S, MIN_DERIVATIVE_AVERAGING_TIME_S)
    change, passed_s = kernel.changes(age_s, np.stack([track.state[:, SPEED], heading]), begins, look_back_s)
    promised = track.state[:, [ACCEL, YAW_RATE], None] * passed_s[:, None, :]
    is_told = (passed_s >= MIN_LOOK_BACK_DATA_S)[:, None, :] & (promised != 0.0)
    clear = track.clear[:, :, None]
    out = np.empty((*promised.shape, 3))
    out[..., 0] = 1.0 - clear
    out[..., 1] = clear * np.where(is_told, np.clip(change / np.where(is_told, promised, 1.0), 0.0, 1.0), 0.0)
    out[..., 2] = clear - out[..., 1]
    return out


def displacement_from_accel_and_yaw_rate_m(state: StateRows) -> FloatArray:
    """Displacement (m) that acceleration and yaw rate would add to constant velocity by each knot, shape (n, 2, k).

    A car that stops stays there.
    """
    speed, accel = state[:, SPEED, None], state[:, ACCEL, None]
    brakes = speed * accel < 0.0
    stop_s = np.where(brakes, np.abs(speed) / np.where(brakes, np.abs(accel), 1.0), np.inf)
    acts_s = np.minimum(HORIZON_KNOTS_S, stop_s)
    along = accel * acts_s**2 / 2.0 - np.where(brakes, speed, 0.0) * (HORIZON_KNOTS_S - acts_s)
    across = np.abs(speed) * state[:, YAW_RATE, None] * HORIZON_KNOTS_S**2 / 2.0
    return np.stack([along, across], axis=1)


def actual_displacement_beyond_constant_velocity_m(track: StateHistory) -> FloatArray:
    """Displacement (m) that was in fact added to constant velocity by each knot, shape (n, 2, k); NaN if not known.

    Along it is the arc's length beyond v h; across it is the angle of the arc's chord times |v| h.
    """
    outcome = [
        actual_positions(
            track.stamp_ns[rows],
            track.stamp_ns[rows],
            track.state[rows, :2],
            HORIZON_KNOTS_S.tolist(),
            MAX_INTERPOLATED_GAP_S,
        )
        for rows in track.row_slices_of_vehicles()
    ]
    found, is_known = (np.concatenate(each) for each in zip(*outcome, strict=True))
    displacement_m = found - track.state[:, None, :2]
    speed, heading = track.state[:, SPEED, None], track.state[:, HEADING, None]
    forward = np.where(speed < 0.0, -1.0, 1.0)
    cosine, sine = forward * np.cos(heading), forward * np.sin(heading)
    ahead, left = (
        cosine * displacement_m[..., 0] + sine * displacement_m[..., 1],
        cosine * displacement_m[..., 1] - sine * displacement_m[..., 0],
    )
    chord = np.hypot(ahead, left)
    angle = np.where(chord > MIN_CHORD_OF_DRIVEN_ARC_M, np.arctan2(left, ahead), 0.0)
    arc = np.where(chord > MIN_CHORD_OF_DRIVEN_ARC_M, chord / np.sinc(angle / np.pi), ahead)
    straight_m = np.abs(speed) * HORIZON_KNOTS_S
    out = np.stack([forward * (arc - straight_m), angle * straight_m], axis=1)
    is_arc = is_known & (np.abs(angle) < MAX_CHORD_TO_HEADING_RAD)
    return np.where(is_arc[:, None, :], out, np.nan)


def rows_at_which_outcomes_became_known(track: StateHistory, knots_s: FloatArray = HORIZON_KNOTS_S) -> Rows:
    """The row with which each start's outcome at each knot became known, shape (n, k); never: n."""
    at_ns = track.stamp_ns[:, None] + np.rint(knots_s * NS_PER_S).astype(np.int64)
    out = np.empty(at_ns.shape, dtype=np.intp)
    for rows in track.row_slices_of_vehicles():
        after = rows.start + np.searchsorted(track.stamp_ns[rows], at_ns[rows])
        out[rows] = np.where(after < rows.stop, after, len(track.rows))
    return out


def outcome_known_times_ns(track: StateHistory, knots_s: FloatArray = HORIZON_KNOTS_S) -> Int64Array:
    """When each start's outcome at each knot became known, shape (n, k); never: `OUTCOME_NEVER_KNOWN_NS`."""
    return np.append(track.known_ns, OUTCOME_NEVER_KNOWN_NS)[rows_at_which_outcomes_became_known(track, knots_s)]


def measure_acting_time_s(starts: PathStarts, prior: FleetPrior | None = None) -> FloatArray:
    """Measure for how long acceleration and yaw rate of each row act by each knot, s, (n, 2, k); see
    `fleet.acting_time_from_displacement_share_s`.

    Args:
        prior: None: the fleet's.
    """
    chosen = prior or load_fleet_prior()
    clear = accel_and_yaw_rate_clearness_0_to_1(starts.state, starts.covariance)
    share = np.einsum("nai,aki->nak", _part_shares_without_history(clear), chosen.gain)
    tracks = state_histories_by_vehicle(starts)
    if tracks:
        track = concatenate_histories(tracks)
        parts = unclear_lasting_new_shares_of_derivatives(track)
        share[track.rows] = np.einsum("naki,naki->nak", parts, gain_of_each_part_from_outcomes(track, parts, chosen))
    return acting_time_from_displacement_share_s(np.clip(share, 0.0, 1.0))


def _part_shares_without_history(clear_share: FloatArray) -> FloatArray:
    """The parts (n, 2, 3) of states without a history: all that is clear counts as lasting."""
    return np.stack([1.0 - clear_share, clear_share, np.zeros_like(clear_share)], axis=-1)


def gain_of_each_part_from_outcomes(track: StateHistory, part_shares: PartShares, prior: FleetPrior) -> PartShares:
    """Measure the gain of each part, by axis and knot, for each state of each vehicle, (n, 2, k, 3).

    Args:
        track: All vehicles of the log whose outcomes count for each other.
        part_shares: Shape (n, 2, k, 3): see `unclear_lasting_new_shares_of_derivatives`.
        prior: The gains without any outcome.
    """
    known_row = rows_at_which_outcomes_became_known(track)
    known_ns = np.append(track.known_ns, OUTCOME_NEVER_KNOWN_NS)[known_row]
    return kernel.gains(
        part_shares,
        displacement_from_accel_and_yaw_rate_m(track.state),
        actual_displacement_beyond_constant_velocity_m(track),
        step_s=track.step_s(),
        knots_s=HORIZON_KNOTS_S,
        track=track.vehicle_indices(),
        known_row=known_row,
        known_ns=known_ns,
        now_ns=track.known_ns,
        by_known=np.ascontiguousarray(np.argsort(known_ns, axis=0, kind="stable").T),
        by_now=np.argsort(track.known_ns, kind="stable"),
        prior=np.ascontiguousarray(prior.gain),
        error_m=np.ascontiguousarray(prior.error_m),
        carried=_gain_ratios_between_knots(prior),
        prior_outcomes=PRIOR_WEIGHT_IN_OUTCOMES_BY_PART,
    )


def _gain_ratios_between_knots(prior: FleetPrior) -> FloatArray:
    """Ratio of the fleet's gain at each knot to that at the knot before, (2, k, 3).

    The unclear part takes the ratio of the lasting one. NaN at the first knot, and after a gain of 0.
    """
    out = np.full(prior.gain.shape, np.nan)
    before = prior.gain[:, :-1]
    np.divide(prior.gain[:, 1:], before, out=out[:, 1:], where=before > 0.0)
    out[:, :, 0] = out[:, :, 1]
    return out
