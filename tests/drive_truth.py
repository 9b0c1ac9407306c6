"""What was true in a simulated drive, on a grid of 1 ms."""

from __future__ import annotations

import numpy as np

from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.simulation.drive import SimulatedDrive
from cwcli.simulation.streams import seconds_to_ns

TRUTH_GRID_STEP_S = 0.001
"""Time step of the grid on which the truth is returned, s."""


def _truth_times_s(drive: SimulatedDrive) -> FloatArray:
    n_steps = int(np.floor(drive.scenario.duration_s / TRUTH_GRID_STEP_S + 1e-9))
    return np.arange(n_steps + 1, dtype=np.float64) * TRUTH_GRID_STEP_S


def truth_stamps_ns(drive: SimulatedDrive) -> Int64Array:
    """Stamps of the truth, (m,), ns since 1970."""
    return drive.scenario.start_ns + seconds_to_ns(_truth_times_s(drive))


def true_states_of_vehicle(drive: SimulatedDrive, name: str) -> FloatArray:
    """True states (m, 8) in the columns of `vehicle_state.STATE_NAMES`, frame `map`, the heading not wrapped."""
    return drive.scenario.vehicles[name].motion.states_at(_truth_times_s(drive))
