"""No warning at all: a scene in which a warning is false. Demands: none."""

from __future__ import annotations

import math

from cwcli.conformance.verdict import DrivenTrial, Verdict

NUMBERS_THAT_JUDGE_NEEDS = ()
"""Names of the numbers that it asks for."""


def judge(driven: DrivenTrial) -> Verdict:
    """Judge one repetition."""
    if not driven.warnings:
        return Verdict(math.nan, "", "no warning")
    first_s, n = driven.warnings[0].raised_s, len(driven.warnings)
    return Verdict(-float(n), "warnings", f"false warning at {first_s:.2f} s", {"warned_s": first_s}, has_failed=True)
