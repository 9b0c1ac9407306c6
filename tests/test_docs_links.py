"""What the pages and the docstrings name is there: linked files, paths of the checkout, modules that are to be run."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.recipes.house import GUIDE, recipes

ROOT = Path(__file__).parents[1]
PAGES = sorted({*ROOT.glob("*.md"), ROOT / "sample_logs/README.md", *ROOT.glob("docs/**/*.md")})
SOURCES = sorted(
    path for folder in ("cwcli", "tests") for path in (ROOT / folder).rglob("*.py*") if path.suffix != ".pyc"
)
LINK = re.compile(r"\]\(([^)#\s]+)")
CODE = re.compile(r"`([^`\n]+)`")
INDENTED = re.compile(r"^ {4}(.+)$", re.MULTILINE)
CHECKOUT_PATH = re.compile(r"(?:cwcli|docs|papers|tests|schemas|sample_logs|\.ci)/[\w./*-]*\w(?![\w*{])")
MODULE = re.compile(r"python3? -m ((?:cwcli|tests)[\w.]*)")
PAGE_NAME = re.compile(r"docs/[\w/.-]+\.md")
WRITTEN = {
    *("cwcli/camera", "cwcli-demo"),
    *(step.path for recipe in recipes(GUIDE.read_text(encoding="utf-8")).values() for step in recipe.steps),
}
"""Topics and folders of a run that look like paths, and the files that the recipes make."""


def links(page: Path) -> Iterator[str]:
    return (target for target in LINK.findall(page.read_text(encoding="utf-8")) if "://" not in target)


def is_there(page: Path, name: str) -> bool:
    """From the checkout, or beside the page; the ending may be left out, `*` and capitals for any name."""
    pattern = re.sub(r"\b[A-Z]{3,}\b", "*", name).rstrip("/")
    places = (ROOT, page.parent, ROOT / "docs")
    return any([*place.glob(pattern), *place.glob(f"{pattern}.*")] for place in places)


def named_paths(text: str) -> Iterator[str]:
    for code in [*CODE.findall(text), *INDENTED.findall(text)]:
        for match in CHECKOUT_PATH.finditer(code):
            is_inside_a_word = match.start() > 0 and (
                code[match.start() - 1].isalnum() or code[match.start() - 1] in "/.-_"
            )
            if not is_inside_a_word and match[0] not in WRITTEN:
                yield match[0]


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_what_a_page_names_is_there(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    missing = [target for target in links(page) if not (page.parent / target).exists()]
    missing += [name for name in named_paths(text) if not is_there(page, name)]
    missing += [name for name in MODULE.findall(text) if not is_there(page, name.replace(".", "/"))]
    assert missing == []


def test_pages_that_docstrings_name_are_there() -> None:
    names = {(name, path.name) for path in SOURCES for name in PAGE_NAME.findall(path.read_text(encoding="utf-8"))}
    assert len(names) > 5
    assert sorted((name, where) for name, where in names if not (ROOT / name).is_file()) == []


def test_every_page_is_linked_from_the_readme_or_lies_in_a_linked_folder() -> None:
    linked = {(ROOT / target).resolve() for target in links(ROOT / "README.md")}
    lost = [page for page in ROOT.glob("docs/**/*.md") if not {page, page.parent} & linked]
    assert lost == []


def test_every_picture_is_shown_on_a_page() -> None:
    shown = {(page.parent / target).resolve() for page in PAGES for target in links(page)}
    pictures = [path for kind in ("png", "svg", "jpg") for path in ROOT.glob(f"docs/**/*.{kind}")]
    assert [path for path in pictures if path not in shown] == []
