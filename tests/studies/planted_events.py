"""How well events are found: drives with one planted event each, and quiet hours.

    python -m tests.studies.planted_events --drives 200 --hours 10

Prints for each event how many were found of those planted, how many drives have one that nobody planted, the balanced
accuracy, and the largest errors of start and end. A planted event is found if its start and end are within 0.3 s.
Exits with 1 if one is not found, or if anything else is.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cwcli.evaluation.system_topics import parse_other_system_options
from cwcli.events import EVENTS
from cwcli.events.search import FoundEvent, find_events_in_log, parse_query
from cwcli.logs.read.reader import Log
from tests.laws.planted_drives import PLANTS, Planted, planted_drive, quiet_drive, write_drive

OTHER_SYSTEM = "warning=/adas/fcw:data==true"
VERDICTS = " or ".join(name for name in EVENTS if name.startswith("warning-"))
MAX_ERROR_S = 0.3
FIRST_SEED, FIRST_QUIET_SEED = 1000, 11_000
QUIET_S = 600.0


@dataclass
class Counts:
    """The tally of one event: drives with it and without, what was found in them, errors of start and end (s).

    Attributes:
        n_false: Drives in which it was found though nobody planted it, or more often than planted.
        n_free: Drives in which it was neither planted nor brought about by what was planted.
    """

    n_planted: int = 0
    n_found: int = 0
    n_false: int = 0
    n_free: int = 0
    errors_s: list[float] = field(default_factory=list)


def find_all(drive: Planted, folder: Path, seed: int) -> tuple[FoundEvent, ...]:
    """Everything that is found in a drive."""
    path = write_drive(drive, folder / f"{seed}.mcap", seed)
    other = parse_other_system_options([OTHER_SYSTEM])
    with Log.open(path) as log:
        found = find_events_in_log(log, parse_query("all"), other).found
        if drive.warnings_s:
            found += find_events_in_log(log, parse_query(VERDICTS), other).found
    path.unlink()
    return found


def errors_of_best_fit_s(found: Sequence[FoundEvent], span: tuple[float, float]) -> tuple[float, float] | None:
    """Errors of start and end of the event that fits a span best; None if none overlaps it."""
    errors = [
        (abs(each.start_s - span[0]), abs(each.start_s + each.duration_s - span[1]))
        for each in found
        if each.start_s <= span[1] and each.start_s + each.duration_s >= span[0]
    ]
    return min(errors, key=sum, default=None)


def count_planted(n_drives: int) -> dict[str, Counts]:
    """Count what is found in drives with one planted event each; prints what is wrong."""
    counts = {event: Counts() for event in EVENTS}
    kinds = list(PLANTS)
    with tempfile.TemporaryDirectory() as folder:
        for k in range(n_drives):
            kind, seed = kinds[k % len(kinds)], FIRST_SEED + k
            drive = planted_drive(kind, seed)
            found = find_all(drive, Path(folder), seed)
            for event, each in counts.items():
                hits = [hit for hit in found if hit.event == event]
                if event in drive.truth:
                    errors = errors_of_best_fit_s(hits, drive.truth[event])
                    is_found = errors is not None and max(errors) <= MAX_ERROR_S
                    each.n_planted += 1
                    each.n_found += is_found
                    each.n_false += len(hits) > 1
                    each.errors_s += errors or ()
                    if len(hits) != 1 or not is_found:
                        print(
                            f"drive {seed} ({kind}): {event} {drive.truth[event]}, errors {errors}, {len(hits)} found"
                        )
                elif event not in drive.implied:
                    each.n_free += 1
                    each.n_false += bool(hits)
                    for hit in hits:
                        print(f"drive {seed} ({kind}): {event} at {hit.start_s:.2f} s, nobody planted it")
    return counts


def balanced_accuracy(counts: dict[str, Counts]) -> float:
    """The mean of the shares of the planted events that are found, and of the free drives in which nothing is."""
    planted, found, false, free = (
        sum(getattr(each, name) for each in counts.values()) for name in ("n_planted", "n_found", "n_false", "n_free")
    )
    return 0.5 * (found / planted + 1.0 - false / free)


def count_in_quiet_hours(hours: float) -> int:
    """Count what is found in drives without any event; prints each."""
    n_quiet = 0
    with tempfile.TemporaryDirectory() as folder:
        for k in range(round(hours * 3600.0 / QUIET_S)):
            seed = FIRST_QUIET_SEED + k
            found = find_all(quiet_drive(np.random.default_rng(seed), QUIET_S), Path(folder), seed)
            n_quiet += len(found)
            for each in found:
                print(f"quiet drive {k}: {each.event} at {each.start_s:.2f} s, {each.moment.actors}")
    return n_quiet


def main() -> int:
    """Run the study; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drives", type=int, default=200)
    parser.add_argument("--hours", type=float, default=10.0)
    arguments = parser.parse_args()
    counts = count_planted(arguments.drives)
    print(f"{'event':18} found  planted  false  of  worst error [s]")
    for event, each in counts.items():
        if each.n_planted:
            row = f"{each.n_found:5}  {each.n_planted:7}  {each.n_false:5}  {each.n_free:4}"
            print(f"{event:18} {row}  {max(each.errors_s, default=np.nan):.2f}")
    print(f"balanced accuracy {balanced_accuracy(counts):.4f}")
    n_quiet = count_in_quiet_hours(arguments.hours)
    print(f"quiet: {n_quiet} events in {arguments.hours:g} h")
    return int(n_quiet > 0 or any(each.n_found < each.n_planted or each.n_false for each in counts.values()))


if __name__ == "__main__":
    sys.exit(main())
