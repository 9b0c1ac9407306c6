"""The longitudinal controller of song2016, section 4: (TTC, dv) in, throttle opening and brake pressure out.

The paper names the inputs and outputs but prints neither sets nor rules. Those below are chosen by hand. The corners of
the TTC sets are the paper's numbers for drivers: 1.0 s most dangerous, 2.0 s begin to brake, 2.9 s normal following.
"""

from __future__ import annotations

import numpy as np

from cwcli.control.fuzzy import FuzzySet, LinguisticVariable, MamdaniInference
from cwcli.signals.columns import FloatArray

ThrottleAndPressure = tuple[FloatArray, FloatArray]
"""Throttle opening, 0 to 1, and pressure of the brake's master cylinder, MPa, shape (n,) each."""
MAX_BRAKE_PRESSURE_MPA = 10.0
"""Largest brake pressure that the controller asks for, MPa. Chosen by hand (docs/papers/song2016-choices.md)."""

TTC_VARIABLE = LinguisticVariable(
    0.0,
    6.0,
    {
        "dangerous": FuzzySet(0.0, 0.0, 1.0, 2.0),
        "braking": FuzzySet(1.0, 2.0, 2.0, 2.9),
        "following": FuzzySet(2.0, 2.9, 2.9, 4.5),
        "free": FuzzySet(2.9, 4.5, 6.0, 6.0),
    },
)
"""Input: time to collision, s. The corners at 1.0, 2.0 and 2.9 s are song2016's numbers for drivers, the others are
chosen by hand."""
CLOSING_SPEED_VARIABLE = LinguisticVariable(
    -5.0,
    20.0,
    {
        "opening": FuzzySet(-5.0, -5.0, -2.0, 0.0),
        "equal": FuzzySet(-2.0, 0.0, 0.0, 3.0),
        "slow": FuzzySet(0.0, 3.0, 3.0, 8.0),
        "fast": FuzzySet(3.0, 8.0, 20.0, 20.0),
    },
)
"""Input: speed difference dv of eq. 11, m/s, positive while the gap closes. Chosen by hand
(docs/papers/song2016-choices.md)."""
BRAKE_PRESSURE_VARIABLE = LinguisticVariable(
    0.0,
    MAX_BRAKE_PRESSURE_MPA,
    {
        "none": FuzzySet(0.0, 0.0, 0.0, 0.4),
        "light": FuzzySet(0.5, 2.0, 2.0, 3.5),
        "medium": FuzzySet(3.0, 5.0, 5.0, 7.0),
        "strong": FuzzySet(6.0, 7.5, 7.5, 9.0),
        "full": FuzzySet(9.2, 10.0, 10.0, 10.0),
    },
)
"""Output: brake pressure, MPa. The centroids of the end sets are almost exactly 0 and 10 MPa. Chosen by hand
(docs/papers/song2016-choices.md)."""
THROTTLE_VARIABLE = LinguisticVariable(
    0.0,
    1.0,
    {
        "closed": FuzzySet(0.0, 0.0, 0.0, 0.04),
        "small": FuzzySet(0.0, 0.15, 0.15, 0.3),
        "half": FuzzySet(0.3, 0.5, 0.5, 0.7),
    },
)
"""Output: throttle opening, 0 to 1. Chosen by hand (docs/papers/song2016-choices.md)."""

BRAKE_PRESSURE_RULES = {
    ("dangerous", "opening"): "light",
    ("dangerous", "equal"): "full",
    ("dangerous", "slow"): "full",
    ("dangerous", "fast"): "full",
    ("braking", "opening"): "none",
    ("braking", "equal"): "strong",
    ("braking", "slow"): "full",
    ("braking", "fast"): "full",
    ("following", "opening"): "none",
    ("following", "equal"): "medium",
    ("following", "slow"): "strong",
    ("following", "fast"): "full",
    # Once warned, the gap must grow or the car must stop: while the host is not the slower one, it brakes.
    ("free", "opening"): "none",
    ("free", "equal"): "medium",
    ("free", "slow"): "medium",
    ("free", "fast"): "strong",
}
"""Brake pressure for each pair of (TTC, dv): a dangerous TTC with a fast closing gap gives full pressure. Chosen by
hand."""
THROTTLE_RULES = {
    (ttc, closing): {("free", "opening"): "half", ("following", "opening"): "small"}.get((ttc, closing), "closed")
    for ttc in TTC_VARIABLE.sets
    for closing in CLOSING_SPEED_VARIABLE.sets
}
"""Throttle opening for each pair of (TTC, dv): closed but where the gap opens at a safe TTC. Chosen by hand."""

_BRAKE_PRESSURE_INFERENCE = MamdaniInference(
    TTC_VARIABLE, CLOSING_SPEED_VARIABLE, BRAKE_PRESSURE_VARIABLE, BRAKE_PRESSURE_RULES
)
"""The inference that gives the brake pressure, MPa."""
_THROTTLE_INFERENCE = MamdaniInference(TTC_VARIABLE, CLOSING_SPEED_VARIABLE, THROTTLE_VARIABLE, THROTTLE_RULES)
"""The inference that gives the throttle opening, 0 to 1."""


def speed_difference_along_heading_mps(
    host_speed_mps: FloatArray, other_speed_mps: FloatArray, heading_difference_rad: FloatArray
) -> FloatArray:
    """The speed difference dv = v1 - v2 cos(phi1 - phi2), m/s (song2016 eq. 11); positive when the host is faster."""
    return np.asarray(host_speed_mps - other_speed_mps * np.cos(heading_difference_rad))


def fuzzy_throttle_and_pressure(ttc_s: FloatArray, speed_difference_mps: FloatArray) -> ThrottleAndPressure:
    """Infer throttle opening and pressure of the brake's master cylinder.

    Args:
        ttc_s: Shape (n,), infinity when the gap does not close.
        speed_difference_mps: Shape (n,), eq. 11.

    Returns:
        Throttle opening, shape (n,), 0 to 1; pressure in MPa, shape (n,), 0 to 10. The throttle is closed wherever the
        pressure exceeds 0.5 MPa: no driver and no controller does both.
    """
    pressure = _BRAKE_PRESSURE_INFERENCE(ttc_s, speed_difference_mps)
    throttle = np.where(pressure > 0.5, 0.0, _THROTTLE_INFERENCE(ttc_s, speed_difference_mps))
    return throttle, pressure
