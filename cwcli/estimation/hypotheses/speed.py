"""Hypotheses on a speed along the car: another unit, or another sign. Factors: NIST SP 811 (2008), appendix B."""

from __future__ import annotations

from cwcli.estimation.hypotheses.base import Hypothesis


def _unit_hypothesis(name: str, fault: str, mps_per_unit: float) -> Hypothesis:
    return Hypothesis.of_scalar(name, "unit", fault, "converted", factor=mps_per_unit)


SPEED_UNIT_AND_SIGN_HYPOTHESES = (
    _unit_hypothesis("km/h", "is in km/h, not m/s", 1.0 / 3.6),
    _unit_hypothesis("mph", "is in miles/h, not m/s", 0.44704),
    _unit_hypothesis("knots", "is in knots, not m/s", 1852.0 / 3600.0),
    _unit_hypothesis("ft/s", "is in feet/s, not m/s", 0.3048),
    _unit_hypothesis("cm/s", "is in cm/s, not m/s", 0.01),
    _unit_hypothesis("mm/s", "is in mm/s, not m/s", 0.001),
    _unit_hypothesis("m/s-read-as-km/h", "is in m/s, but was divided by 3.6 as if it were in km/h", 3.6),
    _unit_hypothesis("m/s-read-as-mph", "is in m/s, but was converted as if it were in miles/h", 1.0 / 0.44704),
    _unit_hypothesis("m/s-read-as-knots", "is in m/s, but was converted as if it were in knots", 3600.0 / 1852.0),
    _unit_hypothesis("mph-read-as-km/h", "is in miles/h, but was converted as if it were in km/h", 1.609344),
    _unit_hypothesis("km/h-read-as-mph", "is in km/h, but was converted as if it were in miles/h", 1.0 / 1.609344),
    _unit_hypothesis("knots-read-as-km/h", "is in knots, but was converted as if it were in km/h", 1.852),
    _unit_hypothesis("km/h-read-as-knots", "is in km/h, but was converted as if it were in knots", 1.0 / 1.852),
    Hypothesis.of_scalar("reversed", "sign", "has the wrong sign", "reversed", factor=-1.0),
)
"""Units and sign of `Kind.SPEED`."""
