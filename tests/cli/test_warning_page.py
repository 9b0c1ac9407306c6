"""docs/warning.md: the lead times that it shows are those of `cwcli run` on the bundled conflicts."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.conftest import ROOT, Run
from tools.results.markers import MARKER

ATOL_S = 0.011
"""Other versions of NumPy may move it by milliseconds; a warning one evaluation sooner moves it by 0.05 s."""
PAGE = (ROOT / "docs" / "warning.md").read_text(encoding="utf-8")
SHOWN = {
    (match["key"].split(":")[0], match["key"].rsplit(" ", 1)[1]): float(match["shown"])
    for match in MARKER.finditer(PAGE)
    if match["name"] == "bundled"
}
LEADS = {name: (SHOWN[name, "stamp"], SHOWN[name, "known"]) for name, _ in SHOWN}


def test_every_conflict_is_told() -> None:
    assert set(LEADS) == {"rear-end", "intersection", "cut-in", "oncoming-left-turn", "stopped-behind-curve"}


@pytest.mark.parametrize("name", LEADS)
def test_a_lead_time_is_that_of_a_run(name: str, cwcli: Run, tmp_path: Path) -> None:
    assert cwcli("simulate", name, "--seed", "1", "-o", "drive.mcap", "--quiet").returncode == 0
    (event,) = json.loads(cwcli("run", "drive.mcap", "--json").stdout)["stages"]["warn"]["sections"]["events"]
    from_stamp_s, from_known_s = LEADS[name]
    assert event["lead_s"] == pytest.approx(from_known_s, abs=ATOL_S)
    assert from_stamp_s - from_known_s == pytest.approx(0.005, abs=1e-9)  # the sensors' transport in these scenarios
