"""The map of the house in CONTRIBUTING.md, from the rooms' docstrings and the import contracts of pyproject.toml."""

from __future__ import annotations

import ast
import tomllib
from collections.abc import Iterator
from pathlib import Path

from cwcli.cli.markdown import format_code, format_markdown_table, replace_marked_block


def guide_page(text: str, root: Path) -> str:
    """CONTRIBUTING.md with its map.

    Args:
        text: The page.
        root: Of the checkout.
    """
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
    layers, *others = project["tool"]["importlinter"]["contracts"]
    rows = [
        (str(level), format_code(path.relative_to(root).as_posix() + "/" * path.is_dir()), _words(path))
        for level, names in enumerate(layers["layers"], start=1)
        for name in names.split(" | ")
        for path in _rooms(root / "cwcli" / name)
    ]
    rules = "\n".join(f"- {contract['name']}" for contract in others)
    return replace_marked_block(
        text, "map", f"{format_markdown_table(('level', 'room', 'what it is'), rows)}\n\nBesides:\n\n{rules}"
    )


def _rooms(path: Path) -> Iterator[Path]:
    """A room and those in it, or the file of that name."""
    if not path.is_dir():
        yield path.with_suffix(".py")
        return
    yield path
    for inner in sorted(path.iterdir()):
        if (inner / "__init__.py").is_file():
            yield from _rooms(inner)


def _words(path: Path) -> str:
    """The first line of what a room says of itself."""
    file = path / "__init__.py" if path.is_dir() else path
    return (ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or "").partition("\n")[0].replace("|", "\\|")
