"""Whether each driver model would have avoided a recorded conflict, and until when it could have taken over.

The ego keeps to its recorded path and drives as recorded until the model takes over. The model keeps that speed and
brakes when it sees danger. The other drives as recorded, and at its last speed and heading beyond its track.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from cwcli.control.driver_models import (
    CAREFUL_HUMAN_DRIVER_AT_CUT_IN,
    FUZZY_SAFETY_DRIVER,
    R157_DRIVER,
    RSS_DRIVER,
    CasePoses,
    DriverModel,
    EgoCases,
    simulate_driver_cases,
)
from cwcli.lazy_dataclass import dataclass
from cwcli.measures.outlines import LengthAndWidthM
from cwcli.measures.pair import ActualTrack, Pair
from cwcli.metrics.table import ColumnDoc, Table
from cwcli.signals.columns import BoolArray, FloatArray, encode_strings, repeat_string
from cwcli.signals.units import NS_PER_S

FIRST_DRIVER_TAKEOVER_BEFORE_CONFLICT_S, SIMULATION_END_AFTER_CONFLICT_S = 8.0, 6.0
"""Time before the conflict at which a driver model takes over first, and time after it at which its drive ends, s.
Chosen by hand; not fitted."""
SIMULATION_STEP_S = 0.1
"""Time step of the driver models, and between the moments at which they take over, s; that of the regulation's
criterion."""
DRIVER_MODELS: Mapping[str, DriverModel] = {
    "careful human": replace(CAREFUL_HUMAN_DRIVER_AT_CUT_IN, is_no_longer_judged=None),
    "UN R157": R157_DRIVER,
    "RSS": RSS_DRIVER,
    "fuzzy": FUZZY_SAFETY_DRIVER,
}
"""The driver models by name. The human brakes for a vehicle that is in the way and less than 2 s away, and judges the
whole conflict, not a cut-in alone."""


@dataclass(frozen=True)
class DriverVerdict:
    """The result of one driver model in a conflict; times are seconds before it, negative after it.

    Attributes:
        driver: Name of the model.
        avoided: Whether it avoids a crash when it takes over at the earliest moment that is judged.
        braked_s: When it brakes first; NaN: never.
        impact_mps: Relative speed of the crash; NaN: none.
        least_gap_m: Least distance of the outlines; negative: a crash.
        last_chance_s: The latest moment at which it can take over and avoid a crash; NaN: there is none.
    """

    driver: str
    avoided: bool
    braked_s: float
    impact_mps: float
    least_gap_m: float
    last_chance_s: float


def judge_preventability(
    pair: Pair, conflict_ns: int, drivers: Mapping[str, DriverModel] = DRIVER_MODELS
) -> list[DriverVerdict]:
    """Judge a conflict with each driver model; empty if one of the two is not known right before the conflict.

    Args:
        pair: The ego and the other, with their actual tracks.
        conflict_ns: Stamp of the crash, or of the most critical moment.
    """
    host, other = (_finite_times_and_states(track, conflict_ns) for track in (pair.host, pair.other))
    first = (
        max(host[0][0], other[0][0], -FIRST_DRIVER_TAKEOVER_BEFORE_CONFLICT_S)
        if len(host[0]) and len(other[0])
        else np.inf
    )
    starts = (
        np.arange(np.ceil(first / SIMULATION_STEP_S - 1e-9), 1.0) * SIMULATION_STEP_S
        if np.isfinite(first)
        else np.zeros(0)
    )
    if not len(starts):
        return []
    time, state = host
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(state[:, :2], axis=0).T))])
    n_steps = round((SIMULATION_END_AFTER_CONFLICT_S - float(starts[0])) / SIMULATION_STEP_S)
    found = []
    for name, driver in drivers.items():
        outcome = simulate_driver_cases(
            driver,
            ego=EgoCases(
                speed_mps=np.maximum(np.interp(starts, time, state[:, 2]), 0.0),
                pose_at=_path_pose_function(way, state),
                size=pair.host_size,
                offset_m=np.interp(starts, time, way),
            ),
            other_at=_pose_by_step_of_recorded_vehicle(other, starts, pair.other_size),
            n_steps=n_steps,
            step_s=SIMULATION_STEP_S,
        )
        in_time = np.flatnonzero(~outcome.crashed)
        found.append(
            DriverVerdict(
                driver=name,
                avoided=not bool(outcome.crashed[0]),
                braked_s=-float(starts[0] + outcome.braked_s[0]),
                impact_mps=float(outcome.impact_mps[0]),
                least_gap_m=float(outcome.least_gap_m[0]),
                last_chance_s=-float(starts[in_time[-1]]) if len(in_time) else float("nan"),
            )
        )
    return found


def _finite_times_and_states(track: ActualTrack, zero_ns: int) -> tuple[FloatArray, FloatArray]:
    """Times (k,) in seconds after a stamp, and x, y, speed, unwrapped heading (k, 4), of the finite states."""
    rows = np.flatnonzero(np.isfinite(track.state[:, :4]).all(axis=1))
    state = track.state[rows, :4].copy()
    state[:, 3] = np.unwrap(state[:, 3])
    return (track.stamp_ns[rows] - zero_ns) / NS_PER_S, state


def _path_pose_function(
    way_m: FloatArray, state: FloatArray
) -> Callable[[FloatArray], tuple[FloatArray, FloatArray, FloatArray]]:
    """A function from the distance along the recorded path to x, y, heading there; straight on beyond its end."""

    def pose_at(asked_m: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        x, y, heading = (np.interp(asked_m, way_m, state[:, column]) for column in (0, 1, 3))
        beyond = np.maximum(asked_m - way_m[-1], 0.0)
        return x + beyond * np.cos(heading), y + beyond * np.sin(heading), heading

    return pose_at


def _pose_by_step_of_recorded_vehicle(
    times_and_states: tuple[FloatArray, FloatArray], start_s: FloatArray, size: LengthAndWidthM
) -> Callable[[int], tuple[CasePoses, BoolArray, LengthAndWidthM]]:
    """A function from the step to the recorded other in each case: poses, whether it counts, and its size."""
    time, state = times_and_states

    def poses_at_time_step(step: int) -> tuple[CasePoses, BoolArray, LengthAndWidthM]:
        time_ns = start_s + step * SIMULATION_STEP_S
        x, y, speed, heading = (np.interp(time_ns, time, state[:, column]) for column in range(4))
        beyond = np.maximum(time_ns - time[-1], 0.0) * speed
        pose = CasePoses(
            x + beyond * np.cos(heading), y + beyond * np.sin(heading), heading, speed, np.zeros(len(time_ns))
        )
        return pose, np.ones(len(time_ns), dtype=bool), size

    return poses_at_time_step


@dataclass(frozen=True)
class JudgedConflict:
    """A conflict of the ego with another vehicle, and the result of each driver model in it."""

    other_id: str
    conflict_ns: int
    verdicts: tuple[DriverVerdict, ...]


def preventability_table(ego_id: str, judged: Sequence[JudgedConflict]) -> Table:
    """The table `preventability`: one row per conflict and driver model."""
    rows = [(conflict, each) for conflict in judged for each in conflict.verdicts]

    def field_values(name: str) -> FloatArray:
        return np.array([getattr(each, name) for _, each in rows], np.float64)

    return Table(
        "preventability",
        {
            "ego_id": repeat_string(ego_id, len(rows)),
            "other_id": encode_strings([conflict.other_id for conflict, _ in rows]),
            "conflict_stamp_ns": np.array([conflict.conflict_ns for conflict, _ in rows], np.int64),
            "driver": encode_strings([each.driver for _, each in rows]),
            "avoided": np.array([each.avoided for _, each in rows], np.bool_),
            "braked_before_s": field_values("braked_s"),
            "impact_mps": field_values("impact_mps"),
            "least_gap_m": field_values("least_gap_m"),
            "last_chance_before_s": field_values("last_chance_s"),
        },
        docs={
            "avoided": ColumnDoc(doc="whether a take-over 8 s before, or as soon as both are known, avoids a crash"),
            "braked_before_s": ColumnDoc(doc="time before the conflict at which the model brakes first; empty: never"),
            "impact_mps": ColumnDoc(doc="relative speed of the model's crash; empty: none"),
            "last_chance_before_s": ColumnDoc(doc="latest take-over that avoids a crash, as time before the conflict"),
        },
    )
