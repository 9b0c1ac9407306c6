"""The documentation as a site: a reader's browser asks no other server for anything, and code is rendered as code."""

from __future__ import annotations

import os
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import urlsplit

import pytest

ROOT = Path(__file__).parents[1]
FETCHED = {
    "script": "src",
    "img": "src",
    "iframe": "src",
    "source": "src",
    "video": "src",
    "audio": "src",
    "embed": "src",
    "object": "data",
    "link": "href",
}
"""Element -> the attribute whose address a browser requests without being asked."""
NOT_FETCHED = {"canonical", "alternate", "next", "prev"}
"""Links (`rel`) that only name a page."""


class Page(HTMLParser):
    """What a browser fetches for a page, its classes, and the text of its code blocks."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.fetched: list[str] = []
        self.classes: set[str] = set()
        self.blocks: list[str] = []
        self._depth = 0
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.classes |= set(given.get("class", "").split())
        if not NOT_FETCHED & set(given.get("rel", "").split()) and FETCHED.get(tag) in given:
            self.fetched.append(given[FETCHED[tag]])
        self.fetched += [each.split()[0] for each in given.get("srcset", "").split(",") if each.strip()]
        if tag == "pre":
            self._depth += 1
            self.blocks.append("")

    def handle_endtag(self, tag: str) -> None:
        self._depth -= tag == "pre"

    def handle_data(self, data: str) -> None:
        if self._depth:
            self.blocks[-1] += data


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Page]:
    """The pages of the built site, by their path in it."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--site-dir", str(folder)]
    done = subprocess.run(
        command, cwd=ROOT, check=False, capture_output=True, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    )
    assert done.returncode == 0, done.stderr.decode()
    return {
        path.relative_to(folder).as_posix(): Page(path.read_text(encoding="utf-8"))
        for path in sorted(folder.rglob("*.html"))
    }


def test_no_page_requests_anything_from_elsewhere(site: dict[str, Page]) -> None:
    """Neither by itself nor by the theme, which fetches a drawing library for pages with diagrams."""
    fetched = [(name, each) for name, page in site.items() for each in page.fetched]
    assert len(fetched) > len(site) > 20
    assert [(name, each) for name, each in fetched if urlsplit(each).netloc] == []
    assert [name for name, page in site.items() if "mermaid" in page.classes] == []


def test_the_configuration_of_commands_is_a_code_block(site: dict[str, Page]) -> None:
    (block,) = (each for each in site["commands.html"].blocks if 'topic = ["ego_position=/gps/fix"]' in each)
    assert block.strip().splitlines()[-2:] == ["[estimate]", 'model = "song2016"']
