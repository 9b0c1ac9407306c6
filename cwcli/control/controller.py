"""The longitudinal controller of song2016, section 4: (TTC, dv) in, throttle opening and brake pressure out.

The paper names the inputs and outputs and prints neither sets nor rules. Those below are ours. The corners of the
TTC sets are the paper's own numbers for drivers: 1.0 s most dangerous, 2.0 s begin to brake, 2.9 s normal following.
"""

from __future__ import annotations

import numpy as np

from cwcli.control.fuzzy import FuzzySet, Mamdani, Variable
from cwcli.signals.columns import FloatArray

MAX_PRESSURE_MPA = 10.0

TTC_S = Variable(
    0.0,
    6.0,
    {
        "dangerous": FuzzySet(0.0, 0.0, 1.0, 2.0),
        "braking": FuzzySet(1.0, 2.0, 2.0, 2.9),
        "following": FuzzySet(2.0, 2.9, 2.9, 4.5),
        "free": FuzzySet(2.9, 4.5, 6.0, 6.0),
    },
)
CLOSING_MPS = Variable(
    -5.0,
    20.0,
    {
        "opening": FuzzySet(-5.0, -5.0, -2.0, 0.0),
        "equal": FuzzySet(-2.0, 0.0, 0.0, 3.0),
        "slow": FuzzySet(0.0, 3.0, 3.0, 8.0),
        "fast": FuzzySet(3.0, 8.0, 20.0, 20.0),
    },
)
# The end sets reach beyond the range, so that their centroids can be "none" and "full" almost exactly.
PRESSURE_MPA = Variable(
    0.0,
    MAX_PRESSURE_MPA,
    {
        "none": FuzzySet(0.0, 0.0, 0.0, 0.4),
        "light": FuzzySet(0.5, 2.0, 2.0, 3.5),
        "medium": FuzzySet(3.0, 5.0, 5.0, 7.0),
        "strong": FuzzySet(6.0, 7.5, 7.5, 9.0),
        "full": FuzzySet(9.2, 10.0, 10.0, 10.0),
    },
)
THROTTLE = Variable(
    0.0,
    1.0,
    {
        "closed": FuzzySet(0.0, 0.0, 0.0, 0.04),
        "small": FuzzySet(0.0, 0.15, 0.15, 0.3),
        "half": FuzzySet(0.3, 0.5, 0.5, 0.7),
    },
)

# Rows: TTC. Columns: dv. Read "when TTC is dangerous and the gap closes fast, brake fully".
PRESSURE_RULES = {
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
THROTTLE_RULES = {
    (ttc, closing): {("free", "opening"): "half", ("following", "opening"): "small"}.get((ttc, closing), "closed")
    for ttc in TTC_S.sets
    for closing in CLOSING_MPS.sets
}

_PRESSURE = Mamdani(TTC_S, CLOSING_MPS, PRESSURE_MPA, PRESSURE_RULES)
_THROTTLE = Mamdani(TTC_S, CLOSING_MPS, THROTTLE, THROTTLE_RULES)


def speed_difference(
    host_speed_mps: FloatArray, other_speed_mps: FloatArray, heading_difference_rad: FloatArray
) -> FloatArray:
    """dv = v1 - v2 cos(phi1 - phi2) (song2016 eq. 11), m/s; positive when the host is the faster."""
    return np.asarray(host_speed_mps - other_speed_mps * np.cos(heading_difference_rad))  # eq. 11


def command(ttc_s: FloatArray, speed_difference_mps: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Throttle opening and brake master-cylinder pressure.

    Args:
        ttc_s: Shape (n,), infinity when the gap does not close.
        speed_difference_mps: Shape (n,), eq. 11.

    Returns:
        Throttle opening, shape (n,), 0 to 1; pressure in MPa, shape (n,), 0 to 10. The throttle is closed wherever the
        pressure exceeds 0.5 MPa: no driver and no controller does both.
    """
    pressure = _PRESSURE(ttc_s, speed_difference_mps)
    throttle = np.where(pressure > 0.5, 0.0, _THROTTLE(ttc_s, speed_difference_mps))
    return throttle, pressure
