"""A small version of the lane part of `cwcli reproduce zhang2011`; the command is the full one."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.reproduction.zhang2011.lane_drives import (
    FIRST_FRAMES,
    JUDGED_FRAMES,
    MethodOnDrives,
    columns_px,
    is_right,
    run_drives,
    vision_camera,
)
from cwcli.reproduction.zhang2011.lanes import LANE_SETS, PAPER_PERCENT, PHASES, lane_study
from cwcli.simulation.road.drive import set_drives
from cwcli.simulation.road.sets import SETS, frames
from cwcli.vision.boundary import NOT_FOUND, Boundary
from cwcli.vision.method import LaneFit
from cwcli.vision.methods import DEFAULT_METHOD, ready_methods

N_DRIVES = 4
SIZE = (320, 240)


@pytest.fixture(scope="module", params=["good", "complex"])
def made(request: pytest.FixtureRequest) -> tuple[str, dict[str, MethodOnDrives]]:
    return request.param, run_drives(request.param, 0, N_DRIVES)


def test_share_of_right_frames_is_the_papers(made: tuple[str, dict[str, MethodOnDrives]]) -> None:
    name, methods = made
    for key in ("zhang2011", DEFAULT_METHOD):
        assert methods[key].is_right.shape == (N_DRIVES, FIRST_FRAMES + JUDGED_FRAMES)
        assert 100.0 * methods[key].is_right[:, FIRST_FRAMES:].mean() >= PAPER_PERCENT[name]


def test_the_stripe_is_never_stricter_than_its_centre(made: tuple[str, dict[str, MethodOnDrives]]) -> None:
    for found in made[1].values():
        assert not (found.is_right_by_centre & ~found.is_right).any()


def test_a_frame_is_judged_against_its_truth() -> None:
    frame = next(iter(frames("good", 1)))
    left, right = (
        Boundary(*frame.truth.parabola(side), 0.0, 1.0, True)  # the best parabola through the truth
        for side in ("left", "right")
    )
    assert is_right(frame, LaneFit(left, right), SIZE, by_stripe=False)
    beside = Boundary(right.a, right.b, right.c + 25.0, 0.0, 1.0, True)
    assert not is_right(frame, LaneFit(left, beside), SIZE, by_stripe=True)
    assert not is_right(frame, LaneFit(left, NOT_FOUND), SIZE, by_stripe=True)


def test_columns_of_a_search_image_of_half_the_size() -> None:
    # Row v of the image lies at v / 2 - 1/4 in one of half the size, so at y = 120 - (v - 0.5) / 2. There x = y + 9.5
    # is column x - 1, which is 2 (x - 0.5) - 0.5 in the image.
    columns = columns_px(Boundary(0.0, 1.0, 9.5, 0.0, 1.0, True), SIZE, (160, 120))
    for v in (0, 101, 239):
        y = 120.0 - (v - 0.5) / 2.0
        assert columns[v] == pytest.approx(2.0 * (y + 9.5 - 0.5) - 0.5, abs=1e-9)


def test_methods_are_told_the_renderers_camera() -> None:
    # A point of the lane's centre line 20 m ahead on a flat road: both cameras see it in the same pixel.
    truth = next(iter(set_drives("good", 1, n_frames=2))).camera
    camera = vision_camera(*SIZE)
    u, v = truth.project(np.array([20.0]), np.array([1.5]), np.array([0.0]))
    x_m, y_m = camera.ground_from_image(u, v)
    assert (float(x_m[0]), float(y_m[0])) == pytest.approx((20.0, 1.5), abs=1e-6)


def test_boundaries_of_the_papers_sets_are_painted_as_its_text_says() -> None:
    assert SETS["good"].kept > 0.9
    assert SETS["complex"].kept > 0.5
    for name in PAPER_PERCENT:
        assert (SETS[name].dashed, SETS[name].double) == (0.0, 0.0)
    assert SETS["hard"].dashed > 0.5


def test_the_study_does_not_depend_on_the_number_of_processes() -> None:
    one, two = (lane_study(JUDGED_FRAMES, jobs=jobs).part for jobs in (1, 2))
    assert one.measured == two.measured
    assert len(one.measured) == 3 * len(ready_methods()) * len(LANE_SETS)
    assert [plot.figure for plot in one.plots] == [f"lanes {name}" for name in LANE_SETS]


def test_times_stand_apart_from_what_is_the_same_in_every_run() -> None:
    study = lane_study(JUDGED_FRAMES)
    assert len(study.times.measured) == 2 * len(PHASES) * len(ready_methods())
    assert {each.figure for each in study.times.measured} == {"table 4"}
    assert {each.figure for each in study.part.measured} == {"conclusion 1"}
