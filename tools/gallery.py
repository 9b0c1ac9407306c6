"""What cwcli looks like, as pictures of itself: `python -m tools.gallery` (`--only NAME` for one of them).

Runs the commands of each picture in an empty folder, on simulated logs alone, opens the pages in Chromium, and writes
`docs/images/gallery/*.webp` and `docs/gallery.md`. Development only; needs Chromium, and Pillow of the extra `plots`.
"""

from __future__ import annotations

import argparse
import html
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cwcli.report.pdf import find_browser

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "gallery.md"
IMAGES = ROOT / "docs" / "images" / "gallery"
MOST_BYTES = 1_500_000
"""Of all pictures together."""
QUALITY = 82
"""Of WebP: letters of a report stay sharp."""
TIMEOUT_S = 600
DRAWING_MS = 60_000
"""Of a page's own time, which runs as fast as its figures are drawn."""
LEAST_WINDOW_PX = 500
"""Chromium's windows are not narrower, whatever is asked for."""
TERMINAL_COLUMNS, CELL_PX, LINE_PX, MARGIN_PX = 88, 8.43, 19, 16
SIMULATE = tuple(f"cwcli simulate {name} -o drives/{name}.mcap" for name in ("city", "cut-in", "intersection", "phone"))
RUN = ("cwcli simulate intersection -o drive.mcap", "cwcli run drive.mcap -o annotated.mcap")
REPORT = (*RUN, "cwcli report annotated.mcap -o report.html")
ROAD = (
    "cwcli simulate road -o road.mcap",
    "cwcli run road.mcap -o lane.mcap --stage lanes,observe,predict-lane,warn-lane",
    "cwcli report lane.mcap -o report.html",
)


@dataclass(frozen=True)
class Picture:
    """A picture.

    Attributes:
        name: Of its file.
        title: Its heading.
        says: What is to be seen.
        commands: From nothing to what is shown; the last one's output is the picture of a terminal.
        page: The page or the image that is shown, "" for the terminal.
        anchor: A pattern of the id in the page that is at the top, "" for its beginning.
        size: Of the window, in pixels; of a terminal the height follows from the lines.
    """

    name: str
    title: str
    says: str
    commands: tuple[str, ...]
    page: str = ""
    anchor: str = ""
    size: tuple[int, int] = (1280, 900)


PICTURES = (
    Picture(
        "report",
        "The report",
        "Its first screen: what happened, where everybody drove, and the paths of which the warning was made.",
        REPORT,
        "report.html",
    ),
    Picture(
        "warning",
        "A warning",
        "When it could be known, what was predicted then, and how near the two came.",
        REPORT,
        "report.html",
        "warning-[0-9a-f]+",
    ),
    Picture(
        "sensors",
        "The sensors",
        "Latency, bias, scale, noise and verdict of each source, and its residuals over time.",
        REPORT,
        "report.html",
        "log-1-sensors",
        size=(1280, 1400),
    ),
    Picture(
        "phone",
        "The report on a phone",
        "The same page, 390 pixels wide.",
        REPORT,
        "report.html",
        size=(390, 780),
    ),
    Picture(
        "fleet",
        "Many logs",
        "One page for a folder of drives: pooled metrics, distributions, and a row for each log.",
        (*SIMULATE, "cwcli run drives/*.mcap -d out", "cwcli report out -o report.html"),
        "report.html",
    ),
    Picture(
        "lanes",
        "Lanes",
        "Boundaries in the frames of a simulated camera, and what the observer makes of them.",
        ROAD,
        "report.html",
    ),
    Picture(
        "error",
        "A plot",
        "Errors of position, speed and heading against the truth, with their 95 % band.",
        (*RUN, "cwcli plot annotated.mcap --what error -o error.png"),
        "error.png",
    ),
    Picture(
        "info",
        "A log at the terminal",
        "What is in a log, which role each channel plays, and which commands can run.",
        (RUN[0], "cwcli info drive.mcap"),
    ),
    Picture(
        "warn",
        "Warnings at the terminal",
        "One line a warning, and what became of every evaluation and message.",
        (
            RUN[0],
            "cwcli estimate drive.mcap -o estimated.mcap",
            "cwcli predict estimated.mcap -o predicted.mcap",
            "cwcli warn predicted.mcap -o warned.mcap",
        ),
    ),
)


def text_of_page() -> str:
    """`docs/gallery.md`."""
    parts = [
        "# Gallery\n\nPictures of cwcli at work, on logs that it simulated. `python -m tools.gallery` makes them anew, "
        "by the commands below each.\n"
    ]
    for each in PICTURES:
        commands = "\n".join(f"    {command}" for command in each.commands)
        parts.append(
            f"## {each.title}\n\n{each.says}\n\n![{each.title}](images/gallery/{each.name}.webp)\n\n{commands}\n"
        )
    return "\n".join(parts)


def run_commands(commands: Sequence[str], folder: Path) -> str:
    """What the last of some commands prints on both streams.

    Raises:
        SystemExit: One failed.
    """
    shown = ""
    for command in commands:
        line = command.replace("cwcli", f"{shlex.quote(sys.executable)} -m cwcli", 1)
        done = subprocess.run(
            ["sh", "-c", line],
            cwd=folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
            timeout=TIMEOUT_S,
        )
        if done.returncode != 0:
            raise SystemExit(f"error: {command} ended with {done.returncode}:\n{done.stdout}")
        shown = done.stdout
    return shown


def terminal(command: str, printed: str) -> tuple[str, tuple[int, int]]:
    """A page that looks like a terminal, and its size."""
    lines = [f"$ {command}", *printed.rstrip("\n").split("\n")]
    columns = max(TERMINAL_COLUMNS, *map(len, lines))
    style = (
        f"margin:0;padding:{MARGIN_PX}px;background:#1b1e24;color:#dfe3ea;"
        f"font:14px/{LINE_PX}px 'DejaVu Sans Mono',monospace"
    )
    text = html.escape("\n".join(lines))
    page = f'<!doctype html><meta charset="utf-8"><body style="margin:0"><pre style="{style}">{text}</pre>'
    return page, (round(columns * CELL_PX) + 2 * MARGIN_PX, len(lines) * LINE_PX + 2 * MARGIN_PX)


def beginning_at(page: Path, anchor: str) -> Path:
    """A copy of a page without what stands before an id: a headless browser's picture begins at the top."""
    text = page.read_text(encoding="utf-8")
    found = re.search(f'id="({anchor})"', text)
    if found is None:
        raise SystemExit(f"error: {page.name} has no id like {anchor}")
    before = f"body :has(~ #{found[1]}), body :has(~ * #{found[1]})"
    copy = page.with_name("from_anchor.html")
    copy.write_text(text.replace("</head>", f"<style>{before} {{display: none}}</style></head>", 1), encoding="utf-8")
    return copy


def framed(page: Path, size: tuple[int, int]) -> Path:
    """A page with another one in a frame of the given size."""
    frame = page.with_name("frame.html")
    style = f"width: {size[0]}px; height: {size[1]}px; border: 0; display: block"
    frame.write_text(
        f'<!doctype html><body style="margin: 0"><iframe src="{page.name}" style="{style}"></iframe>', encoding="utf-8"
    )
    return frame


def photograph(page: Path, anchor: str, size: tuple[int, int], folder: Path) -> Path:
    """A picture of a page in Chromium, as PNG."""
    from PIL import Image

    if anchor:
        page = beginning_at(page, anchor)
    if size[0] < LEAST_WINDOW_PX:
        page = framed(page, size)
    target = folder / "picture.png"
    command = [
        find_browser(),
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--hide-scrollbars",
        "--no-first-run",
        "--disable-background-networking",
        f"--user-data-dir={folder / 'browser'}",
        f"--window-size={max(size[0], LEAST_WINDOW_PX)},{size[1]}",
        f"--virtual-time-budget={DRAWING_MS}",
        f"--screenshot={target}",
        page.as_uri(),
    ]
    subprocess.run(command, check=True, capture_output=True, timeout=TIMEOUT_S)
    if size[0] < LEAST_WINDOW_PX:
        with Image.open(target) as image:
            image.crop((0, 0, *size)).save(target)
    return target


def make(picture: Picture, folder: Path, browser: Path) -> Path:
    """Make one picture; its commands' files are in `folder` if they have run there before."""
    from PIL import Image

    printed = run_commands(picture.commands, folder)
    if picture.page.endswith(".png"):
        source = folder / picture.page
    elif picture.page:
        source = photograph(folder / picture.page, picture.anchor, picture.size, browser)
    else:
        page, size = terminal(picture.commands[-1], printed)
        (folder / "terminal.html").write_text(page, encoding="utf-8")
        source = photograph(folder / "terminal.html", "", size, browser)
    target = IMAGES / f"{picture.name}.webp"
    with Image.open(source) as image:
        image.convert("RGB").save(target, quality=QUALITY, method=6)
    return target


def main() -> int:
    """Exit code 1 where the pictures are too large together."""
    parser = argparse.ArgumentParser(prog="tools.gallery")
    parser.add_argument("--only", choices=[each.name for each in PICTURES], help="make this one alone")
    only = parser.parse_args().only
    IMAGES.mkdir(parents=True, exist_ok=True)
    for each in PICTURES:
        if only in {None, each.name}:
            with tempfile.TemporaryDirectory() as scratch, tempfile.TemporaryDirectory() as browser:
                (Path(scratch) / "drives").mkdir()
                made = make(each, Path(scratch), Path(browser))
            print(f"{made.relative_to(ROOT)}: {made.stat().st_size / 1e3:.0f} kB")
    for path in IMAGES.iterdir():
        if path.stem not in {each.name for each in PICTURES}:
            path.unlink()
    PAGE.write_text(text_of_page(), encoding="utf-8")
    total = sum(path.stat().st_size for path in IMAGES.iterdir())
    print(f"{total / 1e3:.0f} kB in all")
    return int(total > MOST_BYTES)


if __name__ == "__main__":
    sys.exit(main())
