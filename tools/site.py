"""A hook of MkDocs: the pages at the top of the checkout become pages of the site, and links to them hold.

On the disk README.md links to docs/warning.md, and docs/tutorial.md to ../README.md. In the site all pages lie in one
folder, so both links are turned here; docs/ stays readable as it is.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.plugins import event_priority
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[1]
TOP_PAGES = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "security.md",
    "CHANGELOG.md": "changelog.md",
}
"""File at the top of the checkout -> page of the site."""
LINK = re.compile(r"(?<=\]\()(?![a-z]+:|#)([^)#\s]+)")
FOLDERS = {"docs/papers": "docs/papers/README.md"}
"""Folders that pages link to, and the page that stands for each."""


@event_priority(-100)
def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Take out the scripts that would be fetched from elsewhere: the plug-in `offline`, which runs before, adds one.

    It is for searching in a copy on a disk with browsers that start no worker there; a copy without a network did not
    have it anyway.
    """
    polyfills = config.extra.get("polyfills", [])
    config.extra["polyfills"] = [each for each in polyfills if "//" not in str(each)]
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages of the top of the checkout."""
    for name, page in TOP_PAGES.items():
        files.append(File.generated(config, page, content=(ROOT / name).read_text(encoding="utf-8")))
    return files


def on_page_markdown(markdown: str, *, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Turn the links of one page: from where its source lies to where its targets are in the site."""
    del config, files
    at = page.file.src_uri
    source = next((name for name, uri in TOP_PAGES.items() if uri == at), f"docs/{at}")

    def turned(match: re.Match[str]) -> str:
        target = posixpath.normpath(posixpath.join(posixpath.dirname(source), match[1]))
        target = FOLDERS.get(target, target)
        uri = TOP_PAGES.get(target, target.removeprefix("docs/"))
        return posixpath.relpath(uri, posixpath.dirname(at) or ".")

    return LINK.sub(turned, markdown)
