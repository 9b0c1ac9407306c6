"""The page of found events: a card for each, with its map, speeds, distance and TTC over time, a frame, its clip."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from html import escape
from pathlib import Path
from urllib.parse import quote

import numpy as np
import numpy.typing as npt

from cwcli.channels.lanes import read_lanes
from cwcli.channels.published import LANES
from cwcli.digest.drive import find_camera_topic
from cwcli.errors import CwcliError
from cwcli.events.evidence import EventEvidence
from cwcli.events.search import FoundEvent
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log
from cwcli.measures import MEASURES
from cwcli.pipeline.records import read_run_records
from cwcli.report.drawing import EGO_COLOUR, WARNING_COLOUR
from cwcli.report.frames import Thumbnail, make_thumbnails_and_explain_gaps
from cwcli.report.svg import MapTrack, TimeAxis, escape_for_html, html_page, map_svg, strip_svg
from cwcli.signals.columns import FloatArray
from cwcli.signals.units import NS_PER_S
from cwcli.text import format_count, format_number, map_to_distinct_endings

MAX_EVENT_CARDS = 300
"""Greatest number of events with a card; chosen by hand, so that the page stays below 6 MB."""
MAX_POINTS_PER_LINE = 150
"""Greatest number of points of a line; chosen by hand, a line is 300 pixels wide."""

MAX_DRAWN_TTC_S = 10.0
"""Greatest time to collision that is drawn, s; chosen by hand: above, nobody has to act yet."""


@dataclass(frozen=True)
class _Scene:
    """The motion around an event, on the stamps of the ego's states.

    Attributes:
        time_s: From the event's begin, (n,).
        is_inside: Whether the event lasts, (n,).
        ego, other: x, y [m] and speed [m/s] in the map, (n, 3); `other` is None for events of the ego alone.
        distance_m: Between both centres, (n,); None without another vehicle.
        ttc_s: Time to collision, (n,), NaN above `MAX_DRAWN_TTC_S`; None without another vehicle.
    """

    time_s: FloatArray
    is_inside: npt.NDArray[np.bool_]
    ego: FloatArray
    other: FloatArray | None
    distance_m: FloatArray | None
    ttc_s: FloatArray | None


def build_event_page(
    title: str,
    found: Sequence[FoundEvent],
    paths: Mapping[str, str],
    open_log: Callable[[str], Log],
    *,
    margin_s: float,
    clip_addresses: Mapping[tuple[str, str], str],
    step: Callable[[int, str], None] = lambda done, name: None,
) -> bytes:
    """Build the page of some events as HTML, which needs no script and no network.

    Args:
        found: The events, the most severe first; the first `MAX_EVENT_CARDS` get a card.
        paths: Name of a log -> its path.
        open_log: Opens a log by its path.
        margin_s: What the figures show before and after an event, s.
        clip_addresses: Key of an event -> address of its clip relative to the page; no link without one.
        step: Called with the number of drawn events and the name of the log before it is read.
    """
    shown = found[:MAX_EVENT_CARDS]
    figures: dict[tuple[str, str], str] = {}
    log_names = map_to_distinct_endings(paths)
    by_log: dict[str, list[FoundEvent]] = {}
    for event in shown:
        by_log.setdefault(event.log, []).append(event)
    for name, events in by_log.items():
        step(len(figures), name)
        figures |= _draw_events_of_log(events, paths[name], open_log, margin_s)
    head = f"{format_count(len(found), 'event')} in {format_count(len(paths), 'searched log')}, the most severe first."
    if len(shown) < len(found):
        head += f" The first {len(shown)} are shown; `-o` writes the table of all."
    uses: Counter[str] = Counter()
    cards = ""
    for each in shown:
        uses[each.id] += 1
        anchor = each.id if uses[each.id] == 1 else f"{each.id}-{uses[each.id]}"
        clip = clip_addresses.get(each.key, "")
        cards += _event_card_html(each, anchor, log_names[each.log], figures[each.key], clip)
    if not shown:
        return html_page("cwcli find", title, f"No event in {format_count(len(paths), 'searched log')}.", "", "")
    legend = (
        f'In the figures <b style="color:{EGO_COLOUR}">the ego is blue</b> and <b style="color:{WARNING_COLOUR}">the '
        "other vehicle is orange</b>. Thick lines and grey areas are the event. North is up."
    )
    return html_page("cwcli find", title, head, legend, cards)


def addresses_of_clips(clips: Mapping[tuple[str, str], str], page: str | Path) -> dict[tuple[str, str], str]:
    """Return key of an event -> address of its clip, relative to the folder of a page."""
    folder = os.path.abspath(Path(page).parent)  # noqa: PTH100 - links stay as they are
    return {key: quote(os.path.relpath(path, folder)) for key, path in clips.items()}


def _event_card_html(event: FoundEvent, anchor: str, log: str, figures: str, clip: str) -> str:
    """Return the card of one event of the log with a name to show."""
    when = f"{event.start_s:.2f} s after the log's start, for {event.duration_s:.2f} s"
    link = f' · <a href="{escape(clip)}">open the clip</a>' if clip else ""
    return (
        f'<article id="{anchor}"><h2>{escape_for_html(event.event)}: {escape_for_html(event.words)}</h2>'
        f"<p>{escape_for_html(log)}, {when} · severity {format_number(event.moment.severity, 3)} of 10{link}</p>"
        f"<p><small>{escape_for_html(', '.join(event.moment.actors))} · {event.id}</small></p>"
        f'<div class="figures">{figures}</div></article>\n'
    )


def _draw_events_of_log(
    events: Sequence[FoundEvent], path: str, open_log: Callable[[str], Log], margin_s: float
) -> dict[tuple[str, str], str]:
    """Return key -> figures of the events of one log; a sentence where there is nothing to draw."""
    try:
        with open_log(path) as log:
            frames = _frames_html(log, events)
            try:
                evidence = EventEvidence(log)
                drawn = {each.key: _map_and_strips_html(_read_scene(evidence, each, margin_s)) for each in events}
            except CwcliError as error:
                drawn = {each.key: _not_drawn_html(error) for each in events}
            return {each.key: drawn[each.key] + frames[each.key] for each in events}
    except CwcliError as error:
        return {each.key: _not_drawn_html(error) for each in events}


def _not_drawn_html(error: CwcliError) -> str:
    """Return the sentence in the place of a figure."""
    return f"<p><small>Not drawn: {escape_for_html(error.what)}.</small></p>"


def _frames_html(log: Log, events: Sequence[FoundEvent]) -> dict[tuple[str, str], str]:
    """Return key -> the camera's frame at the event's start, with the lane boundaries; "" where there is none.

    Raises:
        CwcliError: The log is damaged.
    """
    topic = find_camera_topic(log, read_run_records(log))
    if not topic:
        return {each.key: "" for each in events}
    has_lanes = any(channel.topic == LANES.topic for channel in log.channels)
    lanes = read_lanes(log.columns(LANES.topic)) if has_lanes else None
    starts_ns = [each.moment.start_ns for each in events]
    found, why = make_thumbnails_and_explain_gaps(log, topic, lanes, starts_ns, is_part=True)
    missing = f"<p><small>No camera frame: {escape_for_html(why)}.</small></p>" if why else ""
    return {
        each.key: _frame_html(each, found[each.moment.start_ns]) if each.moment.start_ns in found else missing
        for each in events
    }


def _frame_html(event: FoundEvent, frame: Thumbnail) -> str:
    """Return the picture of a camera frame; its words say how far from the event's start it was taken."""
    words = f"camera {(frame.stamp_ns - event.moment.start_ns) / NS_PER_S:+.2f} s from the event's start"
    size = f'width="{frame.width_px}" height="{frame.height_px}"'
    return f'<img src="{frame.data_uri}" {size} alt="{words}" title="{words}"/>'


def _read_scene(evidence: EventEvidence, event: FoundEvent, margin_s: float) -> _Scene:
    """Read the motion around an event.

    Raises:
        MissingSignalError: The log holds no states of the ego.
    """
    stamp_ns, moment = evidence.stamp_ns, event.moment
    margin_ns = round(margin_s * NS_PER_S)
    first, last = np.searchsorted(stamp_ns, (moment.start_ns - margin_ns, moment.end_ns + margin_ns + 1))
    rows = np.unique(np.linspace(first, max(last - 1, first), MAX_POINTS_PER_LINE).astype(int))[: int(last - first)]
    time_s = (stamp_ns[rows] - moment.start_ns) / NS_PER_S
    is_inside = (stamp_ns[rows] >= moment.start_ns) & (stamp_ns[rows] <= moment.end_ns)
    names = [each for each in moment.actors[1:] if each in evidence.tracks.others]
    if not names:
        return _Scene(time_s, is_inside, evidence.ego_state[rows, :3], None, None, None)
    pair = evidence.pair_with_ego(names[0])
    ttc_s = np.asarray(pair.evaluate_measure(MEASURES["ttc"]))[rows]
    ttc_s = np.where(ttc_s <= MAX_DRAWN_TTC_S, ttc_s, np.nan)
    motion = evidence.ego_state[rows, :3], pair.other_states[rows, :3], pair.distance_m[rows]
    return _Scene(time_s, is_inside, *motion, ttc_s)


def _map_and_strips_html(scene: _Scene) -> str:
    """Return map and strips of an event."""
    if not len(scene.time_s):
        return "<p><small>Not drawn: the log holds no states at that time.</small></p>"
    actors = [(scene.ego, EGO_COLOUR), *([(scene.other, WARNING_COLOUR)] if scene.other is not None else [])]
    map_label = "map of the event; dots are the ends of the tracks"
    tracks = [MapTrack(states[:, :2], colour, scene.is_inside) for states, colour in reversed(actors)]
    axis = TimeAxis(scene.time_s, "time from the event's start [s]", scene.is_inside)
    strips = strip_svg(axis, "speed [m/s]", [(states[:, 2], colour) for states, colour in actors])
    if scene.distance_m is not None:
        strips += "<br/>" + strip_svg(axis, "distance of the centres [m]", [(scene.distance_m, "#333333")])
    if scene.ttc_s is not None and np.isfinite(scene.ttc_s).any():
        strips += "<br/>" + strip_svg(axis, "time to collision (TTC) [s]", [(scene.ttc_s, "#333333")])
    return f"{map_svg(tracks, map_label)}<div>{strips}</div>"
