"""The gallery: its page, its pictures and the list of the tool that makes them are the same."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest
from PIL import Image

from cwcli.cli.app import load_command
from cwcli.cli.commands import HELP_LINE_BY_COMMAND
from tests.cli.browser import browser
from tools import gallery
from tools.gallery import PICTURES, Picture


def test_the_page_is_what_the_tool_writes() -> None:
    assert gallery.PAGE.read_text(encoding="utf-8") == gallery.text_of_page()


def test_the_pictures_are_those_of_the_list_and_small() -> None:
    assert sorted(path.name for path in gallery.IMAGES.iterdir()) == sorted(f"{each.name}.webp" for each in PICTURES)
    assert sum(path.stat().st_size for path in gallery.IMAGES.iterdir()) < gallery.MOST_BYTES


@pytest.mark.parametrize("picture", PICTURES, ids=lambda each: each.name)
def test_a_picture_has_the_size_of_its_window_and_something_in_it(picture: Picture) -> None:
    with Image.open(gallery.IMAGES / f"{picture.name}.webp") as image:
        if picture.page.endswith(".html"):
            assert image.size == picture.size
        colours = image.convert("RGB").getcolors(1 << 24)
        assert colours is not None and len(colours) > 100
        assert max(count for count, _ in colours) < 0.98 * image.width * image.height  # not an empty page


@pytest.mark.parametrize("width_px", [390, 700])
def test_a_page_is_as_wide_as_its_picture(width_px: int, tmp_path: Path) -> None:
    """The red bar stands at the right edge of the window that the page's script finds, as its figures do."""
    browser()
    style = "position: absolute; left: ${innerWidth - 10}px; top: 0; width: 10px; height: 9em; background: #f00"
    script = f"bar.style = `{style}`"
    (tmp_path / "page.html").write_text(f'<body><div id="bar"></div><script>{script}</script></body>', encoding="utf-8")
    with Image.open(gallery.photograph(tmp_path / "page.html", "", (width_px, 200), tmp_path)) as image:
        assert image.size == (width_px, 200)
        pixels = image.convert("RGB")
    row = [pixels.getpixel((x, 50)) for x in range(width_px)]
    assert row == [(255, 255, 255)] * (width_px - 10) + [(255, 0, 0)] * 10


@pytest.mark.parametrize("command", sorted({each for picture in PICTURES for each in picture.commands}))
def test_its_commands_and_their_options_are_there(command: str) -> None:
    program, name, *given = shlex.split(command)
    assert program == "cwcli" and name in HELP_LINE_BY_COMMAND
    known = {option for parameter in load_command(name).params for option in parameter.opts}
    assert {each for each in given if each.startswith("-")} <= known


def test_no_recorded_drive_is_shown() -> None:
    """Every log begins with `cwcli simulate` in the same picture."""
    for picture in PICTURES:
        made: set[str] = set()
        for command in picture.commands:
            words = shlex.split(command)
            read = [word for word in words[2:] if word.endswith(".mcap") and words[words.index(word) - 1] != "-o"]
            assert words[1] == "simulate" or {*read} <= made | {"drives/*.mcap"}
            made |= {word for word in words if words[words.index(word) - 1] == "-o"}
