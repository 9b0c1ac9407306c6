"""CDR messages that rosbag2 has compressed one by one (`compression_mode: message`): unpacked before they are decoded.

A CDR message begins with a zero byte, a zstd frame with four bytes of its own, so that no setting has to be known:
https://github.com/ros2/rosbag2/tree/rolling/rosbag2_compression
"""

from __future__ import annotations

import numpy as np

from cwcli.logs.codecs.slots import Payloads

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
MAX_MESSAGE_BYTES = 1 << 26
"""What a message may unpack to, 64 MB; one of 4K pixels and three colours has 25 MB."""
MAX_BYTES = 1 << 28
"""What the messages that are decoded at once may unpack to. The others stay packed, and are counted as undecodable."""


def unpacked(payloads: Payloads) -> Payloads:
    """The messages with those unpacked that are zstd frames; what can't be unpacked stays as it is."""
    if not len(payloads.data) or not (payloads.data.take(payloads.starts, mode="clip") == ZSTD_MAGIC[0]).any():
        return payloads
    left_bytes = MAX_BYTES
    pieces: list[bytes] = []
    data = payloads.data.data
    for start, end in zip(payloads.starts.tolist(), payloads.ends.tolist(), strict=True):
        pieces.append(unpacked_message(data[start:end], min(left_bytes, MAX_MESSAGE_BYTES)))
        left_bytes = max(left_bytes - len(pieces[-1]), 0)
    ends = np.cumsum([len(piece) for piece in pieces])
    starts = ends - np.array([len(piece) for piece in pieces])
    return Payloads(np.frombuffer(b"".join(pieces), np.uint8), starts, ends)


def unpacked_message(payload: memoryview | bytes, max_bytes: int = MAX_MESSAGE_BYTES) -> bytes:
    """A message, unpacked where it is a zstd frame that says how much is in it, at most `max_bytes`."""
    found = bytes(payload)
    if not found.startswith(ZSTD_MAGIC):
        return found
    import zstandard

    try:
        size = zstandard.get_frame_parameters(found).content_size
        if size in (zstandard.CONTENTSIZE_UNKNOWN, zstandard.CONTENTSIZE_ERROR) or size > max_bytes:
            return found
        return zstandard.ZstdDecompressor().decompress(found)
    except zstandard.ZstdError:
        return found
