"""The radio link: injected losses come back, pauses that hide the count's turns are none, ages by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cwcli.signals.canonical import RemoteQuantities, RemoteSignal
from cwcli.signals.columns import FloatArray, Strings
from cwcli.signals.radio_link import information_age_quantile_s, measure_station_links

T0_NS = 1_600_000_000_000_000_000
NAN = float("nan")


def signal_of(
    sent_s: np.ndarray, count: np.ndarray, latency_s: np.ndarray | float = 0.05, n_stations: int = 1
) -> RemoteSignal:
    n = len(sent_s)
    stamp_ns = T0_NS + np.round(sent_s * 1e9).astype(np.int64)
    nothing = np.full(n, np.nan)
    quantities: dict[str, Any] = dict.fromkeys(RemoteQuantities.__dataclass_fields__, nothing)
    quantities |= {"position_covariance_m2": np.full((n, 3), np.nan), "message_count": count}
    station = Strings(np.arange(n, dtype=np.int32) % n_stations, tuple(f"{k}" for k in range(n_stations)))
    log_ns = stamp_ns + np.round(np.broadcast_to(latency_s, n) * 1e9).astype(np.int64)
    return RemoteSignal(
        **{**quantities, "source": "/v2x", "station": station, "stamp_ns": stamp_ns, "log_time_ns": log_ns}
    )


@pytest.mark.parametrize(("share", "seed"), [(0.0, 1), (0.02, 2), (0.3, 3), (0.9, 4)])
def test_injected_loss_is_reported_exactly(share: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    is_heard = rng.random(20_000) >= share
    is_heard[[0, -1]] = True
    number = np.flatnonzero(is_heard)
    sent_s = 0.1 * number + rng.uniform(-0.02, 0.02, len(number))
    distance_m = 120.0 + 0.0 * sent_s
    (link,), reception = measure_station_links(signal_of(sent_s, (number + 77) % 128.0), distance_m)
    assert link.n_sent == 20_000
    assert link.n_received == len(number)
    assert link.loss_share == pytest.approx(1.0 - len(number) / 20_000, abs=1e-12)
    assert link.rate_hz == pytest.approx(10.0, rel=1e-3)
    assert link.n_absences == 0
    assert reception.sent.tolist() == [0, 0, 20_000]
    assert reception.received.tolist() == [0, 0, len(number)]
    assert reception.edges_m.tolist() == [0.0, 50.0, 100.0, 150.0]


def test_a_pause_in_which_the_count_may_go_round_is_an_absence() -> None:
    sent_s = np.concatenate([0.1 * np.arange(50), 60.0 + 0.1 * np.arange(50)])
    (link,), _ = measure_station_links(signal_of(sent_s, np.arange(100.0)), np.full(100, NAN))
    assert (link.n_absences, link.n_sent, link.loss_share) == (1, 100, 0.0)
    assert link.present_s == pytest.approx(9.8)
    assert link.rate_hz == pytest.approx(10.0)
    assert link.longest_gap_s == pytest.approx(0.1)


@pytest.mark.parametrize("count", [np.full(60, 7.0), np.full(60, NAN)])
def test_a_sender_that_does_not_count_has_no_known_loss(count: FloatArray) -> None:
    sent_s = np.delete(0.1 * np.arange(90), np.arange(20, 50))
    (link,), reception = measure_station_links(signal_of(sent_s, count), np.full(60, 30.0))
    assert np.isnan(link.loss_share)
    assert link.n_gaps == 1
    assert link.longest_gap_s == pytest.approx(3.1)
    assert reception.sent.sum() == 0


def test_lost_messages_were_sent_between_those_that_arrived() -> None:
    (_,), reception = measure_station_links(
        signal_of(np.array([0.0, 0.1, 0.5]), np.array([126.0, 127.0, 3.0])), np.array([0.0, 40.0, 80.0])
    )
    assert reception.edges_m.tolist() == [0.0, 50.0, 100.0]
    assert reception.received.tolist() == [2, 1]
    assert reception.sent.tolist() == [2, 4]  # lost at 50, 60 and 70 m


def test_clocks_that_disagree_tell_no_latency() -> None:
    sent_s, count = 0.1 * np.arange(20), np.arange(20.0)
    nowhere = np.full(20, NAN)
    for latency_s, known in ((0.05, True), (-0.095, False), (0.0, False)):
        (link,), _ = measure_station_links(signal_of(sent_s, count, latency_s), nowhere)
        assert np.isfinite(link.latency_median_s) == known
        assert link.age[0].tolist() == pytest.approx([0.05, 0.15] if known else [0.0, 0.1])


def test_stations_are_told_apart() -> None:
    links, _ = measure_station_links(
        signal_of(0.05 * np.arange(200), np.arange(200) // 2 % 128.0, n_stations=2), np.full(200, NAN)
    )
    assert [(link.station, link.n_sent, link.n_received) for link in links] == [("0", 100, 100), ("1", 100, 100)]


@pytest.mark.parametrize(
    ("ages", "share", "expected"),
    [
        ([[0.0, 1.0]], 0.95, 0.95),
        ([[0.1, 0.2]], 0.5, 0.15),
        ([[0.0, 1.0], [0.0, 3.0]], 0.5, 1.0),  # 1 s + 1 s of 4 s are below 1 s
        ([[0.0, 1.0], [0.0, 3.0]], 0.75, 2.0),
        ([[0.0, 1.0], [2.0, 3.0]], 0.75, 2.5),
    ],
)
def test_the_age_that_is_not_exceeded_for_a_share_of_the_time(
    ages: list[list[float]], share: float, expected: float
) -> None:
    assert information_age_quantile_s([np.array(ages)], share) == pytest.approx(expected)


def test_without_a_second_message_there_is_no_age() -> None:
    (link,), _ = measure_station_links(signal_of(np.zeros(1), np.zeros(1)), np.zeros(1))
    assert np.isnan(information_age_quantile_s([link.age], 0.95))
    assert np.isnan(link.loss_share)
    assert link.range_m == 0.0
