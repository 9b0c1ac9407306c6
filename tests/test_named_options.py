"""Every command and option that a message, a docstring or a page names exists."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest
import typer.main

from cwcli.cli.app import app, load_command
from cwcli.cli.commands import HELP_LINE_BY_COMMAND

ROOT = Path(__file__).parents[1]
PAGES = sorted([*(ROOT / "docs").rglob("*.md"), *ROOT.glob("*.md")])
SOURCES = sorted((ROOT / "cwcli").rglob("*.py"))
HOLE = "\0"
"""What stands for a value that an f-string fills in."""
FLAG = re.compile(rf"(?<![\w-])--[a-z][\w{HOLE}-]*")
SHORT_FLAG = re.compile(r"(?<!\S)-[A-Za-z](?!\S)")
CALL = re.compile(r"(?<![\w./-])cwcli +([a-z][a-z0-9-]*)(?![\w./=])([^`|;&\n]*)")
"""A command line: the command, and what follows it up to the end of the line, of the code or of the pipe's stage."""
COMMAND_LINE = re.compile(r"(?:^|[|;&$(] ?|run: |- )\s*cwcli +([a-z][a-z0-9-]*)(?![\w./=])", re.MULTILINE)
CODE = re.compile(r"`([^`\n]+)`|^ {4,}(\S[^\n]*)$|^```(?:sh|bash|yaml)\n(.*?)^```", re.MULTILINE | re.DOTALL)
SCRIPT = re.compile(r"\b((?:tests|tools)(?:[./]\w+)+)")
"""A script of the checkout: its path, or its module."""
OF_OTHER_TOOLS = {
    *("--prefix", "--tool", "--cache-sim", "--no-compile"),  # npm, valgrind, pip
    "--head",  # ray
    *("--long", "--cpu", "--rest"),  # pytest with tests/conftest.py
    *("--headless", "--disable-gpu", "--no-sandbox", "--no-first-run", "--disable-background-networking"),  # Chromium
    *("--no-pdf-header-footer", "--user-data-dir", "--virtual-time-budget", "--print-to-pdf"),  # Chromium
    "--host-resolver-rules",  # Chromium
}


class Place(NamedTuple):
    """A text with the file and line where it begins."""

    path: Path
    line: int
    text: str

    def __str__(self) -> str:
        return f"{self.path.relative_to(ROOT) if self.path.is_relative_to(ROOT) else self.path}:{self.line}"


@cache
def options_of(command: str) -> frozenset[str]:
    """The options of a command, long and short, or those of `cwcli` itself."""
    found = typer.main.get_command(app) if command == "" else load_command(command)
    with found.make_context(command, [], resilient_parsing=True, help_option_names=["-h", "--help"]) as context:
        params = found.get_params(context)
    return frozenset(name for param in params for name in (*param.opts, *param.secondary_opts) if name[0] == "-")


@cache
def all_options() -> frozenset[str]:
    return frozenset().union(*map(options_of, ("", *HELP_LINE_BY_COMMAND)))


@cache
def script_text(name: str) -> str:
    """The source of a script of the checkout, named by its path or as a module; "" if there is none."""
    stem = name.removesuffix(".py").replace(".", "/")
    paths = [ROOT / f"{stem}.py", ROOT / stem / "__main__.py"]
    return "".join(path.read_text(encoding="utf-8") for path in paths if path.is_file())


@cache
def defined_on(path: Path) -> str:
    """What may define an option that a page names: the page's own recipes, and the scripts that it names."""
    text = path.read_text(encoding="utf-8")
    return text + "".join(map(script_text, SCRIPT.findall(text))) if path.suffix == ".md" else ""


def problems(place: Place, *, is_code: bool) -> Iterator[str]:
    """What a text names that is not there.

    Args:
        is_code: All of the text is code. In prose "cwcli warns" is no command.
    """
    text = re.sub(r"\\\n\s*", " ", place.text)
    elsewhere = defined_on(place.path)
    if is_code:
        for command in COMMAND_LINE.findall(text):
            if command not in HELP_LINE_BY_COMMAND and f'"{command}": ' not in elsewhere:
                yield f"{place}: there is no command `cwcli {command}`"
    for command, arguments in CALL.findall(text):
        if command in HELP_LINE_BY_COMMAND:
            for flag in (*FLAG.findall(arguments), *SHORT_FLAG.findall(arguments)):
                if is_whole(flag) and flag not in options_of(command):
                    yield f"{place}: `cwcli {command}` has no option {flag}"
    for flag in filter(is_whole, FLAG.findall(text)):
        if flag not in all_options() | OF_OTHER_TOOLS and f'"{flag}"' not in elsewhere:
            yield f"{place}: no command has the option {flag}"


def is_whole(flag: str) -> bool:
    """Whether it is an option's whole name, and no beginning or pattern of names."""
    return HOLE not in flag and not flag.endswith("-")


def parts_of(place: Place) -> Iterator[tuple[Place, bool]]:
    """A text as a whole, and the code in it."""
    yield place, False
    for code in CODE.finditer(place.text):
        line = place.line + place.text[: code.start()].count("\n")
        yield Place(place.path, line, next(group for group in code.groups() if group)), True


def literals(path: Path) -> Iterator[Place]:
    """The string literals of a module, docstrings too."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.JoinedStr):
            parts = (str(part.value) if isinstance(part, ast.Constant) else HOLE for part in node.values)
            yield Place(path, node.lineno, "".join(parts))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield Place(path, node.lineno, node.value)


def found_in(path: Path) -> list[str]:
    """What a module or a page names that is not there."""
    whole = literals(path) if path.suffix == ".py" else [Place(path, 1, path.read_text(encoding="utf-8"))]
    parts = (part for place in whole if "--" in place.text or "cwcli" in place.text for part in parts_of(place))
    return list(dict.fromkeys(problem for place, is_code in parts for problem in problems(place, is_code=is_code)))


@pytest.mark.parametrize(
    ("text", "n_problems"),
    [
        ("`cwcli info LOG --columns TOPIC` lists them", 2),  # no option of info, nor of any other command
        ("`cwcli info LOG --horizon 2`", 1),  # an option of another command
        ("`cwcli list drive.mcap`", 1),
        ("    cwcli info drive.mcap\n    cwcli estimte drive.mcap | cwcli predct - -o x.mcap\n", 2),
        ("a flag `--columns` on its own", 1),
        ("cwcli info -x drive.mcap", 1),
        ("cwcli warns of collisions, cwcli 0.1.0 and `cwcli.errors` as `cwcli info --doctor -q` says", 0),
        ("`cwcli run --estimate-model song2016 --stage lanes,observe`, `--no-tune`", 0),
    ],
)
def test_what_is_not_there_is_found(tmp_path: Path, text: str, n_problems: int) -> None:
    page, module = tmp_path / "page.md", tmp_path / "module.py"
    page.write_text(text)
    module.write_text(f"HINT = f{text + '{1 + 1}'!r}\n")
    assert len(found_in(page)) == len(found_in(module)) == n_problems


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_what_a_page_names_exists(path: Path) -> None:
    assert found_in(path) == []


def test_what_messages_and_docstrings_name_exists() -> None:
    assert [problem for path in SOURCES for problem in found_in(path)] == []
