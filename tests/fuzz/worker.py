"""A process that checks cases and tells of each; it may die of one, and is then started again behind it.

It prints a line of JSON before and after each case: its number alone, then what became of it.
"""

from __future__ import annotations

import argparse
import json
import resource
import signal
import sys
import traceback
from importlib import import_module
from pathlib import Path

import numpy as np

CASES = {
    **{level: f"{level}_cases:check_case" for level in ("kernel", "file", "osi", "bag", "database", "radio", "ros")},
    **{level: f"import_cases:check_{level}" for level in ("nmea", "ubx", "csv", "gpx", "kml", "rtklib", "vbox", "can")},
}
"""What is mutated -> the function that makes a case and checks it."""
MOST_CPU_S = 10.0
MOST_BYTES = 8 << 30
"""Of address space; not under AddressSanitizer, which reserves terabytes."""


def main() -> None:
    """Check the cases that the arguments name."""
    parser = argparse.ArgumentParser()
    parser.add_argument("level", choices=CASES)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--first", type=int, required=True)
    parser.add_argument("--stop", type=int, required=True)
    parser.add_argument("--kernels", type=Path)
    given = parser.parse_args()
    if given.kernels:
        from tests.fuzz.sanitized import use

        use(given.kernels)
    else:
        resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))
    module, _, name = CASES[given.level].partition(":")
    check_case = getattr(import_module(f"tests.fuzz.{module}"), name)
    for k in range(given.first, given.stop):
        tell({"case": k})
        signal.setitimer(signal.ITIMER_PROF, MOST_CPU_S)  # ends the process
        try:
            counts = check_case(np.random.default_rng([given.seed, k]))
            told: dict[str, object] = {"case": k, "counts": counts}
        except Exception:  # whatever it is, it is a finding
            told = {"case": k, "finding": traceback.format_exc()[-MOST_SHOWN:]}
        signal.setitimer(signal.ITIMER_PROF, 0)
        tell(told)


MOST_SHOWN = 4000


def tell(line: dict[str, object]) -> None:
    """To the process that has started this one."""
    sys.__stdout__.write(json.dumps(line) + "\n")  # type: ignore[union-attr]
    sys.__stdout__.flush()  # type: ignore[union-attr]


if __name__ == "__main__":
    main()
