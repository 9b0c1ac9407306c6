"""`python -m tests.budget`: count the instructions of each command; exit code 1 if one costs 3 % more than its figure.

python -m tests.budget                                # count and compare
python -m tests.budget --case help --case info        # these alone
python -m tests.budget --write --reason "..."         # the new figures, for the commit that costs more or less
"""

from __future__ import annotations

import argparse
import datetime
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

from tests.budget.baseline import ROOT, build_commit, git, is_unchanged, ledger_commit
from tests.budget.cases import CASES
from tests.budget.counting import COUNTERS, CountError, available_counter, count_cases
from tests.budget.ledger import (
    TOLERANCE,
    Ledger,
    Line,
    describe_environment,
    find_excess,
    read_ledger,
    update_lines,
    write_ledger,
)

NO_COUNTER = "not counted: neither valgrind nor perf counts instructions here (Debian: apt-get install valgrind)"


def main(arguments: list[str] | None = None) -> int:
    """Count, compare or write, and print; 1 if a case costs too much, 2 if nothing can be counted or compared."""
    parser = argparse.ArgumentParser(prog="python -m tests.budget", description="Count what each command costs.")
    parser.add_argument("--case", action="append", choices=[case.name for case in CASES], help="this one; repeatable")
    parser.add_argument("--write", action="store_true", help="write the counts as the new figures")
    parser.add_argument("--reason", help="why the figures change (with --write)")
    options = parser.parse_args(arguments)
    if options.write and not options.reason:
        parser.error("--write needs --reason: the commit says why it costs more or less")
    name = available_counter()
    if name is None:
        print(NO_COUNTER, file=sys.stderr)
        return 2
    chosen = set(options.case or (case.name for case in CASES))
    try:
        return _write(name, chosen, options.reason) if options.write else _compare(name, chosen)
    except (CountError, subprocess.CalledProcessError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2


def _compare(counter: str, names: set[str]) -> int:
    ledger = read_ledger()
    here = describe_environment(counter)
    differing = sorted(key for key in here if here[key] != ledger.environment.get(key))
    if not differing:
        return report(count_cases(ROOT, names, COUNTERS[counter]), figures(ledger), "its figure")
    print(f"The figures are of another environment ({', '.join(differing)}).")
    commit = ledger_commit()
    if commit is None:
        print("not compared: the commit that wrote the figures is not in the history here", file=sys.stderr)
        return 2
    if is_unchanged(commit):
        print(f"Nothing that is counted has changed since they were written ({commit[:7]}).")
        return 0
    print(f"The commit that wrote them ({commit[:7]}) is counted too, and compared.")
    with tempfile.TemporaryDirectory() as work:
        build_commit(commit, Path(work) / "baseline")
        allowed = count_cases(Path(work) / "baseline", names, COUNTERS[counter])
    return report(count_cases(ROOT, names, COUNTERS[counter]), allowed, "the earlier commit")


def figures(ledger: Ledger) -> dict[str, int]:
    """Case -> instructions."""
    return {name: line.instructions for name, line in ledger.lines.items()}


def print_changes(counted: Mapping[str, int], allowed: Mapping[str, int], against: str) -> None:
    """Print the table of counts."""
    print(f"| case | million instructions | change against {against} |\n|---|---|---|")
    for name, n in counted.items():
        change = f"{100 * (n / allowed[name] - 1):+.2f} %" if name in allowed else "no figure"
        print(f"| {name} | {n / 1e6:,.1f} | {change} |")


def report(counted: Mapping[str, int], allowed: Mapping[str, int], against: str) -> int:
    """Print the table of counts; 1 if one exceeds what is allowed."""
    print_changes(counted, allowed, against)
    excess = find_excess(counted, allowed)
    if excess:
        print(
            f"error: {', '.join(excess)}: more than {100 * TOLERANCE:g} % above {against}. Find what costs it, or write"
            " new figures that say why: python -m tests.budget --write --reason '...'",
            file=sys.stderr,
        )
    return int(bool(excess))


def _write(counter: str, names: set[str], reason: str) -> int:
    here = describe_environment(counter)
    ledger = read_ledger()
    is_other = here != ledger.environment
    if is_other:
        names = {case.name for case in CASES}  # the figures of two environments can't stand in one file
    counted = count_cases(ROOT, names, COUNTERS[counter])
    stamp = Line(
        0, datetime.datetime.now(datetime.UTC).date().isoformat(), git("log", "-1", "--format=%s") or "-", reason
    )
    lines = update_lines(ledger.lines, counted, stamp, all_lines=is_other)
    write_ledger(Ledger(here, {case.name: lines[case.name] for case in CASES if case.name in lines}))
    print_changes(counted, figures(ledger), "its former figure")
    return 0


if __name__ == "__main__":
    sys.exit(main())
