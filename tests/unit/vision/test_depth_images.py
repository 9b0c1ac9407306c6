"""Depth and images with one colour for four pixels: against OpenCV and by hand, and damage as a reason."""

from __future__ import annotations

import struct

import cv2
import numpy as np
import pytest

from cwcli.vision.depth_images import scale_to_grey
from cwcli.vision.frames import decode_frame
from cwcli.vision.raw_images import RawImageError, decode_raw_as_colour, decode_raw_as_grey
from tests.unit.vision.fake_frames import FakeFrame, encoded, gradient

WIDTH, HEIGHT = 64, 48


def as_it_is(width_px: int, height_px: int) -> tuple[int, int]:
    return width_px, height_px


def nv(name: str, data: bytes) -> FakeFrame:
    return FakeFrame(data, width=WIDTH, height=HEIGHT, encoding=name, step=WIDTH)


@pytest.mark.parametrize("name", ["nv12", "nv21"])
def test_nv_image_has_its_luminance_and_its_colours(name: str) -> None:
    """A pure colour of full luminance: BT.601 in the range of video, y = 16 + 65.5 r + 128.6 g + 25 b."""
    y, u, v = 81, 90, 240  # red
    chroma = bytes([u, v] if name == "nv12" else [v, u]) * (WIDTH * HEIGHT // 4)
    frame = nv(name, bytes([y]) * (WIDTH * HEIGHT) + chroma)
    np.testing.assert_array_equal(decode_raw_as_grey(frame), np.full((HEIGHT, WIDTH), y))
    np.testing.assert_allclose(decode_raw_as_colour(frame)[5, 7], [0, 0, 255], atol=2)


def test_nv_image_without_its_colours_is_a_reason() -> None:
    with pytest.raises(RawImageError, match="fewer bytes"):
        decode_raw_as_colour(nv("nv12", bytes(WIDTH * HEIGHT)))
    odd = FakeFrame(bytes(33 * 49 * 2), width=33, height=49, encoding="nv12", step=33)
    with pytest.raises(RawImageError, match="odd number"):
        decode_raw_as_colour(odd)


def test_floats_are_scaled_and_what_is_none_is_black() -> None:
    depth = np.linspace(1.0, 9.0, WIDTH * HEIGHT, dtype=np.float32).reshape(HEIGHT, WIDTH)
    depth[0, 0], depth[1, 1] = np.nan, np.inf
    frame = FakeFrame(depth.tobytes(), width=WIDTH, height=HEIGHT, encoding="32FC1", step=4 * WIDTH)
    grey = decode_raw_as_grey(frame)
    assert (grey[0, 0], grey[1, 1], grey[0, 1], grey[-1, -1]) == (0, 0, 1, 255)
    np.testing.assert_array_equal(decode_raw_as_colour(frame)[:, :, 2], grey)


@pytest.mark.parametrize("values", [[np.nan, np.nan], [3.0, 3.0], [-np.inf, np.inf]])
def test_scaling_of_nothing(values: list[float]) -> None:
    expected = 1 if np.isfinite(values).any() else 0
    np.testing.assert_array_equal(scale_to_grey(np.array([values])), [[expected, expected]])


def compressed(name: str, values: np.ndarray, a: float = 0.0, b: float = 0.0) -> FakeFrame:
    done, png = cv2.imencode(".png", values)
    assert done
    return FakeFrame(struct.pack("<iff", 0, a, b) + png.tobytes(), format=name)


@pytest.mark.parametrize("name", ["16UC1; compressedDepth", "16UC1; compressedDepth png"])
def test_compressed_depth_of_whole_numbers(name: str) -> None:
    values = (np.arange(WIDTH * HEIGHT, dtype=np.uint16) * 20).reshape(HEIGHT, WIDTH)
    decoded = decode_frame(0, compressed(name, values), as_it_is)
    assert (decoded.rejection_reason, decoded.width_px, decoded.height_px) == ("", WIDTH, HEIGHT)
    np.testing.assert_array_equal(decoded.image, values // 256)
    colour = decode_frame(0, compressed(name, values), None).image
    assert colour is not None
    np.testing.assert_array_equal(colour[:, :, 0], values // 256)


def test_compressed_depth_of_real_numbers_is_turned_back() -> None:
    """Depth a / (value - b): with a = 1000 and b = 0, values of 1000 and 100 are 1 m and 10 m."""
    values = np.full((HEIGHT, WIDTH), 1000, np.uint16)
    values[10:20], values[30:] = 100, 0
    image = decode_frame(0, compressed("32FC1; compressedDepth png", values, 1000.0), as_it_is).image
    assert image is not None
    assert (image[0, 0], image[15, 0], image[40, 0]) == (1, 255, 0)


@pytest.mark.parametrize(
    ("name", "data", "reason"),
    [
        ("16UC1; compressedDepth rvl", encoded(gradient(), ".png"), "RVL"),
        ("16UC1; compressedDepth", encoded(gradient(), ".png"), "damaged"),
        ("16UC1; compressedDepth", b"", "neither JPEG, PNG nor WebP"),
    ],
)
def test_compressed_depth_that_is_none(name: str, data: bytes, reason: str) -> None:
    frame = FakeFrame(struct.pack("<iff", 0, 0.0, 0.0) + data if data else b"short", format=name)
    assert reason in decode_frame(0, frame, as_it_is).rejection_reason


@pytest.mark.parametrize(
    "name",
    [
        "jpeg",
        "jpg",
        "JPEG",
        "image/jpeg",
        "bgr8; jpeg compressed bgr8",
        "rgb8;jpeg compressed ",
        "mono8; png compressed",
        "",
    ],
)
def test_format_of_a_compressed_image_is_not_what_decides(name: str) -> None:
    image = decode_frame(0, FakeFrame(encoded(gradient(), ".jpg"), format=name), None).image
    np.testing.assert_array_equal(
        image, cv2.imdecode(np.frombuffer(encoded(gradient(), ".jpg"), np.uint8), cv2.IMREAD_COLOR)
    )
