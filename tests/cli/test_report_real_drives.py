"""The report on real drives says in words what makes them odd: logs of ../shared/logs, else these are skipped."""

from __future__ import annotations

import html
import re
from pathlib import Path

import pytest

from cwcli.cli.main import run_command_line
from tests.cli.browser import visit
from tests.cli.conftest import ROOT

LOGS = ROOT.parent / "shared" / "logs"


def shown(name: str, folder: Path, *options: str) -> str:
    """The words that a browser shows of a log's report."""
    log = LOGS / name
    if not log.exists():
        pytest.skip("the development logs in ../shared/logs are not here")
    annotated, page = folder / "annotated.mcap", folder / "report.html"
    assert run_command_line(["run", str(log), "-o", str(annotated), "--quiet", *options]) == 0
    assert run_command_line(["report", str(annotated), "-o", str(page), "--quiet"]) == 0
    dom = visit(page, folder).dom
    assert 'data-plots="drawn"' in dom
    body = re.sub(r"<(script|style|svg)\b.*?</\1>", " ", dom, flags=re.DOTALL)
    return html.unescape(re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", body)))


def sensors_of(words: str) -> str:
    return words[words.index("The sensors") :]


def test_dresden_s_second_of_latency_and_its_pitched_imu_are_told(tmp_path: Path) -> None:
    """The velocity is known to be a second late (found from the log by hand as well), the phone lay pitched."""
    told = sensors_of(shown("balzer-dresden-2014-03-26.ros2.mcap", tmp_path))
    late = re.search(r"The velocity of /gps/vel came ([\d.]+) s late by its stamps", told)
    assert late and 0.9 < float(late[1]) < 1.1
    pitched = re.search(
        r"The acceleration of /imu/data is off by -[\d.]+ m/s²: that of an IMU pitched by (\d+) degrees", told
    )
    assert pitched and 8 <= int(pitched[1]) <= 13


def test_kitti_s_headings_that_are_on_another_clock_come_first(tmp_path: Path) -> None:
    """Moved by 60 to 80 ms the truth's headings fit best, which was found by hand as well."""
    options = ("--topic", "truth=/truth/pose_imu", "--estimate-truth-origin", "48.9825,8.3904,116.4")
    words = shown("kitti-2011-10-03-drive-0027.first240s.mcap", tmp_path, *options)
    first = words[: words.index("Where everybody drove")]
    early = re.search(r"Do not trust this as it is: the truth \(heading\) is (0\.\d+) s early", first)
    assert early and 0.05 < float(early[1]) < 0.09


def test_psu_testtrack_s_states_are_said_to_be_implausible(tmp_path: Path) -> None:
    """Its messages come in bursts, and hold no speed: what differences of positions tell, no car does."""
    words = shown("psu-testtrack-1obu.mcap", tmp_path, "--ego-station", "2a3c600d")
    first = words[: words.index("Where everybody drove")]
    assert "not to be trusted" in first
    found = re.search(r"Do not trust this as it is: the estimate has an acceleration of (\d+) m/s²", first)
    assert found and int(found[1]) > 12
