"""The number of instructions of a process, in user space.

Valgrind is preferred: it presents the same processor (without AVX-512, whatever the machine has) and lets one thread
run at a time, so that counts repeat to a few parts in a thousand and do not depend on neighbours. `perf` is some thirty
times faster, but its counts follow the processor's features, and virtual machines often have no counters.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tests.budget.cases import CASES, Arguments, command, environment, prepare

Runner = Callable[[list[str], Path, Mapping[str, str]], int]
"""Command, working directory and environment -> instructions."""


class CountError(Exception):
    """A process could not be counted."""


def count_by_valgrind(arguments: list[str], folder: Path, variables: Mapping[str, str]) -> int:
    """Instructions as cachegrind counts them, of the process alone, without children.

    Raises:
        CountError: The process failed.
    """
    with tempfile.TemporaryDirectory() as work:
        target = Path(work) / "cachegrind.out"
        tool = ["valgrind", "--quiet", "--tool=cachegrind", "--cache-sim=no", f"--cachegrind-out-file={target}"]
        _run([*tool, *arguments], folder, variables)
        found = re.search(r"^summary: (\d+)", target.read_text(encoding="utf-8"), re.MULTILINE)
    if found is None:
        raise CountError("valgrind wrote no summary")
    return int(found[1])


def count_by_perf(arguments: list[str], folder: Path, variables: Mapping[str, str]) -> int:
    """Instructions as the processor counts them, children included.

    Raises:
        CountError: The process failed, or the processor counts none here.
    """
    with tempfile.TemporaryDirectory() as work:
        target = Path(work) / "perf.csv"
        _run(["perf", "stat", "-x,", "-e", "instructions:u", "-o", str(target), *arguments], folder, variables)
        found = re.search(r"^(\d+),", target.read_text(encoding="utf-8"), re.MULTILINE)
    if found is None:
        raise CountError("perf counts no instructions here")
    return int(found[1])


def _run(arguments: list[str], folder: Path, variables: Mapping[str, str]) -> None:
    done = subprocess.run(arguments, check=False, cwd=folder, env=dict(variables), capture_output=True)
    if done.returncode:
        raise CountError(f"exit code {done.returncode}: {' '.join(arguments)}\n{done.stderr.decode(errors='replace')}")


COUNTERS: dict[str, Runner] = {"valgrind": count_by_valgrind, "perf": count_by_perf}


def available_counter() -> str | None:
    """The name of the first counter that works on this machine."""
    for name, counter in COUNTERS.items():
        if shutil.which(name):
            try:
                counter(["/bin/true"], Path(), os.environ)
            except CountError:
                continue
            return name
    return None


def count_cases(tree: Path, names: set[str], counter: Runner) -> dict[str, int]:
    """Case -> instructions, of the checkout `tree`; as many at a time as there are processors.

    Raises:
        CountError: A process failed.
    """
    with tempfile.TemporaryDirectory(prefix="budget-") as work:
        folder = Path(work)
        try:
            prepare(tree, folder, names)
        except subprocess.CalledProcessError as error:
            raise CountError(f"{error}\n{error.stderr.decode(errors='replace')}") from error

        def count(arguments: Arguments) -> int:
            return counter(command(arguments, tree), folder, environment(tree)) if arguments else 0

        chosen = [case for case in CASES if case.name in names]
        with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
            whole = pool.map(count, (case.arguments for case in chosen))
            less = pool.map(count, (case.less for case in chosen))
            return {case.name: all_of_it - part for case, all_of_it, part in zip(chosen, whole, less, strict=True)}
