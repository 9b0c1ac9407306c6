"""What the tool that times the set-up measures: sizes of packages by hand, and a path without a compiler."""

from __future__ import annotations

from pathlib import Path

import pytest

from tools.wheel import installed, path_without_compiler, requirements, table_of_sizes


def package(site: Path, name: str, requires: tuple[str, ...], n_bytes: int) -> None:
    folder = site / name
    folder.mkdir(parents=True)
    (folder / "data.bin").write_bytes(bytes(n_bytes))
    told = site / f"{name}-1.0.dist-info"
    told.mkdir()
    lines = ["Metadata-Version: 2.1", f"Name: {name}", "Version: 1.0", *(f"Requires-Dist: {each}" for each in requires)]
    (told / "METADATA").write_text("\n".join(lines) + "\n")
    (told / "RECORD").write_text(f"{name}/data.bin,,{n_bytes}\n")


def test_the_table_tells_sizes_and_who_needs_what(tmp_path: Path) -> None:
    """By hand: 5 + 3 MB, 0.5 MB below the bound, and 8.5 - 5 without what is given; pip is in every environment."""
    site = tmp_path / "lib" / "python3.11" / "site-packages"
    package(site, "pyarrow", (), 5_000_000)
    package(site, "cwcli", ("pyarrow>=16", 'tiny_one; extra == "x"'), 3_000_000)
    package(site, "tiny_one", (), 500_000)
    package(site, "pip", (), 9_000_000)
    assert table_of_sizes(installed(tmp_path)).splitlines()[2:] == [
        "| pyarrow | 5 | cwcli |",
        "| cwcli | 3 |  |",
        "| 1 below 1 MB | 0 |  |",
        "| all | 8 |  |",
        "| all but pyarrow and opencv-python-headless | 4 |  |",
    ]


def test_there_is_no_compiler_on_the_path_of_the_wheel(tmp_path: Path) -> None:
    folder = Path(path_without_compiler(tmp_path / "programs"))
    assert [each.name for each in folder.iterdir()] == ["python3"]


@pytest.mark.parametrize(("to_build", "name"), [(False, "pyarrow>="), (True, "Cython>=")])
def test_what_is_downloaded_is_what_the_project_asks_for(to_build: bool, name: str) -> None:
    assert any(each.startswith(name) for each in requirements(to_build=to_build))
