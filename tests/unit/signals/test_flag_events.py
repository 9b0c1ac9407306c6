"""Events of flags at their messages' repaired stamps, and tables of events joined: against plain loops over rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from cwcli.signals.builders.v2x import _move_flag_events_to_repaired_stamps
from cwcli.signals.columns import Int64Array, Strings, encode_strings
from cwcli.signals.road_events import RoadEvents, join_road_events


@dataclass(frozen=True)
class States:
    """The part of a signal that flags are aligned with."""

    station: Strings
    log_time_ns: Int64Array
    stamp_ns: Int64Array


def random_events(rng: np.random.Generator, n: int, names: tuple[str, ...]) -> RoadEvents:
    stamp_ns, nothing = rng.integers(0, 9, n), np.zeros(n)
    until_ns = stamp_ns + (rng.random(n) < 0.2)
    cause = np.where(rng.random(n) < 0.8, np.nan, 1.0)
    station, kind = (Strings(rng.integers(-1, len(names), n).astype(np.int32), names) for _ in range(2))
    return RoadEvents(station, kind, stamp_ns, rng.integers(0, 8, n), until_ns, cause, *(nothing,) * 4)


def texts(strings: Strings) -> list[str]:
    return [strings.values[code] if code >= 0 else "" for code in strings.codes]


@pytest.mark.parametrize("seed", range(20))
def test_flags_take_the_stamp_of_the_last_state_of_their_station_and_log_time(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(0, 15))
    station = Strings(rng.integers(0, 3, n).astype(np.int32), ("a", "unknown", "c"))
    states = States(station, rng.integers(0, 6, n), rng.integers(100, 200, n))
    events = random_events(rng, 12, ("c", "x", "a"))
    stamp_of = dict(zip(zip(texts(station), states.log_time_ns, strict=True), states.stamp_ns, strict=True))
    expected = [
        stamp_of.get((name, log), stamp) if until == stamp and np.isnan(cause) else stamp
        for name, log, stamp, until, cause in zip(
            texts(events.station), events.log_time_ns, events.stamp_ns, events.until_ns, events.cause, strict=True
        )
    ]
    assert _move_flag_events_to_repaired_stamps(events, states).stamp_ns.tolist() == expected  # type: ignore[arg-type]


@pytest.mark.parametrize("seed", range(20))
def test_joined_tables_hold_the_texts_row_by_row(seed: int) -> None:
    rng = np.random.default_rng(seed)
    parts = [random_events(rng, int(rng.integers(0, 6)), tuple(rng.permutation(["", "a", "b"]))) for _ in range(3)]
    order = np.argsort(np.concatenate([part.stamp_ns for part in parts]), kind="stable")
    joined = join_road_events(parts)
    expected = encode_strings([text for part in parts for text in texts(part.station)])
    assert joined.station.values == expected.values
    assert joined.station.codes.tolist() == expected.codes[order].tolist()
