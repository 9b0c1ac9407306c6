"""Kind and size of an encoded image from its first bytes, before a decoder is let at it."""

from __future__ import annotations

import struct

from cwcli.lazy_dataclass import dataclass

Bytes = bytes | memoryview

PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
"""First bytes of a PNG file (PNG specification, 5.2)."""
JPEG_START_BYTES = b"\xff\xd8\xff"
"""First bytes of a JPEG file: start of image, and the next marker's first byte (ITU-T T.81, annex B)."""
JPEG_END_MARKER = b"\xff\xd9"
"""Marker at the end of a JPEG image (ITU-T T.81, annex B)."""
PNG_END_CHUNK_TYPE = b"IEND"
"""Type of the last chunk of a PNG file (PNG specification, 11.2)."""
_GREY_PNG_COLOUR_TYPES = (b"\x00", b"\x04")
"""Colour types of grey PNG images: without and with transparency."""
JPEG_SCAN_MARKER = b"\xff\xda"
"""Marker before each scan of a JPEG; the data of a scan can't hold it (ITU-T T.81, annex B)."""
MAX_JPEG_SCANS = 50
"""Greatest number of scans of a JPEG that is decoded. Chosen by hand: progressive pictures have about ten, and
each scan costs time in every block of the picture, however short it is."""
PNG_HEADER_BYTES = 33
"""Number of bytes of a PNG's magic and first chunk (PNG specification, 5.2 and 11.2.2)."""
PNG_CHUNK_FRAME_BYTES = 12
"""Number of bytes around the data of a PNG's chunk: length, type and CRC (PNG specification, 5.3)."""
PNG_DATA_CHUNK_TYPE = b"IDAT"
"""Type of the chunks of a PNG that hold its pixels (PNG specification, 11.2.4)."""
MAX_PNG_CHANNELS, MAX_PNG_SAMPLE_BYTES = 4, 2
"""Greatest number of channels of a PNG, and of bytes of a sample (PNG specification, 11.2.2)."""
MAX_BYTES_OF_SMALL_PNG_BEYOND_ITS_PIXELS = 10_000
"""Bytes that a small PNG may hold beyond its pixels: compression makes random data a little longer. Chosen by hand."""
_START_OF_FRAME_MARKERS = frozenset({*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC})
"""Second bytes of the markers that start a JPEG frame and hold its size (ITU-T T.81, table B.1)."""
_MARKERS_WITHOUT_LENGTH = frozenset({0x01, *range(0xD0, 0xD8)})
"""Second bytes of JPEG markers that no length follows (ITU-T T.81, table B.1)."""


@dataclass(frozen=True)
class ImageHeader:
    """Kind (`jpeg`, `png`, `webp`) and size in pixels as the file declares it; whether it is known to be grey."""

    kind: str
    width_px: int
    height_px: int
    is_grey: bool = False


JPEG_TAIL_BYTES = 256
"""Number of bytes at the end of a JPEG in which its end marker is looked for first. Chosen by hand; not fitted."""


def read_image_header(data: Bytes) -> ImageHeader | None:
    """The header of a JPEG, PNG or WebP image; None if it is none of them or is damaged before its size."""
    head = bytes(data[:32])
    if head.startswith(JPEG_START_BYTES):
        return _read_jpeg_header(data)
    if head.startswith(PNG_MAGIC) and head[12:16] == b"IHDR" and len(head) >= 24:
        width_px, height_px = struct.unpack(">II", head[16:24])
        return ImageHeader("png", width_px, height_px, is_grey=head[25:26] in _GREY_PNG_COLOUR_TYPES)
    if head[:4] == b"RIFF" and head[8:12] == b"WEBP" and len(head) >= 30:
        return _read_webp_header(head)
    return None


def excess_data_reason_or_empty(data: Bytes, header: ImageHeader) -> str:
    """Why a picture takes far more work than one of its size, or "": the data of a PNG unpack to any length, and a JPEG
    repeats its scans."""
    if header.kind == "jpeg" and bytes(data).count(JPEG_SCAN_MARKER) > MAX_JPEG_SCANS:
        return f"more than {MAX_JPEG_SCANS} scans"
    if header.kind == "png":
        row_bytes = 1 + header.width_px * MAX_PNG_CHANNELS * MAX_PNG_SAMPLE_BYTES
        max_bytes = header.height_px * row_bytes + MAX_BYTES_OF_SMALL_PNG_BEYOND_ITS_PIXELS
        if len(data) > max_bytes and _count_png_data_bytes(data) > max_bytes:
            return "more data than a picture of its size holds"
    return ""


def _count_png_data_bytes(data: Bytes) -> int:
    n_bytes, at = 0, PNG_HEADER_BYTES
    while at + PNG_CHUNK_FRAME_BYTES <= len(data):
        length = int.from_bytes(data[at : at + 4], "big")
        n_bytes += length if data[at + 4 : at + 8] == PNG_DATA_CHUNK_TYPE else 0
        at += length + PNG_CHUNK_FRAME_BYTES
    return n_bytes


def has_image_end(data: Bytes, image_format: str) -> bool:
    """Whether the image's end is there; OpenCV fills what is missing of a cut JPEG with grey and says nothing."""
    if image_format == "jpeg":
        return JPEG_END_MARKER in bytes(data[-JPEG_TAIL_BYTES:]) or bytes(data).rfind(JPEG_END_MARKER) > 0
    if image_format == "png":
        return bytes(data[-64:]).rfind(PNG_END_CHUNK_TYPE) >= 0
    return len(data) >= 8 + int.from_bytes(data[4:8], "little")


def _read_jpeg_header(data: Bytes) -> ImageHeader | None:
    """Read the header of a JPEG image: walk its segments up to the start of frame."""
    at = 2
    while at + 4 <= len(data):
        if data[at] != 0xFF:
            return None
        marker = data[at + 1]
        if marker == 0xFF:  # fill byte
            at += 1
        elif marker in _MARKERS_WITHOUT_LENGTH:
            at += 2
        elif marker in _START_OF_FRAME_MARKERS:
            if at + 9 > len(data):
                return None
            height_px, width_px = struct.unpack(">HH", bytes(data[at + 5 : at + 9]))
            return ImageHeader("jpeg", width_px, height_px, is_grey=data[at + 9 : at + 10] == b"\x01")
        else:
            length = int.from_bytes(data[at + 2 : at + 4], "big")
            if length < 2:
                return None
            at += 2 + length
    return None


def _read_webp_header(head: bytes) -> ImageHeader | None:
    """Read the header of a lossy, lossless or extended WebP image (RFC 9649)."""
    kind = head[12:16]
    if kind == b"VP8 ":
        width_px, height_px = struct.unpack("<HH", head[26:30])
        return ImageHeader("webp", width_px & 0x3FFF, height_px & 0x3FFF)
    if kind == b"VP8L":
        bits = int.from_bytes(head[21:25], "little")
        return ImageHeader("webp", (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1)
    if kind == b"VP8X":
        width_px, height_px = int.from_bytes(head[24:27], "little"), int.from_bytes(head[27:30], "little")
        return ImageHeader("webp", width_px + 1, height_px + 1)
    return None
