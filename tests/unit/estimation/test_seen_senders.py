"""Senders among what others perceived."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from cwcli.estimation.seen_senders import drop_seen_objects_that_are_senders_and_note
from cwcli.signals.canonical import RemoteQuantities, RemoteSignal
from cwcli.signals.columns import FloatArray, encode_strings
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.remotes import join_remote_signals
from tests.work import count_calls

S = 1_000_000_000
PLACE = LocalMap(50.0, 8.0)
STEP_S = 0.1
N = 40


def road_user(name: str, *, is_perceived: bool, east_m: Any = 0.0, north_m: Any = 0.0, **told: Any) -> RemoteSignal:
    """A car, eastward at 10 m/s from a place on, told ten times a second; 0.2 m (one sigma) each way."""
    time_s = told.pop("time_s", 1.0 + STEP_S * np.arange(N)) + (0.03 if is_perceived else 0.0)
    n = len(time_s)
    moves_mps = told.pop("moves_mps", 10.0)
    latitude, longitude, _ = PLACE.wgs84_from_map(moves_mps * time_s + east_m, north_m + np.zeros(n), np.zeros(n))
    values: dict[str, Any] = {entry.name: np.full(n, np.nan) for entry in fields(RemoteQuantities)}
    sigma_m = told.pop("sigma_m", 0.2)
    values |= {"latitude_deg": latitude, "longitude_deg": longitude, "speed_mps": np.full(n, moves_mps)}
    values |= {"heading_rad": np.zeros(n), "position_covariance_m2": np.tile([sigma_m**2, 0.0, sigma_m**2], (n, 1))}
    values |= {"length_m": np.full(n, 4.5), "width_m": np.full(n, 1.8)}
    values |= {key: value + np.zeros(n) for key, value in told.items()}
    stamp_ns = np.round(time_s * S).astype(np.int64)
    return RemoteSignal(
        **values,
        source="/v2x",
        station=encode_strings([name] * n),
        stamp_ns=stamp_ns,
        log_time_ns=stamp_ns + S // 100,
        is_perceived=np.full(n, is_perceived),
    )


def sender(name: str = "7", **how: Any) -> RemoteSignal:
    return road_user(name, is_perceived=False, **how)


def seen(name: str = "9:1", **how: Any) -> RemoteSignal:
    return road_user(name, is_perceived=True, **how)


def left(*parts: RemoteSignal) -> tuple[dict[str, int], tuple[str, ...]]:
    """How many rows of each id are left, and the notes."""
    signal, notes = drop_seen_objects_that_are_senders_and_note(join_remote_signals(parts), PLACE)
    names = [signal.station.values[code] for code in signal.station.codes]
    return {name: names.count(name) for name in sorted(set(names))}, notes


def test_a_sender_that_is_seen_is_there_once() -> None:
    """From the third moment on: two are no proof."""
    counts, notes = left(sender(), seen(east_m=0.3, north_m=-0.2))
    assert counts == {"7": N, "9:1": 2}
    assert notes == ("1 perceived objects are vehicles that send messages themselves: 38 times, left out",)


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
def test_another_car_stays(other: dict[str, Any]) -> None:
    counts, notes = left(sender(), seen(**other))
    assert counts == {"7": N, "9:1": N}
    assert not notes


def test_where_positions_are_vague_both_stay_and_it_is_said() -> None:
    counts, notes = left(sender(sigma_m=1.0), seen())
    assert counts == {"7": N, "9:1": N}
    assert notes[0].startswith("1 perceived objects may be vehicles")


def test_between_two_senders_in_one_place_nobody_decides() -> None:
    counts, notes = left(sender("7", north_m=0.3), sender("8", north_m=-0.3), seen())
    assert counts == {"7": N, "8": N, "9:1": N}
    assert notes[0].startswith("1 perceived objects may be vehicles")


def kept_s(*parts: RemoteSignal) -> FloatArray:
    """The moments of the objects that are left, seconds."""
    signal, _ = drop_seen_objects_that_are_senders_and_note(join_remote_signals(parts), PLACE)
    return signal.stamp_ns[np.asarray(signal.is_perceived)] / S


def test_what_is_silent_is_seen() -> None:
    """Its last message is of 1.9 s: up to 2.13 s, 0.23 s later, the objects but the first two are left out."""
    times_s = 1.0 + STEP_S * np.arange(10)
    counts, _ = left(sender(time_s=times_s), seen())
    assert counts == {"7": 10, "9:1": N - 10}
    assert kept_s(sender(time_s=times_s), seen())[2] == pytest.approx(2.23)


def test_of_a_silence_only_the_moments_are_kept() -> None:
    """Silent from 2.9 to 4.0 s: the objects of 3.23 to 3.93 s stay."""
    times_s = 1.0 + STEP_S * np.arange(N)
    heard = times_s[(times_s < 2.95) | (times_s > 3.95)]
    expected = [1.03, 1.13, *(3.23 + STEP_S * np.arange(8))]
    np.testing.assert_allclose(kept_s(sender(time_s=heard), seen()), expected, atol=1e-6)


def test_a_sender_that_is_heard_as_often_as_it_is_seen_is_there_once() -> None:
    """Both once a second: the message is 0.6 s old at each object, and newer than the object before."""
    times_s = 1.0 + np.arange(10.0)
    how: dict[str, Any] = {"sigma_m": 0.1, "moves_mps": 1.2, "speed_sigma_mps": 0.01}
    how |= {"heading_sigma_rad": 0.01}
    assert len(kept_s(sender(time_s=times_s, **how), seen(time_s=times_s + 0.57, **how))) == 2


@pytest.mark.parametrize("history_s", [3.0, 300.0])
@pytest.mark.parametrize(
    ("east_m", "north_m", "other"),
    [
        (0.0, 3.5, {}),  # beside
        (0.0, 2.3, {}),  # as near as cars get
        (-12.0, 0.0, {}),  # behind
        (0.0, 20.0, {"heading_rad": np.pi / 2.0, "speed_mps": 5.0}),
        (0.0, 0.0, {"speed_mps": 15.0}),
    ],
)
def test_a_number_that_passes_to_another_car_tells_of_that_one(
    history_s: float, east_m: float, north_m: float, other: dict[str, float]
) -> None:
    """Without a gap, at once: a real car is not left out for what its number was before."""
    times_s = 1.0 + STEP_S * np.arange(round(10.0 * history_s) + 100)
    is_other = times_s > history_s
    usual = {"heading_rad": 0.0, "speed_mps": 10.0}
    told: dict[str, Any] = {name: np.where(is_other, other.get(name, value), value) for name, value in usual.items()}
    taken = seen(
        time_s=times_s, east_m=np.where(is_other, east_m, 0.0), north_m=np.where(is_other, north_m, 0.0), **told
    )
    kept = kept_s(sender(time_s=times_s), taken)
    np.testing.assert_allclose(kept, [1.03, 1.13, *(times_s[is_other] + 0.03)], atol=1e-6)


def test_a_number_that_passes_to_the_nearest_neighbour_is_its_own_within_half_a_second() -> None:
    """Errors of a third of a metre in each message: one moment hardly tells 2.3 m from none."""
    rng = np.random.default_rng(4)
    times_s = 1.0 + STEP_S * np.arange(3100)
    is_other = times_s > 300.0
    errors = 0.3 * rng.standard_normal((2, len(times_s)))
    taken = seen(time_s=times_s, north_m=errors[0] + np.where(is_other, 2.3, 0.0), sigma_m=0.3)
    kept = kept_s(sender(time_s=times_s, north_m=errors[1], sigma_m=0.3), taken)
    assert np.count_nonzero(kept < 300.0) < 0.3 * np.count_nonzero(~is_other)
    late_s = times_s[times_s > 300.5] + 0.03
    np.testing.assert_allclose(kept[kept > 300.55], late_s, atol=1e-6)


@pytest.mark.parametrize(("east_m", "north_m"), [(0.0, 0.6), (0.5, 0.0), (0.0, 0.5)])
@pytest.mark.parametrize("size_m", [0.5, np.nan])
@pytest.mark.parametrize("sigma_m", [0.1, 0.14, 0.2, 0.4])
def test_people_who_walk_together_are_two(east_m: float, north_m: float, size_m: float, sigma_m: float) -> None:
    """One sends VAMs, which tell no size."""
    walks: dict[str, Any] = {"moves_mps": 1.2, "sigma_m": sigma_m}
    alone = sender(length_m=np.nan, width_m=np.nan, **walks)
    beside = seen(east_m=east_m, north_m=north_m, length_m=size_m, width_m=size_m, **walks)
    assert left(alone, beside)[0] == {"7": N, "9:1": N}


def test_positions_without_an_error_are_no_fault() -> None:
    times_s = 1.0 + STEP_S * np.arange(N)
    with np.errstate(all="raise"):
        at_once = left(sender(time_s=times_s, sigma_m=0.0), seen(time_s=times_s - 0.03, sigma_m=0.0))
    assert at_once[0] == {"7": N, "9:1": 2}


def test_messages_that_came_too_late_cost_no_more_than_others() -> None:
    """All logged after every object: ten times as many rows are as many calls, not one more for each step back."""

    def calls(n: int) -> int:
        signal = all_late(n)
        kept: list[RemoteSignal] = []
        n_calls = count_calls(lambda: kept.append(drop_seen_objects_that_are_senders_and_note(signal, PLACE)[0]))
        assert np.count_nonzero(np.asarray(kept[0].is_perceived)) == n
        return n_calls

    assert calls(40_000) < calls(4_000) + 100


def all_late(n: int) -> RemoteSignal:
    """A sender and an object seen at its place; none of its messages had been received by then."""
    times_s = 1.0 + STEP_S * np.arange(n)
    late = sender(time_s=times_s)
    late = replace(late, log_time_ns=late.log_time_ns + 10**6 * S)
    return join_remote_signals([late, seen(time_s=times_s)])


def test_a_row_depends_on_nothing_that_was_received_later() -> None:
    rng = np.random.default_rng(3)
    noisy = seen(north_m=0.8 * rng.standard_normal(N), sigma_m=0.4)
    late = sender()
    late = replace(late, log_time_ns=late.log_time_ns + (rng.random(N) * 0.3 * S).astype(np.int64))
    whole = join_remote_signals([late, noisy])
    kept, _ = drop_seen_objects_that_are_senders_and_note(whole, PLACE)
    assert 0 < np.count_nonzero(np.asarray(kept.is_perceived)) < N
    for cut_ns in (2 * S, 3 * S, 4 * S):
        before = np.flatnonzero(whole.log_time_ns < cut_ns)
        part = replace(
            whole,
            **{name: getattr(whole, name)[before] for name in (entry.name for entry in fields(RemoteQuantities))},
            station=whole.station.select_rows(before),
            stamp_ns=whole.stamp_ns[before],
            log_time_ns=whole.log_time_ns[before],
            is_perceived=np.asarray(whole.is_perceived)[before],
        )
        early, _ = drop_seen_objects_that_are_senders_and_note(part, PLACE)
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
