"""How long and how far a drive was, and who else was there: sentences that need the ego's states alone."""

from __future__ import annotations

import numpy as np

from cwcli.channels.vehicle_state import VehicleStates, driven_distance_m
from cwcli.signals.units import KMH_PER_MPS, NS_PER_S
from cwcli.signals.vehicle_state import SPEED
from cwcli.text import format_count, format_duration


def drive_length_sentence(duration_ns: int, ego: VehicleStates | None, *, n_heard: int = 0, n_tracked: int = 0) -> str:
    """Say how long and how far the drive was, and how many others were known.

    Args:
        duration_ns: From the first to the last message.
        ego: The ego's states in stamp order, None where there are none.
        n_heard: Vehicles received by radio.
    """
    text = f"The log is {format_duration(duration_ns / NS_PER_S)} long"
    if ego is not None and len(ego) > 1:
        top = float(np.nanmax(np.abs(ego.state[:, SPEED])))
        text += f"; the car drove {driven_distance_m(ego):.0f} m, at most {KMH_PER_MPS * top:.0f} km/h"
    if n_heard:
        text += f"; {format_count(n_heard, 'other vehicle')} {'was' if n_heard == 1 else 'were'} heard by radio"
    if n_tracked:
        text += f"; {tracked_targets_text(n_tracked)} by its sensors"
    return f"{text}."


def tracked_targets_text(n: int) -> str:
    """Format `1 target was tracked`."""
    return f"{format_count(n, 'target')} {'was' if n == 1 else 'were'} tracked"


def found_lanes_text(n_both: int, n_frames: int) -> str:
    """Format `Both lane boundaries were found in 40 of 41 camera frames`."""
    return f"Both lane boundaries were found in {n_both} of {n_frames} camera frames"
