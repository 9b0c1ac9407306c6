"""The radio link in the tables of `estimate` and among the headline metrics."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cwcli.estimation.result import Track
from cwcli.evaluation.link import LINK_TABLE_COLUMNS, RadioLinkSummary, add_link_metrics
from cwcli.metrics.headline import HeadlineCollector
from tests.unit.signals.pseudonyms import HERE, scene

N_LOST = 3


def link_with_losses() -> RadioLinkSummary:
    """A car that counts its messages, three of which are lost, 100 m behind the receiver's place when it starts."""
    made = scene(np.random.default_rng(1), n_cars=1)
    is_first = np.flatnonzero(made.signal.station.codes == 0)
    rows = np.delete(is_first, [10, 20, 21])
    station = replace(made.signal.station, codes=made.signal.station.codes[rows])
    columns: dict[str, Any] = {
        name: values[rows]
        for name in made.signal.__dataclass_fields__
        if isinstance(values := getattr(made.signal, name), np.ndarray)
    }
    count = np.delete(np.arange(len(is_first), dtype=np.float64) + 100.0, [10, 20, 21]) % 128.0
    signal = replace(made.signal, station=station, **(columns | {"message_count": count}))
    x_m, y_m, _ = HERE.map_from_wgs84(signal.latitude_deg[:1], signal.longitude_deg[:1], signal.altitude_m[:1])
    stamp_ns = np.array([signal.log_time_ns[0] - 1, signal.log_time_ns[-1] + 1])
    state = np.zeros((2, 8))
    state[:, 0], state[:, 1] = x_m - 100.0, y_m
    grid_ns = np.linspace(stamp_ns[0], stamp_ns[1], 200).astype(np.int64)
    ego = Track(grid_ns, np.repeat(state[:1], 200, axis=0), np.zeros((200, 8, 8)), np.zeros(200, np.uint8))
    return RadioLinkSummary([signal], ego, HERE)


def test_the_tables_tell_each_station_and_the_distances() -> None:
    link = link_with_losses()
    stations, reception = link.build_sections()
    (row,) = link.build_tables()["link"].rows_as_dicts()
    assert len(stations.rows[0]) == len(stations.columns) == len(LINK_TABLE_COLUMNS)
    assert row["sent"] - row["received"] == N_LOST
    assert row["loss_share"] == pytest.approx(N_LOST / row["sent"])
    assert row["latency_median_s"] == pytest.approx(0.03)
    assert 0.13 < row["age_p95_s"] < 0.4  # 30 ms, and up to three periods of 0.1 s
    assert row["range_m"] > 100.0
    assert sum(int(str(cells[1])) for cells in reception.rows) == row["sent"]
    assert sum(int(str(cells[2])) for cells in reception.rows) == row["received"]


def test_the_record_holds_what_the_metrics_are_made_of() -> None:
    link = link_with_losses()
    headline = HeadlineCollector()
    add_link_metrics(headline, json.loads(link.build_record_entries()["link"]))
    found = {row["metric"]: row["value"] for row in headline.to_table().rows_as_dicts()}
    (row,) = link.build_tables()["link"].rows_as_dicts()
    assert found["link.stations_count"] == 1.0
    assert found["link.loss_share"] == pytest.approx(row["loss_share"])
    assert found["link.age_p95_s"] == pytest.approx(row["age_p95_s"])
    assert found["link.latency_p95_s"] == pytest.approx(0.03)
    assert found["link.range_max_m"] == pytest.approx(row["range_m"])


def test_without_remote_vehicles_nothing_is_told() -> None:
    nobody = Track(np.zeros(1, np.int64), np.zeros((1, 8)), np.zeros((1, 8, 8)), np.zeros(1, np.uint8))
    link = RadioLinkSummary([], nobody, HERE)
    assert (link.build_sections(), link.build_tables(), link.build_record_entries()) == ((), {}, {})
    headline = HeadlineCollector()
    add_link_metrics(headline, {})
    assert not headline.rows
