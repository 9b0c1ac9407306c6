"""The radio link from each remote vehicle: tables of `estimate`, an entry of its record, and headline metrics."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cwcli.estimation.result import Track
from cwcli.metrics.headline import HeadlineCollector
from cwcli.metrics.table import ColumnDoc, Table
from cwcli.pipeline.json_names import CellWithValues
from cwcli.pipeline.records import read_finite_number_or_nan
from cwcli.pipeline.result import SummaryTable
from cwcli.signals.canonical import RemoteSignal, Signal
from cwcli.signals.columns import FloatArray
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.radio_link import ReceptionByDistance, StationLink, information_age_quantile_s, measure_station_links
from cwcli.signals.remotes import join_remote_signals, perceived_rows_mask, select_remote_rows
from cwcli.signals.resample import interpolate_signal_at_times

REPORTED_AGE_QUANTILE = 0.95
"""Quantile of the age of the newest message that is reported."""
MAX_INTERPOLATED_EGO_GAP_S = 0.5
"""Longest gap of the ego's track that is interpolated, s. Chosen by hand; not fitted."""
LINK_TABLE_COLUMNS: Mapping[str, ColumnDoc] = {
    "station": ColumnDoc(doc="id of the sender"),
    "received": ColumnDoc(doc="messages received and in order"),
    "sent": ColumnDoc(doc="messages sent, by the sender's message count; NaN where it does not count"),
    "loss_share": ColumnDoc(doc="share of the sent messages that were not received"),
    "rate_hz": ColumnDoc(unit="Hz", doc="messages sent per second; received ones where the sender does not count"),
    "latency_median_s": ColumnDoc(
        unit="s", doc="median time from generation to reception; NaN where the clocks differ"
    ),
    "latency_p95_s": ColumnDoc(unit="s", doc="95 % quantile of the time from generation to reception"),
    "age_p95_s": ColumnDoc(unit="s", doc="age of the newest message: it was younger for 95 % of the time"),
    "gaps": ColumnDoc(doc="pauses of more than five periods, and of 1 s at least"),
    "longest_gap_s": ColumnDoc(unit="s", doc="the longest pause"),
    "absences": ColumnDoc(doc="pauses so long that the message count may have wrapped; they count as no loss"),
    "range_m": ColumnDoc(unit="m", doc="greatest distance of reception from the ego"),
}
"""Columns of the table `link`, which has one row per station."""
LINK_HEADINGS = (
    "station",
    "messages received",
    "messages sent, by their counter",
    "packet error ratio",
    "message rate of the sender [Hz]",
    "median delay from generation to reception [s]",
    "95 % of these delays below [s]",
    "age of the newest message, 95 % of the time below [s]",
    "pauses in reception",
    "longest pause [s]",
    "pauses too long for counting losses",
    "greatest distance at reception [m]",
)
"""Headings of the table `link` on the terminal, in the order of its columns."""


class RadioLinkSummary:
    """Summary of the radio link of a log."""

    def __init__(self, signals: Sequence[Signal], ego: Track, local_map: LocalMap | None) -> None:
        """Summarise the link.

        Args:
            signals: Signals of remote vehicles; Cartesian ones were not received by radio and are ignored.
            local_map: Map of the track, None where it is not georeferenced.
        """
        remotes = [signal for signal in signals if isinstance(signal, RemoteSignal) and signal.x_m is None]
        self.stations: list[StationLink] = []
        self.reception = ReceptionByDistance(np.zeros(1), np.zeros(0, np.int64), np.zeros(0, np.int64))
        signal = join_remote_signals(remotes) if remotes else None
        if signal is not None:
            signal = select_remote_rows(signal, np.flatnonzero(~perceived_rows_mask(signal)))
            self.stations, self.reception = measure_station_links(
                signal, _sender_distance_to_ego_m(signal, ego, local_map)
            )

    def build_sections(self) -> tuple[SummaryTable, ...]:
        """Return sections on the stations and on the reception by distance; none without remote vehicles."""
        if not self.stations:
            return ()
        sections = [
            SummaryTable(
                "link",
                "Radio link from each station",
                LINK_HEADINGS,
                tuple(map(_station_row, self.stations)),
                names=tuple(LINK_TABLE_COLUMNS),
            )
        ]
        shown = self.reception.sent > 0
        if shown.any():
            edges_m = self.reception.edges_m
            rows = tuple(
                (
                    _distance_range_cell(float(edges_m[k]), float(edges_m[k + 1])),
                    int(sent),
                    int(received),
                    float(1.0 - received / sent),
                )
                for k, (received, sent) in enumerate(zip(self.reception.received, self.reception.sent, strict=True))
                if sent
            )
            columns = ("distance of sender and ego [m]", "messages sent", "messages received", "packet error ratio")
            names = ("distance [m]", "sent", "received", "loss_share")
            sections.append(
                SummaryTable("reception", "Loss of messages, by distance of sender and ego", columns, rows, names=names)
            )
        return tuple(sections)

    def build_tables(self) -> dict[str, Table]:
        """Return the table `link`; nothing without remote vehicles."""
        if not self.stations:
            return {}
        columns = dict(zip(LINK_TABLE_COLUMNS, zip(*map(_station_row, self.stations), strict=True), strict=True))
        columns_by_name: dict[str, Any] = {
            name: list(values) if name == "station" else np.array(values, np.float64)
            for name, values in columns.items()
        }
        return {"link": Table("link", columns_by_name, dict(LINK_TABLE_COLUMNS))}

    def build_record_entries(self) -> dict[str, str]:
        """Return the record's entry with the sums for the headline metrics."""
        if not self.stations:
            return {}
        counted = [each for each in self.stations if math.isfinite(each.n_sent)]
        sums = {
            "stations": len(self.stations),
            "sent": sum(each.n_sent for each in counted),
            "lost": sum(each.n_sent - each.n_received for each in counted),
            "age_p95_s": information_age_quantile_s([each.age for each in self.stations], REPORTED_AGE_QUANTILE),
            "latency_p95_s": _greatest_finite_or_nan(each.latency_p95_s for each in self.stations),
            "range_m": _greatest_finite_or_nan(each.range_m for each in self.stations),
        }
        known = {name: value for name, value in sums.items() if math.isfinite(value)}
        return {"link": json.dumps(known)}


def add_link_metrics(headline: HeadlineCollector, entry: Mapping[str, Any]) -> None:
    """Add the metrics of the link from the record's entry; nothing without remote vehicles."""
    if not entry:
        return
    headline.add_count("link.stations_count", read_finite_number_or_nan(entry, "stations"))
    if read_finite_number_or_nan(entry, "sent") > 0:
        headline.add_from_sums(
            "link.loss_share", read_finite_number_or_nan(entry, "lost"), read_finite_number_or_nan(entry, "sent")
        )
    for metric, name in (
        ("link.age_p95_s", "age_p95_s"),
        ("link.latency_p95_s", "latency_p95_s"),
        ("link.range_max_m", "range_m"),
    ):
        if name in entry:
            headline.add_from_sums(metric, read_finite_number_or_nan(entry, name), 1.0)


def _distance_range_cell(low_m: float, high_m: float) -> CellWithValues:
    return CellWithValues(f"{low_m:.0f} to {high_m:.0f}", {"low": low_m, "high": high_m})


def _station_row(link: StationLink) -> tuple[str | float | int, ...]:
    return (
        link.station,
        link.n_received,
        int(link.n_sent) if math.isfinite(link.n_sent) else link.n_sent,
        link.loss_share,
        link.rate_hz,
        link.latency_median_s,
        link.latency_p95_s,
        information_age_quantile_s([link.age], REPORTED_AGE_QUANTILE),
        link.n_gaps,
        link.longest_gap_s,
        link.n_absences,
        link.range_m,
    )


def _sender_distance_to_ego_m(signal: RemoteSignal, ego: Track, local_map: LocalMap | None) -> FloatArray:
    """Return the distance (n,), m, of each sender from the ego at reception; NaN where a position is unknown."""
    if local_map is None:
        return np.full(len(signal.stamp_ns), np.nan)
    altitude_m = np.nan_to_num(signal.altitude_m, nan=0.0)
    x_m, y_m, _ = local_map.map_from_wgs84(signal.latitude_deg, signal.longitude_deg, altitude_m)
    ego_xy = interpolate_signal_at_times(
        ego.stamp_ns, ego.state[:, :2], signal.log_time_ns, max_gap_s=MAX_INTERPOLATED_EGO_GAP_S
    )
    distance_m: FloatArray = np.hypot(x_m - ego_xy[:, 0], y_m - ego_xy[:, 1])
    return distance_m


def _greatest_finite_or_nan(values: Any) -> float:
    return max((value for value in values if math.isfinite(value)), default=float("nan"))
