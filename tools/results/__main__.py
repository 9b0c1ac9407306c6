"""The command: see the package."""

from __future__ import annotations

import argparse
import contextlib
import datetime
import math
import os
import sys
import traceback
from collections.abc import Iterator
from pathlib import Path

import cwcli
from tools.results.pages import DOCS, filled_pages, page_faults, picture_faults, picture_hashes
from tools.results.result_file import (
    RESULTS,
    ResultFile,
    Value,
    faults_of_small_run,
    read_result_file,
    write_result_file,
)
from tools.results.studies import STUDIES, Measured


def measure(name: str, today: str) -> ResultFile:
    """Run a study, whole and with its small seed set, and draw its pictures."""
    study = STUDIES[name]
    whole = study.run(study.seeds)
    small = whole if study.small_seeds == study.seeds else study.run(study.small_seeds)
    values = {}
    for key, found in whole.values.items():
        if isinstance(found, str):
            values[key] = Value(None, text=found)
        else:
            value, low, high = (_finite(each) for each in found)
            values[key] = Value(value, low, high, _finite(_small_number(small, key)))
    pictures = _draw(name, whole)
    return ResultFile(
        name,
        study.command,
        study.seeds,
        study.small_seeds,
        today,
        cwcli.__version__,
        values,
        {**whole.more, "pictures": pictures} if pictures else whole.more,
    )


def _small_number(small: Measured, key: str) -> float:
    found = small.values.get(key, (math.nan, math.nan, math.nan))
    return math.nan if isinstance(found, str) else found[0]


def _finite(value: float) -> float | None:
    """Return six digits of a number; None for NaN."""
    return float(f"{value:.6g}") if math.isfinite(value) else None


def _draw(name: str, whole: Measured) -> dict[str, str]:
    """Write the pictures of a paper's page; returns their hashes by name."""
    if not whole.plots:
        return {}
    from cwcli.output import AtomicGroup, make_folder
    from cwcli.reproduction.plots import write_plots

    folder = DOCS / "papers" / "figures" / name
    make_folder(folder, parents=True)
    with AtomicGroup() as together:
        write_plots(whole.plots, str(folder), together, paper=name, file_format="png", force=True)
    return picture_hashes(folder)


def check_small(names: list[str]) -> list[str]:
    """Rerun the small seed sets; returns what moved."""
    faults = []
    for name in names:
        study = STUDIES[name]
        with _told_time(name):
            found = study.run(study.small_seeds).values
        now = {key: each if isinstance(each, str) else each[0] for key, each in found.items()}
        faults += faults_of_small_run(read_result_file(name), now)
    return faults


def measure_all(names: list[str], folder: Path = RESULTS) -> list[str]:
    """Measure the studies and write each result file when its study is done.

    A study that fails leaves its result file as it was, and the others are measured all the same.

    Returns:
        One sentence for each study that failed.
    """
    today = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    failures = []
    for name in names:
        try:
            with _told_time(name):
                write_result_file(measure(name, today), folder)
        except Exception as error:  # whatever a study raises: the next ones are still measured
            traceback.print_exc()
            failures.append(f"{name}: not measured, its file is as it was: {error}")
    return failures


@contextlib.contextmanager
def _told_time(name: str) -> Iterator[None]:
    """Print the processor time of a study, that of its processes included."""
    before = os.times()
    yield
    after = os.times()
    sys.stderr.write(f"{name}: {sum(after[:4]) - sum(before[:4]):.0f} s of processor time\n")


def main() -> int:
    """Run the studies, or check."""
    parser = argparse.ArgumentParser(prog="python -m tools.results", description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare the pages with the result files, and run nothing")
    parser.add_argument("--small", action="store_true", help="with --check: rerun the small seed sets and compare")
    parser.add_argument("--fill", action="store_true", help="fill the pages from the result files, and run nothing")
    parser.add_argument("--only", action="append", choices=list(STUDIES), help="this study alone; repeatable")
    arguments = parser.parse_args()
    names = [name for name in arguments.only or STUDIES if STUDIES[name].can_run]
    for name in sorted(set(arguments.only or STUDIES) - set(names)):
        sys.stderr.write(f"{name}: not run, the development logs are not at hand\n")
    if arguments.check:
        faults = page_faults() + picture_faults() + (check_small(names) if arguments.small else [])
        sys.stderr.writelines(f"{fault}\n" for fault in faults)
        sys.stderr.write(f"{len(faults)} numbers differ\n" if faults else "all numbers hold\n")
        return 1 if faults else 0
    failures = [] if arguments.fill else measure_all(names)
    for path, text in filled_pages().items():
        Path(path).write_text(text, encoding="utf-8")
    sys.stderr.writelines(f"{failure}\n" for failure in failures)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
