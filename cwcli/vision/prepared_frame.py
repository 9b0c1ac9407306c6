"""What is done with a decoded frame before the search, in the decoding threads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from cwcli.vision.encoded import Image
from cwcli.vision.frames import DecodedFrame
from cwcli.vision.method import Method
from cwcli.vision.rectify import Rectifier


@dataclass(frozen=True)
class PreparedFrame:
    """What the decoding threads made of a frame: the image to be searched, and what the method computed of it."""

    grey: Image
    made: object = None
    colour: Image | None = None


def prepare_with(method: Method, rectifier: Rectifier | None) -> Callable[[DecodedFrame], object] | None:
    """What the decoding threads do with each frame (`PreparedFrame`); None: nothing is left to do."""
    if method.prepare is None and rectifier is None:
        return None

    def prepare(decoded: DecodedFrame) -> PreparedFrame:
        assert decoded.image is not None
        grey, colour = decoded.image, decoded.colour
        if rectifier is not None:
            size = decoded.width_px, decoded.height_px
            grey = rectifier.image(grey, size)
            colour = None if colour is None else rectifier.image(colour, size)
        return PreparedFrame(grey, None if method.prepare is None else method.prepare(grey), colour)

    return prepare
