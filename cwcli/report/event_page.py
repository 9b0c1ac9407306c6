"""The page of found events: a card for each one, with its map, its speeds and distance over time, and its clip."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from html import escape
from pathlib import Path
from urllib.parse import quote

import numpy as np
import numpy.typing as npt

from cwcli.errors import CwcliError
from cwcli.events.evidence import EventEvidence
from cwcli.events.search import FoundEvent
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log
from cwcli.report.drawing import EGO_COLOUR, WARNING_COLOUR
from cwcli.signals.columns import FloatArray
from cwcli.signals.units import NS_PER_S
from cwcli.text import escape_control_characters, format_count, format_number

MAX_CARDS = 300
"""Greatest number of events with a card; chosen by hand, so that the page stays below 3 MB."""
MAX_DRAWN_POINTS = 150
"""Greatest number of points of a line; chosen by hand, a line is 300 pixels wide."""
MAP_PX, STRIP_WIDTH_PX, STRIP_HEIGHT_PX, EDGE_PX = 220, 360, 92, 8
"""Size of the map, width and height of a strip, and the empty edge inside both, in pixels. Chosen by hand."""
MIN_MAP_EXTENT_M = 20.0
"""Least width of what a map shows, m. Chosen by hand: four lengths of a car."""
SCALE_BARS_M = (5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000)
"""Lengths of a map's scale bar, m; the longest one below a third of the map is drawn."""
_STYLE = """body{font:15px/1.45 system-ui,sans-serif;margin:1.5rem auto;max-width:72rem;padding:0 1rem;color:#1a1a1a}
article{border:1px solid #ccc;border-radius:6px;padding:.8rem 1rem;margin:0 0 1rem}h1{font-size:1.5rem}
h2{font-size:1.1rem;margin:0}p{margin:.3rem 0}.figures{display:flex;flex-wrap:wrap;gap:1rem;margin-top:.5rem}
small,text{fill:#555;color:#555}text{font-size:11px}svg{background:#fafafa;border:1px solid #e4e4e4}"""


@dataclass(frozen=True)
class _Scene:
    """The motion around an event, on the stamps of the ego's states.

    Attributes:
        time_s: From the event's begin, (n,).
        is_inside: Whether the event lasts, (n,).
        ego, other: x, y [m] and speed [m/s] in the map, (n, 3); `other` is None for events of the ego alone.
        distance_m: Between both centres, (n,); None without another vehicle.
    """

    time_s: FloatArray
    is_inside: npt.NDArray[np.bool_]
    ego: FloatArray
    other: FloatArray | None
    distance_m: FloatArray | None


def build_event_page(
    title: str,
    found: Sequence[FoundEvent],
    paths: Mapping[str, str],
    open_log: Callable[[str], Log],
    *,
    margin_s: float,
    clip_addresses: Mapping[str, str],
    step: Callable[[int, str], None] = lambda done, name: None,
) -> bytes:
    """Build the page of some events as HTML, which needs no script and no network.

    Args:
        title: What was looked for.
        found: The events, the most severe first; the first `MAX_CARDS` get a card.
        paths: Name of a log -> its path.
        open_log: Opens a log by its path.
        margin_s: What the figures show before and after an event, s.
        clip_addresses: Id of an event -> address of its clip relative to the page; no link without one.
        step: Called with the number of drawn events and the name of the log before it is read.
    """
    shown = found[:MAX_CARDS]
    figures: dict[str, str] = {}
    by_log: dict[str, list[FoundEvent]] = {}
    for event in shown:
        by_log.setdefault(event.log, []).append(event)
    for name, events in by_log.items():
        step(len(figures), name)
        figures |= _draw_events_of_log(events, paths[name], open_log, margin_s)
    head = f"{format_count(len(found), 'event')} in {format_count(len(paths), 'searched log')}, the most severe first."
    if len(shown) < len(found):
        head += f" The first {len(shown)} are shown; `-o` writes the table of all."
    cards = "".join(_event_card_html(each, figures[each.id], clip_addresses.get(each.id, "")) for each in shown)
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8"/>'
        "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'\"/>"
        '<meta name="viewport" content="width=device-width, initial-scale=1"/>'
        f"<title>cwcli find: {_escape_for_html(title)}</title><style>{_STYLE}</style></head><body>\n"
        f"<h1>{_escape_for_html(title)}</h1><p>{_escape_for_html(head)}</p>"
        f'<p><small>In the figures <b style="color:{EGO_COLOUR}">the ego is blue</b> and <b style="color:'
        f'{WARNING_COLOUR}">the other vehicle is orange</b>. Thick lines and grey areas are the event. North is up.'
        f"</small></p>\n{cards}</body></html>\n"
    ).encode()


def addresses_of_clips(clips: Mapping[str, str], page: str | Path) -> dict[str, str]:
    """Return id of an event -> address of its clip, relative to the folder of a page."""
    folder = os.path.abspath(Path(page).parent)  # noqa: PTH100 - links stay as they are
    return {id: quote(os.path.relpath(path, folder)) for id, path in clips.items()}


def _escape_for_html(text: str) -> str:
    """Return text for HTML: escaped, invisible characters spelled out."""
    return escape(escape_control_characters(text))


def _event_card_html(event: FoundEvent, figures: str, clip: str) -> str:
    """Return the card of one event."""
    log = Path(event.log.rstrip("/")).name or event.log
    when = f"{event.start_s:.2f} s after the log's start, for {event.duration_s:.2f} s"
    link = f' · <a href="{escape(clip)}">open the clip</a>' if clip else ""
    return (
        f'<article id="{event.id}"><h2>{_escape_for_html(event.event)}: {_escape_for_html(event.words)}</h2>'
        f"<p>{_escape_for_html(log)}, {when} · severity {format_number(event.moment.severity, 3)} of 10{link}</p>"
        f"<p><small>{_escape_for_html(', '.join(event.moment.actors))} · {event.id}</small></p>"
        f'<div class="figures">{figures}</div></article>\n'
    )


def _draw_events_of_log(
    events: Sequence[FoundEvent], path: str, open_log: Callable[[str], Log], margin_s: float
) -> dict[str, str]:
    """Return id -> figures of the events of one log; a sentence where there is nothing to draw."""
    try:
        with open_log(path) as log:
            evidence = EventEvidence(log)
            return {each.id: _map_and_strips_html(_read_scene(evidence, each, margin_s)) for each in events}
    except CwcliError as error:
        return {each.id: f"<p><small>Not drawn: {_escape_for_html(error.what)}.</small></p>" for each in events}


def _read_scene(evidence: EventEvidence, event: FoundEvent, margin_s: float) -> _Scene:
    """Read the motion around an event.

    Raises:
        MissingSignalError: The log holds no states of the ego.
    """
    stamp_ns, moment = evidence.stamp_ns, event.moment
    margin_ns = round(margin_s * NS_PER_S)
    first, last = np.searchsorted(stamp_ns, (moment.start_ns - margin_ns, moment.end_ns + margin_ns + 1))
    rows = np.unique(np.linspace(first, max(last - 1, first), MAX_DRAWN_POINTS).astype(int))[: int(last - first)]
    time_s = (stamp_ns[rows] - moment.start_ns) / NS_PER_S
    is_inside = (stamp_ns[rows] >= moment.start_ns) & (stamp_ns[rows] <= moment.end_ns)
    names = [each for each in moment.actors[1:] if each in evidence.tracks.others]
    if not names:
        return _Scene(time_s, is_inside, evidence.ego_state[rows, :3], None, None)
    pair = evidence.pair_with_ego(names[0])
    return _Scene(time_s, is_inside, evidence.ego_state[rows, :3], pair.other_states[rows, :3], pair.distance_m[rows])


def _map_and_strips_html(scene: _Scene) -> str:
    """Return map and strips of an event."""
    if not len(scene.time_s):
        return "<p><small>Not drawn: the log holds no states at that time.</small></p>"
    speeds = [(scene.ego[:, 2], EGO_COLOUR)]
    if scene.other is not None:
        speeds.append((scene.other[:, 2], WARNING_COLOUR))
    strips = _strip_svg(scene, "speed [m/s]", speeds)
    if scene.distance_m is not None:
        strips += "<br/>" + _strip_svg(scene, "distance of the centres [m]", [(scene.distance_m, "#333333")])
    return f"{_map_svg(scene)}<div>{strips}</div>"


def _map_svg(scene: _Scene) -> str:
    """Return the map of an event as SVG, with equal scales."""
    tracks = [(scene.ego[:, :2], EGO_COLOUR)]
    if scene.other is not None:
        tracks.insert(0, (scene.other[:, :2], WARNING_COLOUR))
    points = np.concatenate([xy for xy, _ in tracks])
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        return ""
    low, high = points.min(axis=0), points.max(axis=0)
    extent_m = max(float((high - low).max()), MIN_MAP_EXTENT_M)
    scale = (MAP_PX - 2 * EDGE_PX) / extent_m
    parts = []
    for xy, colour in tracks:
        px = (xy - 0.5 * (low + high)) * (scale, -scale) + 0.5 * MAP_PX
        parts.append(_line_svg(px, colour, 1.5))
        parts.append(_line_svg(np.where(scene.is_inside[:, None], px, np.nan), colour, 4.5))
        at = px[np.isfinite(px).all(axis=1)][-1:]
        parts += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="{colour}"/>' for x, y in at]
    bar_m = max((each for each in SCALE_BARS_M if each <= extent_m / 3.0), default=SCALE_BARS_M[0])
    y = MAP_PX - EDGE_PX
    parts.append(f'<path d="M{EDGE_PX} {y}h{bar_m * scale:.1f}" stroke="#555" stroke-width="2"/>')
    parts.append(f'<text x="{EDGE_PX}" y="{y - 4}">{bar_m} m</text>')
    return _drawing_svg(MAP_PX, MAP_PX, "map of the event; dots are the ends of the tracks", "".join(parts))


def _strip_svg(scene: _Scene, title: str, lines: Sequence[tuple[FloatArray, str]]) -> str:
    """Return values over time as SVG: title, greatest and least value, and the times of both ends."""
    values = np.concatenate([each for each, _ in lines])
    values = values[np.isfinite(values)]
    if not len(values):
        return ""
    low, high = min(float(values.min()), 0.0), float(values.max())
    begin, end = float(scene.time_s[0]), float(scene.time_s[-1])
    top, bottom, left, right = 18.0, STRIP_HEIGHT_PX - 16.0, 34.0, STRIP_WIDTH_PX - EDGE_PX

    def x_of(time_s: FloatArray) -> FloatArray:
        return left + (time_s - begin) / max(end - begin, 1e-9) * (right - left)

    inside = x_of(scene.time_s[scene.is_inside])
    parts = []
    if len(inside):
        width = max(inside[-1] - inside[0], 1.0)
        parts.append(
            f'<rect x="{inside[0]:.1f}" y="{top}" width="{width:.1f}" height="{bottom - top}" fill="#e2e2e2"/>'
        )
    for each, colour in lines:
        y = bottom - (each - low) / max(high - low, 1e-9) * (bottom - top)
        parts.append(_line_svg(np.column_stack([x_of(scene.time_s), y]), colour, 2.0))
    parts.append(f'<text x="{left}" y="12">{title}; time from the event\'s start [s]</text>')
    for y_px, value in ((top + 8, high), (bottom, low)):
        parts.append(f'<text x="{left - 4}" y="{y_px}" text-anchor="end">{round(value):d}</text>')
    parts.append(f'<text x="{left}" y="{STRIP_HEIGHT_PX - 3}">{begin:.1f}</text>')
    parts.append(f'<text x="{right}" y="{STRIP_HEIGHT_PX - 3}" text-anchor="end">{end:.1f}</text>')
    return _drawing_svg(STRIP_WIDTH_PX, STRIP_HEIGHT_PX, f"{title} over time", "".join(parts))


def _drawing_svg(width_px: int, height_px: int, label: str, content: str) -> str:
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
