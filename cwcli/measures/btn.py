"""Brake threat number: the needed braking over the braking that the car can do."""

from __future__ import annotations

from cwcli.measures.a_long_req import MEASURE as A_LONG_REQ
from cwcli.measures.base import Measure
from cwcli.measures.limits import CAR_BRAKING_LIMIT_MPS2
from cwcli.measures.pair import Pair, RatiosAtStamps


def brake_threat_number(pair: Pair) -> RatiosAtStamps:
    """Brake threat number at each stamp, (n,): 1 needs all the braking that the car can do."""
    return -pair.evaluate_measure(A_LONG_REQ) / CAR_BRAKING_LIMIT_MPS2


MEASURE = Measure(
    summary="share of the braking that the car can do",
    symbol="BTN",
    column="btn",
    critical="high",
    formula="a_long,req / a_min, a_min = -11.5 m/s^2",
    source="Jansson 2005; Asljung et al. 2017, eq. 9",
    compute=brake_threat_number,
    is_symmetric=False,
    threshold=1.0,
    threshold_source="beyond 1 braking alone no longer helps",
    undefined="nothing is ahead of the host within the width of the two outlines",
    misleads="on wet roads, where the car can do less",
    is_pointwise=True,
)
