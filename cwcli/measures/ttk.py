"""Time to kick down: how long the driver may wait and still avoid the contact by accelerating."""

from __future__ import annotations

from cwcli.measures import manoeuvres
from cwcli.measures.base import Measure
from cwcli.measures.pair import Pair
from cwcli.signals.columns import FloatArray


def time_to_kick_down(pair: Pair) -> FloatArray:
    """Time (s) left to avoid contact by accelerating, at each stamp, (n,)."""
    return manoeuvres.latest_start_of_manoeuvre_s(manoeuvres.ACCELERATING, pair)


MEASURE = Measure(
    summary="time left to avoid contact by accelerating",
    symbol="TTK",
    column="ttk_s",
    critical="low",
    formula=(
        "latest t in [0, TTC] from which the manoeuvre avoids contact: a = 11.5 m/s^2; the other keeps velocity and "
        "heading"
    ),
    source="Tamke, Dang and Breuel 2011",
    compute=time_to_kick_down,
    is_symmetric=False,
    undefined="the two are not on a collision course, or the manoeuvre does not help",
    misleads="where there is no room, or the road is wet",
    is_pointwise=True,
    is_stepped=True,
)
