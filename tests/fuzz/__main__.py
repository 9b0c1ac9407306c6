"""`python -m tests.fuzz`: mutated inputs for any time; exit code 1 if one of them is a finding."""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

from tests.fuzz import sanitized
from tests.fuzz.drive import drive
from tests.fuzz.worker import CASES

MINUTE_S = 60.0


def main() -> int:
    """Parse the arguments, check the cases and tell."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=sys.modules["tests.fuzz"].__doc__)
    parser.add_argument("--level", "--family", choices=CASES, default="kernel")
    parser.add_argument("--minutes", type=float, help="stop after this time")
    parser.add_argument("--inputs", type=int, help="stop after so many mutated inputs")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--case", type=int, help="this one alone, made again")
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument(
        "--sanitize", action="store_true", help="kernels under AddressSanitizer and UBSan (level kernel)"
    )
    given = parser.parse_args()
    if given.sanitize and given.level != "kernel":
        parser.error("--sanitize is for the level kernel")
    if given.minutes is None and given.inputs is None and given.case is None:
        parser.error("one of --minutes, --inputs and --case is needed")
    with tempfile.TemporaryDirectory(prefix="cwcli-fuzz-") as folder:
        begin = time.monotonic()
        kernels, environment = None, None
        if given.sanitize:
            kernels = Path(folder)
            sanitized.build(kernels)
            environment = sanitized.environment()
        built_s = time.monotonic() - begin
        report = drive(
            given.level,
            given.seed,
            first=given.first if given.case is None else given.case,
            n_inputs=given.inputs,
            n_cases=None if given.case is None else 1,
            until_s=None if given.minutes is None else time.monotonic() + given.minutes * MINUTE_S,
            kernels=kernels,
            environment=environment,
        )
        took_s = time.monotonic() - begin - built_s
    for case, what in report.findings.items():
        print(f"\ncase {case} (--level {given.level} --seed {given.seed} --case {case}):\n{what}")
    counts = ", ".join(f"{n:,} {name}" for name, n in sorted(report.counts.items(), key=lambda each: -each[1]))
    print(f"{report.n_cases:,} cases in {took_s:.0f} s, kernels built in {built_s:.0f} s: {counts}")
    print(f"{len(report.findings)} findings")
    return 1 if report.findings else 0


if __name__ == "__main__":
    sys.exit(main())
