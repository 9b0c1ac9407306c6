"""`cwcli reproduce zhang2011 --labelled`: a log of the user's own."""

from __future__ import annotations

from pathlib import Path

import pytest

from cwcli.simulate.road_log import RoadLogConfig, plan_configured_drive, write_road_log
from cwcli.simulation.road.drive import RoadDriveConfig
from tests.cli.conftest import Run

CONFIG = RoadLogConfig(RoadDriveConfig(weather="clear", seed=3, duration_s=0.5, rate_hz=10.0), format="png")


@pytest.fixture(scope="module")
def labelled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("labelled") / "labelled.mcap"
    write_road_log(plan_configured_drive(CONFIG), CONFIG, path)
    return path


def test_the_command_takes_a_labelled_log_and_does_not_write_over_it(cwcli: Run, labelled: Path) -> None:
    arguments = ("reproduce", "zhang2011", "--only", "labelled frames", "--labelled", str(labelled))
    done = cwcli(*arguments)
    assert done.returncode == 0, done.stderr.decode()
    assert b"boundaries" in done.stdout
    before = labelled.read_bytes()
    done = cwcli(*arguments, "--metrics", str(labelled.with_suffix(".csv")))
    assert done.returncode == 0
    copy = labelled.with_suffix(".parquet")
    copy.hardlink_to(labelled)
    done = cwcli(*arguments, "--metrics", str(copy), "--force")
    assert done.returncode == 6
    assert b"the input itself" in done.stderr
    assert labelled.read_bytes() == before


def test_a_file_that_is_no_log_is_told_at_once(cwcli: Run, tmp_path: Path) -> None:
    (tmp_path / "no.mcap").write_text("no log")
    done = cwcli("reproduce", "zhang2011", "--labelled", "no.mcap")
    assert done.returncode == 3
    assert done.stderr.count(b"error: ") == 1
