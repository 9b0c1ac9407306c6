"""Lines and areas on a camera's image: `foxglove.ImageAnnotations`, which viewers draw over the frame of their time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cwcli.channels.published import Channel
from cwcli.signals.columns import FloatArray, Int64Array, OutputField, Repeated, StreamedChannel

LINE_LOOP, LINE_STRIP = 2, 3  # foxglove.PointsAnnotation.Type
PIXELS_PER_THICKNESS = 320.0
MIN_THICKNESS_PX = 2.0
Colour = Sequence[float]
"""Red, green, blue and alpha, 0 to 1."""


@dataclass(frozen=True)
class Shape:
    """What is drawn.

    Attributes:
        kind: `LINE_STRIP`, or `LINE_LOOP`, which is filled.
        points: Shape (k, 2): u, v in the pixels of the image.
        outline, fill: Colours; a fill of None is left out of the message.
        thickness_px: Of the outline.
    """

    kind: int
    points: FloatArray
    outline: Colour
    fill: Colour | None
    thickness_px: float


def line_thickness_px(width_px: float) -> float:
    """Of a line that is seen well on an image of this width."""
    return max(float(width_px) / PIXELS_PER_THICKNESS, MIN_THICKNESS_PX)


def write_image_lines(
    channel: Channel,
    *,
    stamp_ns: Int64Array,
    log_time_ns: Int64Array,
    shapes: Callable[[int, int], Sequence[Sequence[Shape]]],
) -> StreamedChannel:
    """One message a frame, made while it is written.

    Args:
        channel: Where they are published.
        stamp_ns, log_time_ns: Shape (n,), those of the frames, by which viewers put both together.
        shapes: What is drawn on the frames `start` to `stop`; either all shapes of a channel have a fill or none.
    """

    def rows(start: int, stop: int) -> Mapping[str, OutputField]:
        drawn = shapes(start, stop)
        flat = [(stamp, shape) for stamp, each in zip(stamp_ns[start:stop], drawn, strict=True) for shape in each]
        points = np.concatenate([np.zeros((0, 2)), *(shape.points for _, shape in flat)])
        ends = np.cumsum([0, *(len(shape.points) for _, shape in flat)]).astype(np.int64)
        lines: dict[str, OutputField] = {
            "timestamp": np.array([stamp for stamp, _ in flat], np.int64),
            "type": np.array([shape.kind for _, shape in flat], np.int64),
            "points": Repeated(ends, {"x": points[:, 0], "y": points[:, 1]}),
            **_colour("outline_color", [shape.outline for _, shape in flat]),
            **_colour("fill_color", [shape.fill for _, shape in flat if shape.fill is not None]),
            "thickness": np.array([shape.thickness_px for _, shape in flat], np.float64),
        }
        counts = np.cumsum([0, *(len(each) for each in drawn)]).astype(np.int64)
        return {"points": Repeated(counts, lines)}

    return StreamedChannel(channel.topic, channel.schema, log_time_ns, rows=rows)


def _colour(name: str, values: Sequence[Colour]) -> dict[str, OutputField]:
    parts = np.array(values, np.float64).reshape(-1, 4)
    return {f"{name}.{part}": parts[:, k] for k, part in enumerate("rgba")} if len(parts) else {}
