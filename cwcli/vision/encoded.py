"""Types of encoded frames and of decoded images."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.uint8]
"""An image in grey (height, width), or in blue, green, red (height, width, 3)."""


class FrameLike(Protocol):
    """The properties of an encoded frame that decoding needs (`cwcli.logs.read.frames.Frame`)."""

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
