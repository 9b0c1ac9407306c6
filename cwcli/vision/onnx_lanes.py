"""Lane boundaries from a user's own net: its map of lane markings takes the place of the default method's evidence.

Everything else is the default method: one lane of six numbers, its prior, the tracking (`lane_tracker`). The
probabilities of that method were fitted to its own evidence, so none are published.
"""

from __future__ import annotations

from dataclasses import replace
from math import nan
from pathlib import Path

import numpy as np

from cwcli.errors import UsageError
from cwcli.signals.lane_geometry import Pinhole
from cwcli.vision.boundary import Boundary
from cwcli.vision.ground import MIN_DEPTH_BELOW_HORIZON_SHARE
from cwcli.vision.lane_detect import (
    EVIDENCE_DEAD_ZONE,
    Float32Array,
    Int32Array,
    StripeEvidence,
    half_widths_of_two_widened_evidences_px,
)
from cwcli.vision.lane_tracker import LaneTracker
from cwcli.vision.method import GreyImage, LaneFit, LaneFrame, LaneSearch, Method
from cwcli.vision.onnx_model import LaneNet


class OnnxLaneSearch:
    """The search over the frames of one camera.

    Args:
        net: The net that marks lane pixels.
    """

    def __init__(self, net: LaneNet) -> None:
        self._net = net
        self._map: Float32Array = np.zeros((1, 1), np.float32)
        self._tracker = LaneTracker(evidence_source=self._evidence_from_map)

    def step(self, frame: LaneFrame) -> LaneFit:
        """Find both boundaries in the next frame."""
        self._map = self._net.compute_marking_map(frame.grey)
        fit = self._tracker.step(frame)
        return replace(
            fit, left=_boundary_without_probability(fit.left), right=_boundary_without_probability(fit.right)
        )

    def _evidence_from_map(
        self,
        grey: GreyImage,
        rows: Int32Array,
        horizon_px: float,
        pinhole: Pinhole,
        buffer: Float32Array | None = None,
        *,
        with_joints: bool = False,
    ) -> StripeEvidence:
        """The net's map as evidence in some rows, without values in the default method's dead zone."""
        import cv2

        height, width = grey.shape
        sharp = np.maximum(self._map[rows] - np.float32(EVIDENCE_DEAD_ZONE), np.float32(0.0)) / np.float32(
            1.0 - EVIDENCE_DEAD_ZONE
        )
        wide, broad = (
            np.asarray(cv2.dilate(sharp, np.ones((1, 2 * reach + 1), np.uint8)), np.float32)
            for reach in half_widths_of_two_widened_evidences_px(width)
        )
        return StripeEvidence(rows, sharp, wide, broad, horizon_px, MIN_DEPTH_BELOW_HORIZON_SHARE * height, pinhole)


def _boundary_without_probability(boundary: Boundary) -> Boundary:
    """The boundary with an unknown probability."""
    return replace(boundary, probability=nan)


def onnx_method_of_file(path: Path) -> Method:
    """The method with the net of a file.

    Raises:
        InputError, UsageError: The net or its description can't be used.
    """
    net = LaneNet(path)

    def search_size(width_px: int, height_px: int) -> tuple[int, int]:
        return net.description.search_size()

    def make_onnx_search(seed: int) -> LaneSearch:
        return OnnxLaneSearch(net)

    return replace(METHOD, search_size=search_size, make=make_onnx_search)


def _raise_missing_model(*_: int) -> LaneSearch:
    """Raise the error that a model is missing."""
    raise UsageError("--method onnx needs a net", hint="--model net.onnx, with net.toml in the same folder")


METHOD = Method(
    summary="your own net (--model) finds the markings, the default method follows the lane",
    search_size=lambda width_px, height_px: (width_px, height_px),
    make=_raise_missing_model,
    uses_motion=True,
    is_rectified=True,
    with_model=onnx_method_of_file,
)
"""The registered lane method of a user's own net, without a net so far."""
