"""The messages at which decoding of a video stream may start: those with the stream's parameters.

Sources: ITU-T H.264 and H.265, table 7-1 (types of NAL units) and annex B (start codes); VP9 bitstream specification,
version 0.7, section 6.2 (uncompressed header).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field

from cwcli.lazy_dataclass import dataclass

NAL_START_CODE = b"\x00\x00\x01"
"""Bytes before each NAL unit (annex B)."""
H264_SPS_TYPE, H264_SLICE_TYPES = 7, range(1, 6)
"""Types of H.264 NAL units: sequence parameter sets, and slices (table 7-1)."""
H265_SPS_TYPE, H265_SLICE_TYPES = 33, range(32)
"""Types of H.265 NAL units: sequence parameter sets, and slices (table 7-1)."""
VP9_FRAME_MARKER, VP9_SYNC_CODE, VP9_RGB_COLOUR_SPACE = 2, 0x498342, 7
"""Frame marker, synchronisation code and RGB colour space in the header of a VP9 frame (section 6.2)."""


def parameters_if_decodable_start(codec: str, data: bytes | memoryview) -> bytes | None:
    """Parameters that identify a stream, if decoding may start at this message, else None.

    Args:
        codec: `h264`, `h265` or `vp9`.
        data: A message: NAL units with start codes, or a VP9 frame.

    Returns:
        The sequence parameter sets of the message; of a VP9 key frame its format and size.
    """
    if codec == "vp9":
        return _vp9_key_frame_format(bytes(data[:16]))
    parameters = b"".join(_iter_parameter_sets(codec, bytes(data)))
    return parameters or None


def _iter_parameter_sets(codec: str, data: bytes) -> Iterator[bytes]:
    """The sequence parameter sets before the first slice; they can't come later."""
    at = data.find(NAL_START_CODE)
    while 0 <= at < len(data) - len(NAL_START_CODE):
        begin = at + len(NAL_START_CODE)
        first = data[begin]
        kind = first & 0x1F if codec == "h264" else first >> 1 & 0x3F
        if kind in (H264_SLICE_TYPES if codec == "h264" else H265_SLICE_TYPES):
            return
        at = data.find(NAL_START_CODE, begin)
        if kind == (H264_SPS_TYPE if codec == "h264" else H265_SPS_TYPE):
            yield data[begin : at if at >= 0 else len(data)].rstrip(b"\x00")


@dataclass
class _BitReader:
    """Reads numbers of any length from a bit string, first bit first."""

    data: bytes
    at: int = field(default=0)

    def read_bits(self, n_bits: int) -> int:
        """The next n bits as a number; zeros behind the end."""
        value = 0
        for position in range(self.at, self.at + n_bits):
            byte = self.data[position >> 3] if position >> 3 < len(self.data) else 0
            value = value << 1 | byte >> (7 - position % 8) & 1
        self.at += n_bits
        return value


def _vp9_key_frame_format(data: bytes) -> bytes | None:
    """Format and size of a VP9 key frame as text; None for other frames."""
    bits = _BitReader(data)
    if bits.read_bits(2) != VP9_FRAME_MARKER:
        return None
    profile = bits.read_bits(1) | bits.read_bits(1) << 1
    bits.read_bits(1 if profile == 3 else 0)
    is_repeated, is_inter = bits.read_bits(1), bits.read_bits(1)
    bits.read_bits(2)
    if is_repeated or is_inter or bits.read_bits(24) != VP9_SYNC_CODE:
        return None
    depth = bits.read_bits(1) if profile >= 2 else 0
    color_space = bits.read_bits(3)
    has_subsampling = profile in (1, 3)
    layout = bits.read_bits(
        (1 if has_subsampling else 0) if color_space == VP9_RGB_COLOUR_SPACE else (4 if has_subsampling else 1)
    )
    width, height = bits.read_bits(16) + 1, bits.read_bits(16) + 1
    if bits.at > 8 * len(data):
        return None
    return f"{profile} {depth} {color_space} {layout} {width} x {height}".encode()
