"""Names of warnings and conflicts: one each, whatever their number."""

from __future__ import annotations

import hashlib
from types import SimpleNamespace
from typing import Any

import pytest

from cwcli.report import pairs as marks_module
from cwcli.report.pairs import MIN_HEX_DIGITS_OF_ANCHOR_NAME, stable_anchor_names


def test_names_that_agree_by_chance_get_more_digits() -> None:
    """2,000 draws of 65,536 agree some thirty times."""
    names = stable_anchor_names("x.mcap", "warning", (("ttc", str(k)) for k in range(2_000)))
    assert len(set(names)) == 2_000
    assert names[:3] == stable_anchor_names("x.mcap", "warning", (("ttc", str(k)) for k in range(3)))
    assert {len(name) - len("warning-") for name in names} == {
        MIN_HEX_DIGITS_OF_ANCHOR_NAME,
        MIN_HEX_DIGITS_OF_ANCHOR_NAME + 1,
    }


class CountedText(str):
    """Text that counts how often it, or a part of it, is compared."""

    n_compared = 0
    __hash__ = str.__hash__

    def __getitem__(self, place: Any) -> CountedText:
        return CountedText(super().__getitem__(place))

    def __eq__(self, other: object) -> bool:
        CountedText.n_compared += 1
        return super().__eq__(other)


def test_comparisons_grow_with_their_number(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each name sought among all before it would be 50 million comparisons."""

    def digest(text: bytes) -> SimpleNamespace:
        return SimpleNamespace(hexdigest=lambda: CountedText(hashlib.blake2s(text).hexdigest()))

    monkeypatch.setattr(marks_module, "hashlib", SimpleNamespace(blake2s=digest))
    monkeypatch.setattr(CountedText, "n_compared", 0)
    assert len(stable_anchor_names("x.mcap", "conflict", [("7",)] * 10_000)) == 10_000
    assert CountedText.n_compared < 30_000
