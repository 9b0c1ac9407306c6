"""The measured pages: which they are, how their numbers are filled, and what is wrong with them."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path

from tools.results.markers import fill_markers, unmarked_numbers
from tools.results.papers import page_from_file
from tools.results.result_file import RESULTS, ResultFile, read_result_file

DOCS = RESULTS.parent
PAPER_PAGES = {f"papers/{name}.md": name for name in ("song2016", "xiang2019", "zhang2011")}
"""Pages that are made from a result file alone."""
MEASURED_SECTIONS: dict[str, tuple[str, ...]] = {
    "conformance.md": ("Over many seeds",),
    "control.md": ("Measured",),
    "estimation.md": ("Accuracy of latencies",),
    "find.md": ("Measured",),
    "lanes.md": ("Accuracy",),
    "observer.md": ("Accuracy on rendered drives",),
    "papers/song2016-choices.md": ("Table 1", "Figure 7", "Figures 9 and 11", "Traps", "Figures 12 to 15"),
    "papers/xiang2019-filter.md": ("The paper's tracker on a log",),
    "papers/zhang2011-lanes.md": ("Results",),
    "papers/zhang2011-motion.md": ("Figures 14 to 16", "Figures 17 to 19"),
    "performance.md": (),
    "prediction.md": ("On real logs",),
    "tracking.md": ("Measured",),
    "tutorial.md": ("6. A lane departure", "7. A walking target"),
    "warning.md": ("Measured",),
}
"""Page written by hand -> the headings of its measured sections; none: the whole page is measured."""


def results_in(folder: Path) -> Callable[[str], ResultFile]:
    """Return a function from a name to its result file, each read once."""

    @cache
    def result(name: str) -> ResultFile:
        return read_result_file(name, folder)

    return result


def filled_pages(docs: Path = DOCS, texts: Mapping[Path, str] | None = None) -> dict[Path, str]:
    """Return every measured page as its result files say it should be.

    Args:
        docs: Folder of the pages.
        texts: Pages that are not as in the folder, by file.
    """
    texts = texts or {}
    result = results_in(docs / "results")
    pages = {docs / page: page_from_file(result(name)) for page, name in PAPER_PAGES.items()}
    for page in MEASURED_SECTIONS:
        path = docs / page
        pages[path] = fill_markers(texts[path] if path in texts else path.read_text(encoding="utf-8"), result)
    return pages


def picture_hashes(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of each PNG in a folder, by name."""
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(folder.glob("*.png"))}


def picture_faults(docs: Path = DOCS) -> list[str]:
    """Compare the pictures of the papers' pages with the runs of their numbers: one sentence for each that differs."""
    faults = []
    for name in PAPER_PAGES.values():
        drawn = read_result_file(name, docs / "results").more["pictures"]
        here = picture_hashes(docs / "papers" / "figures" / name)
        faults += [
            f"papers/figures/{name}/{picture}: it is not of the run that gave the page's numbers"
            for picture in sorted(drawn.keys() | here.keys())
            if drawn.get(picture) != here.get(picture)
        ]
    return faults


def page_faults(docs: Path = DOCS) -> list[str]:
    """Compare the measured pages with the result files: one sentence for each line that differs or has no marker."""
    faults = []
    for path, wanted in filled_pages(docs).items():
        name, text = path.relative_to(docs).as_posix(), path.read_text(encoding="utf-8")
        for here, there in zip(text.splitlines(), wanted.splitlines(), strict=False):
            if here != there:
                faults.append(f"{name}: '{here[:160]}' should be '{there[:160]}'")
        if len(text.splitlines()) != len(wanted.splitlines()):
            faults.append(f"{name}: it has not as many lines as its result file gives")
        if name in MEASURED_SECTIONS:
            faults += [f"{name}: no marker: {each}" for each in unmarked_numbers(text, MEASURED_SECTIONS[name])]
    return faults
