"""Seeded random streams, one per use, and the schedule of a source's messages."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.units import NS_PER_S


def random_stream(seed: int, *names: str) -> np.random.Generator:
    """The random stream of one use, e.g. (seed, "host", "gnss", "noise").

    The streams of different names are independent, so that a further sensor, or losses on one, change no other draw.
    """
    digest = hashlib.sha256("/".join(names).encode()).digest()
    return np.random.default_rng([seed, *np.frombuffer(digest[:16], dtype="<u4").tolist()])


@dataclass(frozen=True)
class MessageSchedule:
    """The times of one source's messages, and which of them arrive.

    Attributes:
        time_s: Shape (n,): measurement or generation time, seconds of the run, of every message made.
        arrival_ns: Shape (n,): log time minus the run's start.
        is_heard: Shape (n,): False for messages that were lost or fell into an outage.
    """

    time_s: FloatArray
    arrival_ns: Int64Array
    is_heard: np.ndarray[Any, np.dtype[np.bool_]]

    @property
    def stamp_ns(self) -> Int64Array:
        """The stamps of the messages, shape (n,), ns since the run's start."""
        return seconds_to_ns(self.time_s)


def seconds_to_ns(time_s: FloatArray) -> Int64Array:
    """Round seconds to whole nanoseconds."""
    return np.round(np.asarray(time_s) * NS_PER_S).astype(np.int64)


class RunSpan(NamedTuple):
    """Start, length and seed of a simulated run."""

    start_ns: int
    end_s: float
    seed: int


def draw_message_schedule(
    settings: Mapping[str, Any], *, end_s: float, seed: int, names: tuple[str, ...]
) -> MessageSchedule:
    """Draw the stamps, arrival times and losses of a source's messages.

    Args:
        end_s: Length of the run; the last message is stamped before or at it.
        seed, names: Select the source's random streams, one for losses and one for jitter.
    """
    n = max(0, int(np.floor((end_s - settings["phase_s"]) * settings["rate_hz"] + 1e-9)) + 1)
    time_s = settings["phase_s"] + np.arange(n) / settings["rate_hz"]
    jitter = settings["jitter_s"] * random_stream(seed, *names, "jitter").random(n)
    is_heard = random_stream(seed, *names, "drop").random(n) >= settings["drop_probability"]
    for start, end in settings["outages"]:
        is_heard &= ~((start <= time_s) & (time_s < end))
    arrival_ns = seconds_to_ns(time_s) + seconds_to_ns(settings["delay_s"] + jitter)
    return MessageSchedule(time_s, arrival_ns, is_heard)
