"""Decoding: every format against OpenCV's own conversions, damage, bombs, order and threads."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from cwcli.vision.frames import MAX_IMAGE_PIXELS, decode_frame, decode_frames
from cwcli.vision.image_header import read_image_header
from cwcli.vision.raw_images import BAYER_ENCODINGS, decode_raw_as_colour, decode_raw_as_grey
from tests.unit.vision.fake_frames import FakeFrame, encoded, gradient, png_header
from tests.unit.vision.h264_pcm import key_picture, parameters
from tests.unit.vision.video_clips import H265

ATOL_GREY = 1


def same_size(width_px: int, height_px: int) -> tuple[int, int]:
    return width_px, height_px


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".webp"])
@pytest.mark.parametrize("size", [(64, 48), (321, 37)])
def test_header_tells_kind_and_size(suffix: str, size: tuple[int, int]) -> None:
    header = read_image_header(encoded(gradient(*size), suffix))
    assert header is not None
    kind = {".jpg": "jpeg", ".png": "png", ".webp": "webp"}[suffix]
    assert (header.kind, header.width_px, header.height_px) == (kind, *size)


def test_header_of_a_progressive_jpeg_with_a_comment() -> None:
    data = encoded(gradient(), ".jpg", [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])
    commented = data[:2] + b"\xff\xfe\x00\x06abcd" + data[2:]
    header = read_image_header(commented)
    assert header is not None
    assert (header.width_px, header.height_px) == (64, 48)


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_header_tells_what_is_grey(suffix: str) -> None:
    for image, is_grey in ((gradient(), False), (gradient()[..., 0], True)):
        header = read_image_header(encoded(image, suffix))
        assert header is not None
        assert header.is_grey is is_grey


def test_a_frame_a_second_comes_in_colour_too() -> None:
    """At 0, 0.4, ... 2 s: the first, that at 1.2 s, and none before 2.2 s."""
    image = gradient(640, 480)
    data = encoded(image, ".jpg")
    frames = [FakeFrame(data, log_time_ns=k * 400_000_000) for k in range(6)]
    made = list(decode_frames(frames, wanted_size_of=lambda *_: (320, 240), colour_every_ns=10**9))
    assert [each.colour is not None for each in made] == [True, False, False, True, False, False]
    assert made[0].colour is not None
    expected = cv2.resize(image, (320, 240), interpolation=cv2.INTER_AREA)
    np.testing.assert_allclose(made[0].colour.astype(float), expected, atol=6.0)
    plain = list(decode_frames(frames, wanted_size_of=lambda *_: (320, 240)))
    assert all(each.colour is None for each in plain)
    np.testing.assert_array_equal(made[0].image, plain[0].image)


def test_raw_images_and_grey_ones_in_colour() -> None:
    image = gradient()
    raw = FakeFrame(image.tobytes(), encoding="bgr8", width=64, height=48, step=192)
    colour = decode_frame(0, raw, same_size, in_colour=True).colour
    np.testing.assert_array_equal(colour, image)
    grey = FakeFrame(image[..., 0].tobytes(), encoding="mono8", width=64, height=48, step=64)
    for frame in (grey, FakeFrame(encoded(image[..., 0], ".jpg"))):
        assert decode_frame(0, frame, same_size, in_colour=True).colour is None


@pytest.mark.parametrize("encoding", ["nv12", "NV21"])
@pytest.mark.parametrize(
    ("width_px", "height_px", "n_bytes"), [(65, 48, 65 * 72), (64, 49, 64 * 74), (64, 48, 64 * 60)]
)
def test_a_raw_image_without_usable_colours_is_grey(encoding: str, width_px: int, height_px: int, n_bytes: int) -> None:
    frame = FakeFrame(bytes([90]) * n_bytes, width=width_px, height=height_px, encoding=encoding)
    decoded = decode_frame(0, frame, same_size, in_colour=True)
    np.testing.assert_array_equal(decoded.image, np.full((height_px, width_px), 90))
    assert decoded.colour is None


@pytest.mark.parametrize("data", [b"", b"\xff\xd8\xff", b"\xff\xd8\xff\xe0\x00\x01", b"hello", b"\x89PNG\r\n\x1a\n"])
def test_header_of_rubbish_is_none(data: bytes) -> None:
    assert read_image_header(data) is None


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".webp"])
def test_compressed_image_decodes_to_grey(suffix: str) -> None:
    image = gradient()
    data = encoded(image, suffix)
    decoded = decode_frame(7, FakeFrame(memoryview(data), format="whatever"), same_size)
    assert (decoded.index, decoded.log_time_ns, decoded.stamp_ns) == (7, 5, 3)
    assert (decoded.width_px, decoded.height_px) == (64, 48)
    expected = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    np.testing.assert_array_equal(decoded.image, expected)


@pytest.mark.parametrize(
    ("size", "wanted"), [((1280, 960), (320, 240)), ((1280, 720), (320, 240)), ((400, 300), (320, 240))]
)
def test_reduced_decoding_is_near_the_mean_of_the_pixels(size: tuple[int, int], wanted: tuple[int, int]) -> None:
    image = gradient(*size)
    image = cv2.GaussianBlur(image, (0, 0), 8)
    decoded = decode_frame(0, FakeFrame(encoded(image, ".jpg", [cv2.IMWRITE_JPEG_QUALITY, 98])), lambda w, h: wanted)
    assert decoded.image is not None
    assert decoded.image.shape == wanted[::-1]
    assert (decoded.width_px, decoded.height_px) == size
    exact = cv2.resize(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), wanted, interpolation=cv2.INTER_AREA)
    assert np.abs(decoded.image.astype(int) - exact).mean() < 1.0


def raw(encoding: str, array: np.ndarray, *, padding: int = 0, width: int = 64) -> FakeFrame:
    rows = array.reshape(array.shape[0], -1).view(np.uint8)
    padded = np.hstack([rows, np.full((len(rows), padding), 99, np.uint8)])
    return FakeFrame(padded.tobytes(), width=width, height=len(array), encoding=encoding, step=padded.shape[1])


def grey_of(image: np.ndarray) -> np.ndarray:
    return cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)


@pytest.mark.parametrize("padding", [0, 10])
def test_packed_raw_images(padding: int) -> None:
    image = gradient()
    grey = grey_of(image)
    cases = {
        "bgr8": image,
        "rgb8": image[:, :, ::-1].copy(),
        "8UC3": image,
        "bgra8": cv2.cvtColor(image, cv2.COLOR_BGR2BGRA),
        "rgba8": cv2.cvtColor(image, cv2.COLOR_BGR2RGBA),
    }
    for encoding, array in cases.items():
        frame = raw(encoding, array, padding=padding)
        np.testing.assert_allclose(decode_raw_as_grey(frame), grey, atol=ATOL_GREY, err_msg=encoding)
        np.testing.assert_array_equal(decode_raw_as_colour(frame), image, err_msg=encoding)
    for encoding, array in {"mono8": grey, "8UC1": grey, "mono16": grey.astype("<u2") * 256 + 17}.items():
        frame = raw(encoding, array, padding=padding)
        np.testing.assert_array_equal(decode_raw_as_grey(frame), grey, err_msg=encoding)
        np.testing.assert_array_equal(
            decode_raw_as_colour(frame), np.repeat(grey[:, :, None], 3, axis=2), err_msg=encoding
        )


@pytest.mark.parametrize("encoding", sorted(BAYER_ENCODINGS))
def test_bayer_images_give_the_colours_of_a_uniform_image(encoding: str) -> None:
    blue_green_red = (40, 120, 220)
    mosaic = np.zeros((48, 64), np.uint8)
    order = encoding.removeprefix("bayer_")[:4]
    for k, letter in enumerate(order):
        mosaic[k // 2 :: 2, k % 2 :: 2] = blue_green_red["bgr".index(letter)]
    frame = raw(encoding, mosaic)
    np.testing.assert_allclose(
        decode_raw_as_colour(frame)[4:-4, 4:-4], np.broadcast_to(blue_green_red, (40, 56, 3)), atol=1
    )
    grey = 0.114 * 40 + 0.587 * 120 + 0.299 * 220
    np.testing.assert_allclose(decode_raw_as_grey(frame)[4:-4, 4:-4], grey, atol=1.5)


@pytest.mark.parametrize(("encoding", "place"), [("yuyv", 0), ("yuv422_yuy2", 0), ("uyvy", 1), ("yuv422", 1)])
def test_yuv422_images(encoding: str, place: int) -> None:
    luminance = grey_of(gradient())
    array = np.full((48, 64, 2), 128, np.uint8)  # without colour
    array[:, :, place] = luminance
    frame = raw(encoding, array)
    np.testing.assert_array_equal(decode_raw_as_grey(frame), luminance)
    colour = decode_raw_as_colour(frame)
    assert (np.ptp(colour.astype(int), axis=2) <= 1).all()


def test_damage_is_a_reason_not_an_error() -> None:
    jpeg, png = encoded(gradient(640, 480), ".jpg"), encoded(gradient(), ".png")
    cases = {
        "neither JPEG, PNG nor WebP": FakeFrame(b"not an image"),
        "cut short": FakeFrame(jpeg[: len(jpeg) // 2]),
        "damaged": FakeFrame(png[:40] + b"\x00" * 100 + png[140:]),
        "smaller than 32 x 32 pixels": FakeFrame(encoded(gradient(1, 1))),
        f"more than {MAX_IMAGE_PIXELS // 1_000_000} megapixels": FakeFrame(png_header(10_000, 10_000)),
        "one side more than 10 times as long as the other": FakeFrame(encoded(gradient(2000, 32))),
        "the encoding 64fc1 is not supported": FakeFrame(b"\x00" * 40_000, width=100, height=100, encoding="64FC1"),
        "fewer bytes than width, height and encoding need": FakeFrame(
            b"\x00" * 9, width=64, height=48, encoding="mono8"
        ),
        "the video format 'h266' is not known (known: h264, h265, hevc, vp9)": FakeFrame(
            b"\0" * 9, "h266", is_video=True
        ),
    }
    for reason, frame in cases.items():
        decoded = decode_frame(0, frame, same_size)
        assert decoded.image is None
        assert decoded.rejection_reason == reason


@pytest.mark.parametrize("encoding", ["yuyv", "uyvy", "bayer_rggb8", "rgb8", "mono16"])
def test_raw_images_of_odd_sizes_come_in_colour_too(encoding: str) -> None:
    width_px, height_px = 65, 49
    row_bytes = width_px * {"yuyv": 2, "uyvy": 2, "rgb8": 3, "mono16": 2}.get(encoding, 1)
    data = np.full(row_bytes * height_px, 128, np.uint8).tobytes()
    decoded = decode_frame(0, FakeFrame(data, width=width_px, height=height_px, encoding=encoding), None)
    assert decoded.image is not None
    assert decoded.image.shape == (height_px, width_px, 3)
    if encoding != "rgb8":
        assert np.abs(decoded.image.astype(int) - 128).max() <= 4


def test_bomb_is_not_decoded(monkeypatch: pytest.MonkeyPatch) -> None:
    def decode(*_: object) -> None:
        raise AssertionError("a picture of 3.6 billion pixels would be decoded")

    monkeypatch.setattr(cv2, "imdecode", decode)
    assert decode_frame(0, FakeFrame(png_header(60_000, 60_000)), None).image is None
    with pytest.raises(AssertionError, match="billion"):  # nothing else decodes
        decode_frame(0, FakeFrame(encoded(gradient())), None)


def test_frame_without_stamp_has_its_log_time() -> None:
    frame = FakeFrame(encoded(gradient()), stamp_ns=None)
    assert decode_frame(0, frame, same_size).stamp_ns == 5


@pytest.mark.parametrize("stamp_ns", [None, 0, -5, 2**63, 10**30, -(10**30)])
def test_stamp_that_is_no_time_gives_way_to_the_log_time(stamp_ns: int | None) -> None:
    decoded = decode_frame(0, FakeFrame(encoded(gradient()), stamp_ns=stamp_ns), same_size)
    assert decoded.stamp_ns == 5
    assert not decoded.has_stamp


@pytest.mark.parametrize("log_time_ns", [-1, 2**63, 2**64 - 1])
def test_log_time_that_is_no_time_is_a_reason(log_time_ns: int) -> None:
    frame = FakeFrame(encoded(gradient()), log_time_ns=log_time_ns)
    assert decode_frame(0, frame, same_size).rejection_reason == "log time before 1970 or after 2261"
    key = FakeFrame(parameters(4, 3) + key_picture(4, 3, 99), format="h264", log_time_ns=log_time_ns)
    assert [each.rejection_reason for each in decode_frames([key], wanted_size_of=same_size)] == [
        "log time before 1970 or after 2261"
    ]


def test_frames_come_in_order_with_what_was_prepared() -> None:
    frames = [FakeFrame(encoded(np.full((40, 40, 3), k, np.uint8)), log_time_ns=k) for k in range(30)]
    frames[4] = FakeFrame(b"rubbish", log_time_ns=4)
    decoded = list(
        decode_frames(
            frames, wanted_size_of=same_size, prepare=lambda frame: int(np.asarray(frame.image)[0, 0]) + 1, n_threads=3
        )
    )
    assert [each.index for each in decoded] == list(range(30))
    assert [each.prepared for each in decoded] == [None if k == 4 else k + 1 for k in range(30)]


def test_video_is_decoded_in_order_among_other_frames() -> None:
    still = encoded(np.full((96, 128), 200, np.uint8), ".jpg")
    data = [FakeFrame(b"\x00\x00\x00\x01\x09\x10", format="h264"), *(FakeFrame(clip, format="h265") for clip in H265)]
    decoded = list(decode_frames([*data, FakeFrame(still), *data[1:]], wanted_size_of=lambda w, h: (48, 32)))
    assert [each.index for each in decoded] == list(range(14))
    assert decoded[0].rejection_reason == "no picture comes out of the video"
    means = [float(each.image.mean()) for each in decoded[1:] if each.image is not None]
    assert np.allclose(means, [0, 40, 80, 120, 160, 200, 200, 0, 40, 80, 120, 160, 200], atol=3)
    assert {each.image.shape for each in decoded[1:7] if each.image is not None} == {(32, 48)}
    assert (decoded[1].width_px, decoded[1].height_px) == (96, 64)


def test_video_comes_in_colour_at_full_size() -> None:
    decoded = list(decode_frames([FakeFrame(clip, format="h265") for clip in H265], wanted_size_of=None))
    assert [each.image.shape for each in decoded if each.image is not None] == [(64, 96, 3)] * 6


def test_video_of_unusable_pictures_tells_why() -> None:
    tiny = parameters(1, 1) + key_picture(1, 1, 100)
    [decoded] = decode_frames([FakeFrame(tiny, format="h264")], wanted_size_of=same_size)
    assert decoded.rejection_reason == "smaller than 32 x 32 pixels"
