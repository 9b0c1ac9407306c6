"""Evaluate measures that a rule names for the two states that the host has at a moment.

The other's newest state is brought forward along its predicted path by its age, as for all inputs of a rule; its
acceleration, yaw rate and jerk stay as they were. A measure sees nothing later.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cwcli.measures import MEASURES
from cwcli.measures.pair import ActualTrack, Pair
from cwcli.signals.columns import FloatArray
from cwcli.signals.vehicle_state import ACCEL, JERK
from cwcli.warning.measures import PairStates
from cwcli.warning.remote_alignment import interpolate_paths
from cwcli.warning.types import PathArrays, VehicleTrack

Rows = npt.NDArray[np.intp]
OtherRowsPathRowsAges = tuple[Rows, Rows, FloatArray]
"""Rows of the other's states, rows of its paths, and ages of the states in s, (m,) each."""
STATE_COLUMNS_OF_ACCELERATION_YAW_RATE_AND_JERK = slice(ACCEL, JERK + 1)
"""Columns of a state that hold acceleration, yaw rate and jerk."""


def describe_problem_with_measure_names(names: object) -> str:
    """Describe what is wrong with the measures that a rule names; "" if nothing is."""
    if not isinstance(names, tuple) or not all(isinstance(name, str) for name in names):
        return f"has measures = {names!r}, which is not a tuple of names"
    for name in names:
        if name not in MEASURES:
            return f"asks for the measure '{name}', which does not exist (docs/measures.md lists them)"
        if not MEASURES[name].is_pointwise:
            return f"asks for the measure '{name}', which needs more than the two states of a moment"
        if MEASURES[name].needs_covariance:
            return f"asks for the measure '{name}', which needs covariances; use `probability` of the paths instead"
    return ""


def evaluate_named_measures(
    names: Sequence[str],
    host: VehicleTrack,
    other: VehicleTrack,
    host_rows: Rows,
    paths: PathArrays,
    at_moments: OtherRowsPathRowsAges,
) -> dict[str, FloatArray]:
    """Evaluate named measures at m moments: name -> values (m,), NaN where it has none.

    Args:
        at_moments: Shape (m,) each: rows of the other's states, rows of their paths, and ages of the states.
    """
    if not names:
        return {}
    stamp_ns = host.stamp_ns[host_rows]
    theirs, motion = _extrapolated_states_and_derivatives_of_other(other, paths, at_moments)
    own = ActualTrack(stamp_ns, host.state[host_rows])
    moved_track = ActualTrack(stamp_ns, np.concatenate([theirs, motion], axis=1))
    pair = Pair(own, moved_track, host.length_and_width_m, other.length_and_width_m, 0.0).with_states(
        own, theirs, motion
    )
    return {name: pair.evaluate_measure(MEASURES[name]) for name in names}


def pair_states_at_moments(
    host: VehicleTrack,
    other: VehicleTrack,
    host_rows: Rows,
    paths: PathArrays,
    at_moments: OtherRowsPathRowsAges,
) -> PairStates:
    """The states of both at each of m moments; the arguments are those of `evaluate_named_measures`."""
    theirs = np.concatenate(_extrapolated_states_and_derivatives_of_other(other, paths, at_moments), axis=1)
    said = other.says_hard_braking
    says = np.zeros(len(host_rows), np.bool_) if said is None else said[at_moments[0]]
    return PairStates(host.state[host_rows], theirs, says, (host.length_and_width_m, other.length_and_width_m))


def _extrapolated_states_and_derivatives_of_other(
    other: VehicleTrack, paths: PathArrays, at_moments: OtherRowsPathRowsAges
) -> tuple[FloatArray, FloatArray]:
    """Bring the other's position, speed and heading forward, (m, 4); and its unchanged derivatives, (m, 3)."""
    other_rows, place, age_s = at_moments
    current = interpolate_paths(paths, place, age_s, np.zeros(1))
    theirs = np.concatenate([current.x_m, current.y_m, current.speed_mps, current.heading_rad], axis=1)
    return theirs, other.state[other_rows, STATE_COLUMNS_OF_ACCELERATION_YAW_RATE_AND_JERK]
