"""One log's part of the page: figures, warnings, pictures, tables, as the template wants them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from cwcli.errors import CwcliError
from cwcli.logs.log import Log
from cwcli.metrics.headline import metric_of
from cwcli.report.drawing import Figure
from cwcli.report.drive import Drive
from cwcli.report.encounter_figures import distance_figure, fan_figure, nearest_figure
from cwcli.report.encounters import Encounter, Meetings
from cwcli.report.frames import Thumbnail, thumbnails
from cwcli.report.map_figure import map_figure
from cwcli.report.paths import Path2D, path_known_at
from cwcli.report.signal_figures import lane_figure, motion_figure
from cwcli.report.source import Entry
from cwcli.report.story import Badge, Story, encounter_sentence, most_critical, name_of, verdict_badge, verdict_sentence
from cwcli.signals.units import NS_PER_S
from cwcli.stages.channels import EGO_PATH_TOPIC, REMOTE_PATH_TOPIC
from cwcli.text import number

FRAME_OFFSETS_S = (-2.0, -1.0, 0.0, 1.0, 2.0)
LEAD_IN = "the log began"
MAX_ROWS = 200


@dataclass(frozen=True)
class Detail:
    """How much of a log is shown.

    Attributes:
        n_pieces: Of a signal's line.
        n_events: Warnings with figures of their own.
        n_frame_events: Warnings with camera pictures.
        n_frames: Pictures of a drive without warnings.
        has_all_metrics: Every metric is listed, not only those that runs are compared by.
    """

    n_pieces: int = 700
    n_events: int = 8
    n_frame_events: int = 4
    n_frames: int = 8
    has_all_metrics: bool = True


@dataclass(frozen=True)
class Plot:
    """A figure in the page."""

    id: str
    kind: str
    title: str
    hint: str
    figure: Figure


@dataclass(frozen=True)
class Picture:
    """A camera frame in the page."""

    uri: str
    width_px: int
    height_px: int
    alt: str
    caption: str


@dataclass(frozen=True)
class TableView:
    """A table in the page: columns are (heading, is it of numbers)."""

    title: str
    columns: tuple[tuple[str, bool], ...]
    rows: tuple[tuple[str, ...], ...]
    hint: str = ""
    is_folded: bool = False


@dataclass(frozen=True)
class EventView:
    """A warning in the page."""

    number: int
    badge: Badge
    sentence: str
    verdict: str
    plots: tuple[Plot, ...]
    table: TableView
    frames: tuple[Picture, ...]


@dataclass(frozen=True)
class LogView:
    """A log in the page."""

    anchor: str
    name: str
    story: Story
    badges: tuple[Badge, ...]
    is_alone: bool
    is_open: bool
    first: tuple[Plot, ...] = ()
    events: tuple[EventView, ...] = ()
    event_table: TableView | None = None
    signals: tuple[Plot, ...] = ()
    frames: tuple[Picture, ...] = ()
    tables: tuple[TableView, ...] = ()
    notes: tuple[str, ...] = field(default=())


def log_view(
    log: Log,
    entry: Entry,
    drive: Drive,
    meetings: Meetings,
    story: Story,
    *,
    anchor: str,
    badges: Sequence[Badge],
    detail: Detail,
    is_alone: bool,
    is_open: bool,
) -> LogView:
    """Everything that is shown of a log."""
    notes = list(drive.notes)
    chosen = sorted(most_critical(meetings)[: detail.n_events], key=lambda each: (each.raised_ns, each.event_id))
    pictures, why = _pictures(log, drive, chosen[: detail.n_frame_events], detail)
    if why:
        notes.append(why)
    first: list[Plot] = []
    drawn = map_figure(drive, meetings)
    if drawn is not None:
        figure, left_out = drawn
        first.append(_plot(anchor, "map", "Where everybody drove", "seen from above, north up", figure))
        notes += left_out
    events = []
    worst = most_critical(meetings)[0] if chosen else None
    for encounter in chosen:
        shown = _event(log, drive, encounter, anchor, pictures, notes, is_told=len(chosen) == 1)
        if encounter is worst and shown.plots and len(first) == 1 and shown.plots[0].kind == "fan":
            first.append(shown.plots[0])
            shown = _without_first_plot(shown)
        events.append(shown)
    if not chosen and len(first) == 1 and meetings.nearest is not None:
        near = nearest_figure(drive, meetings.nearest)
        if near is not None:
            title = f"How near {meetings.nearest.other.kind} {meetings.nearest.other.id} came"
            first.append(_plot(anchor, "distance", title, "from the estimated tracks", near))
    signals = _signals(drive, meetings, anchor, detail, with_first=first)
    return LogView(
        anchor=anchor,
        name=entry.name,
        story=story,
        badges=tuple(badges),
        is_alone=is_alone,
        is_open=is_open,
        first=tuple(first),
        events=tuple(events),
        event_table=_event_table(drive, meetings) if len(meetings.encounters) > len(chosen) else None,
        signals=tuple(signals),
        frames=tuple(_evenly(drive, pictures)) if not chosen else (),
        tables=tuple(_tables(drive, entry, detail)),
        notes=tuple(dict.fromkeys(notes)),
    )


def _plot(anchor: str, kind: str, title: str, hint: str, figure: Figure, suffix: str = "") -> Plot:
    return Plot(f"{anchor}-{kind}{suffix}", kind, title, hint, figure)


def _event(
    log: Log,
    drive: Drive,
    encounter: Encounter,
    anchor: str,
    pictures: dict[int, Thumbnail],
    notes: list[str],
    *,
    is_told: bool,
) -> EventView:
    suffix = f"-{encounter.event_id}"
    plots = []
    has_paths = drive.ego is not None and not encounter.is_lane_departure
    paths = _paths(log, drive, encounter, notes) if has_paths else (None, None)
    fan = fan_figure(drive, encounter, paths)
    if fan is not None:
        at = f"{(encounter.raised_ns - drive.start_ns) / NS_PER_S:.1f}"
        title = f"Warning {encounter.event_id}, at {at} s: the predicted paths"
        plots.append(_plot(anchor, "fan", title, "ahead is up; dotted: what followed", fan, suffix))
    distance = distance_figure(drive, encounter)
    if distance is not None:
        hint = "by the estimated tracks; time to collision at constant velocities"
        plots.append(_plot(anchor, "distance", "How near they came", hint, distance, suffix))
    frames = []
    for offset_s in FRAME_OFFSETS_S:
        picture = pictures.get(encounter.raised_ns + round(offset_s * NS_PER_S))
        if picture is not None:
            frames.append(
                _picture(drive, picture, f"{offset_s:+.0f} s from the warning" if offset_s else "the warning")
            )
    return EventView(
        number=encounter.event_id,
        badge=verdict_badge(encounter),
        sentence="" if is_told else encounter_sentence(drive, encounter),
        verdict="" if is_told else verdict_sentence(drive.rule, encounter),
        plots=tuple(plots),
        table=_facts(drive, encounter),
        frames=tuple(frames),
    )


def _without_first_plot(event: EventView) -> EventView:
    return EventView(
        event.number, event.badge, event.sentence, event.verdict, event.plots[1:], event.table, event.frames
    )


def _paths(log: Log, drive: Drive, encounter: Encounter, notes: list[str]) -> tuple[Path2D | None, Path2D | None]:
    """The paths of both cars, as known at the warning; targets have no published ones."""
    topics = {channel.topic for channel in log.channels}
    found: list[Path2D | None] = []
    for topic, vehicle in ((EGO_PATH_TOPIC, _ego_id(drive)), (REMOTE_PATH_TOPIC, encounter.other_id)):
        path = None
        if topic in topics:
            try:
                path = path_known_at(
                    log.path, topic, vehicle, encounter.raised_ns, max_age_s=drive.rule.max_age_s, name=log.name
                )
            except CwcliError as error:
                notes.append(error.what)
        found.append(path)
    return found[0], found[1]


def _ego_id(drive: Drive) -> str:
    assert drive.ego is not None
    return drive.ego.ids.values[int(drive.ego.ids.codes[0])]


def _facts(drive: Drive, encounter: Encounter) -> TableView:
    """What was predicted and what happened, side by side."""

    def seconds(stamp_ns: int) -> str:
        return f"{(stamp_ns - drive.start_ns) / NS_PER_S:.2f} s after {LEAD_IN}"

    def metres(value: float) -> str:
        return f"{value:.2f} m" if math.isfinite(value) else "-"

    verdict = encounter.verdict
    rows = [
        ("warned of", name_of(encounter)),
        *([("where it was", encounter.direction)] if encounter.direction else []),
        ("rule", encounter.rule or "-"),
        ("warning given", seconds(encounter.raised_ns)),
        ("warning stood until", seconds(encounter.last_ns)),
    ]
    if math.isfinite(encounter.time_to_event_s):
        rows.append(("predicted: nearest in", f"{encounter.time_to_event_s:.2f} s"))
    if math.isfinite(encounter.predicted_distance_m):
        rows.append(("predicted: centres apart by", metres(encounter.predicted_distance_m)))
    if math.isfinite(encounter.probability):
        rows.append(("predicted: probability", f"{encounter.probability:.2f}"))
    if verdict is not None:
        if verdict.closest_ns >= 0:
            rows.append(("really nearest", seconds(verdict.closest_ns)))
        rows.append(("really: centres apart by", metres(verdict.closest_m)))
        gap = encounter.least_gap_m
        overlap = f"none: they overlapped by {-gap:.2f} m" if gap < 0.0 else metres(gap)
        rows.append(("really: gap between outlines", overlap))
        if math.isfinite(verdict.lead_time_s):
            rows.append(("warned before the conflict by", f"{verdict.lead_time_s:.2f} s"))
    return TableView("In numbers", (("", False), ("", False)), tuple(rows))


def _event_table(drive: Drive, meetings: Meetings) -> TableView:
    """All warnings, where not all have figures."""
    rows = []
    for each in meetings.encounters:
        verdict = each.verdict
        nearest = f"{verdict.closest_m:.2f}" if verdict is not None and math.isfinite(verdict.closest_m) else "-"
        lead = f"{verdict.lead_time_s:.2f}" if verdict is not None and math.isfinite(verdict.lead_time_s) else "-"
        at = f"{(each.raised_ns - drive.start_ns) / NS_PER_S:.2f}"
        rows.append((str(each.event_id), name_of(each), at, verdict_badge(each).text, lead, nearest))
    columns = (
        ("warning", True),
        ("of", False),
        ("at [s]", True),
        ("verdict", False),
        ("lead [s]", True),
        ("nearest [m]", True),
    )
    kept = rows[:MAX_ROWS]
    hint = "the most critical ones have figures above"
    if len(rows) > len(kept):
        hint += f"; the first {MAX_ROWS} of {len(rows)} are listed"
    return TableView("All warnings", columns, tuple(kept), hint)


def _signals(drive: Drive, meetings: Meetings, anchor: str, detail: Detail, *, with_first: list[Plot]) -> list[Plot]:
    plots = []
    motion = motion_figure(drive, meetings, detail.n_pieces)
    if motion is not None:
        n = len(drive.ego) if drive.ego is not None else 0
        hint = "blue: estimated, with its 1-sigma band; grey: measured"
        if n > 2 * detail.n_pieces:
            hint += (
                f". {n} states are drawn as the least and the largest value of each of {detail.n_pieces} pieces, "
                "the band around all of them; measurements on the same spot once"
            )
        plots.append(_plot(anchor, "motion", "How the car moved", hint, motion))
    lane = lane_figure(drive, meetings, detail.n_pieces)
    if lane is not None:
        hint = (
            "at the preview point, with 1-sigma bands; offset: the lane's centre, right positive; heading: of the car "
        )
        hint += "from the lane, left positive; curvature: right positive"
        plot = _plot(anchor, "lane", "The car in its lane", hint, lane)
        if not with_first:
            with_first.append(plot)
        else:
            plots.append(plot)
    return plots


def _pictures(log: Log, drive: Drive, chosen: Sequence[Encounter], detail: Detail) -> tuple[dict[int, Thumbnail], str]:
    if not drive.camera:
        return {}, ""
    wanted = [each.raised_ns + round(offset_s * NS_PER_S) for each in chosen for offset_s in FRAME_OFFSETS_S]
    if not wanted:
        span = drive.end_ns - drive.start_ns
        wanted = [drive.start_ns + span * (2 * k + 1) // (2 * detail.n_frames) for k in range(detail.n_frames)]
    return thumbnails(log, drive, wanted)


def _evenly(drive: Drive, pictures: dict[int, Thumbnail]) -> list[Picture]:
    unique: dict[int, Thumbnail] = {picture.stamp_ns: picture for _, picture in sorted(pictures.items())}
    return [_picture(drive, picture, "") for picture in unique.values()]


def _picture(drive: Drive, picture: Thumbnail, what: str) -> Picture:
    at = f"{(picture.stamp_ns - drive.start_ns) / NS_PER_S:.2f} s"
    caption = f"{at}: {what}" if what else at
    if picture.n_lines is not None:
        caption += f", {('no lane boundary', 'one lane boundary', 'both lane boundaries')[picture.n_lines]} found"
    return Picture(picture.data_uri, picture.width_px, picture.height_px, f"Camera frame at {caption}", caption)


def _tables(drive: Drive, entry: Entry, detail: Detail) -> list[TableView]:
    tables = []
    rows: list[tuple[str, ...]] = []
    for stage in drive.records:
        for given in drive.inputs(stage):
            reasons = [
                f"{n} {reason} ({kind.replace('_', ' ')})"
                for kind in ("rejected", "repaired", "set_aside")
                for reason, n in _counts(given.get(kind)).items()
            ]
            totals = [str(sum(_counts(given.get(kind)).values())) for kind in ("rejected", "repaired")]
            topic, role = str(given.get("topic", "")), str(given.get("role", "")).replace("_", " ")
            read, used = str(given.get("read", "")), str(given.get("used", ""))
            rows.append((stage, topic, role, read, used, *totals, "; ".join(reasons)))
    if rows:
        columns: tuple[tuple[str, bool], ...] = (
            ("stage", False),
            ("channel", False),
            ("used as", False),
            ("read", True),
            ("used", True),
            ("rejected", True),
            ("repaired", True),
            ("reasons", False),
        )
        if not any(row[-1] for row in rows):
            columns, rows = columns[:-1], [row[:-1] for row in rows]
        tables.append(TableView("What became of the messages", columns, tuple(rows[:MAX_ROWS])))
    if entry.metrics:
        tables += _metrics_tables(entry, detail)
    return tables


def _metrics_tables(entry: Entry, detail: Detail) -> list[TableView]:
    """The metrics that runs are compared by, and behind them, folded, the rest."""
    main: list[tuple[str, ...]] = []
    rest: list[tuple[str, ...]] = []
    for metric in list(entry.metrics.values())[: 2 * MAX_ROWS]:
        interval = ""
        if math.isfinite(metric.low) and math.isfinite(metric.high):
            interval = f"{number(metric.low)} to {number(metric.high)}"
        known = metric_of(metric.metric)
        row = (metric.metric, value_text(metric.metric, metric.value), metric.unit, interval, str(metric.n))
        (main if known is not None and known.is_compared else rest).append(row)
    columns = (("metric", False), ("value", True), ("unit", False), ("95 % interval", False), ("samples", True))
    tables = [TableView("Headline metrics", columns, tuple(main))] if main else []
    if rest and detail.has_all_metrics:
        tables.append(TableView("Further metrics", columns, tuple(rest), is_folded=True))
    return tables


def value_text(name: str, value: float) -> str:
    """A metric's value; a count without decimals."""
    is_count = name.endswith(("_count", ".count")) and math.isfinite(value)
    return f"{value:.0f}" if is_count else number(value)


def _counts(value: Any) -> dict[str, int]:
    if not isinstance(value, dict):
        return {}
    return {str(reason): n for reason, n in value.items() if isinstance(n, int) and n}
