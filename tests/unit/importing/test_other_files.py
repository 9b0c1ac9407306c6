"""Files of programs that `test_forty_files` does not have: each becomes the drive, or is refused with its question."""

from __future__ import annotations

from pathlib import Path

import pytest

from cwcli.errors import CwcliError
from cwcli.importing.run import plan_import, write_import
from cwcli.importing.tables import Answers
from tests.unit.importing.other_apps import APP_CASES
from tests.unit.importing.other_drive import errors_by_channel
from tests.unit.importing.other_files import OTHER_CASES

CASES = OTHER_CASES | APP_CASES


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if not case.asks])
def test_file_becomes_the_drive(name: str, tmp_path: Path) -> None:
    """Every channel that is made is right, and every one that the file holds is made."""
    case = CASES[name]
    files = [str(path) for path in case.make(tmp_path)]
    write_import(plan_import(files, Answers()), str(tmp_path / "log.mcap"))
    errors = errors_by_channel(tmp_path / "log.mcap", case.start)
    assert set(errors) == set(case.holds)
    assert {each: error for each, error in errors.items() if not error <= case.holds[each]} == {}


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case.asks])
def test_file_is_refused_with_its_question(name: str, tmp_path: Path) -> None:
    case = CASES[name]
    with pytest.raises(CwcliError, match=case.asks) as found:
        plan_import([str(path) for path in case.make(tmp_path)], Answers())
    assert found.value.hint


def test_rows_at_the_origin_of_the_globe_are_no_fixes(tmp_path: Path) -> None:
    """Loggers write 0, 0 while the receiver has no fix."""
    rows = [f"{1_700_000_000 + k},{0 if k < 5 else 48 + k * 1e-4},{0 if k < 5 else 11}" for k in range(30)]
    (tmp_path / "a.csv").write_text("\n".join(["time,lat,lon", *rows]))
    plan = plan_import([str(tmp_path / "a.csv")], Answers())
    assert [(topic, n) for topic, _, n, _ in plan.topics] == [("/gps/fix", 25)]
    (tmp_path / "b.csv").write_text("\n".join(["time,lat,lon", *rows[:5]]))
    with pytest.raises(CwcliError, match="no row has a position"):
        plan_import([str(tmp_path / "b.csv")], Answers())
