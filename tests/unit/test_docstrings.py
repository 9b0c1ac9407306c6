"""What docstrings list as arguments and attributes exists: a renamed parameter takes its explanation along."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2] / "cwcli"
LIST_HEADING = re.compile(r"( *)(?:Args|Attributes):")


def listed_names(docstring: str) -> Iterator[str]:
    """The names before the colons in the lists of a docstring: `x, y:` gives two."""
    indent = None
    for line in docstring.split("\n"):
        depth = len(line) - len(line.lstrip())
        heading = LIST_HEADING.fullmatch(line)
        if heading:
            indent = len(heading[1]) + 4
        elif indent is not None and line.strip() and depth < indent:
            indent = None
        elif depth == indent and ":" in line:
            entry = re.sub(r"\(.*?\)", "", line.split(":")[0])
            yield from (name.strip().lstrip("*") for name in entry.replace(" and ", ",").split(","))


def assigned_names(owner: ast.ClassDef) -> set[str]:
    """Everything that a class's body declares or assigns, and the parameters of its methods."""
    names = set()
    for node in ast.walk(owner):
        if isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Store):
            names.add(node.id if isinstance(node, ast.Name) else node.attr)
        elif isinstance(node, ast.FunctionDef):
            names.add(node.name)
        elif isinstance(node, ast.arg):
            names.add(node.arg)
    return names


def known_names(node: ast.FunctionDef | ast.ClassDef, classes: dict[str, ast.ClassDef]) -> set[str]:
    """What a docstring may list: the parameters of a function; the attributes of a class and of its bases here."""
    if isinstance(node, ast.FunctionDef):
        return {each.arg for each in ast.walk(node.args) if isinstance(each, ast.arg)}
    names = assigned_names(node)
    for base in node.bases:
        if isinstance(base, ast.Name) and base.id in classes:
            names |= known_names(classes[base.id], classes)
    return names


def stale_names(source: str) -> list[str]:
    tree = ast.parse(source)
    classes = {node.name: node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)}
    return [
        f"line {node.lineno}, {node.name}: {name}"
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef | ast.ClassDef)
        for name in listed_names(ast.get_docstring(node) or "")
        if name not in known_names(node, classes)
    ]


@pytest.mark.parametrize("room", sorted(each.name for each in PACKAGE.iterdir() if each.suffix in ("", ".py")))
def test_listed_arguments_and_attributes_exist(room: str) -> None:
    path = PACKAGE / room
    files = [path] if path.is_file() else sorted(path.rglob("*.py"))
    stale = {str(file.relative_to(PACKAGE)): stale_names(file.read_text(encoding="utf-8")) for file in files}
    assert {file: names for file, names in stale.items() if names} == {}


def test_a_stale_name_is_found() -> None:
    source = '''
def f(length_m: float) -> float:
    """Do it.

    Args:
        way_m: The old name.
        length_m: The new one.
    """


class Window(Base):
    """A window.

    Attributes:
        low, high: Its ends.
        open (m): An old attribute.
    """

    low: float
    high: float
'''
    assert stale_names(source) == ["line 2, f: way_m", "line 11, Window: open"]
