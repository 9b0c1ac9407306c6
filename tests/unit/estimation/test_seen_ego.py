"""The ego among what others perceived."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from cwcli.estimation.result import Track
from cwcli.estimation.seen_ego import drop_ego_seen_by_others_and_note
from cwcli.signals.canonical import RemoteQuantities, RemoteSignal
from cwcli.signals.columns import encode_strings
from cwcli.signals.geodesy import LocalMap

S = 1_000_000_000
PLACE = LocalMap(50.0, 8.0)


def ego_track(n: int = 101) -> Track:
    """Eastward at 10 m/s, ten states a second."""
    state = np.zeros((n, 8))
    state[:, 0] = np.arange(n)
    state[:, 2] = 10.0
    return Track(np.arange(n) * S // 10, state, np.zeros((n, 8, 8)), np.zeros(n, np.uint8))


def seen(offsets_m: dict[str, tuple[float, float]], *, is_perceived: bool = True) -> RemoteSignal:
    """Each object at a constant offset (east, north) from the ego, told every 0.3 s."""
    time_s = np.arange(1, 31) * 0.3
    names = [name for _ in time_s for name in offsets_m]
    stamps = np.repeat(time_s, len(offsets_m))
    east, north = np.array([offsets_m[name] for name in names]).T
    latitude, longitude, _ = PLACE.wgs84_from_map(10.0 * stamps + east, north, np.zeros(len(stamps)))
    nothing: dict[str, Any] = {entry.name: np.full(len(stamps), np.nan) for entry in fields(RemoteQuantities)}
    nothing |= {"latitude_deg": latitude, "longitude_deg": longitude}
    nothing["position_covariance_m2"] = np.full((len(stamps), 3), np.nan)
    stamp_ns = np.round(stamps * S).astype(np.int64)
    return RemoteSignal(
        **nothing,
        source="/cpm",
        station=encode_strings(names),
        stamp_ns=stamp_ns,
        log_time_ns=stamp_ns,
        is_perceived=np.full(len(stamps), is_perceived),
    )


def test_what_lies_on_the_ego_is_left_out_and_its_neighbours_stay() -> None:
    signal = seen({"5:1": (1.0, -0.6), "5:2": (0.0, 3.5), "5:3": (6.0, 0.0), "5:4": (0.0, -1.9)})
    left, notes = drop_ego_seen_by_others_and_note(signal, ego_track(), (None, None), PLACE)
    assert sorted({left.station.values[code] for code in left.station.codes}) == ["5:2", "5:3", "5:4"]
    assert notes == ("1 perceived objects are the ego itself: 30 times, left out",)


def test_a_wide_ego_takes_more_room() -> None:
    left, _ = drop_ego_seen_by_others_and_note(seen({"5:4": (0.0, -1.9)}), ego_track(), (12.0, 2.5), PLACE)
    assert len(left.stamp_ns) == 0


def test_who_says_so_itself_is_never_left_out() -> None:
    signal = seen({"7": (0.0, 0.0)}, is_perceived=False)
    left, notes = drop_ego_seen_by_others_and_note(signal, ego_track(), (None, None), PLACE)
    assert left is signal
    assert not notes


def test_what_becomes_of_a_row_depends_on_no_later_one() -> None:
    signal = seen({"5:1": (1.0, 0.0)})
    lost = np.flatnonzero(np.arange(30) % 3 == 0)  # now and then it is told 4 m to the side
    latitude = signal.latitude_deg.copy()
    latitude[lost] += 4.0 / 111_200
    noisy = RemoteSignal(**{**{f.name: getattr(signal, f.name) for f in fields(signal)}, "latitude_deg": latitude})
    left, _ = drop_ego_seen_by_others_and_note(noisy, ego_track(), (None, None), PLACE)
    # the first is off the ego (0 of 1), the second leaves it at 1 of 2: not most; from the third on it is the ego's
    assert left.stamp_ns.tolist() == noisy.stamp_ns[[0, 1, 3]].tolist()


@pytest.mark.parametrize("n", [0, 5])
def test_without_a_recent_state_nothing_is_told(n: int) -> None:
    signal = seen({"5:1": (0.0, 0.0)})
    left, _ = drop_ego_seen_by_others_and_note(signal, ego_track(n), (None, None), PLACE)
    # five states hold until 0.4 s and 1 s beyond: rows at 0.3 to 1.2 s; 4 of 7 are most, 4 of 8 are not
    assert len(left.stamp_ns) == (30 if n == 0 else 30 - 7)
