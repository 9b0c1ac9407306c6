"""What the tests of the recipes share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from tests.recipes.house import GUIDE, House, recipes

Built = Callable[[str], House]


@pytest.fixture
def built(tmp_path: Path) -> Built:
    """Follows a recipe in a copy; it touches the files that it names, as many as it says, and breaks no rule."""

    def build(title: str) -> House:
        recipe = recipes(GUIDE.read_text(encoding="utf-8"))[title]
        house = replace(House.copied_to(tmp_path), laws=recipe.laws)
        house.follow(recipe)
        touched = house.touched()
        assert touched == {step.path for step in recipe.steps if step.path.startswith("cwcli/")}
        assert len(touched) == recipe.n_files
        house.is_clean()
        return house

    return build
