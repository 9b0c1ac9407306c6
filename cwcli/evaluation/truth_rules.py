"""The rule by which a truth differs from the track: another clock, point of the car, datum, axes or unit.

Errors of an estimate come and go. A truth that is 0.2 s late, or of a point 1.5 m ahead, differs from the track by one
rule all along. Such a difference tells nothing of the estimate's covariance, and not which side is wrong: a clock, a
datum and a lever arm belong to the truth as much as to the sensors. So a rule is told as what it is.

A rule is fitted to each half of the log and judged by the other half: it holds in both, or it is none.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from cwcli.estimation.consistency import nees
from cwcli.estimation.result import Track
from cwcli.estimation.tolerances import TOLERATED_VARIANCE_FACTOR
from cwcli.evaluation.doubts.states import TRUTH_RULES_RECORD_KEY
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.signals.angles import wrap_angle
from cwcli.signals.columns import BoolArray, FloatArray, Int64Array
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import HEADING, SPEED, X, Y

STATES_OF_QUANTITY = {"position": [X, Y], "speed": [SPEED], "heading": [HEADING]}
"""Quantity of a truth -> its states in the order of `STATE_NAMES`; the order of this table is that of the search."""
MAX_SEARCHED_TRUTH_CLOCK_ERROR_S = 30.0
"""Largest error of a truth's clock that is searched, s. Chosen: GPS is 18 s ahead of UTC."""
COARSE_CLOCK_ERROR_SEARCH_STEP_S = 0.5
"""First step of that search, s. Chosen: a car's way bends over seconds."""
FINE_CLOCK_ERROR_SEARCH_STEP_S = 1e-3
"""Last step of that search, s. Chosen: a car drives a few centimetres in it."""
MAX_ROWS_IN_TRUTH_RULE_SEARCH = 400
"""Greatest number of rows in that search. Chosen for its duration."""
MIN_TRUTH_ROWS_OF_HALF_LOG = 20
"""Least number of rows in each half of the log. Chosen by hand: fewer show no rule."""
MAX_REMAINING_NEES_SHARE = 0.25
"""Greatest share of the NEES that is left where a rule holds. Chosen: the rule then makes most of the error."""
MIN_ADVANTAGE_FACTOR_OVER_SIMPLER_RULE = 1.2
"""Factor by which a rule has to be better than an earlier, simpler one. Chosen by hand; not fitted."""
MIN_DURATION_OF_REPEATED_TRUTH_VALUE_S = 2.0
"""Least time in s for which a truth repeats one value while the track moves on. Chosen: longer than a stutter."""
MIN_TRACK_MOVEMENT_WHILE_TRUTH_REPEATS_M = 2.0
"""Least way of the track in that time, m. Chosen: a car that stands repeats its place lawfully."""


@dataclass(frozen=True)
class TruthRule:
    """The rule by which a quantity of a truth differs from the track.

    Attributes:
        text: What the truth does, in words with numbers, as the end of a sentence that begins with the truth.
        advice: What to do; a whole sentence.
        nees_per_dof: What is left of the NEES per degree of freedom without it, by the half that it was not fitted to.
    """

    text: str
    advice: str
    nees_per_dof: float


@dataclass(frozen=True)
class _TruthRows:
    """Rows of one quantity.

    Attributes:
        quantity: Its name.
        stamp_s: Shape (n,).
        truth: Shape (n, d).
        track_s, track: Shape (m,) and (m, 8): the whole track.
        covariance: Shape (n, d, d): of the track at the rows.
        late_s: By how much the truth is late.
    """

    quantity: str
    stamp_s: FloatArray
    truth: FloatArray
    track_s: FloatArray
    track: FloatArray
    covariance: FloatArray
    late_s: float = 0.0

    def track_state_at_true_times(self, state: int, late_s: float) -> FloatArray:
        """The track at the true times of the rows, (n,); NaN outside of it."""
        return np.interp(self.stamp_s - late_s, self.track_s, self.track[:, state], left=np.nan, right=np.nan)

    def estimated_quantity(self, late_s: float) -> FloatArray:
        """The estimated quantity at the true times of the rows, (n, d)."""
        return np.column_stack([self.track_state_at_true_times(i, late_s) for i in STATES_OF_QUANTITY[self.quantity]])

    def track_minus_truth(self, late_s: float) -> FloatArray:
        """Track minus truth, (n, d)."""
        error = self.estimated_quantity(late_s) - self.truth
        return np.asarray(wrap_angle(error) if self.quantity == "heading" else error)

    def select(self, rows: BoolArray) -> _TruthRows:
        """Some of the rows."""
        return replace(self, stamp_s=self.stamp_s[rows], truth=self.truth[rows], covariance=self.covariance[rows])

    def nees_per_dof(self, error: FloatArray, rows: BoolArray) -> float:
        """Mean over some rows; infinite where less than half of them are known."""
        known = rows & np.isfinite(error).all(axis=1)
        if not known.any() or 2 * np.count_nonzero(known) < np.count_nonzero(rows):
            return float("inf")
        mean: float = nees(error[known], self.covariance[known]).mean() / error.shape[1]
        return float(mean)


_RuleFit = Callable[[_TruthRows, BoolArray], FloatArray]
"""Rows and which of them count, (n,) -> parameters."""


@dataclass(frozen=True)
class _RuleKind:
    """A kind of rule.

    Attributes:
        quantities: To which it applies.
        fit: Returns the parameters.
        apply: Rows and parameters -> rows whose truth is without the rule.
        text: Parameters -> `TruthRule.text`.
        advice: As in `TruthRule`.
    """

    quantities: tuple[str, ...]
    fit: _RuleFit
    apply: Callable[[_TruthRows, FloatArray], _TruthRows]
    text: Callable[[FloatArray], str]
    advice: str


def find_truth_rules(
    stamp_ns: Int64Array, truth: Mapping[str, FloatArray], ego: Track, covariance: FloatArray, names: Sequence[str]
) -> dict[str, TruthRule]:
    """Return the rule by which each of some quantities of a truth differs from the track, where there is one.

    Args:
        stamp_ns: Shape (n,): of the truth.
        truth: Quantity -> values, (n, d) or (n,), in the map frame and in SI units.
        ego: The track.
        covariance: Shape (n, 8, 8): of the track at the truth's rows.
        names: Quantities whose NEES is too large.
    """
    found: dict[str, TruthRule] = {}
    clock: FloatArray | None = None
    track_s = (ego.stamp_ns - stamp_ns[0]) / NS_PER_S
    for quantity, states in STATES_OF_QUANTITY.items():
        if quantity not in names or quantity not in truth:
            continue
        values = truth[quantity].reshape(len(stamp_ns), len(states))
        known = np.isfinite(values).all(axis=1)
        if np.count_nonzero(known) < 2 * MIN_TRUTH_ROWS_OF_HALF_LOG:
            continue
        rows = _TruthRows(
            quantity,
            (stamp_ns[known] - stamp_ns[0]) / NS_PER_S,
            values[known],
            track_s,
            ego.state,
            covariance[known][:, states][:, :, states],
        )
        rule, clock = _rule_and_clock_of_quantity(rows, clock)
        if rule is not None:
            found[quantity] = rule
    return found


def truth_rules_to_record_entry(rules: Mapping[str, TruthRule]) -> dict[str, str]:
    """Return the entry of the record with the rules of each quantity, for the doubts."""
    found = {
        quantity: {"text": rule.text, "advice": rule.advice, "nees_per_dof": rule.nees_per_dof}
        for quantity, rule in rules.items()
    }
    return {TRUTH_RULES_RECORD_KEY: json.dumps(found)}


def _rule_and_clock_of_quantity(
    rows: _TruthRows, clock: FloatArray | None
) -> tuple[TruthRule | None, FloatArray | None]:
    """Return the rule of a quantity, and by how much the truth is late if that is the rule.

    Args:
        clock: The rule of another quantity, which is tried first.
    """
    before = rows.nees_per_dof(rows.track_minus_truth(rows.late_s), np.ones(len(rows.stamp_s), np.bool_))
    if clock is not None:
        moved = CLOCK_RULE_KIND.apply(rows, clock)
        left = moved.nees_per_dof(moved.track_minus_truth(moved.late_s), np.ones(len(rows.stamp_s), np.bool_))
        if left <= max(TOLERATED_VARIANCE_FACTOR, MAX_REMAINING_NEES_SHARE * before):
            return TruthRule(CLOCK_RULE_KIND.text(clock), CLOCK_RULE_KIND.advice, left), clock
    best, best_left = None, MAX_REMAINING_NEES_SHARE * before * MIN_ADVANTAGE_FACTOR_OVER_SIMPLER_RULE
    for kind in TRUTH_RULE_KINDS:
        if rows.quantity in kind.quantities:
            left = _held_out_nees(rows, kind)
            if MIN_ADVANTAGE_FACTOR_OVER_SIMPLER_RULE * left < best_left:
                best, best_left = kind, left
    if best is None:
        return None, clock
    parameters = best.fit(rows, np.ones(len(rows.stamp_s), np.bool_))
    return TruthRule(best.text(parameters), best.advice, best_left), parameters if best is CLOCK_RULE_KIND else clock


def _held_out_nees(rows: _TruthRows, kind: _RuleKind) -> float:
    """Return the greater NEES of both halves of the log, each without the rule as fitted to the other half."""
    first = rows.stamp_s < np.median(rows.stamp_s)
    left = []
    for fitted in (first, ~first):
        if np.count_nonzero(fitted) < MIN_TRUTH_ROWS_OF_HALF_LOG:
            return float("inf")
        without = kind.apply(rows, kind.fit(rows, fitted))
        left.append(without.nees_per_dof(without.track_minus_truth(without.late_s), ~fitted))
    return max(left)


def _weighted_fit_of_truth_minus_track(columns: Callable[[_TruthRows], FloatArray]) -> _RuleFit:
    """Return the weighted least squares of truth minus track by columns (n, d, p)."""

    def fit(rows: _TruthRows, chosen: BoolArray) -> FloatArray:
        error, design = -rows.track_minus_truth(rows.late_s), columns(rows)
        use = chosen & np.isfinite(error).all(axis=1)
        weight = np.linalg.inv(rows.covariance[use])
        normal = np.einsum("nip,nij,njq->pq", design[use], weight, design[use])
        explained = np.einsum("nip,nij,nj->p", design[use], weight, error[use])
        return np.asarray(np.linalg.lstsq(normal, explained, rcond=None)[0])

    return fit


def _correct_by_linear_columns(
    columns: Callable[[_TruthRows], FloatArray],
) -> Callable[[_TruthRows, FloatArray], _TruthRows]:
    return lambda rows, parameters: _with_truth(rows, rows.truth - columns(rows) @ parameters)


def _with_truth(rows: _TruthRows, truth: FloatArray) -> _TruthRows:
    return replace(rows, truth=truth)


def _reference_point_columns(rows: _TruthRows) -> FloatArray:
    heading = rows.track_state_at_true_times(HEADING, rows.late_s)
    ahead = np.column_stack([np.cos(heading), np.sin(heading)])
    return np.stack([ahead, np.column_stack([-ahead[:, 1], ahead[:, 0]])], axis=2)


def _map_offset_columns(rows: _TruthRows) -> FloatArray:
    return np.broadcast_to(np.eye(2), (len(rows.stamp_s), 2, 2))


def _map_rotation_columns(rows: _TruthRows) -> FloatArray:
    xy = rows.estimated_quantity(rows.late_s)
    x, y = (xy - np.nanmean(xy, axis=0)).T
    return np.stack([*np.moveaxis(_map_offset_columns(rows), 2, 0), np.stack([x, y], 1), np.stack([-y, x], 1)], axis=2)


def _speed_columns(rows: _TruthRows) -> FloatArray:
    return rows.estimated_quantity(rows.late_s)[:, :, None]


def _clock_error_fit_with(other: _RuleKind | None) -> _RuleFit:
    """Return the fit of by how much the truth is late, s, and of another rule's parameters beside it, (1 + p,).

    The likeliest delay is searched on a grid, then in ever finer steps.
    """

    def fit(rows: _TruthRows, chosen: BoolArray) -> FloatArray:
        every = np.flatnonzero(chosen)
        thin = np.zeros_like(chosen)
        thin[every[:: max(1, len(every) // MAX_ROWS_IN_TRUTH_RULE_SEARCH)]] = True
        few = rows.select(thin)
        all_few = np.ones(len(few.stamp_s), np.bool_)

        def cost(late_s: float) -> float:
            moved = _rows_with_later_clock(few, late_s)
            if other is not None:
                moved = other.apply(moved, other.fit(moved, all_few))
            return moved.nees_per_dof(moved.track_minus_truth(moved.late_s), all_few)

        grid = np.arange(
            -MAX_SEARCHED_TRUTH_CLOCK_ERROR_S,
            MAX_SEARCHED_TRUTH_CLOCK_ERROR_S + COARSE_CLOCK_ERROR_SEARCH_STEP_S,
            COARSE_CLOCK_ERROR_SEARCH_STEP_S,
        )
        best = float(grid[int(np.argmin([cost(each) for each in grid.tolist()]))])
        step = 0.5 * COARSE_CLOCK_ERROR_SEARCH_STEP_S
        while step > FINE_CLOCK_ERROR_SEARCH_STEP_S:
            best = min((best, best - step, best + step), key=cost)
            step *= 0.5
        return np.append(best, [] if other is None else other.fit(_rows_with_later_clock(rows, best), chosen))

    return fit


def _clock_error_remover_with(other: _RuleKind | None) -> Callable[[_TruthRows, FloatArray], _TruthRows]:
    def apply(rows: _TruthRows, parameters: FloatArray) -> _TruthRows:
        moved = _rows_with_later_clock(rows, float(parameters[0]))
        return moved if other is None else other.apply(moved, parameters[1:])

    return apply


def _rows_with_later_clock(rows: _TruthRows, late_s: float) -> _TruthRows:
    return replace(rows, late_s=rows.late_s + late_s)


def _kind_of_clock_and_other_rule(other: _RuleKind) -> _RuleKind:
    """Return the rule of another clock and another rule together."""
    return _RuleKind(
        other.quantities,
        _clock_error_fit_with(other),
        _clock_error_remover_with(other),
        lambda parameters: f"{_clock_text(parameters)}, and {other.text(parameters[1:])}",
        f"{CLOCK_RULE_KIND.advice} {other.advice}",
    )


def _clock_text(late_s: FloatArray) -> str:
    return f"is {abs(late_s[0]):.2g} s {'late' if late_s[0] > 0.0 else 'early'} against the track, as by another clock"


def _reference_point_text(place_m: FloatArray, directions: Sequence[tuple[str, str]]) -> str:
    """Format `3 m ahead and 1 m left`; a component below a tenth of the distance is left out.

    Args:
        place_m: Shape (2,).
        directions: Words for a positive and for a negative value of each component.
    """
    return " and ".join(
        f"{abs(value):.2g} m {words[value < 0.0]}"
        for value, words in zip(place_m.tolist(), directions, strict=True)
        if abs(value) > 0.1 * np.hypot(*place_m)
    )


def _point_text(place_m: FloatArray) -> str:
    place = _reference_point_text(place_m, (("ahead", "behind"), ("left", "right")))
    return f"lies {place} of the estimated point, as another point of the car"


def _map_offset_text(offset_m: FloatArray) -> str:
    place = _reference_point_text(offset_m, (("east", "west"), ("north", "south")))
    return f"lies {place} of the track, as by another datum or base station"


def _map_text(parameters: FloatArray) -> str:
    turn = complex(1.0 + parameters[2], parameters[3])
    return (
        f"is turned by {np.degrees(np.angle(turn)):.2g} deg and scaled by {abs(turn):.5g}, as by another projection "
        "of the map"
    )


def _constant_offset_fit(sign: float) -> _RuleFit:
    """Return the constant (1,) in truth = sign * track + constant."""

    def fit(rows: _TruthRows, chosen: BoolArray) -> FloatArray:
        difference = (rows.truth - sign * rows.estimated_quantity(rows.late_s))[:, 0]
        use = chosen & np.isfinite(difference)
        return np.array([np.angle(np.exp(1j * difference[use]).mean())])

    return fit


def _correct_by_turned_axes(sign: float) -> Callable[[_TruthRows, FloatArray], _TruthRows]:
    return lambda rows, turn_rad: _with_truth(rows, sign * (rows.truth - turn_rad))


def _held_truth_rows_mask(rows: _TruthRows) -> BoolArray:
    """Return which rows of a truth repeat the value before them for long while the track moves on, (n,)."""
    if rows.quantity != "position":
        return np.zeros(len(rows.stamp_s), np.bool_)
    is_new = np.append(True, (np.diff(rows.truth, axis=0) != 0.0).any(axis=1))
    first = np.flatnonzero(is_new)
    last = np.append(first[1:], len(is_new)) - 1
    estimated = rows.estimated_quantity(rows.late_s)  # NaN outside of the track, where no movement is known
    is_held = (rows.stamp_s[last] - rows.stamp_s[first] > MIN_DURATION_OF_REPEATED_TRUTH_VALUE_S) & (
        np.hypot(*(estimated[last] - estimated[first]).T) > MIN_TRACK_MOVEMENT_WHILE_TRUTH_REPEATS_M
    )
    return np.repeat(is_held, last - first + 1)


def _total_held_time_s(rows: _TruthRows, chosen: BoolArray) -> FloatArray:
    """Return for how long the truth is held, s, (1,)."""
    step_s = np.append(0.0, np.diff(rows.stamp_s))
    return np.array([step_s[_held_truth_rows_mask(rows) & chosen].sum()])


def _drop_held_truth_rows(rows: _TruthRows, _: FloatArray) -> _TruthRows:
    return _with_truth(rows, np.where(_held_truth_rows_mask(rows)[:, None], np.nan, rows.truth))


CLOCK_RULE_KIND = _RuleKind(
    ("position", "speed", "heading"),
    _clock_error_fit_with(None),
    _clock_error_remover_with(None),
    _clock_text,
    "Check the truth's clock against those of the sensors.",
)
"""Another clock; it comes first, because it holds for all quantities."""
REFERENCE_POINT_RULE_KIND = _RuleKind(
    ("position",),
    _weighted_fit_of_truth_minus_track(_reference_point_columns),
    _correct_by_linear_columns(_reference_point_columns),
    _point_text,
    "Give the mounting of the position's sensor with --lever-arm, or take a truth of the same point.",
)
"""Another point of the car."""
MAP_OFFSET_RULE_KIND = _RuleKind(
    ("position",),
    _weighted_fit_of_truth_minus_track(_map_offset_columns),
    _correct_by_linear_columns(_map_offset_columns),
    _map_offset_text,
    "Check the datum and the origin of the truth and of the fixes.",
)
"""An offset on the map."""
TRUTH_RULE_KINDS = (
    _RuleKind(
        ("position",),
        _total_held_time_s,
        _drop_held_truth_rows,
        lambda held_s: f"repeats one value for {held_s[0]:.0f} s while the car moves on",
        "Leave that part out with --start and --end, or take another truth.",
    ),
    CLOCK_RULE_KIND,
    REFERENCE_POINT_RULE_KIND,
    MAP_OFFSET_RULE_KIND,
    _RuleKind(
        ("position",),
        _weighted_fit_of_truth_minus_track(_map_rotation_columns),
        _correct_by_linear_columns(_map_rotation_columns),
        _map_text,
        "Check the projection of the truth's positions.",
    ),
    _kind_of_clock_and_other_rule(REFERENCE_POINT_RULE_KIND),
    _kind_of_clock_and_other_rule(MAP_OFFSET_RULE_KIND),
    _RuleKind(
        ("speed",),
        _weighted_fit_of_truth_minus_track(_speed_columns),
        lambda rows, share: _with_truth(rows, rows.truth / (1.0 + share)),
        lambda share: f"is {1.0 + share[0]:.4g} times the estimated one, as in another unit or by another wheel",
        "Check the unit of the truth's speed.",
    ),
    _RuleKind(
        ("heading",),
        _constant_offset_fit(1.0),
        _correct_by_turned_axes(1.0),
        lambda turn: (
            f"is turned {np.degrees(abs(turn[0])):.2g} deg to the {'left' if turn[0] > 0.0 else 'right'}, as a device "
            "that is mounted so or counts from another north"
        ),
        "Check how the truth's device is mounted, and where its heading counts from.",
    ),
    _RuleKind(
        ("heading",),
        _constant_offset_fit(-1.0),
        _correct_by_turned_axes(-1.0),
        lambda turn: f"counts clockwise, and {np.degrees(turn[0]) % 360.0:.3g} deg where the car heads east",
        "Check which way the truth's heading counts; it should be counter-clockwise from east.",
    ),
)
"""All kinds; of two that explain as much, the earlier one is told."""
