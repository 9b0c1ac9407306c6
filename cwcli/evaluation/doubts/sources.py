"""Doubts about the sources of the ego: they contradict each other, or are not as good as they say."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

from cwcli.estimation.tolerances import MAX_GATED_ROW_SHARE, TOLERATED_VARIANCE_FACTOR
from cwcli.evaluation.doubts.base import DoubtRule, Finding
from cwcli.evaluation.doubts.evidence import DoubtEvidence, name_sources_in_words, source_name
from cwcli.pipeline.records import read_finite_number_or_nan, to_float_or_nan
from cwcli.signals.vehicle_state import StateFlag
from cwcli.text import format_count, shorten_and_escape

MIN_CONTRADICTIONS_TO_DOUBT_ESTIMATE = 1
"""Number of contradictions from which the estimate is doubted. Chosen by hand: one is enough to spoil it."""


def find_contradictions(evidence: DoubtEvidence) -> Iterator[Finding]:
    """Yield each contradiction that the estimator found."""
    found = evidence.estimate_summary.contradictions
    for sentence in found:
        yield Finding(float(len(found)), name_sources_in_words(sentence))


CONTRADICTION_RULE = DoubtRule(
    summary="sources that contradict each other",
    short_name="contradicting sources",
    threshold=MIN_CONTRADICTIONS_TO_DOUBT_ESTIMATE,
    unit="",
    source="chosen: one spoils the estimate",
    advice="Find out which of them is wrong, and leave it out or correct it with --topic or --map.",
    find=find_contradictions,
    is_of_whole_log=True,
)


MIN_CORRECTIONS_FOR_DOUBT = 1
"""Number of corrected sources from which the estimate is doubted. Chosen by hand: the user should see every one."""
ADVICE_NAMING_OPTION_THAT_UNDOES_CORRECTION = "Check that sensor, or mend the recording; {}."
"""The advice where the recorded sentence names the option that undoes the correction."""
EVIDENCE_PATTERN = r" \((?P<evidence>[^()]*); (?P<option>--trust \S+ leaves it unchanged)\)\.?$"
"""The end of the recorded sentence: what shows the fault, and the option (`cwcli.estimation.correction`)."""
LOG_LIKELIHOOD_RATIO_PATTERN = r"^log-likelihood ratio \S+ by "
"""The beginning of the evidence where other sources show the fault: its number is for `--details` alone."""


def find_corrected_sources(evidence: DoubtEvidence) -> Iterator[Finding]:
    """Yield each source that the estimator corrected by itself."""
    found = evidence.estimate_summary.corrections
    for sentence in found:
        end = re.search(EVIDENCE_PATTERN, sentence)
        if end is None:
            yield Finding(float(len(found)), name_sources_in_words(sentence))
            continue
        shown = re.sub(LOG_LIKELIHOOD_RATIO_PATTERN, "shown by ", end["evidence"])
        yield Finding(
            float(len(found)),
            name_sources_in_words(f"{sentence[: end.start()]} ({shown})"),
            ADVICE_NAMING_OPTION_THAT_UNDOES_CORRECTION.format(shorten_and_escape(end["option"])),
        )


CORRECTION_RULE = DoubtRule(
    summary="sources that were corrected",
    short_name="corrected sources",
    threshold=MIN_CORRECTIONS_FOR_DOUBT,
    unit="",
    source="chosen: each is shown",
    advice="Mend the recording, or confirm it with --as.",
    find=find_corrected_sources,
    is_of_whole_log=True,
    is_repaired=True,
)


def find_gated_sources(evidence: DoubtEvidence) -> Iterator[Finding]:
    """Yield each source of the ego that contradicts the others too often."""
    for source in evidence.ego_sources:
        gated = read_finite_number_or_nan(source, "gated")
        n = gated + read_finite_number_or_nan(source, "used")
        if n > 0 and gated > MAX_GATED_ROW_SHARE * n:
            share = gated / n
            yield Finding(
                share, f"{100 * share:.0f} % of the measurements of {source_name(source)} contradict the other sources."
            )


GATED_SOURCES_RULE = DoubtRule(
    summary="a source whose measurements the gate rejects",
    short_name="rejected measurements",
    threshold=MAX_GATED_ROW_SHARE,
    unit="share",
    source="chosen: as in the verdict of `estimate`",
    advice="Check its stamps and its mounting.",
    find=find_gated_sources,
    is_of_whole_log=True,
)


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
    for name, nis, inside in evidence.summary_of_stage("track").rows_of_table_columns_or_empty(
        "sensors", "sensor", "mean NIS/dof", "NIS/dof within bounds"
    ):
        if isinstance(nis, int | float) and not isinstance(nis, bool) and inside == "OUT":
            yield from _iter_finding_if_nis_too_large(shorten_and_escape(str(name), 60), to_float_or_nan(nis))


def _iter_finding_if_nis_too_large(name: str, nis: float) -> Iterator[Finding]:
    if TOLERATED_VARIANCE_FACTOR < nis < math.inf:
        yield Finding(nis, f"{name} scatters {math.sqrt(nis):.1f} times as much as its uncertainty says.")


UNDERSTATED_NOISE_RULE = DoubtRule(
    summary="innovations beyond their sigma (NIS per degree of freedom, outside its bounds)",
    short_name="noise beyond its sigma",
    threshold=TOLERATED_VARIANCE_FACTOR,
    unit="",
    source="chosen: as in the verdict of `estimate`",
    advice="Expect greater errors of the states than their covariance says.",
    find=find_understated_noise,
    is_of_whole_log=True,
)


MIN_RESETS_FOR_DOUBT = 1
"""Number of resets from which the estimate is doubted. Chosen by hand: a jump is never the car's motion."""


def find_resets(evidence: DoubtEvidence) -> Iterator[Finding]:
    """Yield each source that was believed again only after repeated rejections."""
    for source in evidence.ego_sources:
        n = read_finite_number_or_nan(source, "resets")
        if n >= MIN_RESETS_FOR_DOUBT:
            yield Finding(n, f"{source_name(source)} jumped {format_count(int(n), 'time')}, and the track with it.")


RESETS_RULE = DoubtRule(
    summary="a track that jumps because a source jumped",
    short_name="jumps",
    threshold=MIN_RESETS_FOR_DOUBT,
    unit="",
    source="chosen: no car jumps",
    advice="Do not use the states flagged after_reset.",
    find=find_resets,
    is_of_whole_log=True,
    flag=StateFlag.AFTER_RESET,
)
