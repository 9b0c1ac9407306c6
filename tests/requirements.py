"""What tests need beyond the extra `[test]`: the one table by which a test is collected or left out."""

from __future__ import annotations

import shutil
from importlib.util import find_spec
from pathlib import Path

FOLDER = Path(__file__).parent
NPM_FOLDER = FOLDER / "peers" / "typescript" / "node_modules"
PROGRAMS = {"node", "valgrind"}
NEEDED: dict[str, tuple[str, ...]] = {
    "budget/test_planted.py": ("valgrind",),
    "fuzz/test_uninitialised.py": ("valgrind",),
    "peers/test_cam.py": ("pycrate_asn1dir",),
    "peers/test_codec.py": ("pycrate_asn1dir",),
    "peers/test_denm.py": ("pycrate_asn1dir",),
    "peers/test_etsi_cam.py": ("pycrate_asn1dir",),
    "peers/test_export_gdal.py": ("pyogrio",),
    "peers/test_fleet_ray.py": ("ray",),
    "peers/test_fleet_readers.py": ("duckdb", "pandas", "polars"),
    "peers/test_library_pandas.py": ("pandas",),
    "peers/test_layout.py": ("foxglove",),
    "peers/test_osi_export.py": ("osi_utilities",),
    "peers/test_ros_tools.py": ("evo",),
    "peers/test_s3.py": ("moto", "s3fs"),
    "peers/test_sumo_scenes.py": ("sumo",),
    "peers/test_typescript_reader.py": ("node", "@mcap/core"),
    "peers/test_viewers.py": ("rerun",),
    "peers/test_without_cwcli.py": ("evo", "pandas"),
    "test_docs_site.py": ("mkdocs",),
    "unit/logs_write/test_packaging.py": ("Cython",),
    "unit/logs_write/test_schemas.py": ("grpc_tools",),
}
"""File below `tests/` -> the modules, programs and npm packages (they begin with `@`) that it needs."""

LONG_FOLDERS = ("budget", "cli", "fuzz", "papers", "recipes", "scenarios")
"""Folders whose tests run commands, whole drives or copies of the checkout, and take many minutes together."""
QUICK = (
    "budget/test_budget.py",
    "cli/test_console.py",
    "cli/test_cookbook.py",
    "cli/test_info.py",
    "cli/test_main.py",
    "cli/test_options.py",
    "cli/test_progress.py",
    "cli/test_readme.py",
    "cli/test_reference.py",
    "cli/test_tables.py",
    "cli/test_text.py",
)
"""Files in these folders that a default run keeps: the first contact with the command line."""


def is_long(path: Path) -> bool:
    """Whether the tests of a file are long, all of them."""
    if not path.is_relative_to(FOLDER):
        return False
    inner = path.relative_to(FOLDER)
    return inner.parts[0] in LONG_FOLDERS and inner.as_posix() not in QUICK


def is_available(name: str) -> bool:
    """Whether a module, a program or an npm package is installed."""
    if name.startswith("@"):
        return (NPM_FOLDER / name).is_dir()
    if name in PROGRAMS:
        return shutil.which(name) is not None
    return find_spec(name) is not None


def needs_more(path: Path) -> bool:
    """Whether a test file needs more than `[test]`, installed or not."""
    return path.is_relative_to(FOLDER) and path.relative_to(FOLDER).as_posix() in NEEDED


def find_missing(path: Path) -> tuple[str, ...]:
    """What a test file needs that is not installed; nothing for a file that needs no more than `[test]`."""
    if not path.is_relative_to(FOLDER):
        return ()
    return tuple(name for name in NEEDED.get(path.relative_to(FOLDER).as_posix(), ()) if not is_available(name))


def describe_left_out() -> str | None:
    """One line about the files that are left out and what they need; None if everything is installed."""
    missing = {name: find_missing(FOLDER / name) for name in NEEDED}
    left_out = {name: needs for name, needs in missing.items() if needs}
    if not left_out:
        return None
    needs = ", ".join(sorted({each for several in left_out.values() for each in several}))
    return f"{len(left_out)} test files are not collected, as these are not installed: {needs} (tests/requirements.py)"
