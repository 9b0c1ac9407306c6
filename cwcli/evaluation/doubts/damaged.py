"""A file that is damaged or cut off."""

from __future__ import annotations

from collections.abc import Iterator

from cwcli.evaluation.doubts.base import DoubtRule, Finding
from cwcli.evaluation.doubts.evidence import DoubtEvidence
from cwcli.text import shorten_and_escape

MAX_FAULTS = 1
"""Number of faults of the file from which its results are doubted. Chosen by hand: nobody knows what one has lost."""


def find_faults(evidence: DoubtEvidence) -> Iterator[Finding]:
    """Yield what is wrong with the file."""
    faults = {reason: n for reason, n in evidence.faults.items() if n > 0}
    if faults:
        most = max(faults, key=lambda reason: faults[reason])
        count = f": {faults[most]}" if faults[most] > 1 else ""
        more = f", and {len(faults) - 1} more" if len(faults) > 1 else ""
        yield Finding(float(sum(faults.values())), f"The file is damaged ({shorten_and_escape(most)}{count}{more}).")


RULE = DoubtRule(
    summary="a damaged file",
    short_name="damaged file",
    threshold=MAX_FAULTS,
    unit="",
    source="chosen: the lost part is not known",
    advice="Copy or record it again; the intact parts were used.",
    find=find_faults,
)
