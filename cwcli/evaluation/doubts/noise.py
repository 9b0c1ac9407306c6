"""Innovations that exceed the noise that a source states (NIS)."""

from __future__ import annotations

import math
from collections.abc import Iterator

from cwcli.estimation.tolerances import TOLERATED_VARIANCE_FACTOR
from cwcli.evaluation.doubts.base import DoubtRule, Finding
from cwcli.evaluation.doubts.evidence import DoubtEvidence, source_name
from cwcli.pipeline.records import read_finite_number_or_nan, to_float_or_nan
from cwcli.text import shorten_and_escape


def find_understated_noise(evidence: DoubtEvidence) -> list[Finding]:
    """Return the sources, of the ego and of tracked targets, whose NIS is outside its bounds and too large."""
    found = list(_iter_sources_with_understated_noise(evidence))
    return sorted(found, key=lambda each: -each.value)


def _iter_sources_with_understated_noise(evidence: DoubtEvidence) -> Iterator[Finding]:
    for source in evidence.ego_sources:
        if source.get("nis_inside") is False:
            yield from _iter_finding_if_nis_too_large(
                source_name(source), read_finite_number_or_nan(source, "nis_per_dof")
            )
    for name, nis, inside in evidence.summary_of_stage("track").column_cells("sensors", "sensor", "NIS/dof", "inside"):
        if isinstance(nis, int | float) and not isinstance(nis, bool) and inside == "OUT":
            yield from _iter_finding_if_nis_too_large(shorten_and_escape(str(name), 60), to_float_or_nan(nis))


def _iter_finding_if_nis_too_large(name: str, nis: float) -> Iterator[Finding]:
    if TOLERATED_VARIANCE_FACTOR < nis < math.inf:
        yield Finding(nis, f"{name} scatters {math.sqrt(nis):.1f} times as much as its uncertainty says.")


RULE = DoubtRule(
    summary="innovations beyond their sigma (NIS per degree of freedom, outside its bounds)",
    short_name="noise beyond its sigma",
    threshold=TOLERATED_VARIANCE_FACTOR,
    unit="",
    source="chosen: as in the verdict of `estimate`",
    advice="Expect greater errors of the states than their covariance says.",
    find=find_understated_noise,
)
