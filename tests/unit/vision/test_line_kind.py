"""Kinds and colours of lines: rows made by hand, and rendered drives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cwcli.signals.lane_geometry import Pinhole
from cwcli.vision.boundary import Boundary, LineColour, LineKind
from cwcli.vision.lane_detect import StripeEvidence
from cwcli.vision.line_classifier import LineClassifier, classify_line_colours
from cwcli.vision.line_kind import classify_line_kind, classify_lines_in_frame, fill_worn_holes, split_into_stretches
from cwcli.vision.method import LaneFit, LaneFrame, LaneState
from tests.studies.lane_kinds import in_colour, planned, watched
from tests.unit.vision.lane_scene import mounted

FINE, COARSE = 0.05, 0.3
"""Lengths of a row in lane widths (3.6 m): 18 cm and 1.1 m."""
LANE = np.array([160.0, 0.0, 2.8, 0.0, 100.0, 0.0])
"""Vanishes in column 160, 2.8 camera heights wide, straight, horizon in row 100."""
ROWS = np.arange(104, 238, 2, dtype=np.int32)


def rows(*parts: tuple[float, bool]) -> tuple[list[bool], list[float]]:
    """Fine rows: lengths in lane widths, and whether they are painted."""
    painted = [is_painted for length, is_painted in parts for _ in range(round(length / FINE))]
    return painted, [FINE] * len(painted)


@pytest.mark.parametrize(
    ("line", "kind"),
    [
        (rows((3.0, True)), LineKind.SOLID),
        (rows((1.0, True), (0.2, False), (1.5, True)), LineKind.SOLID),  # a hole of 0.7 m is wear
        (rows((0.8, True), (2.5, False), (0.5, True)), LineKind.DASHED),  # 3 m painted, 9 m bare
        (rows((2.0, False), (1.7, True), (0.1, False)), LineKind.DASHED),  # 6 m behind a gap
        (rows((0.9, False), (0.05, True), (1.0, False), (0.05, True), (0.5, False)), LineKind.DOTS),
        (rows((3.0, False)), LineKind.UNKNOWN),
        (rows((1.0, True)), LineKind.UNKNOWN),  # 3.6 m are too little to tell
        (rows((1.4, True)), LineKind.SOLID),
        (rows((0.6, True), (0.4, False), (0.6, True)), LineKind.UNKNOWN),  # neither wear nor a gap of dashes
    ],
)
def test_kind_of_rows(line: tuple[list[bool], list[float]], kind: LineKind) -> None:
    assert classify_line_kind(*line) is kind


def test_dots_that_look_like_a_dash_far_away() -> None:
    near, lengths = rows((0.3, False), (0.05, True), (0.3, False), (0.05, True), (0.3, False))
    far = [False] * 2 + [True] * 4
    assert classify_line_kind(near + far, lengths + [COARSE] * 6) is LineKind.DOTS
    bare = [False] * len(near)
    assert classify_line_kind(bare + far, lengths + [COARSE] * 6) is LineKind.DASHED


def test_stretches_and_holes() -> None:
    line = split_into_stretches([True, True, False, True, False], [0.1, 0.1, 0.2, 0.1, 0.2])
    assert [(each.is_painted, each.n_rows) for each in line] == [(True, 2), (False, 1), (True, 1), (False, 1)]
    whole = fill_worn_holes(line)
    assert [each.is_painted for each in whole] == [True, False]
    assert whole[0].length == pytest.approx(0.5)


def evidence_with(*lines: tuple[float, float]) -> StripeEvidence:
    """Full evidence at places over the camera's height, each stripe of a half width."""
    u, h = np.arange(320.0)[None], (ROWS - LANE[4])[:, None]
    sharp = np.zeros((len(ROWS), 320), np.float32)
    for place, half in lines:
        sharp[np.abs(u - LANE[0] - place * h) <= half * h] = 1.0
    return StripeEvidence(ROWS, sharp, sharp, sharp, 100.0, 7.2, Pinhole(159.5, 300.0, 1.0))


def test_two_stripes_are_a_double_line() -> None:
    """The second 0.25 camera heights beside the first: 32 cm; on the right there is one of 12 cm alone."""
    seen = classify_lines_in_frame(evidence_with((-1.4, 0.05), (-1.65, 0.05), (1.4, 0.05)), LANE)
    assert [each.is_double for each in seen] == [True, False]
    assert [each.kind for each in seen] == [LineKind.SOLID, LineKind.SOLID]
    inside = classify_lines_in_frame(evidence_with((-1.4, 0.05), (1.15, 0.05), (1.4, 0.05)), LANE)
    assert [each.is_double for each in inside] == [False, True]


@pytest.mark.parametrize("off", [0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.45])
def test_one_stripe_beside_its_boundary_is_not_double(off: float) -> None:
    """The boundary is up to 0.45 camera heights, 58 cm, beside the only stripe."""
    seen = classify_lines_in_frame(evidence_with((-1.4 + off, 0.05), (1.4 + off, 0.05)), LANE)
    assert [each.is_double for each in seen] == [False, False]


def test_colours_of_a_picture_made_by_hand() -> None:
    evidence = evidence_with((-1.4, 0.05), (1.4, 0.05))
    picture = np.tile(np.array([90, 100, 104], np.uint8), (240, 320, 1))
    left, right = (np.zeros((240, 320), np.bool_) for _ in range(2))
    left[ROWS, :160], right[ROWS, 160:] = evidence.sharp[:, :160] > 0, evidence.sharp[:, 160:] > 0
    picture[left], picture[right] = (60, 180, 220), (190, 208, 212)
    assert classify_line_colours(picture, evidence, LANE) == (LineColour.YELLOW, LineColour.WHITE)
    grey = np.repeat(picture[..., :1], 3, axis=2)
    assert classify_line_colours(grey, evidence, LANE) == (LineColour.UNKNOWN, LineColour.UNKNOWN)
    dark = replace(evidence, sharp=np.zeros_like(evidence.sharp))
    assert classify_line_colours(picture, dark, LANE) == (LineColour.UNKNOWN, LineColour.UNKNOWN)


def step(watch: LineClassifier, number: int, evidence: StripeEvidence, **changes: float) -> tuple[LineKind, LineKind]:
    """The kinds after one more frame, 0.5 s after the one before."""
    side = Boundary(0.0, 0.0, 0.0, 1.0, 0.9, True)
    fit = LaneFit(side, side, state=LaneState.FOUND, steady_s=0.5 * number)
    frame = LaneFrame(np.zeros((240, 320), np.uint8), mounted(), 500_000_000 * number, number)
    named = watch.fit_with_kinds_and_colours(replace(fit, **changes), frame, evidence, LANE)  # type: ignore[arg-type]
    return named.left.kind, named.right.kind


def test_votes_over_time_in_a_lane_change_and_after_a_jump() -> None:
    watch = LineClassifier()
    both, one = evidence_with((-1.4, 0.05), (-1.65, 0.05), (1.4, 0.05)), evidence_with((-1.4, 0.05), (1.4, 0.05))
    bare = evidence_with()
    assert step(watch, 0, both) == (LineKind.DOUBLE, LineKind.SOLID)
    assert step(watch, 1, one) == (LineKind.DOUBLE, LineKind.SOLID)  # half of the votes
    for number in range(2, 6):
        last = step(watch, number, one)
    assert last == (LineKind.SOLID, LineKind.SOLID)
    watch = LineClassifier()
    step(watch, 0, both)
    assert step(watch, 1, bare, lane_change=1) == (LineKind.UNKNOWN, LineKind.DOUBLE)
    assert step(watch, 2, bare, steady_s=0.0) == (LineKind.UNKNOWN, LineKind.UNKNOWN)


def test_rendered_kinds_and_colours() -> None:
    """All kinds, 2 s each; 24 drives of 4 s and other seeds: docs/lanes.md."""
    kinds, colours, n = 0, 0, 0
    for seed in range(100, 107):
        drive, names, painted = planned(seed, "good", 2.0)
        fits = watched(drive, (in_colour(drive, painted, k) for k in range(len(drive))))
        for fit in fits[10:]:
            for side, (_, kind), colour in zip((fit.left, fit.right), names, painted, strict=True):
                n += side.found
                kinds += side.found and side.kind is kind
                colours += side.found and side.colour is colour
    assert n >= 140
    assert kinds >= 0.95 * n
    assert colours >= 0.95 * n
