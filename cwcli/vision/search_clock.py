"""Which frames of a fast camera are searched: as many as the road needs. The others are not even decoded."""

from __future__ import annotations

import math

from cwcli.vision.camera import WidthHeightPx

MAX_SEARCH_INTERVAL_NS = 70_000_000
"""Longest time between two searched frames of a camera that is faster than that, in nanoseconds. A camera of 30 Hz has
every second frame searched, one of 60 Hz every fourth, one of 25 Hz or less every one. Chosen by hand: at 100 ms a
still that is moved as a driving car sees it was followed with errors of up to 0.42 m instead of 0.3 m."""


class SearchClock:
    """Decides which frames are searched, by the times of the frames so far alone.

    Args:
        is_every_frame: Search every frame.
    """

    def __init__(self, *, is_every_frame: bool = False) -> None:
        self._longest_ns = -math.inf if is_every_frame else MAX_SEARCH_INTERVAL_NS
        self._searched_ns: int | None = None
        self._last_ns = 0
        self._size = (0, 0)

    def is_search_due(self, time_ns: int, size: WidthHeightPx) -> bool:
        """Whether the next frame is searched.

        It is, unless the frame after it comes early enough, if it follows as soon as this one did. The first frame, a
        frame of another size, and one whose time goes back are searched too.
        """
        step_ns = time_ns - self._last_ns
        is_due = (
            self._searched_ns is None
            or size != self._size
            or step_ns <= 0
            or time_ns + step_ns - self._searched_ns > self._longest_ns
        )
        self._last_ns, self._size = time_ns, size
        if is_due:
            self._searched_ns = time_ns
        return is_due
