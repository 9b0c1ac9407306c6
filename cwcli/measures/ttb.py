"""Time to brake: how long the driver may wait and still avoid the contact by braking."""

from __future__ import annotations

from cwcli.measures import manoeuvres
from cwcli.measures.base import Measure
from cwcli.measures.pair import Pair
from cwcli.signals.columns import FloatArray


def time_to_brake(pair: Pair) -> FloatArray:
    """Time (s) left to avoid contact by braking, at each stamp, (n,)."""
    return manoeuvres.latest_start_of_manoeuvre_s(manoeuvres.BRAKING, pair)


MEASURE = Measure(
    summary="time left to avoid contact by braking",
    symbol="TTB",
    column="ttb_s",
    critical="low",
    formula=(
        "latest t in [0, TTC] from which the manoeuvre avoids contact: a = 11.5 m/s^2 until it stands; the other keeps"
        " velocity and heading"
    ),
    source="Tamke, Dang and Breuel 2011",
    compute=time_to_brake,
    is_symmetric=False,
    undefined="the two are not on a collision course, or the manoeuvre no longer helps (then BTN, STN or TTR say so)",
    misleads="where there is no room, or the road is wet",
    is_pointwise=True,
    is_stepped=True,
)
