"""Proactive fuzzy safety: how unsafe the gap is if the vehicle ahead brakes."""

from __future__ import annotations

from cwcli.measures import fuzzy
from cwcli.measures.base import Measure
from cwcli.measures.pair import Pair
from cwcli.signals.columns import FloatArray


def proactive_fuzzy_safety(pair: Pair) -> FloatArray:
    """Proactive fuzzy safety at each stamp, (n,), from 0 (safe) to 1 (unsafe)."""
    at = pair.other_in_host_axes
    ahead = at.vx_mps + at.host_speed_mps
    return pair.expand_to_all_rows(fuzzy.proactive_unsafety_of_gap(at.headway_m, at.host_speed_mps, ahead))


MEASURE = Measure(
    summary="how unsafe the gap would be if the vehicle ahead braked",
    symbol="PFS",
    column="pfs",
    critical="high",
    formula=(
        "1 below u t + u^2 / (2 b_max) - u_l^2 / (2 b_l), 0 above u t + u^2 / (2 b_min) - u_l^2 / (2 b_l) + 2 m, "
        "linear between, of HW - 2 m; t 0.75 s, b 4 to 6, b_l 7 m/s^2"
    ),
    source="Mattas et al. 2020; UN R157",
    compute=proactive_fuzzy_safety,
    is_symmetric=False,
    threshold=0.99,
    threshold_source="1 is unsafe by definition",
    undefined="nothing is ahead of the host within the width of the two outlines",
    misleads="in dense traffic, where everybody follows more closely",
    is_pointwise=True,
    clause=lambda threshold: (
        f"the gap would have been unsafe (PFS above {threshold:g}) if the vehicle ahead had braked"
    ),
)
