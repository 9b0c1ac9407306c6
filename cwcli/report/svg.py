"""Small drawings in SVG, and the plain page that holds them: they need no script and no network."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cwcli.signals.columns import FloatArray
from cwcli.text import escape_control_characters

MAP_SIZE_PX, STRIP_WIDTH_PX, STRIP_HEIGHT_PX, EMPTY_EDGE_PX = 220, 360, 92, 8
"""Size of the map, width and height of a strip, and the empty edge inside both, in pixels. Chosen by hand."""
MIN_MAP_EXTENT_M = 20.0
"""Least width of what a map shows, m. Chosen by hand: four lengths of a car."""
SCALE_BARS_M = (5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000)
"""Lengths of a map's scale bar, m; the longest one below a third of the map is drawn."""
_STYLE = """body{font:15px/1.45 system-ui,sans-serif;margin:1.5rem auto;max-width:72rem;padding:0 1rem;color:#1a1a1a}
article{border:1px solid #ccc;border-radius:6px;padding:.8rem 1rem;margin:0 0 1rem}h1{font-size:1.5rem}
h2{font-size:1.1rem;margin:0}p{margin:.3rem 0}.figures{display:flex;flex-wrap:wrap;gap:1rem;margin-top:.5rem}
small,text{fill:#555;color:#555}text{font-size:11px}svg{background:#fafafa;border:1px solid #e4e4e4}"""


class MapTrack(NamedTuple):
    """A track on a map.

    Attributes:
        xy_m: East and north, (n, 2); NaN where not known.
        colour: Of the line, as CSS.
        is_thick: Which points the line is thick at, (n,); None: none.
    """

    xy_m: FloatArray
    colour: str
    is_thick: npt.NDArray[np.bool_] | None = None


class TimeAxis(NamedTuple):
    """The time axis of a strip.

    Attributes:
        time_s: Times of the values, (n,), ascending.
        label: What the times count from.
        is_shaded: Which times have a grey background, (n,); None: none.
    """

    time_s: FloatArray
    label: str
    is_shaded: npt.NDArray[np.bool_] | None = None


def html_page(kind: str, title: str, head: str, legend: str, cards: str) -> bytes:
    """Build a page of cards as HTML.

    Args:
        kind: What the page is of, before its title in the tab.
        title: The title, plain text.
        head: The first sentences, plain text.
        legend: What the colours of the figures mean, HTML.
        cards: The cards, HTML.
    """
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8"/>'
        '<meta http-equiv="Content-Security-Policy" '
        "content=\"default-src 'none'; img-src data:; style-src 'unsafe-inline'\"/>"
        '<meta name="viewport" content="width=device-width, initial-scale=1"/>'
        f"<title>{kind}: {escape_for_html(title)}</title><style>{_STYLE}</style></head><body>\n"
        f"<h1>{escape_for_html(title)}</h1><p>{escape_for_html(head)}</p>"
        f"<p><small>{legend}</small></p>\n{cards}</body></html>\n"
    ).encode()


def escape_for_html(text: str) -> str:
    """Return text for HTML: escaped, invisible characters spelled out."""
    return escape(escape_control_characters(text))


def map_svg(tracks: Sequence[MapTrack], label: str) -> str:
    """Return a map of some tracks as SVG, with equal scales and dots at the ends; "" without a known point."""
    points = np.concatenate([each.xy_m for each in tracks])
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        return ""
    low, high = points.min(axis=0), points.max(axis=0)
    extent_m = max(float((high - low).max()), MIN_MAP_EXTENT_M)
    scale = (MAP_SIZE_PX - 2 * EMPTY_EDGE_PX) / extent_m
    parts = []
    for xy_m, colour, is_thick in tracks:
        px = (xy_m - 0.5 * (low + high)) * (scale, -scale) + 0.5 * MAP_SIZE_PX
        parts.append(_line_svg(px, colour, 1.5))
        if is_thick is not None:
            parts.append(_line_svg(np.where(is_thick[:, None], px, np.nan), colour, 4.5))
        at = px[np.isfinite(px).all(axis=1)][-1:]
        parts += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="{colour}"/>' for x, y in at]
    bar_m = max((each for each in SCALE_BARS_M if each <= extent_m / 3.0), default=SCALE_BARS_M[0])
    y = MAP_SIZE_PX - EMPTY_EDGE_PX
    parts.append(f'<path d="M{EMPTY_EDGE_PX} {y}h{bar_m * scale:.1f}" stroke="#555" stroke-width="2"/>')
    parts.append(f'<text x="{EMPTY_EDGE_PX}" y="{y - 4}">{bar_m} m</text>')
    return _svg_element_of_drawing(MAP_SIZE_PX, MAP_SIZE_PX, label, "".join(parts))


def strip_svg(
    axis: TimeAxis,
    title: str,
    lines: Sequence[tuple[FloatArray, str]],
    marks: Sequence[tuple[float, str]] = (),
) -> str:
    """Return values over time as SVG: title, greatest and least value, and the times of both ends.

    Args:
        axis: The times.
        title: What the values are, with their unit.
        lines: Values, (n,), and colour of each line.
        marks: Time and colour of each vertical line.
    """
    values = np.concatenate([each for each, _ in lines])
    values = values[np.isfinite(values)]
    if not len(values):
        return ""
    low, high = min(float(values.min()), 0.0), float(values.max())
    begin, end = float(axis.time_s[0]), float(axis.time_s[-1])
    top, bottom, left, right = 18.0, STRIP_HEIGHT_PX - 16.0, 44.0, STRIP_WIDTH_PX - EMPTY_EDGE_PX

    def x_of(time_s: FloatArray) -> FloatArray:
        return left + (time_s - begin) / max(end - begin, 1e-9) * (right - left)

    parts = []
    shaded = x_of(axis.time_s[axis.is_shaded]) if axis.is_shaded is not None else np.empty(0)
    if len(shaded):
        width = max(shaded[-1] - shaded[0], 1.0)
        parts.append(
            f'<rect x="{shaded[0]:.1f}" y="{top}" width="{width:.1f}" height="{bottom - top}" fill="#e2e2e2"/>'
        )
    for x, (_, colour) in zip(x_of(np.array([at_s for at_s, _ in marks], float)), marks, strict=True):
        parts.append(f'<path d="M{x:.1f} {top}V{bottom}" stroke="{colour}" stroke-dasharray="3 2"/>')
    for each, colour in lines:
        y = bottom - (each - low) / max(high - low, 1e-9) * (bottom - top)
        parts.append(_line_svg(np.column_stack([x_of(axis.time_s), y]), colour, 2.0))
    parts.append(f'<text x="{EMPTY_EDGE_PX}" y="12">{title}; {axis.label}</text>')
    for y_px, value in ((top + 8, high), (bottom, low)):
        parts.append(f'<text x="{left - 4}" y="{y_px}" text-anchor="end">{_axis_number_text(value, high - low)}</text>')
    parts.append(f'<text x="{left}" y="{STRIP_HEIGHT_PX - 3}">{begin:z.1f}</text>')
    parts.append(f'<text x="{right}" y="{STRIP_HEIGHT_PX - 3}" text-anchor="end">{end:z.1f}</text>')
    return _svg_element_of_drawing(STRIP_WIDTH_PX, STRIP_HEIGHT_PX, f"{title} over time", "".join(parts))


def _axis_number_text(value: float, span: float) -> str:
    """Return a number at an axis, without decimals where the axis spans more than a few units."""
    return f"{value:z.0f}" if span >= 3.0 or value == 0.0 else f"{value:.2g}"


def _svg_element_of_drawing(width_px: int, height_px: int, label: str, content: str) -> str:
    """Return a drawing."""
    return f'<svg width="{width_px}" height="{height_px}" role="img" aria-label="{label}">{content}</svg>'


def _line_svg(px: FloatArray, colour: str, width_px: float) -> str:
    """Return a line through points (n, 2), interrupted where one is not known."""
    known = np.asarray(np.isfinite(px).all(axis=1))
    starts = known & ~np.concatenate([[False], known[:-1]])
    steps = "".join(
        f"{'M' if start else 'L'}{x:.1f} {y:.1f}" for (x, y), start in zip(px[known], starts[known], strict=True)
    )
    return f'<path d="{steps}" fill="none" stroke="{colour}" stroke-width="{width_px}"/>' if steps else ""
