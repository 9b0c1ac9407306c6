"""Reads the contents of an annotated log that can be exported, as tables and as tracks."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cwcli.channels.published import (
    EGO_ONLINE,
    EGO_PATH,
    EGO_STATE,
    LANES,
    OBSERVER,
    PAIR_MEASURES,
    REJECTED,
    REMOTE_ONLINE,
    REMOTE_PATH,
    REMOTE_STATE,
    TARGETS,
    WARNINGS,
    Channel,
)
from cwcli.channels.target import read_targets_as_states
from cwcli.channels.vehicle_state import KINEMATIC_FIELDS, read_vehicle_states
from cwcli.errors import DataError, MissingSignalError, UsageError
from cwcli.export.track_formats import Track
from cwcli.logs.read.reader import Log
from cwcli.metrics.table import Table
from cwcli.pipeline.records import local_map_from_estimate_record, read_run_records
from cwcli.signals.columns import Columns, Field, Strings, median_of_finite, select_column_rows
from cwcli.signals.row_order import iter_track_rows
from cwcli.signals.vehicle_state import ACCEL, YAW_RATE
from cwcli.text import join_names

MAX_VEHICLES_IN_ERROR = 10
"""Greatest number of vehicles that an error names. Chosen by hand."""
CONTENTS_OF_ALL_VEHICLES = ("ego", "remote", "targets")
"""Contents that a format for all vehicles takes together, if the log has them."""


class ExportContent(NamedTuple):
    """One content of a log that can be exported."""

    channel: Channel
    is_tracks: bool = False


CHANNEL_BY_EXPORT_CONTENT_NAME = {
    "ego": ExportContent(EGO_STATE, is_tracks=True),
    "ego-online": ExportContent(EGO_ONLINE, is_tracks=True),
    "remote": ExportContent(REMOTE_STATE, is_tracks=True),
    "remote-online": ExportContent(REMOTE_ONLINE, is_tracks=True),
    "targets": ExportContent(TARGETS, is_tracks=True),
    "lanes": ExportContent(LANES),
    "observer": ExportContent(OBSERVER),
    "paths": ExportContent(EGO_PATH),
    "remote-paths": ExportContent(REMOTE_PATH),
    "warnings": ExportContent(WARNINGS),
    "measures": ExportContent(PAIR_MEASURES),
    "rejected": ExportContent(REJECTED),
}
"""Name of a content, as `--what` spells it -> its channel."""


def content_names_of_ego_and_others(log: Log) -> list[str]:
    """Names of the contents of the ego and of all other vehicles that the log holds; at least the ego's."""
    topics_of_log = {channel.topic for channel in log.channels if channel.message_count}
    return [
        what for what in CONTENTS_OF_ALL_VEHICLES if CHANNEL_BY_EXPORT_CONTENT_NAME[what].channel.topic in topics_of_log
    ] or [CONTENTS_OF_ALL_VEHICLES[0]]


def require_content_in_log(log: Log, what: str) -> None:
    """Check that the log holds a content.

    Raises:
        MissingSignalError: It does not; the error names what the log holds.
    """
    topics_of_log = {channel.topic for channel in log.channels}
    channel = CHANNEL_BY_EXPORT_CONTENT_NAME[what].channel
    if channel.topic in topics_of_log:
        return
    contents_of_log = tuple(
        f"{name} ({each.channel.topic})"
        for name, each in CHANNEL_BY_EXPORT_CONTENT_NAME.items()
        if each.channel.topic in topics_of_log
    )
    raise MissingSignalError(
        f"no channel {channel.topic}: there is no `{what}` to export",
        where=log.name,
        found=contents_of_log or ("no channel of cwcli",),
        hint=f"`cwcli {channel.stage} LOG -o annotated.mcap` makes it",
    )


def table_to_export(log: Log, what: str, vehicle: str | None) -> Table:
    """Read a content as a table with a row a message: log time, then the published fields.

    Args:
        what: A name in `CONTENTS`.
        vehicle: Only the rows with this id, or None for all.

    Raises:
        UsageError: No row has the id; the error names the ids there are.
        InputError: The log is damaged.
    """
    columns = log.columns(CHANNEL_BY_EXPORT_CONTENT_NAME[what].channel.topic)
    fields: dict[str, Field] = {"log_time_ns": columns.log_time_ns, **columns.fields}
    if vehicle is not None:
        rows = _rows_of_vehicle(columns, vehicle, what)
        fields = {name: select_column_rows(column, rows) for name, column in fields.items()}
    return Table(what.replace("-", "_"), fields)


def tracks_to_export(log: Log, what: str, vehicle: str | None) -> list[Track]:
    """Read states as tracks, one a vehicle, in the order of their first states.

    Raises:
        UsageError: No state has the id; the error names the ids there are.
        MissingSignalError: There is no state.
        DataError: Another version wrote the channel.
        InputError: The log is damaged.
    """
    topic = CHANNEL_BY_EXPORT_CONTENT_NAME[what].channel.topic
    if what == "targets":
        states = read_targets_as_states(log.columns(topic))
    else:
        states = read_vehicle_states(log.load_topics({topic: KINEMATIC_FIELDS})[topic], with_covariance=False)
    local_map = local_map_from_estimate_record(read_run_records(log).get("estimate", {}))
    latitude_deg, longitude_deg = np.full((2, len(states)), np.nan)
    if local_map is not None:
        x_m, y_m = states.state[:, 0], states.state[:, 1]
        latitude_deg, longitude_deg, _ = local_map.wgs84_from_map(x_m, y_m, np.zeros(len(states)))
    found = []
    known = list(iter_track_rows(states.ids, states.stamp_ns))
    for name, all_rows in known:
        rows = all_rows[np.isfinite(states.state[all_rows, :4]).all(axis=1)]
        if (vehicle is None or name == vehicle) and len(rows):
            x_m, y_m, speed_mps, heading_rad = states.state[rows, :4].T
            place = latitude_deg[rows], longitude_deg[rows]
            motion = {"accel_mps2": states.state[rows, ACCEL], "yaw_rate_radps": states.state[rows, YAW_RATE]}
            length_m, width_m = states.length_m[rows], states.width_m[rows]
            size_m = median_of_finite(length_m), median_of_finite(width_m)
            track = Track(name, states.stamp_ns[rows], x_m, y_m, heading_rad, speed_mps, *place, what, size_m=size_m)
            found.append(replace(track, **motion))
    if vehicle is not None and not found:
        raise _unknown_vehicle_error(vehicle, [name for name, _ in known], what)
    if not found:
        raise MissingSignalError(f"{topic} holds no state", where=log.name)
    return found


def require_geographic_positions(tracks: list[Track], log: Log, name: str) -> None:
    """Check that the tracks have latitudes and longitudes.

    Raises:
        DataError: They have none: the log's positions are Cartesian.
    """
    if not all(np.isfinite(track.latitude_deg).all() for track in tracks):
        raise DataError(
            f"{name} holds latitudes and longitudes, and the map of this log has no place on the earth",
            where=log.name,
            hint="export it as csv, parquet, tum or kitti",
        )


def _rows_of_vehicle(columns: Columns, vehicle: str, what: str) -> np.ndarray[tuple[int, ...], np.dtype[np.intp]]:
    """Row numbers of a vehicle's messages, by its id."""
    named = [columns.fields.get(field) for field in ("id", "other_id")]
    ids = next((column for column in named if isinstance(column, Strings)), None)
    if ids is None:
        raise UsageError(f"--id {vehicle}: `{what}` is not about several vehicles")
    if vehicle not in ids.values:
        raise _unknown_vehicle_error(vehicle, list(ids.values), what)
    return np.flatnonzero(ids.codes == ids.values.index(vehicle))


def _unknown_vehicle_error(vehicle: str, known: list[str], what: str) -> UsageError:
    shown = join_names(known[:MAX_VEHICLES_IN_ERROR]) if known else "nobody"
    more = f" and {len(known) - MAX_VEHICLES_IN_ERROR} more" if len(known) > MAX_VEHICLES_IN_ERROR else ""
    return UsageError(f"--id {vehicle}: `{what}` holds no such vehicle", hint=f"it holds {shown}{more}")
