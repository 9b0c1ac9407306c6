"""Whose clock the latencies count from: the one on which the sources agree.

The search compares each source with one reference, which is convenient, but may itself be late. A measurement can't be
stamped before it was made. So where more sources agree on a time before the reference's than are on the reference's, or
as many with a position among them (a receiver has the satellites' clock), the reference is late and not they early.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import compress

import numpy as np

from cwcli.estimation.latency import SIGNIFICANT_SIGMAS, Latency, LatencyStatus, references
from cwcli.estimation.measurements import Kind
from cwcli.estimation.passes import Series


def on_agreed_clock(series: Sequence[Series], latencies: Sequence[Latency]) -> tuple[list[Latency], list[str]]:
    """Move the latencies to the clock on which the sources agree.

    Nothing is moved where the user gives a latency, because that names a clock.

    Args:
        series: All series.
        latencies: Parallel, against the reference of `references`.

    Returns:
        The latencies, and a note where they were moved.
    """
    is_reference = references(series)
    if not any(latency.status is LatencyStatus.REFERENCE for latency in latencies) or any(
        latency.status is LatencyStatus.GIVEN for latency in latencies
    ):
        return list(latencies), []
    early = [
        i for i, latency in enumerate(latencies) if latency.status is LatencyStatus.APPLIED and latency.found_s < 0.0
    ]
    groups = [[k for k in early if _agree(latencies[i], latencies[k])] for i in early]
    group = max(
        groups, key=lambda g: (_n_sources(series, g), any(series[k].kind is Kind.POSITION for k in g)), default=[]
    )
    others = [
        k
        for k, latency in enumerate(latencies)
        if is_reference[k]
        or (latency.status is LatencyStatus.NOT_SIGNIFICANT and not any(_agree(latency, latencies[i]) for i in group))
    ]
    has_position = any(series[k].kind is Kind.POSITION for k in group)
    if _n_sources(series, group) + 0.5 * has_position <= _n_sources(series, others):
        return list(latencies), []
    return _moved(series, latencies, group, is_reference)


def _moved(
    series: Sequence[Series], latencies: Sequence[Latency], group: Sequence[int], is_reference: Sequence[bool]
) -> tuple[list[Latency], list[str]]:
    """The latencies against the mean of a group of sources that agree; see `on_agreed_clock`."""
    weight = np.array([latencies[k].sigma_s ** -2.0 for k in group])
    early_s = float(weight @ [latencies[k].found_s for k in group] / weight.sum())
    sigma_s = float(weight.sum() ** -0.5)
    moved = []
    for k, latency in enumerate(latencies):
        if is_reference[k]:
            moved.append(Latency(LatencyStatus.APPLIED, -early_s, sigma_s, max(latencies[i].bound_s for i in group)))
        elif k in group:
            moved.append(Latency(LatencyStatus.REFERENCE))
        elif latency.status in (LatencyStatus.APPLIED, LatencyStatus.NOT_SIGNIFICANT):
            found_s, both_s = latency.found_s - early_s, float(np.hypot(latency.sigma_s, sigma_s))
            is_clear = abs(found_s) > SIGNIFICANT_SIGMAS * both_s
            status = LatencyStatus.APPLIED if is_clear else LatencyStatus.NOT_SIGNIFICANT
            moved.append(replace(latency, status=status, found_s=found_s, sigma_s=both_s))
        else:
            moved.append(latency)
    names = ", ".join(dict.fromkeys(series[k].source for k in group))
    late = next(compress((s.source for s in series), is_reference))
    ahead = f"{names}: {-1e3 * early_s:.0f} ms ahead of {late}"
    return moved, [f"{ahead}, so {late} is late; states are on the clock of {names}"]


def _agree(one: Latency, other: Latency) -> bool:
    return abs(one.found_s - other.found_s) <= SIGNIFICANT_SIGMAS * float(np.hypot(one.sigma_s, other.sigma_s))


def _n_sources(series: Sequence[Series], rows: Sequence[int]) -> int:
    return len({series[k].source for k in rows})
