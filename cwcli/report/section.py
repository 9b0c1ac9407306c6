"""One log's part of the page: figures, warnings, pictures, tables, as the template wants them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from cwcli.channels.predicted_path import read_predicted_paths
from cwcli.channels.published import EGO_PATH, REMOTE_PATH
from cwcli.digest.drive import Drive
from cwcli.digest.encounters import DriveEncounters, Encounter
from cwcli.digest.story import (
    Badge,
    Story,
    badge_of_warning_verdict,
    careful_driver_sentence,
    encounter_sentence,
    encounters_by_criticality,
    verdict_sentence,
)
from cwcli.errors import CwcliError
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log
from cwcli.pipeline.records import local_map_from_estimate_record
from cwcli.prediction.paths import Paths
from cwcli.report.drawing import Figure
from cwcli.report.encounter_figures import (
    distance_and_ttc_figure_around_warning,
    nearest_approach_figure,
    predicted_paths_figure,
)
from cwcli.report.frames import Thumbnail, make_thumbnails_and_explain_gaps
from cwcli.report.map_figure import build_map_figure
from cwcli.report.pairs import conflicts_table, pair_extremes_table, unwarned_conflict_links, warning_anchor_names
from cwcli.report.residuals import build_residual_plots
from cwcli.report.sensors import build_sensors_view, truth_error_figure
from cwcli.report.signal_figures import lane_figure, motion_figure
from cwcli.report.source import LogEntry
from cwcli.report.system import other_system_tables
from cwcli.report.tables import all_warnings_table, build_log_tables, encounter_facts_table
from cwcli.report.views import EventView, LogView, Picture, Player, Plot
from cwcli.signals.row_order import iter_rows_by_id
from cwcli.signals.units import NS_PER_S

FRAME_TIME_OFFSETS_FROM_WARNING_S = (-2.0, -1.0, 0.0, 1.0, 2.0)
"""Times of the camera frames around a warning, in s. Chosen by hand; not fitted."""
MAX_MISSED_CONFLICT_LINKS = 5
"""The greatest number of links to conflicts without a warning in a row of the overview. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class DetailLevel:
    """The level of detail of a log's section.

    Attributes:
        n_pieces: Of a signal's line.
        n_events: Warnings with figures of their own.
        n_frame_events: Warnings with camera pictures.
        n_frames: Pictures of a drive without warnings.
        n_moments: Pictures of which the one at the marked moment is shown.
        has_all_metrics: Every metric is listed, not only those that runs are compared by.
        has_residuals: Each source's residuals are drawn.
    """

    n_pieces: int = 700
    n_events: int = 8
    n_frame_events: int = 4
    n_frames: int = 8
    n_moments: int = 100
    has_all_metrics: bool = True
    has_residuals: bool = True


@dataclass(frozen=True)
class SectionOptions:
    """How the section of a log is shown.

    Attributes:
        is_alone: The page is of this log alone.
        is_open: The section is unfolded.
    """

    anchor: str
    badges: Sequence[Badge]
    detail: DetailLevel
    is_alone: bool
    is_open: bool


def build_log_view(
    log: Log,
    entry: LogEntry,
    drive: Drive,
    drive_encounters: DriveEncounters,
    story: Story,
    options: SectionOptions,
) -> LogView:
    """Collect everything that the page shows of a log."""
    anchor, detail = options.anchor, options.detail
    notes = [*drive.notes, *(drive.other_system.notes if drive.other_system is not None else ())]
    chosen = sorted(
        encounters_by_criticality(drive_encounters)[: detail.n_events], key=lambda each: (each.raised_ns, each.event_id)
    )
    pictures, over_all, why = _collect_thumbnails(log, drive, chosen[: detail.n_frame_events], detail)
    if why:
        notes.append(why)
    first: list[Plot] = []
    drawn = build_map_figure(drive, drive_encounters)
    if drawn is not None:
        figure, left_out = drawn
        plot = _make_plot(anchor, "map", "Where everybody drove", "seen from above, north up", figure)
        first.append(replace(plot, origin=_map_origin_text(drive)))
        notes += left_out
    named = warning_anchor_names(entry.name, drive_encounters)
    mark = dict(zip((each.event_id for each in drive_encounters.encounters), named, strict=True))
    with_figures = {each.event_id for each in chosen}
    events = []
    worst = encounters_by_criticality(drive_encounters)[0] if chosen else None
    for encounter in chosen:
        shown = _build_event_view(log, drive, encounter, anchor, pictures, notes, is_in_headline=len(chosen) == 1)
        shown = replace(shown, mark=mark[encounter.event_id])
        if encounter is worst and shown.plots and len(first) == 1 and shown.plots[0].kind == "fan":
            first.append(shown.plots[0])
            shown = replace(shown, plots=shown.plots[1:])
        events.append(shown)
    if (
        not chosen
        and len(first) == 1
        and drive_encounters.nearest is not None
        and not drive_encounters.nearest.is_parked
    ):
        near = nearest_approach_figure(drive, drive_encounters.nearest)
        if near is not None:
            title = f"How near {drive_encounters.nearest.other.kind} {drive_encounters.nearest.other.id} came"
            first.append(_make_plot(anchor, "distance", title, "from the estimated tracks", near))
    signals = _build_signal_plots(drive, drive_encounters, anchor, detail, plots_beside_map=first)
    sensors = build_sensors_view(drive)
    if sensors is not None and detail.has_residuals:
        plots, n_residuals = build_residual_plots(drive, anchor, detail.n_pieces)
        sensors = replace(sensors, plots=tuple(plots), n_residuals=n_residuals)
    return LogView(
        anchor=anchor,
        name=entry.name,
        story=story,
        badges=tuple(options.badges),
        is_alone=options.is_alone,
        is_open=options.is_open,
        first=tuple(first),
        events=tuple(events),
        event_table=all_warnings_table(
            drive, drive_encounters, {key: name for key, name in mark.items() if key not in with_figures}
        )
        if len(drive_encounters.encounters) > len(chosen)
        else None,
        others=tuple(
            filter(
                None,
                (pair_extremes_table(drive, drive_encounters), conflicts_table(drive, drive_encounters, entry.name)),
            )
        ),
        signals=tuple(signals),
        system=tuple(other_system_tables(drive, entry.metrics)),
        frames=tuple(_pictures_in_time_order(drive, pictures)) if not chosen else (),
        player=build_picture_player(drive, over_all),
        sensors=sensors,
        tables=tuple(build_log_tables(drive, entry, has_all_metrics=detail.has_all_metrics)),
        links=(
            *((event.mark, f"warning {event.number}") for event in events),
            *unwarned_conflict_links(drive_encounters, entry.name)[:MAX_MISSED_CONFLICT_LINKS],
        ),
        notes=tuple(dict.fromkeys(notes)),
    )


def _make_plot(anchor: str, kind: str, title: str, hint: str, figure: Figure, suffix: str = "") -> Plot:
    """Make a plot whose id follows from the anchor and the kind."""
    return Plot(f"{anchor}-{kind}{suffix}", kind, title, hint, figure)


def _map_origin_text(drive: Drive) -> str:
    """Format the map's origin as latitude, longitude and altitude; "" if it is not known."""
    local_map = local_map_from_estimate_record(drive.records.get("estimate", {}))
    if local_map is None:
        return ""
    return f"{local_map.origin_lat_deg!r},{local_map.origin_lon_deg!r},{local_map.origin_alt_m!r}"


def _build_event_view(
    log: Log,
    drive: Drive,
    encounter: Encounter,
    anchor: str,
    pictures: dict[int, Thumbnail],
    notes: list[str],
    *,
    is_in_headline: bool,
) -> EventView:
    """Build a warning's part of the section."""
    suffix = f"-{encounter.event_id}"
    plots = []
    has_paths = drive.ego is not None and not encounter.is_lane_departure
    paths = _ego_and_other_paths_known_at_warning(log, drive, encounter, notes) if has_paths else (None, None)
    fan = predicted_paths_figure(drive, encounter, paths)
    if fan is not None:
        at = f"{(encounter.raised_ns - drive.start_ns) / NS_PER_S:.1f}"
        title = f"Warning {encounter.event_id}, at {at} s: the predicted paths"
        plots.append(_make_plot(anchor, "fan", title, "ahead is up; dotted: what followed", fan, suffix))
    distance = distance_and_ttc_figure_around_warning(drive, encounter)
    if distance is not None:
        hint = "by the estimated tracks; time to collision at constant velocities"
        plots.append(_make_plot(anchor, "distance", "How near they came", hint, distance, suffix))
    frames = []
    for offset_s in FRAME_TIME_OFFSETS_FROM_WARNING_S:
        picture = pictures.get(encounter.raised_ns + round(offset_s * NS_PER_S))
        if picture is not None:
            frames.append(
                _build_picture(drive, picture, f"{offset_s:+.0f} s from the warning" if offset_s else "the warning")
            )
    said = (verdict_sentence(drive.warning_config, encounter), careful_driver_sentence(drive, encounter))
    return EventView(
        number=encounter.event_id,
        badge=badge_of_warning_verdict(encounter),
        sentence="" if is_in_headline else encounter_sentence(drive, encounter),
        verdict="" if is_in_headline else " ".join(filter(None, said)),
        plots=tuple(plots),
        table=encounter_facts_table(drive, encounter),
        frames=tuple(frames),
    )


def _ego_and_other_paths_known_at_warning(
    log: Log, drive: Drive, encounter: Encounter, notes: list[str]
) -> tuple[Paths | None, Paths | None]:
    """Return the predicted paths of both vehicles as known at the warning; targets have none."""
    topics = {channel.topic for channel in log.channels}
    assert drive.warnings is not None
    logged_ns = int(drive.warnings.log_time_ns[encounter.rows[0]])
    found: list[Paths | None] = []
    for channel, vehicle in ((EGO_PATH, _ego_id(drive)), (REMOTE_PATH, encounter.other_id)):
        path = None
        if channel.topic in topics:
            try:
                path = _newest_logged_path(log, channel.topic, vehicle, logged_ns, drive.warning_config.max_age_s)
            except CwcliError as error:
                notes.append(error.what)
        found.append(path)
    return found[0], found[1]


def _newest_logged_path(log: Log, topic: str, vehicle: str, at_ns: int, max_age_s: float) -> Paths | None:
    """Return the newest path of a vehicle that had been logged at a time, or None.

    The paths are by far the largest channels of an annotated log: loaded whole, twenty vehicles over ten minutes fill a
    gigabyte. So only what was logged shortly before is read.
    """
    start_ns = max(0, at_ns - round(max_age_s * NS_PER_S))
    predicted = read_predicted_paths(log.load_topics({topic: None}, logged=(start_ns, at_ns + 1))[topic])
    rows = dict(iter_rows_by_id(predicted.ids)).get(vehicle, ())
    if not len(rows):
        return None
    newest = rows[np.lexsort((rows, predicted.stamp_ns[rows]))[-1:]]
    path = predicted.paths.paths_of_rows(newest)
    return path if len(path.time_s) > 1 and np.isfinite(path.x_m).all() and np.isfinite(path.y_m).all() else None


def _ego_id(drive: Drive) -> str:
    """Return the ego's id in the channel of states."""
    assert drive.ego is not None
    return drive.ego.ids.values[int(drive.ego.ids.codes[0])]


def _build_signal_plots(
    drive: Drive, drive_encounters: DriveEncounters, anchor: str, detail: DetailLevel, *, plots_beside_map: list[Plot]
) -> list[Plot]:
    """Build the plots over time; without a map the lane's plot goes to `plots_beside_map`."""
    plots = []
    motion = motion_figure(drive, drive_encounters, detail.n_pieces)
    if motion is not None:
        n = len(drive.ego) if drive.ego is not None else 0
        hint = "blue: estimated, with its 1-sigma band; grey: measured"
        if len(drive.gated):
            hint += "; red crosses: gated"
        if n > 2 * detail.n_pieces:
            hint += (
                f". {n} states are drawn as the least and the largest value of each of {detail.n_pieces} pieces, "
                "the band around all of them; measurements on the same spot once"
            )
        plots.append(_make_plot(anchor, "motion", "How the car moved", hint, motion))
    errors = None if drive.truth is None else truth_error_figure(drive, drive.truth, drive_encounters, detail.n_pieces)
    if errors is not None:
        assert drive.truth is not None
        hint = f"estimated minus {drive.truth.topic}; the band is what the covariance says, 95 % should lie in it"
        plots.append(_make_plot(anchor, "errors", "How wrong the estimate is", hint, errors))
    lane = lane_figure(drive, drive_encounters, detail.n_pieces)
    if lane is not None:
        hint = (
            "at the preview point, with 1-sigma bands; offset: the lane's centre, right positive; heading: of the car "
        )
        hint += "from the lane, left positive; curvature: right positive"
        plot = _make_plot(anchor, "lane", "The car in its lane", hint, lane)
        if not plots_beside_map:
            plots_beside_map.append(plot)
        else:
            plots.append(plot)
    return plots


def _collect_thumbnails(
    log: Log, drive: Drive, chosen: Sequence[Encounter], detail: DetailLevel
) -> tuple[dict[int, Thumbnail], list[Thumbnail], str]:
    """Return thumbnails by the times that are shown, those of the player, and why some are missing."""
    if not drive.camera_topic:
        return {}, [], ""
    frame_times_ns = [
        each.raised_ns + round(offset_s * NS_PER_S) for each in chosen for offset_s in FRAME_TIME_OFFSETS_FROM_WARNING_S
    ]
    if not frame_times_ns:
        span = drive.end_ns - drive.start_ns
        frame_times_ns = [drive.start_ns + span * (2 * k + 1) // (2 * detail.n_frames) for k in range(detail.n_frames)]
    over_all = evenly_spaced_stamps_ns(drive, detail.n_moments)
    found, why = make_thumbnails_and_explain_gaps(log, drive.camera_topic, drive.lanes, [*frame_times_ns, *over_all])
    return {at: found[at] for at in frame_times_ns if at in found}, [found[at] for at in over_all if at in found], why


def _pictures_in_time_order(drive: Drive, pictures: dict[int, Thumbnail]) -> list[Picture]:
    """Return the pictures in order of time, each once."""
    unique: dict[int, Thumbnail] = {picture.stamp_ns: picture for _, picture in sorted(pictures.items())}
    return [_build_picture(drive, picture, "") for picture in unique.values()]


def _build_picture(drive: Drive, picture: Thumbnail, caption_suffix: str) -> Picture:
    at_s = (picture.stamp_ns - drive.start_ns) / NS_PER_S
    caption = f"{at_s:.2f} s: {caption_suffix}" if caption_suffix else f"{at_s:.2f} s"
    if picture.n_lines is not None:
        caption += f", {('no lane boundary', 'one lane boundary', 'both lane boundaries')[picture.n_lines]} found"
    return Picture(picture.data_uri, picture.width_px, picture.height_px, f"Camera frame at {caption}", caption, at_s)


MAX_FRAMES_TEXT_BYTES = 1_300_000
"""The greatest size of a log's frames as text, in bytes; more are thinned out. Chosen by hand; not fitted."""


def evenly_spaced_stamps_ns(drive: Drive, n: int) -> list[int]:
    """Return n stamps, evenly over the log, at which frames are wanted; [] without a camera."""
    if not drive.camera_topic or n < 1:
        return []
    span = drive.end_ns - drive.start_ns
    return [drive.start_ns + span * k // max(n - 1, 1) for k in range(n)]


def build_picture_player(drive: Drive, pictures: Iterable[Thumbnail]) -> Player | None:
    """Build the player of the frames in order of time, thinned out to fit; None of fewer than two."""
    unique = {picture.stamp_ns: picture for picture in pictures}
    shown = [unique[stamp] for stamp in sorted(unique)]
    while len(shown) > 2 and sum(len(each.data_uri) for each in shown) > MAX_FRAMES_TEXT_BYTES:
        shown = shown[::2]
    if len(shown) < 2:
        return None
    return Player(
        first=shown[0].data_uri,
        width_px=shown[0].width_px,
        height_px=shown[0].height_px,
        start_s=round(_seconds_since_start(drive, min(shown[0].stamp_ns, drive.start_ns)), 2),
        end_s=round(_seconds_since_start(drive, max(shown[-1].stamp_ns, drive.end_ns)), 2),
        moments=tuple(
            (round(_seconds_since_start(drive, each.stamp_ns), 3), each.data_uri.partition(",")[2]) for each in shown
        ),
    )


def _seconds_since_start(drive: Drive, stamp_ns: int) -> float:
    """Return the seconds since the log began."""
    return (stamp_ns - drive.start_ns) / NS_PER_S
