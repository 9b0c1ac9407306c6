"""CONTRIBUTING.md: its recipes stay within their bounds and are all tested, and its map is that of the house."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.recipes.house import GUIDE, changed, recipes

TEXT = GUIDE.read_text(encoding="utf-8")
RECIPES = recipes(TEXT)
BOUNDS = {
    "A stage": 4,
    "A channel": 3,
    "A measure": 2,
    "A collision rule": 2,
    "A motion model": 2,
    "An event": 2,
    "A lane method": 2,
    "A message type": 2,
    "A sensor quantity": 3,
    "A command": 2,
    "A clause of a standard": 2,
    "A doubt": 2,
    "An import format": 2,
}
"""Source files that an addition may touch, a `.proto` with its channel. If it takes more, the house is to be mended."""


def test_there_is_a_recipe_for_each_kind_within_its_bound() -> None:
    assert {title: recipe.n_files for title, recipe in RECIPES.items()} == BOUNDS


def test_every_recipe_is_followed_by_a_test() -> None:
    texts = "".join(path.read_text(encoding="utf-8") for path in Path(__file__).parent.glob("test_*.py"))
    assert set(re.findall(r'built\("([^"]+)"\)', texts)) == set(RECIPES)


def test_every_numbered_line_is_a_step() -> None:
    parts = TEXT.split("\n### ")[1:]
    numbers = [[int(number) for number in re.findall(r"^(\d)\. ", part, re.MULTILINE)] for part in parts]
    assert numbers == [[k + 1 for k in range(len(recipe.steps))] for recipe in RECIPES.values()]
    assert TEXT.count("\n```\n") == sum(len(recipe.steps) for recipe in RECIPES.values())


def test_a_diff_is_applied_where_its_old_lines_are_and_nowhere_else() -> None:
    text = "a\n\nb\nc\n"
    assert changed(text, " a\n+new\n\n@@\n-c\n+d\n") == "a\nnew\n\nb\nd\n"
    for wrong in ("-x\n+y\n", "+only new\n"):
        with pytest.raises(ValueError, match="not once"):
            changed(text, wrong)
