"""The house stays livable: short files, no circle of imports, a room for stages that holds little else."""

from __future__ import annotations

from pathlib import Path

import grimp
import pytest

PACKAGE = Path(__file__).parents[2] / "cwcli"
MOST_LINES = 400
MOST_STAGE_FILES, MOST_STAGE_LINES = 25, 4000


def n_lines(path: Path) -> int:
    return len(path.read_text(encoding="utf-8").splitlines())


@pytest.mark.parametrize("pattern", ["*.py", "*.pyx", "*.pxd", "*.pyi"])
def test_every_file_can_be_read_in_one_sitting(pattern: str) -> None:
    lengths = {str(path.relative_to(PACKAGE)): n_lines(path) for path in PACKAGE.rglob(pattern)}
    assert lengths
    assert {name: length for name, length in lengths.items() if length > MOST_LINES} == {}


def test_the_room_of_stages_holds_stages() -> None:
    files = list((PACKAGE / "stages").rglob("*.py"))
    assert 0 < len(files) <= MOST_STAGE_FILES
    assert sum(map(n_lines, files)) <= MOST_STAGE_LINES


def circles(graph: grimp.ImportGraph) -> list[set[str]]:
    """Modules that import one another, round about: the strong components of more than one (Tarjan)."""
    order: dict[str, int] = {}
    lowest: dict[str, int] = {}
    stack: list[str] = []
    found: list[set[str]] = []

    def visit(module: str) -> None:
        order[module] = lowest[module] = len(order)
        stack.append(module)
        for imported in graph.find_modules_directly_imported_by(module):
            if imported not in order:
                visit(imported)
            if imported in stack:
                lowest[module] = min(lowest[module], lowest[imported])
        if lowest[module] == order[module]:
            component = set(stack[stack.index(module) :])
            del stack[stack.index(module) :]
            if len(component) > 1:
                found.append(component)

    for module in sorted(graph.modules):
        if module not in order:
            visit(module)
    return found


def test_the_search_finds_a_circle() -> None:
    graph = grimp.ImportGraph()
    for importer, imported in (("a", "b"), ("b", "c"), ("c", "b"), ("c", "d")):
        graph.add_import(importer=importer, imported=imported)
    assert circles(graph) == [{"b", "c"}]


def test_no_module_imports_itself_round_about() -> None:
    assert circles(grimp.build_graph("cwcli", cache_dir=None)) == []
