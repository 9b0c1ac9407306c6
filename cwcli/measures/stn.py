"""Steer threat number: the needed lateral acceleration over that which the car can do."""

from __future__ import annotations

from cwcli.measures.a_lat_req import MEASURE as A_LAT_REQ
from cwcli.measures.base import Measure
from cwcli.measures.limits import CAR_LATERAL_LIMIT_MPS2
from cwcli.measures.pair import Pair, RatiosAtStamps


def steer_threat_number(pair: Pair) -> RatiosAtStamps:
    """Steer threat number at each stamp, (n,): 1 needs all the lateral acceleration that the car can do."""
    return pair.evaluate_measure(A_LAT_REQ) / CAR_LATERAL_LIMIT_MPS2


MEASURE = Measure(
    summary="share of the steering that the car can do",
    symbol="STN",
    column="stn",
    critical="high",
    formula="a_lat,req / a_lat,max, a_lat,max = 8 m/s^2",
    source="Jansson 2005; Brannstrom et al. 2008",
    compute=steer_threat_number,
    is_symmetric=False,
    threshold=1.0,
    threshold_source="beyond 1 steering alone no longer helps",
    undefined="as for a_lat,req",
    misleads="as for a_lat,req",
    is_pointwise=True,
)
