"""A file that changes while it is imported gives no log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from cwcli.errors import InputError
from cwcli.importing import bounded_import
from cwcli.importing.run import ImportPlan, plan_import
from cwcli.importing.tables import Answers

HEAD = "time [s],latitude [deg],longitude [deg]\n"
ROWS = [f"{1_700_000_000 + k / 10:.1f},{50 + k * 1e-5:.6f},8.0\n" for k in range(200)]


@pytest.mark.parametrize("way", ["overwritten", "replaced"])
def test_a_file_that_changes_during_the_import_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, way: str
) -> None:
    path, target = tmp_path / "drive.csv", tmp_path / "drive.mcap"
    path.write_text(HEAD + "".join(ROWS))

    def plan_and_change(files: Sequence[str], answers: Answers) -> ImportPlan:
        plan = plan_import(files, answers)
        other = tmp_path / "other.csv" if way == "replaced" else path
        other.write_text(HEAD + "".join(ROWS[:100]))
        other.rename(path)
        return plan

    monkeypatch.setattr(bounded_import, "plan_import", plan_and_change)
    request: dict[str, Any] = {
        "files": [str(path)],
        "answers": asdict(Answers()) | {"columns": []},
        "target": str(target),
        "force": False,
        "stdout": None,
        "progress": None,
    }
    with pytest.raises(InputError) as found:
        bounded_import.import_requested_files_in_own_process(request)
    assert "drive.csv" in str(found.value)
    assert not target.exists()
