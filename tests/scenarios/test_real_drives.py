"""The default lane method on clips of real pictures: a small part of `studies/real_drives.py`."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.metrics.lane_scores import VISUAL_STANDARD_MIN_ROW_SHARE
from cwcli.signals.columns import FloatArray
from tests.studies.real_clips import VIDEO, Video, read_video, video_clip
from tests.studies.real_drives import Counts, counted, watched
from tests.studies.real_stills import STILLS, read_pictures, still_clip

needs_pictures = pytest.mark.skipif(
    not (VIDEO.exists() and STILLS.exists()), reason="the logs and pictures in ../shared are not here"
)


@pytest.fixture(scope="module")
def video() -> Video:
    return read_video(frames=80)


ROWS_PX = (360, 420, 480)
WHERE_PX = (((370, 430), (270, 350), (180, 270)), ((530, 600), (610, 700), (690, 800)))
"""Columns between which the left and the right boundary's paint lies on each of the rows, in the first 80 frames."""
RIGHT_PAINT_PX = {
    0: (569.6, 667.8, 763.2),
    25: (565.8, 660.4, 753.1),
    40: (567.9, 659.5, 752.8),
    79: (559.1, 648.1, 737.2),
}
"""Middle of the solid line's paint on those rows, by frame: looked at, four times enlarged."""


def paint_px(video: Video) -> FloatArray:
    """Middles of both boundaries' paint in each frame, shape (n, 2, rows): of what is brighter than the road by 50."""
    made = np.full((len(video.greys), 2, len(ROWS_PX)), np.nan)
    for (frame, side, k), _ in np.ndenumerate(made):
        row, (first, end) = ROWS_PX[k], WHERE_PX[side][k]
        band = video.greys[frame][row - 1 : row + 2, first:end].mean(axis=0)
        paint = np.clip(band - np.median(band) - 50.0, 0.0, None)
        if paint.max() > 30.0:
            made[frame, side, k] = first + np.sum(paint * np.arange(end - first)) / paint.sum()
    return made


@needs_pictures
def test_the_lanes_taken_for_true_lie_on_the_paint_and_do_not_jump(video: Video) -> None:
    """They are found by the method itself; the paint is not. The picture is 960 pixels wide."""
    paint = paint_px(video)
    for frame, columns in RIGHT_PAINT_PX.items():
        assert paint[frame, 1] == pytest.approx(columns, abs=0.1)
    error = video.lines[:, :, ROWS_PX] - paint
    assert np.isfinite(error[:, 1]).all()
    assert (np.isfinite(error[:, 0]).sum(axis=0) >= 20).all()  # frames with a dash there
    assert (np.nanmax(np.abs(error), axis=(0, 1)) <= (3.0, 6.0, 10.0)).all()  # 0.02 times the lane's width there
    assert np.nanmax(np.abs(np.diff(error, axis=0))) <= 4.0


def assert_nothing_jumps(counts: Counts) -> None:
    assert not counts.jumps.any()
    assert counts.departures == 0


@needs_pictures
@pytest.mark.parametrize("kind", ["third rate", "dashes gone", "truck", "glare", "exposure"])
@pytest.mark.parametrize("is_aside", [False, True])
def test_lanes_of_a_varied_video_do_not_jump(video: Video, kind: str, is_aside: bool) -> None:
    counts = counted(watched(video_clip(video, kind, is_aside=is_aside)))
    assert_nothing_jumps(counts)
    assert counts.wrong[0] <= 0.01 * counts.sure[0]
    assert counts.found >= 0.97 * 2 * counts.frames


@needs_pictures
def test_a_first_frame_that_misleads_is_corrected_and_nothing_jumps_while_it_is_believed() -> None:
    """The last frame's lines meet 34 rows above the horizon: a lane half a metre aside was kept to the end."""
    seen = watched(video_clip(read_video(), "backwards", is_aside=False))
    counts = counted(seen)
    assert_nothing_jumps(counts)
    assert counts.wrong[0] <= 0.05 * counts.sure[0]
    is_late = seen.stamp_ns >= 1_200_000_000  # looked at again after 0.2, 0.4 and 0.8 s; better for 0.4 s
    assert (seen.share[is_late] >= VISUAL_STANDARD_MIN_ROW_SHARE).all()


@needs_pictures
def test_a_still_that_moves_as_a_car_would_see_it_is_followed() -> None:
    still = next(each for each in read_pictures() if each.name.endswith("test4"))
    seen = watched(still_clip(still, with_motion=False))
    assert_nothing_jumps(counted(seen))
    assert float(np.nanmax(np.abs(seen.error_m))) <= 0.3
