"""Preparation of decoded frames for the search, in the decoding threads: rectifying, and the method's own part."""

from __future__ import annotations

from collections.abc import Callable

from cwcli.lazy_dataclass import dataclass
from cwcli.vision.encoded import Image
from cwcli.vision.frames import DecodedFrame
from cwcli.vision.method import Method
from cwcli.vision.rectify import Rectifier


@dataclass(frozen=True)
class PreparedFrame:
    """A prepared frame: the image to be searched, what the method computed of it, and the image in colour."""

    grey: Image
    method_result: object = None
    colour: Image | None = None


def make_frame_preparer(method: Method, rectifier: Rectifier | None) -> Callable[[DecodedFrame], object] | None:
    """A function that prepares each decoded frame for a method (`PreparedFrame`); None where there is nothing to do."""
    if method.prepare is None and rectifier is None:
        return None

    def rectify_and_scale_frame(decoded: DecodedFrame) -> PreparedFrame:
        assert decoded.image is not None
        grey, colour = decoded.image, decoded.colour
        if rectifier is not None:
            size = decoded.width_px, decoded.height_px
            grey = rectifier.rectify_image(grey, size)
            colour = None if colour is None else rectifier.rectify_image(colour, size)
        return PreparedFrame(grey, None if method.prepare is None else method.prepare(grey), colour)

    return rectify_and_scale_frame
