"""A small version of the lane part of `cwcli reproduce zhang2011`; the command is the full one."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.reproduction.findings_report import PROCESSOR_TIMES_SECTION_KEY
from cwcli.reproduction.zhang2011.lane_drives import (
    N_FRAMES_BEFORE_STABLE_PHASE,
    N_JUDGED_FRAMES,
    MethodResults,
    boundary_columns_px,
    camera_for_lane_methods,
    is_fit_correct,
    run_methods_on_drives,
)
from cwcli.reproduction.zhang2011.lanes import (
    FRAME_RANGES_OF_LANE_SEARCH_PHASES,
    PAPER_CORRECT_FRAMES_PERCENT_BY_ROAD_SET,
    ROAD_SET_NAMES,
    run_lane_study,
)
from cwcli.simulation.road.drive import iter_set_drives
from cwcli.simulation.road.sets import FRAME_SETS
from cwcli.vision.boundary import BOUNDARY_NOT_FOUND, Boundary
from cwcli.vision.method import LaneFit
from cwcli.vision.methods import DEFAULT_METHOD, methods_without_model
from tests.set_frames import iter_set_frames

N_DRIVES = 4
SIZE = (320, 240)


@pytest.fixture(scope="module", params=["good", "complex"])
def made(request: pytest.FixtureRequest) -> tuple[str, dict[str, MethodResults]]:
    return request.param, run_methods_on_drives(request.param, 0, N_DRIVES)


def test_share_of_right_frames_is_the_papers(made: tuple[str, dict[str, MethodResults]]) -> None:
    name, methods = made
    for key in ("zhang2011", DEFAULT_METHOD):
        assert methods[key].is_correct.shape == (N_DRIVES, N_FRAMES_BEFORE_STABLE_PHASE + N_JUDGED_FRAMES)
        assert (
            100.0 * methods[key].is_correct[:, N_FRAMES_BEFORE_STABLE_PHASE:].mean()
            >= PAPER_CORRECT_FRAMES_PERCENT_BY_ROAD_SET[name]
        )


def test_the_stripe_is_never_stricter_than_its_centre(made: tuple[str, dict[str, MethodResults]]) -> None:
    for found in made[1].values():
        assert not (found.is_correct_by_centre & ~found.is_correct).any()


def test_a_frame_is_judged_against_its_truth() -> None:
    frame = next(iter(iter_set_frames("good", 1)))
    left, right = (
        Boundary(*frame.truth.fit_boundary_parabola_px(side), 0.0, 1.0, True)  # the best parabola through the truth
        for side in ("left", "right")
    )
    assert is_fit_correct(frame, LaneFit(left, right), SIZE, by_stripe=False)
    beside = Boundary(right.a, right.b, right.c + 25.0, 0.0, 1.0, True)
    assert not is_fit_correct(frame, LaneFit(left, beside), SIZE, by_stripe=True)
    assert not is_fit_correct(frame, LaneFit(left, BOUNDARY_NOT_FOUND), SIZE, by_stripe=True)


def test_columns_of_a_search_image_of_half_the_size() -> None:
    # Row v of the image lies at v / 2 - 1/4 in one of half the size, so at y = 120 - (v - 0.5) / 2. There x = y + 9.5
    # is column x - 1, which is 2 (x - 0.5) - 0.5 in the image.
    columns = boundary_columns_px(Boundary(0.0, 1.0, 9.5, 0.0, 1.0, True), SIZE, (160, 120))
    for v in (0, 101, 239):
        y = 120.0 - (v - 0.5) / 2.0
        assert columns[v] == pytest.approx(2.0 * (y + 9.5 - 0.5) - 0.5, abs=1e-9)


def test_methods_are_told_the_renderers_camera() -> None:
    # A point of the lane's centre line 20 m ahead on a flat road: both cameras see it in the same pixel.
    truth = next(iter(iter_set_drives("good", 1, n_frames=2))).camera
    camera = camera_for_lane_methods(*SIZE)
    u, v = truth.project_to_image_px(np.array([20.0]), np.array([1.5]), np.array([0.0]))
    x_m, y_m = camera.ground_points_from_image(u, v)
    assert (float(x_m[0]), float(y_m[0])) == pytest.approx((20.0, 1.5), abs=1e-6)


def test_boundaries_of_the_papers_sets_are_painted_as_its_text_says() -> None:
    assert FRAME_SETS["good"].min_remaining_paint_share > 0.9
    assert FRAME_SETS["complex"].min_remaining_paint_share > 0.5
    for name in PAPER_CORRECT_FRAMES_PERCENT_BY_ROAD_SET:
        assert (FRAME_SETS[name].dashed, FRAME_SETS[name].double) == (0.0, 0.0)
    assert FRAME_SETS["hard"].dashed > 0.5


def test_the_study_does_not_depend_on_the_number_of_processes() -> None:
    one, two = (run_lane_study(N_JUDGED_FRAMES, jobs=jobs).shares_part for jobs in (1, 2))
    assert one.numbers == two.numbers
    assert len(one.numbers) == 3 * len(methods_without_model()) * len(ROAD_SET_NAMES)
    assert [plot.figure for plot in one.plots] == [f"lanes {name}" for name in ROAD_SET_NAMES]


def test_times_stand_apart_from_what_is_the_same_in_every_run() -> None:
    study = run_lane_study(N_JUDGED_FRAMES)
    assert len(study.times.rows) == len(FRAME_RANGES_OF_LANE_SEARCH_PHASES) * len(methods_without_model())
    assert study.times.key == PROCESSOR_TIMES_SECTION_KEY  # no class, and not on the page
    assert {each.figure for each in study.shares_part.numbers} == {"conclusion 1"}
