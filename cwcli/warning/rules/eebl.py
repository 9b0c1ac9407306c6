"""Emergency electronic brake light: who drives ahead, the same way, brakes hard, seen or not (SAE J2945/1, EEBL).

It needs no collision course: the car may be hidden behind a lorry, and the host not yet closing in. It warns where

1. the other drives ahead of the host and the same way, in its lane or in one beside it: along the arc that the host is
   driving on (its yaw rate over its speed), not along a straight line;
2. it brakes with `MIN_HARD_BRAKING_MPS2` at least by its estimated state, for as long as the persistence says, or has
   said so itself (`eventHardBraking` of a BSM, above 0.4 g; a DENM of an emergency brake): then at once;
3. it matters to the host: were the other to brake on until it stands, and the host to go on for the horizon before it
   does anything, the host would then have to brake with `--min-deceleration` at least.

The warning ends when the other no longer brakes with half of that, or the host no longer follows it.
Limits: the acceleration of a BSM is filtered by its sender and so late (docs/v2x.md); the flag is not. Lanes are taken
3.6 m wide.
"""

from __future__ import annotations

import numpy as np

from cwcli.signals.angles import wrap_angle
from cwcli.signals.columns import BoolArray, FloatArray
from cwcli.signals.vehicle_state import ACCEL, HEADING, SPEED, YAW_RATE, X, Y
from cwcli.warning.measures import Measures, PairStates
from cwcli.warning.rules.base import Decision, Rule
from cwcli.warning.types import WarningConfig

MIN_HARD_BRAKING_MPS2 = 4.0
"""Least deceleration of hard braking, m/s^2: about the 0.4 g of `eventHardBraking` (SAE J2735)."""
RELEASE_SHARE_OF_HARD_BRAKING = 0.5
"""Share of hard braking below which the other's braking ends a warning. Chosen by hand; not fitted."""
ASSUMED_LANE_WIDTH_M = 3.6
"""Assumed width of a lane, m: 12 feet, as on US highways."""
MAX_LATERAL_OFFSET_M = 1.5 * ASSUMED_LANE_WIDTH_M
"""Greatest distance in m of a vehicle from the host's path that is in its lane or an adjacent one: one and a half
`ASSUMED_LANE_WIDTH_M`."""
MAX_HEADING_DIFFERENCE_RAD = np.deg2rad(45.0)
"""Largest angle between directions of vehicles that drive the same way. Chosen by hand; not fitted."""
MIN_HOST_SPEED_MPS = 2.0
"""Least speed in m/s of a host with a usable path. Chosen by hand; not fitted."""


def decide_by_hard_braking_ahead(
    measures: Measures, onset: Measures | None, config: WarningConfig, persistence_s: float
) -> Decision:
    """Decide by hard braking of a vehicle ahead in the same direction to which the host would have to react."""
    states = measures.states
    assert states is not None  # RULE asks for them
    gap_m, follows = _gap_and_mask_of_vehicle_ahead(states)
    braking_mps2 = -states.other[:, ACCEL] * np.where(states.other[:, SPEED] < 0.0, -1.0, 1.0)
    needed_mps2, left_m = _deceleration_and_distance_to_stop_behind(
        states, gap_m, np.fmax(braking_mps2, MIN_HARD_BRAKING_MPS2), config.horizon_s
    )
    matters = follows & ~(needed_mps2 < config.min_deceleration_mps2)
    hard = matters & (braking_mps2 >= MIN_HARD_BRAKING_MPS2)
    said = matters & states.says_hard_braking
    closing = states.host[:, SPEED] - states.other[:, SPEED]
    with np.errstate(divide="ignore", invalid="ignore"):
        time_s = np.where(closing > 0.0, np.maximum(gap_m, 0.0) / closing, np.inf)
    return Decision(
        armed=hard | said,
        raised=hard | said,
        held=follows
        & ((braking_mps2 >= RELEASE_SHARE_OF_HARD_BRAKING * MIN_HARD_BRAKING_MPS2) | states.says_hard_braking),
        time_to_event_s=time_s,
        predicted_distance_m=np.where(np.isfinite(left_m), np.maximum(left_m, 0.0), measures.min_distance_m),
        at_once=said,
    )


def _gap_and_mask_of_vehicle_ahead(states: PairStates) -> tuple[FloatArray, BoolArray]:
    """Gap of the outlines along the host's arc (m), and whether the other is ahead in the same direction, (m,) each."""
    host, other = states.host, states.other
    dx, dy = other[:, X] - host[:, X], other[:, Y] - host[:, Y]
    cos, sin = np.cos(host[:, HEADING]), np.sin(host[:, HEADING])
    forward, left = dx * cos + dy * sin, dy * cos - dx * sin
    speed = np.maximum(np.abs(host[:, SPEED]), MIN_HOST_SPEED_MPS)
    curvature = np.nan_to_num(host[:, YAW_RATE] / speed)
    # the arc about (0, 1/k): where on it the other is nearest, and how far off it
    direction_rad = np.arctan2(curvature * forward, 1.0 - curvature * left)
    is_straight = np.abs(curvature) * np.hypot(forward, left) < 1e-6
    with np.errstate(divide="ignore", invalid="ignore"):
        along = np.where(is_straight, forward, direction_rad / curvature)
        to_centre = np.hypot(curvature * forward, 1.0 - curvature * left)
        across = np.where(is_straight, left, (1.0 - to_centre) / curvature)
    way = wrap_angle(other[:, HEADING] - host[:, HEADING] - np.where(is_straight, 0.0, direction_rad))
    gap = along - 0.5 * (states.sizes[0][0] + states.sizes[1][0])
    follows = (gap > 0.0) & (np.abs(across) <= MAX_LATERAL_OFFSET_M) & (np.abs(way) <= MAX_HEADING_DIFFERENCE_RAD)
    follows &= (host[:, SPEED] >= MIN_HOST_SPEED_MPS) & (other[:, SPEED] >= 0.0)
    return gap, np.asarray(follows)


def _deceleration_and_distance_to_stop_behind(
    states: PairStates, gap_m: FloatArray, braking_mps2: FloatArray, wait_s: float
) -> tuple[FloatArray, FloatArray]:
    """The deceleration that the host needs after a wait to stop behind the other; infinity where none is enough.

    Returns:
        The deceleration, m/s^2, and the distance that is left for it, m, both (m,).
    """
    speed = states.host[:, SPEED]
    left_m = gap_m + states.other[:, SPEED] ** 2 / (2.0 * braking_mps2) - speed * wait_s
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(left_m > 0.0, speed**2 / (2.0 * left_m), np.inf), left_m


RULE = Rule(
    summary="a vehicle ahead in the host's lane or an adjacent one, driving the same way, brakes hard or reports "
    "it (EEBL)",
    persistence_s=0.2,
    decide=decide_by_hard_braking_ahead,
    words="hard braking ahead by {other}",
    uses_states=True,
    is_symmetric=False,
    is_of_collisions=False,
)
