"""Nothing online knows what comes later: a log that is cut gives the same states, paths and warnings until then.

Few logs and cuts, by chance; `python -m tests.studies.causality` takes all logs and fifty cuts each.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cwcli.channels.published import EGO_ONLINE, EGO_PATH, REMOTE_ONLINE, TARGETS_ONLINE, WARNINGS
from tests.cut_logs import Messages, cut_log, cut_times, first_change, online_messages, stages_of
from tests.studies.causality import calibration_of

ROOT = Path(__file__).parents[2]
SAMPLES = ROOT / "sample_logs"
LOGS = ROOT.parent / "shared" / "logs"
N_CUTS = 4


def changes(path: Path, stages: dict[str, Any], folder: Path, seed: int) -> tuple[Messages, list[str]]:
    whole = online_messages(path, stages, folder)
    told = []
    for at_ns in cut_times(path, N_CUTS, np.random.default_rng(seed)):
        cut_log(path, at_ns, folder / "cut.mcap")
        change = first_change(whole, online_messages(folder / "cut.mcap", stages, folder), at_ns)
        told += [] if change is None else [f"{change.topic}: {change.words}"]
    return whole, told


@pytest.mark.parametrize("is_calibrated", [False, True], ids=["latency none", "calibration"])
def test_cutting_a_log_changes_nothing_before_the_cut(is_calibrated: bool, tmp_path: Path) -> None:
    path = SAMPLES / "intersection.mcap"
    stages = stages_of(calibration_of(path, None) if is_calibrated else None)
    whole, told = changes(path, stages, tmp_path, seed=1)
    assert not told
    assert all(whole[topic] for topic in (EGO_ONLINE.topic, REMOTE_ONLINE.topic, EGO_PATH.topic, WARNINGS.topic))


@pytest.mark.parametrize("name", ["udacity-obj-pose.ros2", "psu-follow-2obu", "wydot-bsm"])
def test_cutting_a_real_log_changes_nothing_before_the_cut(name: str, tmp_path: Path) -> None:
    path = LOGS / f"{name}.mcap"
    if not path.exists():
        pytest.skip("the development logs are not there")
    whole, told = changes(path, stages_of(ego_station="31325433" if name == "wydot-bsm" else None), tmp_path, seed=2)
    assert not told
    assert whole[TARGETS_ONLINE.topic if name.startswith("udacity") else EGO_PATH.topic]


def test_parameters_of_the_whole_log_are_found_out(tmp_path: Path) -> None:
    """The proof can fail: with the defaults noise and latencies come from the whole log."""
    _, told = changes(SAMPLES / "intersection.mcap", stages_of(blind=False), tmp_path, seed=1)
    assert told
