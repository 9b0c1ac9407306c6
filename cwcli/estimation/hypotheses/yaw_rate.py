"""Hypotheses on a yaw rate that comes beside a speed: another unit, or another sign."""

from __future__ import annotations

import math

from cwcli.estimation.hypotheses.base import Hypothesis

YAW_RATE_UNIT_AND_SIGN_HYPOTHESES = (
    Hypothesis.of_scalar("degrees/s", "unit", "is in degrees/s, not rad/s", "converted", factor=math.pi / 180.0),
    Hypothesis.of_scalar("milliradians/s", "unit", "is in milliradians/s, not rad/s", "converted", factor=1e-3),
    Hypothesis.of_scalar(
        "rad/s-read-as-degrees/s",
        "unit",
        "is in rad/s, but was converted as if it were in degrees/s",
        "converted",
        factor=180.0 / math.pi,
    ),
    Hypothesis.of_scalar("clockwise", "sign", "counts clockwise, not counter-clockwise", "reversed", factor=-1.0),
)
"""Hypotheses on the unit and the sign of a source of `Kind.YAW_RATE`."""
