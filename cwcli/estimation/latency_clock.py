"""Shift latencies to the clock on which most sources agree.

The search compares each source with one reference, which may itself be late. A measurement can't be stamped before it
was made. So where at least as many sources agree on a clock ahead of the reference as on that of the reference, the
reference is late. Of two groups of one size the one with a position counts: a receiver has the satellites' clock.
Sources whose latencies drift alike, and that are ahead, show in the same way that the reference's clock drifts.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cwcli.estimation.latency import MIN_SIGNIFICANT_SIGMAS, Latency, LatencyStatus
from cwcli.estimation.measurements import Kind
from cwcli.lazy_dataclass import dataclass, replace

MAX_CLOCK_DRIFT_DIFFERENCE_SHARE = 0.2
"""Greatest difference of two drifts of one clock, as a share of the larger one. Chosen by hand: a drift of a latency is
found to some percent."""


@dataclass(frozen=True)
class SourceLatency:
    """Latency of a quantity of a source.

    Attributes:
        source, kind: The quantity.
        is_reference: Whether the latencies of the others are relative to its source.
        latency: Its latency.
    """

    source: str
    kind: Kind
    is_reference: bool
    latency: Latency


def shift_latencies_to_agreed_clock_and_note(
    source_latencies: Sequence[SourceLatency],
) -> tuple[list[Latency], list[str]]:
    """Move latencies to the clock on which the sources agree.

    Nothing is moved where the user gives a latency, because that names a clock.

    Args:
        source_latencies: Latencies of all sources, relative to one reference.

    Returns:
        The latencies, and a note where they were moved.
    """
    latencies = [each.latency for each in source_latencies]
    statuses = {latency.status for latency in latencies}
    if LatencyStatus.REFERENCE not in statuses or LatencyStatus.GIVEN in statuses:
        return latencies, []
    early = [
        each
        for each in source_latencies
        if each.latency.status in (LatencyStatus.APPLIED, LatencyStatus.DRIFTS) and each.latency.found_s < 0.0
    ]
    groups = [[other for other in early if _do_latencies_agree(other.latency, each.latency)] for each in early]
    group = max(groups, key=_count_source_votes, default=[])
    others = [
        each
        for each in source_latencies
        if each.is_reference or _agrees_with_reference_but_not_group(each.latency, group)
    ]
    if _count_source_votes(group) < len({each.source for each in others}):
        return latencies, []
    return _shift_latencies_to_mean_clock_and_note(source_latencies, group)


def disputed_clock_sigma_s(source_latencies: Sequence[SourceLatency], shifted_latencies: Sequence[Latency]) -> float:
    """Return one sigma of the clock of the states where one source alone is ahead of the reference, s; else 0.

    Either that source's stamps are early, or the reference is late: the log does not tell.
    """
    late_s = [
        latency.applied_s
        for each, latency in zip(source_latencies, shifted_latencies, strict=True)
        if each.is_reference and latency.status is LatencyStatus.APPLIED
    ]
    ahead = {each.source for each, latency in zip(source_latencies, shifted_latencies, strict=True)
             if latency.status is LatencyStatus.REFERENCE and not each.is_reference}  # fmt: skip
    return late_s[0] if late_s and len(ahead) == 1 else 0.0


def _shift_latencies_to_mean_clock_and_note(
    source_latencies: Sequence[SourceLatency], group: Sequence[SourceLatency]
) -> tuple[list[Latency], list[str]]:
    """Shift latencies to the mean clock of a group of sources that agree."""
    weight = np.array([each.latency.sigma_s**-2.0 for each in group])
    early_s = float(weight @ [each.latency.found_s for each in group] / weight.sum())
    sigma_s = float(weight.sum() ** -0.5)
    drift = float(weight @ [each.latency.drift for each in group] / weight.sum())
    middle_s = float(weight @ [each.latency.middle_s for each in group] / weight.sum())
    shifted = []
    for each in source_latencies:
        latency = each.latency
        if each.is_reference:
            bound_s = max(one.latency.bound_s for one in group)
            status = LatencyStatus.DRIFTS if drift else LatencyStatus.APPLIED
            shifted.append(Latency(status, -early_s, sigma_s, bound_s, drift=-drift, middle_s=middle_s))
        elif each in group:
            shifted.append(Latency(LatencyStatus.REFERENCE))
        elif latency.status is LatencyStatus.DRIFTS:
            both_s = float(np.hypot(latency.sigma_s, sigma_s))
            shifted.append(
                replace(latency, found_s=latency.found_s - early_s, sigma_s=both_s, drift=latency.drift - drift)
            )
        elif latency.status in (LatencyStatus.APPLIED, LatencyStatus.NOT_SIGNIFICANT):
            found_s, both_s = latency.found_s - early_s, float(np.hypot(latency.sigma_s, sigma_s))
            is_clear = abs(found_s) > MIN_SIGNIFICANT_SIGMAS * both_s
            status = LatencyStatus.APPLIED if is_clear else LatencyStatus.NOT_SIGNIFICANT
            shifted.append(replace(latency, status=status, found_s=found_s, sigma_s=both_s))
        else:
            shifted.append(latency)
    names = ", ".join(dict.fromkeys(each.source for each in group))
    late = next(each.source for each in source_latencies if each.is_reference)
    ahead = f"{names}: {-1e3 * early_s:.0f} ms ahead of {late}"
    return shifted, [f"{ahead}, so {late} is late; states are on the clock of {names}"]


def _do_latencies_agree(one: Latency, other: Latency) -> bool:
    """Whether two latencies are those of one clock: by their drifts, and by their values within sigma."""
    if abs(one.drift - other.drift) > MAX_CLOCK_DRIFT_DIFFERENCE_SHARE * max(abs(one.drift), abs(other.drift)):
        return False
    return abs(one.found_s - other.found_s) <= MIN_SIGNIFICANT_SIGMAS * float(np.hypot(one.sigma_s, other.sigma_s))


def _agrees_with_reference_but_not_group(latency: Latency, group: Sequence[SourceLatency]) -> bool:
    """Whether a latency differs significantly from the group but not from the reference."""
    return latency.status is LatencyStatus.NOT_SIGNIFICANT and not any(
        _do_latencies_agree(latency, one.latency) for one in group
    )


def _count_source_votes(group: Sequence[SourceLatency]) -> float:
    """Return the number of sources in a group, plus a half for a position, which decides a tie."""
    return len({each.source for each in group}) + 0.5 * any(each.kind is Kind.POSITION for each in group)
