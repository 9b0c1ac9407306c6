"""The registry of lane methods. To add one: write it in a file of its own and add one entry here."""

from __future__ import annotations

from cwcli.vision import lane_tracker, zhang2011
from cwcli.vision.method import Method
from cwcli.vision.objective import block_responses

METHODS: dict[str, Method] = {
    "cwcli": Method(
        summary="both boundaries together as stripes of a marking's width, tracked; finds the horizon itself",
        search_size=lane_tracker.search_size,
        make=lane_tracker.LaneTracker,
        uses_motion=True,
        is_rectified=True,
    ),
    "zhang2011": Method(
        summary="the paper's genetic search on 320 x 240",
        search_size=zhang2011.search_size,
        make=zhang2011.Zhang2011Search,
        prepare=block_responses,
    ),
}
DEFAULT_METHOD = "cwcli"
