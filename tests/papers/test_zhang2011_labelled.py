"""Real frames with labels, as far as rendered ones with exact labels in TuSimple's form can stand for them."""

from __future__ import annotations

from pathlib import Path

import pytest

from cwcli.errors import MissingSignalError
from cwcli.reproduction.zhang2011.labelled import labelled_frames_part
from cwcli.simulate.road_log import RoadLogConfig, plan_configured_drive, write_road_log
from cwcli.simulation.road.drive import RoadDriveConfig
from tests.cli.conftest import SAMPLES

CONFIG = RoadLogConfig(RoadDriveConfig(weather="clear", seed=3, duration_s=1.0, rate_hz=10.0), format="png")


@pytest.fixture(scope="module")
def labelled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("labelled") / "labelled.mcap"
    write_road_log(plan_configured_drive(CONFIG), CONFIG, path)
    return path


def test_boundaries_of_rendered_frames_are_found(labelled: Path) -> None:
    found = {each.what: each for each in labelled_frames_part(labelled).numbers}
    assert len(found) == 4
    assert {each.figure for each in found.values()} == {"labelled frames"}
    default = found["cwcli: boundaries beside the car that are found"]
    assert default.ours > 80.0
    assert default.low <= default.ours <= default.high
    assert found["zhang2011: boundaries beside the car that are found"].ours > 0.0
    for key in ("cwcli", "zhang2011"):
        every, each = (
            found[f"{key}: {what} beside the car {end}"].ours
            for what, end in (("frames with every boundary", "found"), ("boundaries", "that are found"))
        )
        assert every <= each


def test_a_log_without_labels_is_refused() -> None:
    with pytest.raises(MissingSignalError, match="no labels of lanes"):
        labelled_frames_part(SAMPLES / "straight.mcap")
