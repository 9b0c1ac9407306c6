"""Time to steer: how long the driver may wait and still avoid the contact by steering to one side."""

from __future__ import annotations

from cwcli.measures import manoeuvres
from cwcli.measures.base import Measure
from cwcli.measures.pair import Pair
from cwcli.signals.columns import FloatArray


def time_to_steer(pair: Pair) -> FloatArray:
    """Time (s) left to avoid contact by steering to one side, at each stamp, (n,)."""
    return manoeuvres.latest_start_of_manoeuvre_s(manoeuvres.STEERING, pair)


MEASURE = Measure(
    summary="time left to avoid contact by steering",
    symbol="TTS",
    column="tts_s",
    critical="low",
    formula=(
        "latest t in [0, TTC] from which the manoeuvre avoids contact: 8 m/s^2 to the left or the right, the heading "
        "kept; the other keeps velocity and heading"
    ),
    source="Tamke, Dang and Breuel 2011",
    compute=time_to_steer,
    is_symmetric=False,
    undefined="the two are not on a collision course, or the manoeuvre does not help",
    misleads="where there is no room, or the road is wet",
    is_pointwise=True,
    is_stepped=True,
)
