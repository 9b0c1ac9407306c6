"""Values of the ego's states that no car on a road has."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from cwcli.evaluation.doubts.base import DoubtRule, Finding
from cwcli.evaluation.doubts.evidence import DoubtEvidence
from cwcli.signals.columns import FloatArray, StateRows
from cwcli.signals.units import KMH_PER_MPS
from cwcli.signals.vehicle_state import ACCEL, SPEED, YAW_RATE

MAX_PLAUSIBLE_SPEED_KMH = 200.0
"""Greatest plausible speed of a car, km/h: few motorways allow more than 130, and test tracks stay below 200. Chosen by
hand."""
MAX_PLAUSIBLE_ACCEL_MPS2 = 12.0
"""Greatest plausible acceleration of a car, m/s^2: tyres on a dry road transmit about 1.2 g at most. Chosen by hand."""
IMPLAUSIBLE_VALUE_ADVICE = "Check the units and the axes of the sensors."
"""The advice for every implausible value, a sentence for users."""


def _absolute_speed_kmh(state: StateRows) -> FloatArray:
    return KMH_PER_MPS * np.abs(state[:, SPEED])


def _absolute_longitudinal_accel_mps2(state: StateRows) -> FloatArray:
    return np.abs(state[:, ACCEL])


def _absolute_lateral_accel_mps2(state: StateRows) -> FloatArray:
    return np.abs(state[:, SPEED] * state[:, YAW_RATE])


def _make_implausible_size_rule(
    quantity: str,
    unit: str,
    greatest_plausible: float,
    source: str,
    magnitude_of_states: Callable[[FloatArray], FloatArray],
) -> DoubtRule:
    """Make the rule of one quantity.

    Args:
        quantity: The quantity with its article, in words.
        magnitude_of_states: Its magnitude (n,) from states (n, 8).
    """

    def find(evidence: DoubtEvidence) -> Iterator[Finding]:
        if evidence.ego is None:
            return
        values = np.nan_to_num(magnitude_of_states(evidence.ego.state), nan=-1.0, posinf=-1.0)
        at = int(values.argmax())
        if values[at] > greatest_plausible:
            at_s = evidence.seconds_since_start(int(evidence.ego.stamp_ns[at]))
            yield Finding(float(values[at]), f"The estimate has {quantity} of {values[at]:.0f} {unit} at {at_s:.0f} s.")

    return DoubtRule(f"{quantity} that no car has", greatest_plausible, unit, source, IMPLAUSIBLE_VALUE_ADVICE, find)


SPEED_RULE = _make_implausible_size_rule(
    "a speed", "km/h", MAX_PLAUSIBLE_SPEED_KMH, "chosen: above public roads", _absolute_speed_kmh
)
_TYRE_LIMIT_SOURCE = "tyres on a dry road transmit about 1.2 g"
ACCELERATION_RULE = _make_implausible_size_rule(
    "an acceleration", "m/s²", MAX_PLAUSIBLE_ACCEL_MPS2, _TYRE_LIMIT_SOURCE, _absolute_longitudinal_accel_mps2
)
LATERAL_ACCELERATION_RULE = _make_implausible_size_rule(
    "a lateral acceleration", "m/s²", MAX_PLAUSIBLE_ACCEL_MPS2, _TYRE_LIMIT_SOURCE, _absolute_lateral_accel_mps2
)
