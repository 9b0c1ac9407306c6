"""What the wheel holds: every package, the schemas and the sample logs."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import cwcli
from cwcli import kernels
from tools.release import versions

ROOT = Path(__file__).parents[3]


def setuptools_table() -> dict[str, object]:
    table: dict[str, object] = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    return table


def test_every_package_is_listed() -> None:
    folders = {path.parent.relative_to(ROOT) for path in (ROOT / "cwcli").rglob("*.py")}
    found = {".".join(folder.parts) for folder in folders} | {"cwcli.schemas", "cwcli.sample_logs"}
    assert setuptools_table()["packages"] == sorted(found)


def test_folders_outside_the_package_are_packages() -> None:
    directories = setuptools_table()["package-dir"]
    assert directories == {"cwcli": "cwcli", "cwcli.sample_logs": "sample_logs", "cwcli.schemas": "schemas"}
    assert all((ROOT / folder / "__init__.py").is_file() for folder in ("schemas", "sample_logs"))


def test_every_file_kind_of_the_data_folders_is_shipped() -> None:
    package_data = setuptools_table()["package-data"]
    assert isinstance(package_data, dict)
    for package, folder in (("cwcli.schemas", ROOT / "schemas"), ("cwcli.sample_logs", ROOT / "sample_logs")):
        shipped = {path for pattern in package_data[package] for path in folder.glob(pattern)}
        present = {path for path in folder.rglob("*") if path.is_file() and path.suffix not in (".py", ".pyc")}
        assert present == shipped


def test_kernels_keep_to_the_limited_api() -> None:
    """One wheel for this version of Python and all later ones; Python would prefer a build for one version alone."""
    built = [path.name for path in Path(str(kernels.__path__[0])).glob("*.so")]
    names = {"_memoryviews", *(path.stem for path in (ROOT / "cwcli/kernels").glob("*.pyx"))}
    assert sorted(built) == sorted(f"{name}.abi3.so" for name in names)


def test_kernels_share_the_code_of_memoryviews() -> None:
    """Each would compile it again: two thirds of the time of a compilation and half of the wheel."""
    sources = [path for path in (ROOT / "cwcli/kernels").glob("*.pyx") if re.search(r"\[::?1?\]", path.read_text())]
    assert len(sources) > 10
    built = [path.with_suffix(".abi3.so") for path in sources]
    assert [path.name for path in built if b"_memoryviews" not in path.read_bytes()] == []


def test_a_missing_compiler_is_said_in_one_line(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "setup.py", "-q", "build", "--build-base", str(tmp_path)],
        cwd=ROOT,
        env={**os.environ, "CC": "no-such-compiler"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("error")]
    assert "needs a C compiler, and `no-such-compiler` is not there" in line
    assert not list(tmp_path.iterdir())


def test_the_version_is_the_same_everywhere() -> None:
    assert set(versions(ROOT).values()) == {cwcli.__version__}
