"""The default lane method on clips of real pictures: a small part of `studies/real_drives.py`."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.metrics.lane_scores import VISUAL_SHARE
from tests.studies.real_clips import VIDEO, Video, read_video, video_clip
from tests.studies.real_drives import Counts, counted, watched
from tests.studies.real_stills import STILLS, read_pictures, still_clip

needs_pictures = pytest.mark.skipif(
    not (VIDEO.exists() and STILLS.exists()), reason="the logs and pictures in ../shared are not here"
)


@pytest.fixture(scope="module")
def video() -> Video:
    return read_video(frames=80)


def assert_nothing_jumps(counts: Counts) -> None:
    assert not counts.jumps.any()
    assert counts.departures == 0


@needs_pictures
@pytest.mark.parametrize("kind", ["as it is", "third rate", "dashes gone", "truck", "glare", "exposure"])
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
    assert (seen.share[is_late] >= VISUAL_SHARE).all()


@needs_pictures
def test_a_still_that_moves_as_a_car_would_see_it_is_followed() -> None:
    still = next(each for each in read_pictures() if each.name.endswith("test4"))
    seen = watched(still_clip(still, with_motion=False))
    assert_nothing_jumps(counted(seen))
    assert float(np.nanmax(np.abs(seen.error_m))) <= 0.3
