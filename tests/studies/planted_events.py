"""How well events are found: drives with one planted event each, and quiet hours.

    python -m tests.studies.planted_events --drives 200 --hours 10

Prints for each event how many were found of those planted, how many drives have one that nobody planted, the balanced
accuracy, and the largest errors of start and end.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

from cwcli.events import EVENTS
from cwcli.evaluation.system_topics import parse_other_system_options
from cwcli.events.search import FoundEvent, find_events_in_log, parse_query
from cwcli.logs.read.reader import Log
from tests.laws.planted_drives import PLANTS, Planted, planted_drive, quiet_drive, write_drive

OTHER_SYSTEM = "warning=/adas/fcw:data==true"
FIRST_SEED = 1000
QUIET_S = 600.0


def find_all(drive: Planted, folder: Path, seed: int) -> tuple[FoundEvent, ...]:
    """Everything that is found in a drive."""
    path = write_drive(drive, folder / f"{seed}.mcap", seed)
    other = parse_other_system_options([OTHER_SYSTEM])
    with Log.open(path) as log:
        found = find_events_in_log(log, parse_query("all"), other).found
        if drive.warnings_s:
            found += find_events_in_log(log, parse_query("warning-false"), other).found
    path.unlink()
    return found


def best_match(found: tuple[FoundEvent, ...], event: str, span: tuple[float, float]) -> tuple[float, float] | None:
    """Errors of start and end of the found event that fits best; None if none overlaps."""
    errors = [
        (each.start_s - span[0], each.start_s + each.duration_s - span[1])
        for each in found
        if each.event == event and each.start_s <= span[1] and each.start_s + each.duration_s >= span[0]
    ]
    return min(errors, key=lambda each: abs(each[0]) + abs(each[1]), default=None)


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drives", type=int, default=200)
    parser.add_argument("--hours", type=float, default=10.0)
    arguments = parser.parse_args()
    n_planted: Counter[str] = Counter()
    n_found: Counter[str] = Counter()
    n_free: Counter[str] = Counter()
    n_false: Counter[str] = Counter()
    errors: dict[str, list[float]] = {}
    kinds = list(PLANTS)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for k in range(arguments.drives):
            seed = FIRST_SEED + k
            drive = planted_drive(kinds[k % len(kinds)], seed)
            found = find_all(drive, folder, seed)
            for event in EVENTS:
                if event in drive.truth:
                    n_planted[event] += 1
                    fit = best_match(found, event, drive.truth[event])
                    n_found[event] += fit is not None
                    errors.setdefault(event, []).extend(map(abs, fit or ()))
                elif event not in drive.implied and not (event.startswith("warning-") and drive.warnings_s):
                    n_free[event] += 1
                    hits = [each for each in found if each.event == event]
                    n_false[event] += bool(hits)
                    for each in hits:
                        print(f"drive {seed} ({kinds[k % len(kinds)]}): {event} at {each.start_s:.2f} s")
        print(f"{'event':18} found  planted  false  of  worst error [s]")
        for event in EVENTS:
            if n_planted[event]:
                worst = max(errors[event], default=np.nan)
                row = f"{n_found[event]:5}  {n_planted[event]:7}  {n_false[event]:5}  {n_free[event]:4}  {worst:.2f}"
                print(f"{event:18} {row}")
        hits, misses = sum(n_found.values()), sum(n_planted.values())
        sensitivity, specificity = hits / misses, 1.0 - sum(n_false.values()) / sum(n_free.values())
        print(f"balanced accuracy {0.5 * (sensitivity + specificity):.4f}")
        n_quiet = 0
        for k in range(round(arguments.hours * 3600.0 / QUIET_S)):
            drive = quiet_drive(np.random.default_rng(FIRST_SEED + 10_000 + k), QUIET_S)
            found = find_all(drive, folder, FIRST_SEED + 10_000 + k)
            n_quiet += len(found)
            for each in found:
                print(f"quiet drive {k}: {each.event} at {each.start_s:.2f} s, {each.moment.actors}")
        print(f"quiet: {n_quiet} events in {arguments.hours:g} h")


if __name__ == "__main__":
    main()
