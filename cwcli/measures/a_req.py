"""Required acceleration: the longitudinal and the lateral one together."""

from __future__ import annotations

import numpy as np

from cwcli.measures.a_lat_req import MEASURE as A_LAT_REQ
from cwcli.measures.a_long_req import MEASURE as A_LONG_REQ
from cwcli.measures.base import Measure
from cwcli.measures.pair import Mps2AtStamps, Pair


def required_acceleration(pair: Pair) -> Mps2AtStamps:
    """Required acceleration (m/s^2) at each stamp, (n,)."""
    return np.hypot(pair.evaluate_measure(A_LONG_REQ), pair.evaluate_measure(A_LAT_REQ))


MEASURE = Measure(
    summary="longitudinal and lateral required accelerations together",
    symbol="a_req",
    column="a_req_mps2",
    critical="high",
    formula="sqrt(a_long,req^2 + a_lat,req^2)",
    source="Jansson 2005, section 5.3",
    compute=required_acceleration,
    is_symmetric=False,
    undefined="one of the two is undefined",
    misleads="the car needs one of the two, not both",
    is_pointwise=True,
)
