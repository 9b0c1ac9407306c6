"""The tables in README.md's session are what `cwcli run` prints; `cwcli info`'s are compared in test_reference.py."""

from __future__ import annotations

import re

import pytest

from tests.cli.conftest import ROOT, SAMPLES, Run

RTOL = 0.02
ATOL = 0.002
"""In the unit of each column: other versions of NumPy may change the last digits, nothing else may."""


def tables(text: str) -> list[list[str]]:
    """The two tables that the session shows, as rows of words."""
    found = re.findall(
        r"^((?:1-sigma errors against|Warnings \().*?)\n\n", text + "\n\n", flags=re.MULTILINE | re.DOTALL
    )
    return [line.split() for table in found for line in table.splitlines()]


def number(word: str) -> float | None:
    try:
        return float(word.strip("(),"))
    except ValueError:
        return None


def test_tables_of_the_session_are_those_of_cwcli_run(cwcli: Run) -> None:
    readme = re.sub(r"^ {4}", "", (ROOT / "README.md").read_text(encoding="utf-8"), flags=re.MULTILINE)
    shown = tables(readme[readme.index("Two of its tables:") : readme.index("## Exit codes")])
    printed = tables(cwcli("run", SAMPLES / "intersection.mcap").stdout.decode())  # with --details
    assert [len(row) for row in shown] == [len(row) for row in printed]
    assert len(shown) == 15
    for shown_row, printed_row in zip(shown, printed, strict=True):
        for ours, theirs in zip(shown_row, printed_row, strict=True):
            value = number(theirs)
            if value is None:
                assert ours == theirs
            else:
                assert number(ours) == pytest.approx(value, rel=RTOL, abs=ATOL)
