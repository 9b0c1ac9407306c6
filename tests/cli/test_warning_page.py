"""docs/warning.md: the lead times that it tells are those of `cwcli run` on the bundled conflicts."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from tests.cli.conftest import ROOT, Run

ATOL_S = 0.011
"""Other versions of NumPy may move it by milliseconds; a warning one evaluation sooner moves it by 0.05 s."""
PAGE = " ".join((ROOT / "docs" / "warning.md").read_text(encoding="utf-8").split())
(TOLD,) = re.findall(r"lead times in seconds from the stamp and from when the warning could be known: (.*?\d)\. ", PAGE)
LEADS = {name: (float(stamp), float(known)) for name, stamp, known in re.findall(r"([a-z-]+) ([\d.]+), ([\d.]+)", TOLD)}


def test_every_conflict_is_told() -> None:
    assert set(LEADS) == {"rear-end", "intersection", "cut-in", "oncoming-left-turn", "stopped-behind-curve"}


@pytest.mark.parametrize("name", LEADS)
def test_a_lead_time_is_that_of_a_run(name: str, cwcli: Run, tmp_path: Path) -> None:
    assert cwcli("simulate", name, "--seed", "1", "-o", "drive.mcap", "--quiet").returncode == 0
    (event,) = json.loads(cwcli("run", "drive.mcap", "--json").stdout)["stages"]["warn"]["sections"]["events"]
    from_stamp_s, from_known_s = LEADS[name]
    assert event["lead_s"] == pytest.approx(from_known_s, abs=ATOL_S)
    assert from_stamp_s - from_known_s == pytest.approx(0.005, abs=1e-9)  # the sensors' transport in these scenarios
