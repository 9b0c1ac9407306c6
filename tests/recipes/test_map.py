"""The map of the house: every room has its place in the import contracts, a new one too."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

from tests.recipes.house import LINT, ROOT, House

CONTRACTS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]["contracts"]


def test_every_room_has_one_place_among_the_layers() -> None:
    (layers,) = (contract for contract in CONTRACTS if contract["type"] == "layers")
    placed = [name for line in layers["layers"] for name in line.split(" | ")]
    folder = ROOT / "cwcli"
    rooms = [path.name for path in folder.iterdir() if (path / "__init__.py").is_file()]
    files = [path.stem for path in folder.glob("*.py") if not path.stem.startswith("__")]
    assert sorted(placed) == sorted([*rooms, *files])
    assert layers["exhaustive"]


def test_every_other_contract_holds_for_all_rooms_or_says_which_it_is_about() -> None:
    narrow = {contract["id"] for contract in CONTRACTS if contract.get("source_modules", ["cwcli"]) != ["cwcli"]}
    assert narrow == {"cli", "ground"}


def test_a_room_without_a_place_or_with_a_library_of_another_room_breaks_a_contract(tmp_path: Path) -> None:
    house = House.copied_to(tmp_path)
    (tmp_path / "cwcli" / "parlour").mkdir()
    (tmp_path / "cwcli" / "parlour" / "__init__.py").write_text('"""A new room."""\n\nimport typer\n')
    linted = subprocess.run(
        [sys.executable, *LINT], check=False, cwd=house.folder, capture_output=True, text=True, env=house.environment()
    )
    assert linted.returncode == 1, linted.stderr
    broken = [line.partition(" BROKEN")[0] for line in linted.stdout.splitlines() if " BROKEN" in line]
    assert broken == [contract["name"] for contract in CONTRACTS if contract["id"] in ("layers", "terminal")]
    assert "parlour" in linted.stdout
