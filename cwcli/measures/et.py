"""Encroachment time: how long the host is in the area that the other drives through as well."""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.pair import Pair, PairNumber
from cwcli.measures.pet import host_encroachment_duration_s


def encroachment_time_of_pair_s(pair: Pair) -> PairNumber:
    """Encroachment time (s) of the pair, (), at its narrowest encroachment."""
    return np.array(host_encroachment_duration_s(pair))


MEASURE = Measure(
    summary="time that the host is in the area where both drive",
    symbol="ET",
    column="et_s",
    critical="high",
    formula=(
        "from the first to the last moment around that of PET at which the host's outline overlaps the other's of some"
        " other moment within 5 s, in steps of 0.1 s"
    ),
    source="Allen, Shin and Cooper 1978",
    compute=encroachment_time_of_pair_s,
    is_series=False,
    is_symmetric=False,
    undefined="as for PET, or the two drive within 30 degrees of parallel",
    misleads="in a queue: it lasts as long as the host stands",
)
