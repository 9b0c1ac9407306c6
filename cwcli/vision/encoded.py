"""What goes into decoding, and what comes out."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.uint8]
"""Grey (height, width), or blue, green, red (height, width, 3)."""


class FrameLike(Protocol):
    """What decoding needs to know of a frame (`cwcli.logs.read.frames.Frame`)."""

    @property
    def log_time_ns(self) -> int: ...
    @property
    def stamp_ns(self) -> int | None: ...
    @property
    def format(self) -> str: ...
    @property
    def data(self) -> bytes | memoryview: ...
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    @property
    def encoding(self) -> str: ...
    @property
    def step(self) -> int: ...
    @property
    def is_video(self) -> bool: ...
