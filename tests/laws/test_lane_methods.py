"""Laws that every registered lane method obeys."""

from __future__ import annotations

from dataclasses import asdict, replace

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from cwcli.vision.boundary import Boundary
from cwcli.vision.camera import Camera, Mounting, default_camera
from cwcli.vision.method import LaneFit, LaneFrame, LaneSearch
from cwcli.vision.methods import METHODS, methods_without_model
from tests.set_frames import render_set_frame
from tests.unit.vision.lane_scene import mounted, score

Grey = npt.NDArray[np.uint8]
STEP_NS = 100_000_000
N_FRAMES = 12
"""Of a standing camera: as many as a method that searches by chance needs to find a lane that is there."""
NOISE_GREY = 3.0
SCENES = [render_set_frame("good", index) for index in range(10)]

every_method = pytest.mark.parametrize("name", methods_without_model())


def prepared(name: str, image: Grey) -> Grey:
    """A camera's image in the size that the method searches, read-only."""
    height, width = image.shape
    grey = np.array(cv2.resize(image, METHODS[name].search_size(width, height), interpolation=cv2.INTER_AREA), np.uint8)
    grey.setflags(write=False)
    return grey


def step(name: str, search: LaneSearch, image: Grey, camera: Camera, number: int = 0) -> LaneFit:
    """The next frame of a search, brought to the size that the method asks for."""
    grey = prepared(name, image)
    seen = camera.with_image_size(grey.shape[1], grey.shape[0])
    return search.step(LaneFrame(grey, seen, number * STEP_NS, number, speed_mps=0.0, yaw_rate_radps=0.0))


def watched(name: str, image: Grey, camera: Camera, *, offset_grey: float = 0.0, seed: int = 0) -> LaneFit:
    """What is found after some frames of one view, each with its own noise."""
    search, rng = METHODS[name].make(seed), np.random.default_rng(1)
    for number in range(N_FRAMES):
        noisy = image + offset_grey + rng.normal(0.0, NOISE_GREY, image.shape)
        fit = step(name, search, np.clip(noisy, 0, 255).astype(np.uint8), camera, number)
    return fit


def mirrored(boundary: Boundary, width_px: int) -> Boundary:
    """The boundary in the mirrored image, whose columns count from the other side."""
    return replace(boundary, a=-boundary.a, b=-boundary.b, c=width_px + 1 - boundary.c)


def assert_same(one: LaneFit, other: LaneFit) -> None:
    """Every number of two fits is the same, arrays' and NaN as well, which `==` can't tell."""
    np.testing.assert_equal(asdict(one), asdict(other))


@every_method
def test_what_is_right_is_right_in_the_mirror_and_in_other_light(name: str) -> None:
    camera = mounted()
    right = 0
    for scene in SCENES:
        if not score(watched(name, scene.grey, camera), scene.truth).is_correct:
            continue
        right += 1
        seen = watched(name, scene.grey[:, ::-1], replace(camera, cx=camera.width_px - 1 - camera.cx))
        back = LaneFit(mirrored(seen.right, camera.width_px), mirrored(seen.left, camera.width_px))
        assert score(back, scene.truth).is_correct
        for offset_grey in (-15.0, 25.0):
            assert score(watched(name, scene.grey, camera, offset_grey=offset_grey), scene.truth).is_correct
    assert right >= 8


@every_method
def test_the_same_frames_and_seed_give_the_same_lane(name: str) -> None:
    for seed in (0, 2**64 - 1):
        one, other = (watched(name, SCENES[0].grey, mounted(), seed=seed) for _ in range(2))
        assert_same(one, other)


@every_method
def test_one_search_knows_nothing_of_another(name: str) -> None:
    alone = [watched(name, scene.grey, mounted()) for scene in SCENES[:2]]
    searches = [METHODS[name].make(0) for _ in range(2)]
    rngs = [np.random.default_rng(1) for _ in range(2)]
    for number in range(N_FRAMES):
        fits = []
        for scene, search, rng in zip(SCENES, searches, rngs, strict=False):
            noisy = scene.grey + rng.normal(0.0, NOISE_GREY, scene.grey.shape)
            fits.append(step(name, search, np.clip(noisy, 0, 255).astype(np.uint8), mounted(), number))
    for fit, its in zip(fits, alone, strict=True):
        assert_same(fit, its)


@pytest.mark.parametrize("grey", [0, 1, 128, 255])
@every_method
def test_nothing_is_found_on_a_blank_frame(name: str, grey: int) -> None:
    search = METHODS[name].make(0)
    for number in range(3):
        fit = step(name, search, np.full((240, 320), grey, np.uint8), mounted(), number)
        assert not fit.left.found
        assert not fit.right.found


@every_method
def test_a_lane_is_found_after_blank_frames(name: str) -> None:
    search, scene = METHODS[name].make(0), SCENES[0]
    for number in range(3):
        step(name, search, np.zeros((240, 320), np.uint8), mounted(), number)
    for number in range(3, 3 + 4 * N_FRAMES):
        fit = step(name, search, scene.grey, mounted(), number)
    assert score(fit, scene.truth).is_correct


@pytest.mark.parametrize("name", [name for name in methods_without_model() if METHODS[name].prepare is not None])
def test_what_was_prepared_changes_nothing(name: str) -> None:
    method = METHODS[name]
    assert method.prepare is not None
    grey = prepared(name, SCENES[0].grey)
    given = LaneFrame(grey, mounted(), 0, 0)
    with_it = method.make(0).step(replace(given, prepared=method.prepare(grey)))
    assert_same(with_it, method.make(0).step(given))


@pytest.mark.parametrize("name", [name for name in methods_without_model() if METHODS[name].carry is not None])
def test_the_lane_of_a_standing_car_is_carried_where_it_is(name: str) -> None:
    carry, search, scene = METHODS[name].carry, METHODS[name].make(0), SCENES[0]
    assert carry is not None
    for number in range(N_FRAMES):
        step(name, search, scene.grey, mounted(), number)
    assert score(carry(search, N_FRAMES * STEP_NS, 0.0, 0.0), scene.truth).is_correct


@pytest.mark.parametrize("size", [(32, 32), (33, 47), (320, 32), (321, 241), (641, 359), (1281, 719), (3840, 2160)])
@every_method
def test_a_frame_of_any_size_is_searched(name: str, size: tuple[int, int]) -> None:
    width, height = size
    search, rng = METHODS[name].make(0), np.random.default_rng(3)
    camera = default_camera(width, height, Mounting())
    for number in range(2):
        fit = step(name, search, rng.integers(0, 256, (height, width), np.uint8), camera, number)
        for side in (fit.left, fit.right):
            assert np.isnan(side.probability) or 0.0 <= side.probability <= 1.0
            assert np.isfinite([side.a, side.b, side.c]).all() or not side.found
