"""Encoded pictures as the blocks of a Matroska file without an end, so that a demuxer hands them on one by one.

Of the format only what a single video track needs: each picture is a cluster with one block and its time. A time is all
that ties a decoded picture to the message that it came in, whatever was lost between.

Source: RFC 9559 (Matroska), RFC 8794 (EBML).
"""

from __future__ import annotations

from cwcli.signals.units import NS_PER_MS

BLOCK_INTERVAL_MS = 40
"""Time between two blocks in milliseconds. Demuxers take it for a frame rate; it says nothing of the camera's."""

MATROSKA_CODEC_IDS = {"h264": "V_MPEG4/ISO/AVC", "h265": "V_MPEGH/ISO/HEVC", "vp9": "V_VP9", "av1": "V_AV1"}
"""Name of each codec in Matroska. The pictures stay as they are (H.264 and H.265 with start codes, Annex B)."""

_EBML, _DOC_TYPE, _DOC_TYPE_VERSION, _DOC_TYPE_READ_VERSION = "1A45DFA3", "4282", "4287", "4285"
"""Identifiers of the elements of an EBML header (RFC 8794)."""
_SEGMENT, _INFO, _TIMESTAMP_SCALE, _MUXING_APP, _WRITING_APP = "18538067", "1549A966", "2AD7B1", "4D80", "5741"
"""Identifiers of the segment and of the elements that describe it (RFC 9559)."""
_TRACKS, _TRACK_ENTRY, _TRACK_NUMBER, _TRACK_UID, _TRACK_TYPE = "1654AE6B", "AE", "D7", "73C5", "83"
"""Identifiers of the elements of a track (RFC 9559)."""
_CODEC_ID, _VIDEO, _PIXEL_WIDTH, _PIXEL_HEIGHT = "86", "E0", "B0", "BA"
"""Identifiers of the elements of a video track (RFC 9559)."""
_CLUSTER, _TIMESTAMP, _SIMPLE_BLOCK = "1F43B675", "E7", "A3"
"""Identifiers of a cluster, of its time and of its picture (RFC 9559)."""

UNKNOWN_ELEMENT_SIZE = b"\x01" + b"\xff" * 7
"""Size of an element whose end is not known yet (RFC 8794, 6.2)."""
VIDEO_TRACK_TYPE = 1
"""Number for a video track in Matroska's track type (RFC 9559)."""
DECLARED_PICTURE_SIDE_PX = 16
"""Width and height that the track declares: the format wants them, but the pictures hold their own."""


def encode_matroska_start(codec: str) -> bytes:
    """The bytes of a Matroska file before its first block.

    Args:
        codec: `h264`, `h265`, `vp9` or `av1`.
    """
    video = _encode_element(_PIXEL_WIDTH, _encode_number(DECLARED_PICTURE_SIDE_PX)) + _encode_element(
        _PIXEL_HEIGHT, _encode_number(DECLARED_PICTURE_SIDE_PX)
    )
    track = (
        _encode_element(_TRACK_NUMBER, _encode_number(1))
        + _encode_element(_TRACK_UID, _encode_number(1))
        + _encode_element(_TRACK_TYPE, _encode_number(VIDEO_TRACK_TYPE))
        + _encode_element(_CODEC_ID, MATROSKA_CODEC_IDS[codec].encode())
        + _encode_element(_VIDEO, video)
    )
    info = (
        _encode_element(_TIMESTAMP_SCALE, _encode_number(NS_PER_MS))
        + _encode_element(_MUXING_APP, b"cwcli")
        + _encode_element(_WRITING_APP, b"cwcli")
    )
    head = (
        _encode_element(_DOC_TYPE, b"matroska")
        + _encode_element(_DOC_TYPE_VERSION, _encode_number(4))
        + _encode_element(_DOC_TYPE_READ_VERSION, _encode_number(2))
    )
    segment = bytes.fromhex(_SEGMENT) + UNKNOWN_ELEMENT_SIZE
    return (
        _encode_element(_EBML, head)
        + segment
        + _encode_element(_INFO, info)
        + _encode_element(_TRACKS, _encode_element(_TRACK_ENTRY, track))
    )


def encode_matroska_block(number: int, data: bytes | memoryview) -> bytes:
    """The bytes of one encoded picture; its time is `number * BLOCK_INTERVAL_MS`."""
    block = b"\x81\x00\x00\x80" + data  # track 1, at the cluster's time, a picture to start from
    return _encode_element(
        _CLUSTER,
        _encode_element(_TIMESTAMP, _encode_number(number * BLOCK_INTERVAL_MS)) + _encode_element(_SIMPLE_BLOCK, block),
    )


def _encode_element(identifier: str, content: bytes) -> bytes:
    """The bytes of an EBML element: identifier, size in eight bytes, content."""
    return bytes.fromhex(identifier) + (len(content) | 1 << 56).to_bytes(8, "big") + content


def _encode_number(value: int) -> bytes:
    """A whole number as the content of an EBML element, eight bytes."""
    return value.to_bytes(8, "big")
