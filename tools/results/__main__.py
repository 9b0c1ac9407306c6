"""The command: see the package."""

from __future__ import annotations

import argparse
import datetime
import math
import sys
import time
from pathlib import Path

import cwcli
from tools.results.pages import DOCS, filled_pages, page_faults
from tools.results.result_file import ResultFile, Value, faults_of_small_run, read_result_file, write_result_file
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
    _draw(name, whole)
    return ResultFile(
        name,
        study.command,
        study.seeds,
        study.small_seeds,
        today,
        cwcli.__version__,
        study.is_checked,
        values,
        whole.more,
    )


def _small_number(small: Measured, key: str) -> float:
    found = small.values.get(key, (math.nan, math.nan, math.nan))
    return math.nan if isinstance(found, str) else found[0]


def _finite(value: float) -> float | None:
    """Return six digits of a number; None for NaN."""
    return float(f"{value:.6g}") if math.isfinite(value) else None


def _draw(name: str, whole: Measured) -> None:
    """Write the pictures of a paper's page."""
    if not whole.plots:
        return
    from cwcli.output import AtomicGroup, make_folder
    from cwcli.reproduction.plots import write_plots

    folder = DOCS / "papers" / "figures" / name
    make_folder(folder, parents=True)
    with AtomicGroup() as together:
        write_plots(whole.plots, str(folder), together, paper=name, file_format="png", force=True)


def check_small(names: list[str]) -> list[str]:
    """Rerun the small seed sets; returns what moved."""
    faults = []
    for name in names:
        study = STUDIES[name]
        if not study.is_checked:
            continue
        started = time.perf_counter()
        found = study.run(study.small_seeds).values
        now = {key: each if isinstance(each, str) else each[0] for key, each in found.items()}
        faults += faults_of_small_run(read_result_file(name), now)
        sys.stderr.write(f"{name}: {time.perf_counter() - started:.0f} s\n")
    return faults


def main() -> int:
    """Run the studies, or check."""
    parser = argparse.ArgumentParser(prog="python -m tools.results", description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare the pages with the result files, and run nothing")
    parser.add_argument("--small", action="store_true", help="with --check: rerun the small seed sets and compare")
    parser.add_argument("--fill", action="store_true", help="fill the pages from the result files, and run nothing")
    parser.add_argument("--only", action="append", choices=list(STUDIES), help="this study alone; repeatable")
    arguments = parser.parse_args()
    names = arguments.only or list(STUDIES)
    if arguments.check:
        faults = page_faults() + (check_small(names) if arguments.small else [])
        sys.stderr.writelines(f"{fault}\n" for fault in faults)
        sys.stderr.write(f"{len(faults)} numbers differ\n" if faults else "all numbers hold\n")
        return 1 if faults else 0
    if not arguments.fill:
        today = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
        for name in names:
            started = time.perf_counter()
            target = write_result_file(measure(name, today))
            sys.stderr.write(f"{target}: {time.perf_counter() - started:.0f} s\n")
    for path, text in filled_pages().items():
        Path(path).write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
