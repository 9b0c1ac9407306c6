"""Compressed video: each message gets its own picture, whatever is lost, damaged or held back."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from cwcli.errors import InputError
from cwcli.vision.encoded import Image
from cwcli.vision.frames import MAX_VIDEO_PIXELS
from cwcli.vision.video import CODEC_OF_VIDEO_FORMAT, decode_video, parameters_if_decodable_start
from tests.unit.vision import video_clips
from tests.unit.vision.h264_pcm import MB_PX, changed_picture, key_picture, parameters

W, H = 4, 3
"""Size of the pictures in macroblocks."""
MAX_PIXELS = 50_000_000
ATOL_GREY = 2
KEY_LUMA = 60
PERIOD = 10


@dataclass
class Message:
    data: bytes
    number: int = 0


def luma_of(k: int) -> int:
    return 80 + 7 * (k % 20)


def drive(n: int, width: int = W, height: int = H) -> list[bytes]:
    """Pictures of which every tenth is a key; each other one changes one macroblock, the next in turn."""
    out = []
    for k in range(n):
        since = k % PERIOD
        if since == 0:
            out.append(parameters(width, height) + key_picture(width, height, KEY_LUMA))
        else:
            out.append(changed_picture(width, height, since, since - 1, luma_of(k)))
    return out


def grey(luma: int) -> float:
    """Full-range grey of a luma sample (ITU-R BT.601: 16 is black, 235 is white)."""
    return (luma - 16) * 255 / 219


def expected(k: int, lost: Sequence[int] = ()) -> Image:
    """What picture k of `drive` shows; a lost one's macroblock stays as in the key picture."""
    since = k % PERIOD
    image = np.full((H * MB_PX, W * MB_PX), grey(KEY_LUMA))
    for step in range(1, since + 1):
        number = k - since + step
        if number not in lost:
            row, column = divmod(step - 1, W)
            block = np.s_[row * MB_PX : (row + 1) * MB_PX, column * MB_PX : (column + 1) * MB_PX]
            image[block] = grey(luma_of(number))
    return image


def decoded(
    data: Sequence[bytes], video_format: str = "h264", **settings: Any
) -> list[tuple[Message, Image | None, tuple[int, int]]]:
    messages = [Message(each, number) for number, each in enumerate(data)]
    results = list(decode_video(messages, video_format, **{"max_pixels": MAX_PIXELS} | settings))
    assert [message for message, _, _ in results] == messages, "every message once, in order"
    return results


def assert_shows(image: Image | None, wanted: Image) -> None:
    assert image is not None
    assert np.abs(image.astype(float) - wanted[:, :, None]).max() <= ATOL_GREY


def test_each_message_gets_its_picture() -> None:
    results = decoded(drive(120))
    assert {size for _, _, size in results} == {(W * MB_PX, H * MB_PX)}
    for k, (_, image, _) in enumerate(results):
        assert_shows(image, expected(k))


def test_the_pictures_behind_a_lost_message_are_those_of_their_own_messages() -> None:
    kept = [k for k in range(40) if k not in (13, 14)]
    every = drive(40)
    results = dict(zip(kept, decoded([every[k] for k in kept]), strict=True))
    for k in (*range(13), *range(20, 40)):  # from the next key picture on nothing is missing
        assert_shows(results[k][1], expected(k))
    for k in range(15, 20):
        image = results[k][1]
        assert image is not None
        row, column = divmod(k % PERIOD - 1, W)
        own = image[row * MB_PX : (row + 1) * MB_PX, column * MB_PX : (column + 1) * MB_PX]
        assert np.abs(own.astype(float) - grey(luma_of(k))).max() <= ATOL_GREY


@pytest.mark.parametrize(
    ("damage", "at"),
    [
        pytest.param(b"", 5, id="empty"),
        pytest.param(b"no video at all" * 20, 5, id="text"),
        pytest.param(b"\x00\x00\x00\x01" + b"\xff" * 300, 5, id="an unknown unit"),
        pytest.param(bytes(range(256)), 0, id="first of all"),
        pytest.param(b"\x00" * 64, 39, id="last"),
    ],
)
def test_a_message_without_a_picture_is_told_as_such(damage: bytes, at: int) -> None:
    data = drive(40)
    data.insert(at, damage)
    results = decoded(data)
    assert [k for k, (_, image, _) in enumerate(results) if image is None] == [at]
    for k, (_, image, _) in enumerate(results):
        if k != at:
            assert_shows(image, expected(k - (k > at)))


def test_nothing_comes_before_the_first_parameters() -> None:
    data = drive(32)[3:]
    results = decoded(data)
    assert [image is None for _, image, _ in results] == [True] * 7 + [False] * 22
    assert_shows(results[7][1], expected(10))


def test_a_long_way_to_the_first_key_picture_and_through_rubbish_is_no_end() -> None:
    later = drive(30)[1:10] * 40
    rubbish = [b"\x00\x00\x01\x41" + bytes([k % 251]) * 50 for k in range(200)]
    results = decoded([*later, *drive(10), *rubbish, *drive(10)])
    first, second = len(later), len(later) + 10 + len(rubbish)
    for k in range(10):
        assert_shows(results[first + k][1], expected(k))
        assert_shows(results[second + k][1], expected(k))


def test_parameters_of_their_own_are_a_message_without_a_picture() -> None:
    results = decoded([parameters(W, H), key_picture(W, H, KEY_LUMA)])
    assert results[0][1] is None
    assert_shows(results[1][1], expected(0))


def test_a_new_size_starts_a_new_stream() -> None:
    results = decoded([*drive(12), *drive(12, W + 1, H + 2), *drive(3)])
    sizes = [size for _, image, size in results if image is not None]
    assert sizes == [(64, 48)] * 12 + [(80, 80)] * 12 + [(64, 48)] * 3
    assert all(image is not None and image.shape[1::-1] == size for _, image, size in results)
    assert_shows(results[26][1], expected(2))


def test_a_picture_that_is_too_large_is_left_as_it_is() -> None:
    """The rest of its stream is left out, too; the next stream is decoded."""
    results = decoded([*drive(20, W + 2, H + 2), *drive(3)], max_pixels=(W + 2) * (H + 2) * MB_PX**2 - 1)
    assert [image is None for _, image, _ in results] == [True] * 20 + [False] * 3
    assert {size for _, _, size in results[:20]} == {((W + 2) * MB_PX, (H + 2) * MB_PX)}


def test_video_with_pictures_of_50_megapixels_is_decoded_up_to_its_first_one() -> None:
    """45 kB, of which each message would take a tenth of a second: counted, within the bounds."""
    side = 440
    changed = (changed_picture(side, side, k, 0, 90) for k in range(1, 100))
    messages = [parameters(side, side) + key_picture(4, 4, 100), *changed]
    results = decoded(messages, max_pixels=MAX_VIDEO_PIXELS)
    assert [image for _, image, _ in results] == [None] * 100
    assert {size for _, _, size in results} == {(side * MB_PX, side * MB_PX)}


def test_about_fifty_messages_are_read_ahead_however_many_there_are() -> None:
    taken = 0

    def messages() -> Iterator[Message]:
        nonlocal taken
        for k, data in enumerate(drive(400)):
            taken = k + 1
            yield Message(data, k)

    ahead = [taken - k for k, _ in enumerate(decode_video(messages(), "h264", max_pixels=MAX_PIXELS))]
    assert len(ahead) == 400
    assert max(ahead) <= 100


def test_what_the_messages_raise_is_handed_on() -> None:
    def messages() -> Iterator[Message]:
        yield from (Message(data) for data in drive(3))
        raise InputError("the log ends here")

    with pytest.raises(InputError, match="the log ends here"):
        list(decode_video(messages(), "h264", max_pixels=MAX_PIXELS))


def test_decoding_may_be_left_off() -> None:
    taken = []
    frames = decode_video(
        (Message(data) for data in drive(400) if not taken.append(data)),  # type: ignore[func-returns-value]
        "h264",
        max_pixels=MAX_PIXELS,
    )
    assert next(frames)[1] is not None
    frames.close()  # type: ignore[attr-defined]
    assert len(taken) <= 100  # as far as it reads ahead


@pytest.mark.parametrize(
    ("video_format", "clip"), [("h265", video_clips.H265), ("hevc", video_clips.H265), ("vp9", video_clips.VP9)]
)
def test_pictures_of_other_encoders(video_format: str, clip: list[bytes]) -> None:
    data = [clip[1], *clip, b"rubbish", *clip]  # the first builds on nothing
    results = decoded(data, video_format)
    assert [k for k, (_, image, _) in enumerate(results) if image is None] == [0, 7]
    for k in range(6):
        for _, image, size in (results[1 + k], results[8 + k]):
            assert image is not None and size == (96, 64)
            assert abs(float(image.mean()) - 40 * k) <= 3


@pytest.mark.parametrize(("codec", "clip"), [("h264", drive(6)), ("h265", video_clips.H265), ("vp9", video_clips.VP9)])
def test_a_stream_starts_at_its_parameters_only(codec: str, clip: list[bytes]) -> None:
    heads = [parameters_if_decodable_start(codec, data) for data in clip]
    assert heads[0] is not None and heads[1:] == [None] * 5
    assert parameters_if_decodable_start(codec, memoryview(clip[0])) == heads[0]
    for n in range(8):
        assert parameters_if_decodable_start(codec, clip[0][:n]) in (None, b"\x67", b"\x67\x42")


def test_the_head_of_vp9_tells_format_and_size() -> None:
    assert parameters_if_decodable_start("vp9", video_clips.VP9[0]) == b"0 0 0 0 96 x 64"


def test_a_format_without_a_decoder_is_told_before_anything_is_read() -> None:
    with pytest.raises(InputError, match="AV1") as caught:
        list(decode_video(iter([Message(b"")]), "av1", max_pixels=MAX_PIXELS, where="drive.mcap: /camera"))
    assert "H.264" in caught.value.hint
    assert set(CODEC_OF_VIDEO_FORMAT) == {"h264", "h265", "hevc", "vp9", "av1"}


def test_an_opencv_without_ffmpeg_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    import cv2

    monkeypatch.setattr(cv2.videoio_registry, "getStreamBufferedBackends", lambda: ())
    with pytest.raises(InputError, match="without FFmpeg"):
        list(decode_video([Message(b"")], "h264", max_pixels=MAX_PIXELS))
