"""Lines and areas on a camera's image: `foxglove.ImageAnnotations`, which viewers draw over the frame of their time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from cwcli.channels.published import Channel
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray, Int64Array, OutputField, Repeated, StreamedChannel, encode_strings

LINE_LOOP, LINE_STRIP = 2, 3
"""The kinds of lines: values of `foxglove.PointsAnnotation.Type`."""
IMAGE_WIDTH_PER_LINE_THICKNESS = 320.0
"""Width of the image per width of a line, both in pixels; chosen by eye."""
MIN_LINE_THICKNESS_PX = 2.0
"""Least width of a line in pixels; chosen by eye."""
Colour = Sequence[float]
"""A colour as red, green, blue and, where needed, alpha, each 0 to 1."""


@dataclass(frozen=True)
class ImageShape:
    """A line or an area on an image.

    Attributes:
        kind: `LINE_STRIP`, or `LINE_LOOP`, which is filled.
        points: Shape (k, 2): u, v in the pixels of the image.
        outline, fill: Colours; a fill of None is left out of the message.
    """

    kind: int
    points: FloatArray
    outline: Colour
    fill: Colour | None
    thickness_px: float


@dataclass(frozen=True)
class ImageLabel:
    """A word on the image.

    Attributes:
        at: u, v of its lower left corner, pixels.
        size_px: Height of its letters.
    """

    text: str
    at: tuple[float, float]
    colour: Colour
    size_px: float


def line_thickness_px(width_px: float) -> float:
    """The width in pixels of a line that is easily visible on an image of this width."""
    return max(float(width_px) / IMAGE_WIDTH_PER_LINE_THICKNESS, MIN_LINE_THICKNESS_PX)


def make_image_annotation_channel(
    channel: Channel,
    *,
    stamp_ns: Int64Array,
    log_time_ns: Int64Array,
    shapes: Callable[[int, int], Sequence[Sequence[ImageShape]]],
    labels: Callable[[int, int], Sequence[Sequence[ImageLabel]]] | None = None,
) -> StreamedChannel:
    """Make a channel of one annotation message a frame; messages are built while the log is written.

    Args:
        stamp_ns, log_time_ns: Shape (n,), those of the frames, by which viewers put both together.
        shapes: What is drawn on the frames `start` to `stop`; either all shapes of a channel have a fill or none.
        labels: The words on the frames `start` to `stop`; None for no words.
    """

    def build_fields_of_rows(start: int, stop: int) -> Mapping[str, OutputField]:
        drawn = shapes(start, stop)
        flat = [(stamp, shape) for stamp, each in zip(stamp_ns[start:stop], drawn, strict=True) for shape in each]
        points = np.concatenate([np.zeros((0, 2)), *(shape.points for _, shape in flat)])
        ends = np.cumsum([0, *(len(shape.points) for _, shape in flat)]).astype(np.int64)
        lines: dict[str, OutputField] = {
            "timestamp": np.array([stamp for stamp, _ in flat], np.int64),
            "type": np.array([shape.kind for _, shape in flat], np.int64),
            "points": Repeated(ends, {"x": points[:, 0], "y": points[:, 1]}),
            **_colour_fields("outline_color", [shape.outline for _, shape in flat]),
            **_colour_fields("fill_color", [shape.fill for _, shape in flat if shape.fill is not None]),
            "thickness": np.array([shape.thickness_px for _, shape in flat], np.float64),
        }
        counts = np.cumsum([0, *(len(each) for each in drawn)]).astype(np.int64)
        fields: dict[str, OutputField] = {"points": Repeated(counts, lines)}
        if labels is not None:
            fields["texts"] = _text_annotations_of_frames(stamp_ns[start:stop], labels(start, stop))
        return fields

    return StreamedChannel(channel.topic, channel.schema, log_time_ns, make_rows=build_fields_of_rows)


def _text_annotations_of_frames(stamp_ns: Int64Array, labels: Sequence[Sequence[ImageLabel]]) -> Repeated:
    flat = [label for each in labels for label in each]
    counts = [len(each) for each in labels]
    fields: dict[str, OutputField] = {
        "timestamp": np.repeat(stamp_ns, counts),
        "position.x": np.array([label.at[0] for label in flat], np.float64),
        "position.y": np.array([label.at[1] for label in flat], np.float64),
        "text": encode_strings(label.text for label in flat),
        "font_size": np.array([label.size_px for label in flat], np.float64),
        **_colour_fields("text_color", [label.colour for label in flat]),
    }
    return Repeated(np.cumsum([0, *counts]).astype(np.int64), fields)


def _colour_fields(name: str, values: Sequence[Colour]) -> dict[str, OutputField]:
    parts = np.array(values, np.float64).reshape(-1, 4)
    return {f"{name}.{part}": parts[:, k] for k, part in enumerate("rgba")} if len(parts) else {}
