"""Decompresses CDR messages that rosbag2 has compressed one by one (`compression_mode: message`).

A CDR message begins with a zero byte, a zstd frame with its own four bytes, so that no setting has to be known:
https://github.com/ros2/rosbag2/tree/rolling/rosbag2_compression
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from cwcli.logs.codecs.column_buffers import Payloads

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
"""The first bytes of a zstd frame (RFC 8878, 3.1.1)."""
MAX_DECOMPRESSED_MESSAGE_BYTES = 1 << 26
"""The greatest decompressed size of a message in bytes (64 MiB). Chosen by hand: a 4K image of three colours has
25 MB."""
MAX_DECOMPRESSED_BATCH_BYTES, MAX_BATCH_COMPRESSION_RATIO = 1 << 28, 64
"""The messages of a batch may decompress to this number of bytes (256 MiB) plus this multiple of their size. Further
messages stay compressed, and are counted as undecodable. Chosen by hand."""
DECOMPRESSED_PART_BYTES = 1 << 24
"""The size in bytes (16 MiB) from which decompressed messages are passed on as one part. Chosen by hand."""


def iter_decompressed_parts(payloads: Payloads) -> Iterator[Payloads]:
    """Yield the messages in parts, zstd frames decompressed; a frame that can't be decompressed stays unchanged.

    If no message is compressed, all messages are one part.
    """
    if not zstd_message_mask(payloads).any():
        yield payloads
        return
    left_bytes = MAX_DECOMPRESSED_BATCH_BYTES + MAX_BATCH_COMPRESSION_RATIO * payloads.n_bytes
    pieces: list[bytes] = []
    n_bytes = 0
    data = payloads.data.data
    for start, end in zip(payloads.starts.tolist(), payloads.ends.tolist(), strict=True):
        piece = decompress_message(data[start:end], min(left_bytes, MAX_DECOMPRESSED_MESSAGE_BYTES))
        left_bytes = max(left_bytes - len(piece), 0)
        pieces.append(piece)
        n_bytes += len(piece)
        if n_bytes >= DECOMPRESSED_PART_BYTES:
            yield _join_messages(pieces)
            pieces, n_bytes = [], 0
    if pieces:
        yield _join_messages(pieces)


def zstd_message_mask(payloads: Payloads) -> npt.NDArray[np.bool_]:
    """Return the mask (n,) of messages that begin like a zstd frame."""
    packed = np.ones(len(payloads), np.bool_)
    for k, octet in enumerate(ZSTD_MAGIC) if len(payloads.data) else ():
        packed &= payloads.data.take(payloads.starts + k, mode="clip") == octet
    return packed & (payloads.ends - payloads.starts >= len(ZSTD_MAGIC))


def _join_messages(pieces: list[bytes]) -> Payloads:
    """Concatenate messages."""
    ends = np.cumsum([len(piece) for piece in pieces])
    starts = ends - np.array([len(piece) for piece in pieces])
    return Payloads(np.frombuffer(b"".join(pieces), np.uint8), starts, ends)


def decompress_message(payload: memoryview | bytes, max_bytes: int = MAX_DECOMPRESSED_MESSAGE_BYTES) -> bytes:
    """Return a message, decompressed if it is a zstd frame that declares at most `max_bytes`, else unchanged."""
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
