"""Declared, documented and imported are the same packages: at run time, in each extra, and for the tests."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PAGE = (ROOT / "docs" / "dependencies.md").read_text(encoding="utf-8")
NOT_INSTALLED = {
    "evo": "evo",
    "foxglove": "foxglove-sdk",
    "grpc_tools": "grpcio-tools",
    "osi_utilities": "asam-osi-utilities",
    "pycrate_asn1c": "pycrate",
    "pycrate_asn1dir": "pycrate",
    "rerun": "rerun-sdk",
    "sumo": "eclipse-sumo",
}
"""Modules of the peers, which may not be installed -> the package, where its name is another."""
DEVELOPMENT = ("test", "peers", "check")
"""The extras for those who change cwcli; `dev` is all of them."""
RUN = {
    "build": ".ci/run: -m build",
    "cython": 'tests/fuzz/sanitized.py: "cython"',
    "evo": "tests/peers/test_ros_tools.py: evo_ape",
    "import-linter": ".ci/run: lint-imports",
    "mkdocs-material": ".ci/run: mkdocs",
    "moto": "tests/peers/test_s3.py: moto.server",
    "mypy": ".ci/run: mypy",
    "pytest-xdist": "README.md: pytest -n auto",
    "ruff": ".ci/run: ruff",
    "s3fs": "tests/peers/test_s3.py: s3://bucket",
}
"""What is run, or found by its name, and not imported -> where: what stands there."""


def package(requirement: str) -> str:
    """`moto[s3,server]>=5` -> `moto`."""
    return re.split(r"[\[<>=!~; ]", requirement, maxsplit=1)[0].lower()


def versions_with_hashes(name: str) -> dict[str, tuple[int, ...]]:
    """Package -> version, of a file of `.ci`; each has hashes of its files."""
    found = {}
    for part in re.split(r"\n(?=\S)", (ROOT / ".ci" / name).read_text(encoding="utf-8").strip()):
        head, *hashes = part.split(" \\\n    --hash=sha256:")
        assert hashes and all(re.fullmatch(r"[0-9a-f]{64}", each) for each in hashes), head
        found[package(head)] = numbers_of_version(head.partition("==")[2])
    return found


def numbers_of_version(text: str) -> tuple[int, ...]:
    """`6.0` and `6` are the same version."""
    return tuple(map(int, re.sub(r"(\.0)+$", "", text).split(".")))


def declared(extra: str) -> set[str]:
    return {*map(package, PROJECT["project"]["optional-dependencies"][extra])}


RUNTIME = {*map(package, PROJECT["project"]["dependencies"])}
EXTRAS = {
    extra: declared(extra)
    for extra in PROJECT["project"]["optional-dependencies"]
    if extra not in (*DEVELOPMENT, "dev")
}


def modules(path: Path) -> Iterator[str]:
    """The modules that a file imports, by name or by `import_module`."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            yield node.module
        elif isinstance(node, ast.Call) and "import" in getattr(node.func, "attr", getattr(node.func, "id", "")):
            for argument in node.args[:1]:
                part = argument.values[0] if isinstance(argument, ast.JoinedStr) else argument
                if isinstance(part, ast.Constant) and isinstance(part.value, str):
                    yield part.value


def imported(*folders: str, without: tuple[str, ...] = ()) -> set[str]:
    """The packages that the files below some folders import, our own and Python's aside."""
    packages = {name: {*map(str.lower, found)} for name, found in packages_distributions().items()}
    files = [path for folder in folders for path in (ROOT / folder).rglob("*.py")]
    files = [path for path in files if not any(path.is_relative_to(ROOT / folder) for folder in without)]
    own = {name for path in files for name in (path.stem, path.parent.name)}
    ours = {"cwcli", "tests", "tools", *own} - {"can"}  # our file, and python-can's package
    names = {name.partition(".")[0] for path in files for name in modules(path)} - ours - {*sys.stdlib_module_names}
    assert names
    return {one for name in names for one in packages.get(name, {NOT_INSTALLED.get(name, name)})}


def listed(heading: str, column: int) -> list[list[str]]:
    """The cells of a section's table up to a column."""
    section = re.split(rf"^## {re.escape(heading)}.*$", PAGE, flags=re.MULTILINE)[1].partition("\n## ")[0]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in section.splitlines() if line[:1] == "|"]
    return [row[: column + 1] for row in rows[2:]]


def test_what_is_imported_is_declared_and_what_is_declared_is_imported() -> None:
    needed = RUNTIME.union(*(packages for extra, packages in EXTRAS.items() if extra != "bench"))
    found = imported("cwcli")
    assert found == needed - {*RUN}


def test_the_page_lists_what_is_declared() -> None:
    assert sorted(name for (name,) in listed("At run time", 0)) == sorted(RUNTIME)
    extras: dict[str, set[str]] = {}
    for extra, name in listed("Extras", 1):
        extras.setdefault(extra.strip("`").removeprefix("cwcli-drive[").rstrip("]") or [*extras][-1], set()).add(name)
    assert extras == EXTRAS
    shared = set().union(*(EXTRAS[extra] for extra in ("bags", "plots", "report", "can", "ray", "remote")))
    assert shared <= declared("dev")
    for extra in DEVELOPMENT:
        assert {name for (name,) in listed(f"To develop: `[{extra}]`", 0)} == declared(extra) - shared
    for name in PROJECT["build-system"]["requires"]:
        assert re.search(rf"\b{package(name)}\b", listed_text("To build"), re.IGNORECASE)


def listed_text(heading: str) -> str:
    return PAGE.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]


def test_what_tests_import_is_declared_for_them_and_nothing_else() -> None:
    dev = declared("dev")
    assert dev == set().union(*map(declared, DEVELOPMENT))
    found = imported("tests", "tools")
    assert found - RUNTIME <= dev | EXTRAS["bench"]
    assert dev - found - {*RUN} - imported("cwcli") == set()


def test_a_default_run_imports_nothing_but_what_the_extra_for_tests_installs() -> None:
    found = imported("tests", without=("tests/peers", "tests/studies", "tests/bench"))
    assert found - RUNTIME <= declared("test")


@pytest.mark.parametrize("name", RUN)
def test_what_is_not_imported_is_run_or_found_by_name(name: str) -> None:
    file, _, words = RUN[name].partition(": ")
    assert words in (ROOT / file).read_text(encoding="utf-8")
    assert name in declared("dev")


def test_no_module_asks_protobuf_for_what_only_new_versions_have() -> None:
    """`FieldDescriptor.is_repeated` came with protobuf 6.31; `is_repeated_field` works with all that are allowed."""
    sources = [path for path in (ROOT / "cwcli").rglob("*.py") if ".is_repeated" in path.read_text()]
    assert sources == []


def test_lowest_and_newest_tested_versions_have_hashes() -> None:
    lowest, newest = versions_with_hashes("lowest.txt"), versions_with_hashes("newest.txt")
    needed = (each.partition(">=") for each in PROJECT["project"]["dependencies"])
    assert lowest == {package(name): numbers_of_version(version) for name, _, version in needed}
    assert newest.keys() == lowest.keys()
    assert all(newest[name] >= lowest[name] for name in lowest)
