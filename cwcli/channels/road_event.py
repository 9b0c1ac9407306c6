"""`cwcli.v1.RoadEvent`: events that V2X stations report, such as hard braking or a stationary vehicle."""

from __future__ import annotations

import numpy as np

from cwcli.channels.output import make_output_channel
from cwcli.channels.published import REMOTE_EVENTS
from cwcli.metrics.table import Table
from cwcli.signals.columns import Columns, Field, OutputChannel
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.leaf_fields import read_integers, read_numbers, read_texts
from cwcli.signals.road_events import RoadEvents


def make_road_event_channels(events: RoadEvents | None, local_map: LocalMap | None) -> tuple[OutputChannel, ...]:
    """Make the channel of one message a reported event, logged at its reception; no channel without events.

    Args:
        events: The reported events, or None.
        local_map: Map in which their positions are given too; None leaves these unknown.
    """
    if events is None:
        return ()
    return (make_output_channel(REMOTE_EVENTS, events.log_time_ns, _road_event_fields(events, local_map)),)


def road_event_table_by_name(events: RoadEvents | None, local_map: LocalMap | None) -> dict[str, Table]:
    """Make the table of reported events, by its name."""
    if events is None:
        return {}
    columns = {"log_time_ns": events.log_time_ns, **_road_event_fields(events, local_map)}
    return {"road_events": Table("road_events", columns)}


def _road_event_fields(events: RoadEvents, local_map: LocalMap | None) -> dict[str, Field]:
    nothing = np.full(len(events), np.nan)
    x_m, y_m = nothing, nothing
    if local_map is not None and len(events):
        x_m, y_m, _ = local_map.map_from_wgs84(events.latitude_deg, events.longitude_deg, nothing)
    return {
        "stamp_ns": events.stamp_ns,
        "id": events.station,
        "kind": events.kind,
        "until_ns": events.until_ns,
        "cause_code": events.cause,
        "sub_cause_code": events.sub_cause,
        "latitude_deg": events.latitude_deg,
        "longitude_deg": events.longitude_deg,
        "x_m": x_m,
        "y_m": y_m,
        "relevance_m": events.relevance_m,
    }


def read_road_events(columns: Columns) -> RoadEvents:
    """Read the events of a channel, in log-time order.

    Raises:
        DataError: A field is missing: another version wrote them.
    """
    for place in ("x_m", "y_m"):  # not needed here; without them another version wrote the channel
        read_numbers(columns, place, required=True)
    return RoadEvents(
        station=read_texts(columns, "id", required=True),
        kind=read_texts(columns, "kind", required=True),
        stamp_ns=read_integers(columns, "stamp_ns", required=True)[0],
        log_time_ns=columns.log_time_ns,
        until_ns=read_integers(columns, "until_ns", required=True)[0],
        cause=read_numbers(columns, "cause_code", required=True),
        sub_cause=read_numbers(columns, "sub_cause_code", required=True),
        latitude_deg=read_numbers(columns, "latitude_deg", required=True),
        longitude_deg=read_numbers(columns, "longitude_deg", required=True),
        relevance_m=read_numbers(columns, "relevance_m", required=True),
    )
