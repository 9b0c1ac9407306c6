"""Senders among what others perceived."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from cwcli.estimation.seen_senders import without_seen_senders
from cwcli.signals.canonical import RemoteQuantities, RemoteSignal
from cwcli.signals.columns import strings_from
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.remotes import joined_remotes

S = 1_000_000_000
PLACE = LocalMap(50.0, 8.0)
STEP_S = 0.1
N = 40


def road_user(name: str, *, is_perceived: bool, east_m: Any = 0.0, north_m: Any = 0.0, **told: Any) -> RemoteSignal:
    """Eastward at 10 m/s from a place on, told ten times a second; 0.2 m (one sigma) each way."""
    time_s = 1.0 + STEP_S * np.arange(N) + (0.03 if is_perceived else 0.0)
    latitude, longitude, _ = PLACE.wgs84_from_map(10.0 * time_s + east_m, north_m + np.zeros(N), np.zeros(N))
    values: dict[str, Any] = {entry.name: np.full(N, np.nan) for entry in fields(RemoteQuantities)}
    sigma_m = told.pop("sigma_m", 0.2)
    values |= {"latitude_deg": latitude, "longitude_deg": longitude, "speed_mps": np.full(N, 10.0)}
    values |= {"heading_rad": np.zeros(N), "position_covariance_m2": np.tile([sigma_m**2, 0.0, sigma_m**2], (N, 1))}
    values |= {key: np.full(N, value, np.float64) for key, value in told.items()}
    stamp_ns = np.round(time_s * S).astype(np.int64)
    return RemoteSignal(
        **values,
        source="/v2x",
        station=strings_from([name] * N),
        stamp_ns=stamp_ns,
        log_time_ns=stamp_ns + S // 100,
        is_perceived=np.full(N, is_perceived),
    )


def sender(name: str = "7", **how: Any) -> RemoteSignal:
    return road_user(name, is_perceived=False, **how)


def seen(name: str = "9:1", **how: Any) -> RemoteSignal:
    return road_user(name, is_perceived=True, **how)


def left(*parts: RemoteSignal) -> tuple[dict[str, int], tuple[str, ...]]:
    """How many rows of each id are left, and the notes."""
    signal, notes = without_seen_senders(joined_remotes(parts), PLACE)
    names = [signal.station.values[code] for code in signal.station.codes]
    return {name: names.count(name) for name in sorted(set(names))}, notes


def test_a_sender_that_is_seen_is_there_once() -> None:
    """From the third moment on: two are no proof."""
    counts, notes = left(sender(), seen(east_m=0.3, north_m=-0.2))
    assert counts == {"7": N, "9:1": 2}
    assert notes == ("1 objects that others perceived are senders that are heard themselves: 38 times, left out",)


@pytest.mark.parametrize(
    "other",
    [
        {"north_m": 3.5},  # in the next lane
        {"north_m": 2.3},  # as near as cars get
        {"east_m": 7.0},  # behind
        {"speed_mps": 15.0},
        {"speed_mps": -10.0},
        {"heading_rad": 0.5},
    ],
)
def test_another_car_stays(other: dict[str, float]) -> None:
    counts, notes = left(sender(), seen(**other))
    assert counts == {"7": N, "9:1": N}
    assert not notes


def test_where_positions_are_vague_both_stay_and_it_is_said() -> None:
    counts, notes = left(sender(sigma_m=1.0), seen())
    assert counts == {"7": N, "9:1": N}
    assert notes[0].startswith("1 objects that others perceived may be senders")


def test_between_two_senders_in_one_place_nobody_decides() -> None:
    counts, notes = left(sender("7", north_m=0.3), sender("8", north_m=-0.3), seen())
    assert counts == {"7": N, "8": N, "9:1": N}
    assert notes[0].startswith("1 objects that others perceived may be senders")


def test_what_is_silent_is_seen() -> None:
    whole = sender()
    silent = replace(whole, **{entry.name: getattr(whole, entry.name)[:10] for entry in fields(RemoteQuantities)})
    silent = replace(
        silent,
        station=strings_from(["7"] * 10),
        stamp_ns=whole.stamp_ns[:10],
        log_time_ns=whole.log_time_ns[:10],
        is_perceived=np.zeros(10, np.bool_),
    )
    counts, _ = left(silent, seen())
    # heard up to a second after its last message at 1.9 s: the objects of 1.03 to 2.83 s but the first two are left out
    assert counts == {"7": 10, "9:1": N - 17}


def test_a_row_depends_on_nothing_that_was_received_later() -> None:
    rng = np.random.default_rng(3)
    noisy = seen(north_m=0.8 * rng.standard_normal(N), sigma_m=0.4)
    late = sender()
    late = replace(late, log_time_ns=late.log_time_ns + (rng.random(N) * 0.3 * S).astype(np.int64))
    whole = joined_remotes([late, noisy])
    kept, _ = without_seen_senders(whole, PLACE)
    assert 0 < np.count_nonzero(kept.is_perceived) < N
    for cut_ns in (2 * S, 3 * S, 4 * S):
        before = np.flatnonzero(whole.log_time_ns < cut_ns)
        part = replace(
            whole,
            **{name: getattr(whole, name)[before] for name in (entry.name for entry in fields(RemoteQuantities))},
            station=whole.station.rows(before),
            stamp_ns=whole.stamp_ns[before],
            log_time_ns=whole.log_time_ns[before],
            is_perceived=np.asarray(whole.is_perceived)[before],
        )
        early, _ = without_seen_senders(part, PLACE)
        expected = kept.stamp_ns[kept.log_time_ns < cut_ns]
        assert early.stamp_ns.tolist() == expected.tolist()


def test_two_cars_are_hardly_ever_taken_for_one() -> None:
    """Receivers and sensors whose errors last, as wrong as they say; the nearest neighbour that a road has."""
    rng = np.random.default_rng(0)
    n_joined = {"itself": 0, "neighbour": 0}
    n_drives = 600
    for _ in range(n_drives):
        sigmas = rng.uniform(0.1, 0.6, 2)
        wrong = rng.normal(size=(2, 2)) * sigmas[:, None]
        own = sender(east_m=wrong[0, 0], north_m=wrong[0, 1], sigma_m=sigmas[0])
        for name, lane_m in (("itself", 0.0), ("neighbour", 2.3)):
            other = seen(east_m=wrong[1, 0], north_m=lane_m + wrong[1, 1], sigma_m=sigmas[1])
            n_joined[name] += left(own, other)[0]["9:1"] < N
    assert n_joined["neighbour"] <= 2  # a thousandth is 0.6
    assert n_joined["itself"] > n_drives // 3
