"""What the wheel holds: every package, the schemas and the sample logs."""

from __future__ import annotations

import tomllib
from pathlib import Path

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
