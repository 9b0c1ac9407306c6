"""The covariance of a found lane: the curvature of a known objective, its propagation, and rendered drives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cwcli.simulation.road.camera import camera_of_zhang2011, wide_camera
from cwcli.vision import lane_covariance as module
from cwcli.vision.ground import GeometrySigmas, compute_lane_geometry
from cwcli.vision.lane_covariance import (
    COVARIANCE_PER_INVERSE_OBJECTIVE_CURVATURE,
    covariance_of_first_five_lane_numbers,
    propagate_covariance_to_fit,
)
from cwcli.vision.lane_detect import StripeEvidence, search_first_frame
from cwcli.vision.lane_model import BEND, first_frame_prior, fit_boundary_parabolas, pitch_from_horizon_rad
from cwcli.vision.lane_tracker import LaneTracker
from cwcli.vision.method import LaneFit, LaneFrame
from tests.set_frames import render_set_frame
from tests.studies.lane_nees import errors
from tests.unit.vision.fit_lists import columns_of
from tests.unit.vision.lane_scene import mounted

SIGMA = np.array([2.0, 0.01, 0.02, 20.0, 0.8])


def found(index: int = 0) -> tuple[np.ndarray, StripeEvidence]:
    """The best lane of a rendered frame, and its evidence."""
    lanes, _, evidence = search_first_frame(
        render_set_frame("good", index).grey, mounted(), first_frame_prior(mounted())
    )
    return lanes[0], evidence


def test_the_covariance_of_a_known_objective(monkeypatch: pytest.MonkeyPatch) -> None:
    """-(x - lane)' A (x - lane) falls by 2 A: the covariance is SCALE / 2 times the inverse of A."""
    lane, evidence = found()
    rng = np.random.default_rng(1)
    root = np.eye(5) + 0.3 * rng.normal(size=(5, 5))
    information = (root / SIGMA[:, None]) @ (root / SIGMA[:, None]).T

    def judged(_: StripeEvidence, lanes: np.ndarray, table: np.ndarray) -> np.ndarray:
        off = (lanes - lane)[:, :5]
        return 1.0 - 1e-3 * np.einsum("ni,ij,nj->n", off, information, off)

    monkeypatch.setattr(module, "lane_objectives", judged)
    monkeypatch.setattr(module, "CURVATURE_CHANGE_SIGMA_1PM2", 0.0)
    monkeypatch.setattr(module, "SIGMA_CAP_IN_DERIVATIVE_STEPS", 1e6)
    made = covariance_of_first_five_lane_numbers(evidence, lane, first_frame_prior(mounted()).table, mounted())
    np.testing.assert_allclose(
        made, COVARIANCE_PER_INVERSE_OBJECTIVE_CURVATURE / 2e-3 * np.linalg.inv(information), rtol=1e-6, atol=1e-9
    )


def test_what_is_hidden_is_less_exact(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "CURVATURE_CHANGE_SIGMA_1PM2", 0.0)
    lane, evidence = found()
    table = first_frame_prior(mounted()).table
    whole = covariance_of_first_five_lane_numbers(evidence, lane, table, mounted())
    sharp, broad = evidence.sharp.copy(), evidence.broad.copy()
    sharp[: len(sharp) // 2] = broad[: len(sharp) // 2] = 0.0  # nothing far away
    hidden = covariance_of_first_five_lane_numbers(replace(evidence, sharp=sharp, broad=broad), lane, table, mounted())
    assert hidden[BEND, BEND] > 2.0 * whole[BEND, BEND]
    for made in (whole, hidden):
        np.testing.assert_allclose(made, made.T, rtol=1e-9)
        assert (np.linalg.eigvalsh(made / np.outer(SIGMA, SIGMA)) > 0.0).all()


def test_propagation_against_samples() -> None:
    """From the five numbers to what is published, and on to the sigmas at the preview point."""
    lane, _ = found(1)  # no sample of its parabolas is so near the image's edge that some of the drawn ones lose it
    camera = mounted()
    own = np.diag((0.05 * SIGMA) ** 2)
    own[0, 3] = own[3, 0] = -0.5 * np.sqrt(own[0, 0] * own[3, 3])
    drawn = np.tile(lane, (4000, 1))
    drawn[:, :5] += np.random.default_rng(2).multivariate_normal(np.zeros(5), own, 4000)
    published = np.array(
        [[*fit_boundary_parabolas(each, camera).ravel(), pitch_from_horizon_rad(each, camera)] for each in drawn]
    )
    made = propagate_covariance_to_fit(lane, own, camera)
    np.testing.assert_allclose(np.sqrt(np.diagonal(made)), published.std(axis=0), rtol=0.08)
    correlation = np.corrcoef(published.T)
    sigma = np.sqrt(np.diagonal(made))
    np.testing.assert_allclose(made / np.outer(sigma, sigma), correlation, atol=0.08)

    fit = LaneTracker().step(LaneFrame(render_set_frame("good", 1).grey, camera, 0, 0))
    exact = GeometrySigmas(pitch_rad=0.0, yaw_rad=0.0, height_m=0.0)

    def fit_of(numbers: np.ndarray) -> LaneFit:
        sides = [
            replace(side, a=a, b=b, c=c)
            for side, (a, b, c) in zip((fit.left, fit.right), numbers[:6].reshape(2, 3).tolist(), strict=True)
        ]
        return LaneFit(sides[0], sides[1], pitch_rad=float(numbers[6]), covariance=made)

    at = compute_lane_geometry(
        columns_of([fit_of(each) for each in published[:1500]]), camera, preview_m=20.0, sigmas=exact
    )
    told = compute_lane_geometry(columns_of([fit_of(published.mean(axis=0))]), camera, preview_m=20.0, sigmas=exact)
    for name in ("lateral_deviation", "heading_deviation", "curvature"):
        unit = {"lateral_deviation": "m", "heading_deviation": "rad", "curvature": "1pm"}[name]
        spread = float(np.std(getattr(at, f"{name}_{unit}")))
        assert float(getattr(told, f"{name}_sigma_{unit}")[0]) == pytest.approx(spread, rel=0.1)


@pytest.mark.parametrize("name", ["good", "complex"])
def test_errors_are_as_great_as_they_are_said_to_be(name: str) -> None:
    """Drives that were not in sight of the constants; more of them: docs/lanes.md."""
    for camera in (camera_of_zhang2011(), wide_camera(480, 270)):
        seen = errors(name, 4, 21, camera, 20.0)
        assert len(seen.error) >= 20
        ratios = seen.ratios()
        assert (ratios > 0.03).all()
        assert (ratios < 3.5).all()
