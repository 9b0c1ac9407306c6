"""Every column of a summary has a name, so that the JSON has no empty key."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from cwcli.cli.main import run_command_line

SAMPLES = sorted((Path(__file__).parents[3] / "sample_logs").glob("*.mcap"))


def keys(value: Any) -> set[str]:
    if isinstance(value, dict):
        return set(value).union(*(keys(each) for each in value.values()))
    return set().union(*(keys(each) for each in value)) if isinstance(value, list) else set()


@pytest.mark.parametrize("log", SAMPLES, ids=lambda path: path.stem)
def test_the_json_has_no_empty_key(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["run", str(log), "--json", "--quiet"]) == 0
    found = keys(json.loads(capsys.readouterr().out))
    assert "nis_per_dof" in found
    assert "" not in found
