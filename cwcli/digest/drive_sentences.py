"""How long and how far a drive was, and who else was there: sentences that need the ego's states alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np

from cwcli.channels.vehicle_state import VehicleStates, driven_distance_m
from cwcli.evaluation.records import source_config_from_record
from cwcli.pipeline.records import Record
from cwcli.signals.units import KMH_PER_MPS, NS_PER_S
from cwcli.signals.vehicle_state import SPEED
from cwcli.text import format_count, format_duration


class LogSpan(Protocol):
    """The log times of the first and the last message, nanoseconds."""

    @property
    def start_ns(self) -> int: ...
    @property
    def end_ns(self) -> int: ...


def drive_length_sentence(
    log: LogSpan, ego: VehicleStates | None, records: Mapping[str, Record], *, n_heard: int = 0, n_tracked: int = 0
) -> str:
    """Say how long and how far the drive was, and how many others were known.

    Args:
        log: The times of the log's first and last message.
        ego: The ego's states in stamp order, None where there are none.
        records: The run records of the stages by name: they tell which part of the log was used.
        n_heard: Vehicles received by radio.
    """
    text = f"The log is {format_duration((log.end_ns - log.start_ns) / NS_PER_S)} long{_used_part_text(log, records)}"
    if ego is not None and len(ego) > 1:
        top = float(np.fmax.reduce(np.abs(ego.state[:, SPEED])))
        text += f"; the car drove {driven_distance_m(ego):.0f} m, at most {KMH_PER_MPS * top:.0f} km/h"
    if n_heard:
        text += f"; {format_count(n_heard, 'other vehicle')} {'was' if n_heard == 1 else 'were'} heard by radio"
    if n_tracked:
        text += f"; {tracked_targets_text(n_tracked)} by its sensors"
    return f"{text}."


def _used_part_text(log: LogSpan, records: Mapping[str, Record]) -> str:
    """Format `, of which 3.0 s to 6.0 s were used`, "" where the estimate used the whole log."""
    sources = source_config_from_record(records.get("estimate", {}))
    if sources.start_ns is None and sources.end_ns is None:
        return ""
    first_ns = log.start_ns if sources.start_ns is None else max(sources.start_ns, log.start_ns)
    last_ns = log.end_ns if sources.end_ns is None else min(sources.end_ns, log.end_ns)
    first, last, length = (f"{(each - log.start_ns) / NS_PER_S:.1f} s" for each in (first_ns, last_ns, log.end_ns))
    if first_ns >= last_ns or (first, last) == ("0.0 s", length):
        return ""
    return f", of which {first} to {last} were used"


def tracked_targets_text(n: int) -> str:
    """Format `1 target was tracked`."""
    return f"{format_count(n, 'target')} {'was' if n == 1 else 'were'} tracked"


def found_lanes_text(n_both: int, n_frames: int) -> str:
    """Format `Both lane boundaries were found in 40 of 41 camera frames`."""
    return f"Both lane boundaries were found in {n_both} of {n_frames} camera frames"
