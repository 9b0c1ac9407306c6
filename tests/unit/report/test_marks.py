"""Names of warnings and conflicts: one each, whatever their number."""

from __future__ import annotations

import time

from cwcli.report.marks import DIGITS, marks


def test_names_that_agree_by_chance_get_more_digits() -> None:
    """2,000 draws of 65,536 agree some thirty times."""
    names = marks("x.mcap", "warning", (("ttc", str(k)) for k in range(2_000)))
    assert len(set(names)) == 2_000
    assert names[:3] == marks("x.mcap", "warning", (("ttc", str(k)) for k in range(3)))
    assert {len(name) - len("warning-") for name in names} == {DIGITS, DIGITS + 1}


def test_the_time_grows_with_their_number() -> None:
    """Each name sought among all before it would be 900 million comparisons: 10 s and more."""
    start = time.process_time()
    assert len(marks("x.mcap", "conflict", [("7",)] * 30_000)) == 30_000
    assert time.process_time() - start < 2.0
