"""Lane departure: warn when the predicted path takes a front tyre over a boundary.

What it does: the outside of each front tyre is carried along the predicted path and compared with the fitted
boundaries; the time to line crossing is when the first of them meets its boundary. It warns below `warn_s`, if the
boundary has come nearer so fast that it would be crossed within `release_s`, and once a tyre is on the line, but never
before ISO's earliest warning line.

Why: a constant lateral speed or a constant turning radius misjudges bends and the driver's steering (zhang2011,
section 0).

Zones (ISO 17361, lane departure warning systems, for cars): with V the rate of departure the earliest line lies 0.75 m
inside the boundary for V up to 0.5 m/s, 1.5 s V for V up to 1.0 m/s, 1.5 m above, and the latest one 0.3 m outside it.
A system of class II must work from 17 m/s on. What these numbers rest on is in docs/observer.md.

Limits: it does not know the turn signal, so a wanted lane change is warned of too. Without a boundary on a side, or
slower than `min_speed_mps`, that side is silent and counted; so it is where the boundary has just been found, has
jumped, or is only carried on (`lane_agreement`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field
from typing import Annotated, Any, NamedTuple

import numpy as np

from cwcli.errors import UsageError
from cwcli.lazy_dataclass import dataclass
from cwcli.metrics.table import ColumnDoc, Table
from cwcli.option import Option
from cwcli.signals.clocks import earliest_known_times_ns
from cwcli.signals.columns import BoolArray, FloatArray, Int64Array
from cwcli.signals.normal_distribution import normal_cdf
from cwcli.signals.units import NS_PER_S
from cwcli.warning.events import EventSpan, EventTiming, find_events
from cwcli.warning.lane_agreement import agreement_duration_of_left_and_right_s, approach_speed_bound_mps
from cwcli.warning.lane_gap import boundary_y_and_direction_at_distances, first_crossing_time_s, last_known_gap_m
from cwcli.warning.output import NOT_CLEARED_NS
from cwcli.warning.rows import CLEARED, HELD, RAISED, WarningRow, WarningRows, build_warning_rows
from cwcli.warning.types import DEFAULT_VEHICLE_WIDTH_M, LeftAndRight, PathArrays

LANE_DEPARTURE_RULE_NAME = "lane-departure"
"""Name of the rule in warnings and tables."""
SIDES = ("left", "right")
"""Names of the sides, in the order of the evaluation."""

EARLIEST_WARNING_LINE_AT_SLOW_DEPARTURE_M = 0.75
"""Earliest warning line, m inside the boundary, at rates of departure up to 0.5 m/s (ISO 17361)."""
EARLIEST_WARNING_LINE_OFFSET_PER_DEPARTURE_RATE_S = 1.5
"""Time that the rate of departure is multiplied with for the earliest warning line, up to 1.0 m/s (ISO 17361)."""
EARLIEST_WARNING_LINE_AT_FAST_DEPARTURE_M = 1.5
"""Earliest warning line, m inside the boundary, at higher rates of departure (ISO 17361)."""
LATEST_WARNING_LINE_OF_CARS_M = -0.3
"""Latest warning line of passenger cars, m inside the boundary; negative: outside of it (ISO 17361)."""
CLASS_II_MIN_SPEED_MPS = 17.0
"""Speed from which a system of class II must work (ISO 17361)."""
DEFAULT_RELEASE_TIME_TO_LINE_CROSSING_S = 1.5
"""Time to line crossing in s beyond which a warning ends. Chosen by hand; not fitted."""


def earliest_warning_line_m(rate_mps: FloatArray) -> FloatArray:
    """Distance inside the boundary before which no warning may come, at a rate of departure (ISO 17361)."""
    return np.clip(
        EARLIEST_WARNING_LINE_OFFSET_PER_DEPARTURE_RATE_S * np.asarray(rate_mps, dtype=np.float64),
        EARLIEST_WARNING_LINE_AT_SLOW_DEPARTURE_M,
        EARLIEST_WARNING_LINE_AT_FAST_DEPARTURE_M,
    )


@dataclass(frozen=True)
class LaneDepartureConfig:
    """Options of the lane-departure rule.

    Attributes:
        warn_s: Warn when the time to line crossing falls to this.
        min_rate_mps: A slower approach is no departure until the tyre is on the line.
        release_s: The warning is held until the time to line crossing is longer than this (None:
            `DEFAULT_RELEASE_TIME_TO_LINE_CROSSING_S`, or `warn_s` if that is longer)
        release_m: and the tyre is farther than this inside the boundary.
        persistence_s: The condition must have held this long.
        agree_s: No warning is raised from a boundary that was not seen, or that jumped, within this time.
        hold_off_s: A condition that has been false this long is over.
        min_speed_mps: No warning is raised below this speed; a raised one ends `speed_hysteresis_mps` below it.
        rate_over_s: The rate of departure is taken over this piece of the path.
        max_width_m, min_width_m: Boundaries that are nearer or farther from each other than this are rejected.
    """

    warn_s: Annotated[
        float,
        Option("--line-crossing", "Warn when the time to line crossing is at most this.", metavar="SECONDS"),
    ] = 0.7
    min_rate_mps: float = 0.05
    release_s: float | None = None
    release_m: float = 0.1
    persistence_s: float = 0.1
    agree_s: float = 0.3
    hold_off_s: float = 1.0
    min_speed_mps: Annotated[
        float,
        Option("--min-speed", "Do not warn below this speed.", metavar="MPS"),
    ] = CLASS_II_MIN_SPEED_MPS
    speed_hysteresis_mps: float = 1.0
    rate_over_s: float = 0.3
    min_width_m: float = 2.0
    max_width_m: float = 6.0

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            UsageError: A value is negative, not a number, or the thresholds contradict each other.
        """
        for name, value in vars(self).items():
            if value is not None and not (math.isfinite(value) and value >= 0.0):
                raise UsageError(f"{name} is {value!r}; permitted: a number from 0", where=LANE_DEPARTURE_RULE_NAME)
        if self.effective_release_s < self.warn_s:
            raise UsageError(
                f"release_s ({self.effective_release_s:g}) is below warn_s ({self.warn_s:g})",
                where=LANE_DEPARTURE_RULE_NAME,
            )
        if self.min_width_m >= self.max_width_m:
            raise UsageError("min_width_m is not below max_width_m", where=LANE_DEPARTURE_RULE_NAME)

    @property
    def effective_release_s(self) -> float:
        """The time to line crossing beyond which a warning ends."""
        return max(DEFAULT_RELEASE_TIME_TO_LINE_CROSSING_S, self.warn_s) if self.release_s is None else self.release_s


@dataclass(frozen=True)
class LaneBoundaries:
    """Both boundaries in the body frame, x from the camera, left positive: the circles, or spirals, that
    y = y0 + s x + k x^2 / 2 touches beside the camera (`signals.lane_geometry`).

    Attributes:
        left, right: Shape (n, 3): y0 (m), s, k (1/m); NaN where not found.
        camera_forward_m: Distance of the camera ahead of the centre of gravity.
        is_seen: Shape (n,): False in frames whose lane is only extrapolated from those before; None: not known.
        steady_s: Shape (n,): time since the lane's last jump by its method; NaN or None: not known.
        curvature_change_1pm2: Shape (n,): change of curvature of the spirals, left positive; None: circles.
    """

    left: FloatArray
    right: FloatArray
    camera_forward_m: float = 0.0
    is_seen: BoolArray | None = None
    steady_s: FloatArray | None = None
    curvature_change_1pm2: FloatArray | None = None


class FrontAxle(NamedTuple):
    """The front axle of the warned vehicle.

    Attributes:
        width_m: Width over the outsides of the front tyres.
        ahead_m: Distance of the axle ahead of the centre of gravity.
        vehicle_id: Name of the vehicle.
    """

    width_m: float = DEFAULT_VEHICLE_WIDTH_M
    ahead_m: float = 1.2
    vehicle_id: str = "ego"


class _Frames(NamedTuple):
    """What is evaluated at each frame: stamp, path from it, boundaries and speed."""

    stamp_ns: Int64Array
    paths: PathArrays
    boundaries: LaneBoundaries
    speed_mps: FloatArray


@dataclass(frozen=True)
class LaneDepartureResult:
    """Warnings of leaving the lane.

    Attributes:
        rows: The warnings' states over time; `other_id` is "left boundary" or "right boundary".
        events: One row per event.
        series: One row per frame.
        counts: Number of frames of each side, by what became of them.
    """

    rows: WarningRows
    events: Table
    series: Table
    counts: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class _SideEvaluation:
    """One side at each frame, shape (n,): gap of the tyre, rate, time to crossing, probability; and the events."""

    gap_m: FloatArray
    rate_mps: FloatArray
    crossing_s: FloatArray
    end_gap_m: FloatArray
    probability: FloatArray
    spans: list[EventSpan]


def evaluate_lane_departure(
    stamp_ns: Int64Array,
    log_time_ns: Int64Array,
    paths: PathArrays,
    boundaries: LaneBoundaries,
    speed_mps: FloatArray,
    config: LaneDepartureConfig | None = None,
    host: FrontAxle = FrontAxle(),  # noqa: B008 - it can't change
) -> LaneDepartureResult:
    """Evaluate the rule for both boundaries at every frame.

    Args:
        stamp_ns: Shape (n,), strictly increasing.
        log_time_ns: Shape (n,), non-decreasing.
        paths: n paths of the centre of gravity in each frame's body frame, at least `warn_s` long.

    Raises:
        UsageError: The paths are too short.
    """
    config = config or LaneDepartureConfig()
    if paths.time_s[-1] < config.warn_s - 1e-9:
        raise UsageError(
            f"the paths reach {paths.time_s[-1]:g} s, the rule looks {config.warn_s:g} s ahead",
            where=LANE_DEPARTURE_RULE_NAME,
        )
    lines = _left_and_right_boundaries_nan_if_implausible(boundaries, config)
    both = (boundaries.left, boundaries.right)
    agreed = agreement_duration_of_left_and_right_s(
        stamp_ns, both, boundaries.is_seen, boundaries.steady_s, config.agree_s
    )
    frames = _Frames(stamp_ns, paths, boundaries, speed_mps)
    sides = [
        _evaluate_side(frames, line, sign, agreed_s, config, host)
        for line, sign, agreed_s in zip(lines, (1.0, -1.0), agreed, strict=True)
    ]
    found = sorted((int(stamp_ns[span.raised]), at, span) for at, side in enumerate(sides) for span in side.spans)
    events = [(number, at, span) for number, (_, at, span) in enumerate(found, start=1)]
    known_ns = earliest_known_times_ns(stamp_ns, log_time_ns)
    return LaneDepartureResult(
        rows=_build_warning_rows(sides, events, stamp_ns, log_time_ns, known_ns, host.vehicle_id),
        events=_departure_events_table(sides, events, stamp_ns, known_ns, host.vehicle_id),
        series=_frame_series_table(sides, stamp_ns),
        counts=_frame_counts_by_outcome(boundaries, lines, agreed, speed_mps, config),
    )


def _left_and_right_boundaries_nan_if_implausible(
    boundaries: LaneBoundaries, config: LaneDepartureConfig
) -> LeftAndRight:
    """Both boundaries, (n, 3) each; NaN in frames in which they cross or are too far apart."""
    with np.errstate(invalid="ignore"):
        width = boundaries.left[:, 0] - boundaries.right[:, 0]
        wrong = (width < config.min_width_m) | (width > config.max_width_m)
    left, right = (np.where(wrong[:, None], np.nan, line) for line in (boundaries.left, boundaries.right))
    return left, right


def _evaluate_side(
    frames: _Frames,
    line: FloatArray,
    sign: float,
    agreed_s: FloatArray,
    config: LaneDepartureConfig,
    host: FrontAxle,
) -> _SideEvaluation:
    """Evaluate one boundary at every frame; `sign` is 1 for the left one and -1 for the right one."""
    stamp_ns, paths, speed_mps = frames.stamp_ns, frames.paths, frames.speed_mps
    change_1pm2 = frames.boundaries.curvature_change_1pm2
    change_1pm2 = np.zeros(len(stamp_ns)) if change_1pm2 is None else change_1pm2
    t = paths.time_s
    cos, sin = np.cos(paths.heading_rad), np.sin(paths.heading_rad)
    x = paths.x_m + host.ahead_m * cos - sign * 0.5 * host.width_m * sin
    y = paths.y_m + host.ahead_m * sin + sign * 0.5 * host.width_m * cos
    ahead = x - frames.boundaries.camera_forward_m
    line_y, direction = boundary_y_and_direction_at_distances(line, ahead, change_1pm2)
    gap = sign * (line_y - y) * np.cos(direction)
    last = max(1, int(np.searchsorted(t, config.rate_over_s - 1e-9)))
    rate = (gap[:, 0] - gap[:, last]) / t[last]
    crossing = first_crossing_time_s(t, gap)
    within = t <= config.warn_s + 1e-9
    sigma = np.sqrt(np.maximum(paths.position_covariance_m2[:, :, 2], 1e-12))
    with np.errstate(invalid="ignore"):
        chance = np.fmax.reduce(normal_cdf(-gap[:, within] / sigma[:, within]), axis=1)
        near = gap[:, 0] <= earliest_warning_line_m(rate)
        over = (gap[:, 0] <= 0.0) & (rate > -config.min_rate_mps)
        comes = gap[:, 0] <= config.effective_release_s * approach_speed_bound_mps(stamp_ns, gap[:, 0], agreed_s)
        leaving = (crossing <= config.warn_s) & (rate > config.min_rate_mps) & comes
        fast = speed_mps >= config.min_speed_mps
        raised = near & (over | leaving) & fast & (agreed_s >= 0.0)
        is_held = (gap[:, 0] < config.release_m) | ((crossing <= config.effective_release_s) & (rate > 0.0))
        is_held &= speed_mps >= config.min_speed_mps - config.speed_hysteresis_mps
    timing = EventTiming(stamp_ns, config.persistence_s, config.hold_off_s)
    spans = find_events(stamp_ns, raised, raised, is_held, timing)
    return _SideEvaluation(gap[:, 0], rate, crossing, last_known_gap_m(gap), chance, spans)


def _build_warning_rows(
    sides: list[_SideEvaluation],
    events: list[tuple[int, int, EventSpan]],
    stamp_ns: Int64Array,
    log_time_ns: Int64Array,
    known_ns: Int64Array,
    host_id: str,
) -> WarningRows:
    """The warnings' states over time: raised, held and cleared."""
    rows: list[WarningRow] = []

    def append_row(i: int, number: int, state: int, name: str, text: str, *numbers: float) -> None:
        times = (int(log_time_ns[i]), int(stamp_ns[i]), int(known_ns[i]))
        rows.append(WarningRow(*times, number, state, f"{name} boundary", text, *numbers))

    for number, at, span in events:
        side, name = sides[at], SIDES[at]
        for i in range(span.raised, span.last + 1):
            time, gap, rate = float(side.crossing_s[i]), float(side.gap_m[i]), float(side.rate_mps[i])
            when = f"in {time:.1f} s" if math.isfinite(time) and time > 0.0 else "now"
            text = f"leaving the lane to the {name} {when}: {gap:.2f} m to the line, {rate:.2f} m/s"
            distance = 0.0 if math.isfinite(time) else float(side.end_gap_m[i])
            state = RAISED if i == span.raised else HELD
            append_row(i, number, state, name, text, time, distance, math.nan, float(side.probability[i]))
        if span.cleared is not None:
            append_row(span.cleared, number, CLEARED, name, f"warning {number} of the {name} boundary is over")
    return build_warning_rows(rows, rule=LANE_DEPARTURE_RULE_NAME, host_id=host_id)


def _departure_events_table(
    sides: list[_SideEvaluation],
    events: list[tuple[int, int, EventSpan]],
    stamp_ns: Int64Array,
    known_ns: Int64Array,
    host_id: str,
) -> Table:
    """The table with one row per event."""

    def values_when_raised(name: str) -> FloatArray:
        return np.array([float(getattr(sides[at], name)[span.raised]) for _, at, span in events], dtype=np.float64)

    def to_stamps(values: list[int]) -> Int64Array:
        return np.array(values, dtype=np.int64)

    def raised_last_and_cleared_ns(clock_ns: Int64Array) -> tuple[Int64Array, Int64Array, Int64Array]:
        raised, last = (
            to_stamps([int(clock_ns[getattr(s, name)]) for _, _, s in events]) for name in ("raised", "last")
        )
        cleared = [NOT_CLEARED_NS if span.cleared is None else int(clock_ns[span.cleared]) for _, _, span in events]
        return raised, last, to_stamps(cleared)

    raised_ns, last_ns, cleared_ns = raised_last_and_cleared_ns(known_ns)
    raised_stamp_ns, last_stamp_ns, cleared_stamp_ns = raised_last_and_cleared_ns(stamp_ns)
    gap, rate = values_when_raised("gap_m"), values_when_raised("rate_mps")
    columns: dict[str, Any] = {
        "event_id": to_stamps([number for number, _, _ in events]),
        "rule": [LANE_DEPARTURE_RULE_NAME] * len(events),
        "host_id": [host_id] * len(events),
        "side": [SIDES[at] for _, at, _ in events],
        "raised_ns": raised_ns,
        "last_held_ns": last_ns,
        "cleared_ns": cleared_ns,
        "duration_s": (last_ns - raised_ns) / NS_PER_S,
        "raised_stamp_ns": raised_stamp_ns,
        "last_held_stamp_ns": last_stamp_ns,
        "cleared_stamp_ns": cleared_stamp_ns,
        "time_to_line_crossing_s": values_when_raised("crossing_s"),
        "gap_m": gap,
        "departure_rate_mps": rate,
        "earliest_line_m": earliest_warning_line_m(rate),
        "latest_line_m": np.full(len(events), LATEST_WARNING_LINE_OF_CARS_M),
        "probability": values_when_raised("probability"),
    }
    docs = {
        "raised_ns": ColumnDoc(doc="when the warning could be given"),
        "cleared_ns": ColumnDoc(doc="-1: still active at the end of the log"),
        "cleared_stamp_ns": ColumnDoc(doc="-1: still active at the end of the log"),
        "gap_m": ColumnDoc(doc="outside of the front tyre to the boundary when the warning was raised"),
        "earliest_line_m": ColumnDoc(doc="ISO 17361's earliest warning line at that rate, inside the boundary"),
        "latest_line_m": ColumnDoc(doc="ISO 17361's latest warning line for passenger cars; negative: outside"),
    }
    return Table("lane_departures", columns, docs)


def _frame_series_table(sides: list[_SideEvaluation], stamp_ns: Int64Array) -> Table:
    """The table with one row per frame."""
    columns: dict[str, Any] = {"stamp_ns": stamp_ns}
    for name, side in zip(SIDES, sides, strict=True):
        active = np.zeros(len(stamp_ns), dtype=np.bool_)
        for span in side.spans:
            active[span.raised : span.last + 1] = True
        columns |= {
            f"{name}_gap_m": side.gap_m,
            f"{name}_departure_rate_mps": side.rate_mps,
            f"{name}_time_to_line_crossing_s": side.crossing_s,
            f"{name}_is_active": active,
        }
    return Table("lane_series", columns)


def _frame_counts_by_outcome(
    boundaries: LaneBoundaries,
    lines: LeftAndRight,
    agreed_s: LeftAndRight,
    speed_mps: FloatArray,
    config: LaneDepartureConfig,
) -> dict[str, int]:
    """Number of frames, by what became of them."""

    def missing_row_mask(line: FloatArray) -> BoolArray:
        return np.asarray(np.isnan(line).any(axis=1), dtype=np.bool_)

    fast = speed_mps >= config.min_speed_mps
    wrong = missing_row_mask(lines[0]) & ~missing_row_mask(boundaries.left) & ~missing_row_mask(boundaries.right)
    return {
        "frames": len(speed_mps),
        "left_evaluated": int(np.count_nonzero(fast & ~missing_row_mask(lines[0]))),
        "right_evaluated": int(np.count_nonzero(fast & ~missing_row_mask(lines[1]))),
        "left_not_found": int(np.count_nonzero(missing_row_mask(boundaries.left))),
        "right_not_found": int(np.count_nonzero(missing_row_mask(boundaries.right))),
        "left_too_new_or_jumped": int(np.count_nonzero(fast & ~missing_row_mask(lines[0]) & (agreed_s[0] < 0.0))),
        "right_too_new_or_jumped": int(np.count_nonzero(fast & ~missing_row_mask(lines[1]) & (agreed_s[1] < 0.0))),
        "implausible_width": int(np.count_nonzero(wrong)),
        "too_slow": int(np.count_nonzero(speed_mps < config.min_speed_mps)),
        "speed_not_known": int(np.count_nonzero(~np.isfinite(speed_mps))),
    }
