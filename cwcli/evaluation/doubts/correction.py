"""Sources that were wrong in a known way and were corrected: the estimate is as good as that judgement."""

from __future__ import annotations

import re
from collections.abc import Iterator

from cwcli.evaluation.doubts.base import DoubtRule, Finding
from cwcli.evaluation.doubts.evidence import DoubtEvidence, name_sources_in_words
from cwcli.text import shorten_and_escape

MAX_UNDOUBTED_CORRECTIONS = 1
"""Number of corrected sources from which the estimate is doubted. Chosen by hand: the user should see every one."""
ADVICE_WITH_AN_OPTION = "Check that sensor, or mend the recording; {}."
"""The advice where the recorded sentence names the option that undoes the correction."""
EVIDENCE_PATTERN = r" \((?P<evidence>[^()]*); (?P<option>--trust \S+ leaves it unchanged)\)\.?$"
"""The end of the recorded sentence: what shows the fault, and the option (`cwcli.estimation.correction`)."""
RATIO_PATTERN = r"^log-likelihood ratio \S+ by "
"""The beginning of the evidence where other sources show the fault: its number is for `--details` alone."""


def find_corrections(evidence: DoubtEvidence) -> Iterator[Finding]:
    """Yield each source that the estimator corrected by itself."""
    found = evidence.estimate_summary.corrections
    for sentence in found:
        end = re.search(EVIDENCE_PATTERN, sentence)
        if end is None:
            yield Finding(float(len(found)), name_sources_in_words(sentence))
            continue
        shown = re.sub(RATIO_PATTERN, "shown by ", end["evidence"])
        yield Finding(
            float(len(found)),
            name_sources_in_words(f"{sentence[: end.start()]} ({shown})"),
            ADVICE_WITH_AN_OPTION.format(shorten_and_escape(end["option"])),
        )


RULE = DoubtRule(
    summary="sources that were corrected",
    short_name="corrected sources",
    threshold=MAX_UNDOUBTED_CORRECTIONS,
    unit="",
    source="chosen: each is shown",
    advice="Mend the recording, or confirm it with --as.",
    find=find_corrections,
    is_repaired=True,
)
