"""Frames as the log's reader gives them, made by hand."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

import cv2
import numpy as np


@dataclass(frozen=True)
class FakeFrame:
    data: bytes | memoryview
    format: str = ""
    width: int = 0
    height: int = 0
    encoding: str = ""
    step: int = 0
    log_time_ns: int = 5
    stamp_ns: int | None = 3
    is_video: bool = False


def encoded(image, suffix=".png", options=()):
    done, data = cv2.imencode(suffix, image, list(options))
    assert done
    return data.tobytes()


def png_header(width_px, height_px):
    """The start of a PNG that declares a size and holds nothing else."""
    head = b"IHDR" + struct.pack(">IIBBBBB", width_px, height_px, 8, 2, 0, 0, 0)
    start = struct.pack(">I", len(head) - 4) + head + struct.pack(">I", zlib.crc32(head))
    end = bytes(4) + b"IEND" + struct.pack(">I", zlib.crc32(b"IEND"))
    return b"\x89PNG\r\n\x1a\n" + start + end


def gradient(width_px=64, height_px=48):
    """A colour image without sharp edges."""
    v, u = np.mgrid[0:height_px, 0:width_px]
    return np.stack([u * 3, v * 4, 255 - u * 2], axis=-1).astype(np.uint8)
