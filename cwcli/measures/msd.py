"""Minimum stopping distance of the host."""

from __future__ import annotations

from cwcli.measures.base import Measure
from cwcli.measures.limits import CAR_BRAKING_LIMIT_MPS2
from cwcli.measures.pair import MetresAtStamps, Pair


def host_minimum_stopping_distance_m(pair: Pair) -> MetresAtStamps:
    """Distance (m) in which the host can stop, at each stamp, (n,)."""
    speed = pair.other_in_host_axes.host_speed_mps
    return pair.expand_to_all_rows(speed**2 / (2.0 * CAR_BRAKING_LIMIT_MPS2))


MEASURE = Measure(
    summary="distance in which the host can stop",
    symbol="MSD",
    column="msd_m",
    critical="high",
    formula="v_e^2 / (2 a), a = 11.5 m/s^2",
    source="Allen, Shin and Cooper 1978",
    compute=host_minimum_stopping_distance_m,
    is_symmetric=False,
    is_of_host=True,
    undefined="the centres are more than 200 m apart",
    misleads="it assumes no reaction time and a dry road",
    is_pointwise=True,
)
