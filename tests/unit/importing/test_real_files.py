"""Files as 60 programs write them become the drive of `real_drive`, or are refused with their question."""

from __future__ import annotations

from pathlib import Path

import pytest

from cwcli.errors import CwcliError
from cwcli.importing.run import plan_import, write_import
from cwcli.importing.tables import Answers
from tests.unit.importing.real_drive import measure_errors
from tests.unit.importing.real_files import REAL_FILES
from tests.unit.importing.real_tables import BOUNDS, REAL_TABLES

CASES = REAL_TABLES | REAL_FILES


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if not case.asks])
def test_real_file_becomes_the_drive(name: str, tmp_path: Path) -> None:
    """Every quantity that the file holds is made, and is right."""
    case = CASES[name]
    write_import(plan_import([str(path) for path in case.make(tmp_path)], Answers()), str(tmp_path / "log.mcap"))
    errors = measure_errors(tmp_path / "log.mcap", case.start)
    assert set(errors) == set(case.holds.split())
    bounds = BOUNDS | case.bounds
    assert {each: error for each, error in errors.items() if not error <= bounds[each]} == {}


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case.asks])
def test_real_file_is_refused_with_its_question(name: str, tmp_path: Path) -> None:
    case = CASES[name]
    with pytest.raises(CwcliError, match=case.asks) as found:
        plan_import([str(path) for path in case.make(tmp_path)], Answers())
    assert found.value.hint
