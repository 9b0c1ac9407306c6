"""`cwcli plot`: images that show what the log holds, and trajectory errors by their definitions."""

from __future__ import annotations

import math
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cwcli.cli.commands.plot import PLOT_NAMES_TEXT
from cwcli.cli.main import run_command_line
from cwcli.digest.drive import read_drive
from cwcli.errors import EXIT_BAD_INPUT, EXIT_MISSING_SIGNAL, EXIT_NOT_WRITTEN, EXIT_USAGE, MissingSignalError
from cwcli.evaluation.evaluation_context import EgoTruth
from cwcli.logs.read.reader import Log
from cwcli.report import plots
from tests.cli.conftest import SAMPLES

NO_LANE = sorted({*plots.PLOT_NAMES} - {"lane"})


@pytest.fixture(scope="module")
def annotated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("annotated") / "intersection.mcap"
    assert run_command_line(["run", str(SAMPLES / "intersection.mcap"), "-o", str(target), "--quiet"]) == 0
    return target


def test_the_help_names_every_plot() -> None:
    assert PLOT_NAMES_TEXT.split(", ") == list(plots.PLOT_NAMES)


@pytest.mark.parametrize("what", NO_LANE)
def test_each_plot_is_drawn_and_the_same_each_time(annotated: Path, tmp_path: Path, what: str) -> None:
    for name in ("a.svg", "b.svg"):
        assert run_command_line(["plot", str(annotated), "--what", what, "-o", str(tmp_path / name), "--quiet"]) == 0
    drawn = (tmp_path / "a.svg").read_bytes()
    assert drawn == (tmp_path / "b.svg").read_bytes()
    assert drawn.count(b"<path") > 20 and b"<svg" in drawn
    assert b"<!-- intersection.mcap -->" in drawn  # the title, whose letters are paths
    assert (b"<!-- raw position fixes -->" in drawn) == (what == "map")


def test_view_names_a_file_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["view", str(tmp_path / "nope.mcap")]) == EXIT_BAD_INPUT
    said = capsys.readouterr().err
    assert "there is no such file" in said and "Rerun" not in said


def test_view_says_of_a_pipe_or_a_device_that_it_is_no_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    os.mkfifo(tmp_path / "pipe")
    for name in (str(tmp_path / "pipe"), "/dev/null"):
        assert run_command_line(["view", name]) == EXIT_BAD_INPUT
        assert "it is no file that can be read" in capsys.readouterr().err


def test_a_png_is_one(annotated: Path, tmp_path: Path) -> None:
    assert run_command_line(["plot", str(annotated), "-o", str(tmp_path / "motion.png")]) == 0
    assert (tmp_path / "motion.png").read_bytes().startswith(b"\x89PNG\r\n\x1a\n")


def circle(stamp_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions and headings on a circle of 50 m at 10 m/s."""
    angle = stamp_s * 10.0 / 50.0
    return 50.0 * np.column_stack([np.sin(angle), 1.0 - np.cos(angle)]), angle


def test_the_relative_error_is_that_of_the_way_seen_from_its_beginning() -> None:
    """A wrong heading of 0.1 rad turns a way of one second, the chord 2 * 50 sin(0.1) m, by as much."""
    stamp_s = np.arange(0.0, 20.0, 0.1)
    xy, heading = circle(stamp_s)
    truth = EgoTruth("/truth", np.round(stamp_s * 1e9).astype(np.int64), xy, heading_rad=heading)
    state = np.zeros((len(stamp_s), 8))
    state[:, :2], state[:, 3] = xy + np.array([3.0, -4.0]), heading + 0.1  # an offset is no relative error
    stamp_ns, found = plots.displacement_end_ns_and_error_m(state, truth)
    assert (stamp_ns - truth.stamp_ns[: len(stamp_ns)] == 1_000_000_000).all() and len(found) == 190
    chord = 2.0 * 50.0 * math.sin(0.1)
    np.testing.assert_allclose(found, 2.0 * chord * math.sin(0.05), rtol=1e-9)
    no_heading = EgoTruth("/truth", truth.stamp_ns, xy)
    np.testing.assert_allclose(plots.displacement_end_ns_and_error_m(state, no_heading)[1], 0.0, atol=1e-12)
    state[:, 0] *= 1.02  # the way's own length counts in the map, too
    scaled = plots.displacement_end_ns_and_error_m(state, no_heading)[1]
    np.testing.assert_allclose(scaled, 0.02 * np.abs(xy[10:, 0] - xy[:-10, 0]), atol=1e-9)


def test_the_absolute_error_s_mean_is_that_of_the_tracks(annotated: Path, tmp_path: Path) -> None:
    with Log.open(annotated) as log:
        drive = read_drive(log)
    assert drive.truth is not None and drive.ego is not None
    at = np.isin(drive.ego.stamp_ns, drive.truth.stamp_ns)
    assert at.sum() == len(drive.truth.stamp_ns)  # both at 20 Hz
    apart = np.hypot(*(drive.ego.state[at, :2] - drive.truth.xy).T)
    (panel,) = plots.absolute_position_error_panels(drive)
    assert (
        f"mean {apart.mean():.3g}, median {np.median(apart):.3g}, max {apart.max():.3g} m, n 201"
        in panel.statistics_text
    )


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["-o", "x.bmp"], EXIT_USAGE, "an image ends in .png or .svg"),
        (["-o", "x.png", "--what", "erorr"], EXIT_USAGE, "did you mean error"),
        (["-o", "x.png", "--what", "lane"], EXIT_MISSING_SIGNAL, "run `cwcli lanes` first"),
        (["-o", "no/such/x.png"], EXIT_NOT_WRITTEN, "no/such"),
    ],
)
def test_errors_are_one_line(
    annotated: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], code: int, words: str
) -> None:
    assert run_command_line(["plot", str(annotated), *arguments]) == code
    said = re.sub(r"\s+", " ", capsys.readouterr().err)
    assert words in said and "Traceback" not in said


def test_a_log_without_results_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = str(tmp_path / "x.png")
    assert run_command_line(["plot", str(SAMPLES / "straight.mcap"), "-o", target]) == EXIT_MISSING_SIGNAL
    assert "run `cwcli estimate` first" in capsys.readouterr().err
    assert not Path(target).exists()


def test_a_log_without_a_truth_is_told(annotated: Path) -> None:
    with Log.open(annotated) as log:
        drive = replace(read_drive(log), truth=None)
    for what in ("error", "ape", "rpe"):
        with pytest.raises(MissingSignalError, match="no truth of the ego"):
            plots.draw_plot(drive, what, "png")
