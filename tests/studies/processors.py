"""The numeric tests as other processors, other orders and a busy machine would run them.

    python -m tests.studies.processors                    all of it
    python -m tests.studies.processors --only blas        OpenBLAS's kernel of each processor that this one can be
    python -m tests.studies.processors --only numpy       NumPy with its CPU features off, one after the other and all
    python -m tests.studies.processors --only libm        the C library without FMA and AVX
    python -m tests.studies.processors --only order       three random orders of the test files' tests
    python -m tests.studies.processors --only load        beside eight busy processes
    python -m tests.studies.processors tests/unit/metrics other tests

It prints a line a run and ends with 1 if a test fails in any of them.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
NUMERIC = ("tests/laws", "tests/unit/tracking", "tests/unit/estimation", "tests/unit/dynamics", "tests/unit/measures")
CORES = {
    "Prescott": "SSE3",
    "Nehalem": "SSE42",
    "Sandybridge": "AVX",
    "Haswell": "AVX2",
    "Zen": "AVX2",
    "SkylakeX": "AVX512F",
    "Cooperlake": "AVX512F",
}
"""OpenBLAS's kernel (`OPENBLAS_CORETYPE`) -> the CPU feature that it needs, as NumPy calls it."""
FEATURES = ("X86_V3", "X86_V4", "AVX512_ICL", "AVX512_SPR", "AVX2", "FMA3", "AVX512F", "AVX512CD", "AVX512_SKX")
"""Features that NumPy dispatches on: the first ones since 2.4, which has groups of them, the others before."""
NO_FMA = "glibc.cpu.hwcaps=-FMA,-FMA4,-AVX2,-AVX512F"
N_BUSY = 8
SEEDS = (1, 2, 3)


@dataclass(frozen=True)
class Variant:
    """One run: what is different about it."""

    group: str
    name: str
    environment: dict[str, str] = field(default_factory=dict)
    options: tuple[str, ...] = ()
    n_busy: int = 0


class RandomOrder:
    """A plug-in of pytest: the tests in an order of chance."""

    def __init__(self, seed: int) -> None:
        self.seed = seed

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        order = np.random.default_rng(self.seed).permutation(len(items))
        items[:] = [items[k] for k in order]


def features() -> dict[str, bool]:
    """CPU feature -> whether this processor has it."""
    from numpy._core._multiarray_umath import __cpu_features__

    return dict(__cpu_features__)


def dispatched() -> list[str]:
    """The features of this processor that NumPy uses and can do without."""
    from numpy._core._multiarray_umath import __cpu_dispatch__

    has = features()
    return [each for each in __cpu_dispatch__ if has.get(each) and each in FEATURES]


def variants() -> Iterator[Variant]:
    """Every run that this processor can do."""
    has = features()
    for core, needed in CORES.items():
        if has.get(needed, needed in ("SSE3", "SSE42")):
            yield Variant("blas", core, {"OPENBLAS_CORETYPE": core})
    off = dispatched()
    for each in off:
        yield Variant("numpy", f"without {each}", {"NPY_DISABLE_CPU_FEATURES": each})
    if off:
        yield Variant("numpy", "without all", {"NPY_DISABLE_CPU_FEATURES": " ".join(off)})
    yield Variant("libm", "without FMA", {"GLIBC_TUNABLES": NO_FMA})
    for seed in SEEDS:
        yield Variant("order", f"seed {seed}", options=("--order", str(seed)))
    yield Variant("load", f"beside {N_BUSY} busy processes", n_busy=N_BUSY)


def run(variant: Variant, tests: list[str]) -> bool:
    """Run the tests in one way; False if any fails."""
    with ExitStack() as stack:
        for _ in range(variant.n_busy):
            busy = stack.enter_context(subprocess.Popen([sys.executable, "-c", "while True: pass"]))
            stack.callback(busy.kill)
        done = subprocess.run(
            [sys.executable, "-m", "tests.studies.processors", "--one", *variant.options, *tests],
            check=False,
            cwd=ROOT,
            env=os.environ | variant.environment,
            capture_output=True,
            text=True,
        )
    failed = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    print(f"{variant.group:6} {variant.name:28} {'passed' if done.returncode == 0 else 'FAILED'}", flush=True)
    if done.returncode:
        print("\n".join(failed) or done.stdout[-2000:] + done.stderr[-2000:], flush=True)
    return done.returncode == 0


def main() -> int:
    """Run all variants, or the tests once (`--one`, for itself)."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--only", choices=("blas", "numpy", "libm", "order", "load"))
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--order", type=int, help=argparse.SUPPRESS)
    parser.add_argument("tests", nargs="*")
    given = parser.parse_args()
    tests = given.tests or [each for each in NUMERIC if (ROOT / each).exists()]
    if given.one:
        plugins = [] if given.order is None else [RandomOrder(given.order)]
        return int(pytest.main(["-q", "-p", "no:cacheprovider", *tests], plugins=plugins))
    chosen = [each for each in variants() if given.only in (None, each.group)]
    passed = [run(each, tests) for each in chosen]
    return 0 if all(passed) else 1


if __name__ == "__main__":
    sys.exit(main())
