"""`estimate --model song2016`, then `predict --model cj-cya`: on logs, too, the paper's derivatives and its model."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cwcli.channels.predicted_path import read_predicted_paths
from cwcli.channels.vehicle_state import read_vehicle_states
from cwcli.logs.read.reader import Log
from cwcli.signals.vehicle_state import ACCEL, JERK, YAW_ACCEL, YAW_RATE
from tests.cli.conftest import SAMPLES, Run

SAMPLES_OF_SLOPE, STEP_S = 8, 0.05
ATOL = 2e-3  # what is published is rounded: half a millimetre a second squared


@pytest.mark.parametrize("causal", [(), ("--causal",)], ids=["smoothed", "causal"])
def test_cj_cya_after_song2016_has_the_papers_derivatives(cwcli: Run, tmp_path: Path, causal: tuple[str, ...]) -> None:
    """The slopes are NumPy's polynomials of degree 1 through eight published states; the paths are not ctra's."""
    estimated = tmp_path / "estimated.mcap"
    command = ("estimate", SAMPLES / "curve.mcap", "--model", "song2016", *causal, "-o", estimated)
    assert cwcli(*command).returncode == 0
    paths = {}
    for model in ("ctra", "cj-cya"):
        predicted = tmp_path / f"{model}.mcap"
        assert cwcli("predict", estimated, "--model", model, "-o", predicted).returncode == 0
        with Log.open(predicted) as log:
            states = read_vehicle_states(log.columns("/cwcli/ego/state"))
            paths[model] = read_predicted_paths(log.columns("/cwcli/ego/path"))
    time_s = STEP_S * np.arange(SAMPLES_OF_SLOPE)
    for value, slope in ((ACCEL, JERK), (YAW_RATE, YAW_ACCEL)):
        for row in range(60, len(states), 29):
            window = states.state[row - SAMPLES_OF_SLOPE + 1 : row + 1, value]
            assert states.state[row, slope] == pytest.approx(np.polyfit(time_s, window, 1)[0], abs=ATOL)
        assert np.abs(states.state[60:, slope]).max() > 0.01
    ctra, cj_cya = paths["ctra"].paths, paths["cj-cya"].paths
    apart_m = np.hypot(ctra.x_m - cj_cya.x_m, ctra.y_m - cj_cya.y_m)[:, -1]
    assert (apart_m[60:] > 0.0).all()
    assert np.median(apart_m) > 0.1
