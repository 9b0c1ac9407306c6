"""Critical fuzzy safety: how unsafe the gap is if the vehicle ahead keeps its speed."""

from __future__ import annotations

from cwcli.measures import fuzzy
from cwcli.measures.base import Measure
from cwcli.measures.pair import Pair
from cwcli.signals.columns import FloatArray


def critical_fuzzy_safety(pair: Pair) -> FloatArray:
    """Critical fuzzy safety at each stamp, (n,), from 0 (safe) to 1 (unsafe)."""
    at = pair.other_in_host_axes
    ahead = at.vx_mps + at.host_speed_mps
    return pair.expand_to_all_rows(
        fuzzy.critical_unsafety_of_gap(at.headway_m, at.host_speed_mps, ahead, at.host_accel_mps2)
    )


MEASURE = Measure(
    summary="how hard it is to avoid a vehicle ahead at its present speed",
    symbol="CFS",
    column="cfs",
    critical="high",
    formula=(
        "1 below (u + a t / 2 - u_l) t + (u + a t - u_l)^2 / (2 b_max), 0 above the same with b_min, linear between, "
        "of HW; 0 when not closing; t 0.75 s, b 4 to 6 m/s^2, a at least -b_min"
    ),
    source="Mattas et al. 2020; UN R157",
    compute=critical_fuzzy_safety,
    is_symmetric=False,
    threshold=0.99,
    threshold_source="1 is unsafe by definition",
    undefined="nothing is ahead of the host within the width of the two outlines",
    misleads="for a vehicle ahead that brakes",
    is_pointwise=True,
    clause=lambda threshold: f"a vehicle ahead could hardly be avoided at its present speed (CFS above {threshold:g})",
)
