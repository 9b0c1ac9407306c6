"""Runs cases in processes of their own, and gathers what they found."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from tests.fuzz.sanitized import ROOT

CASES_A_PROCESS = 2000
MOST_SHOWN = 4000
MOST_FINDINGS = 30
"""A run ends with so many: inputs of a case that is a finding are not counted."""
N_SUMMARY_LINES = 12


@dataclass
class Report:
    """What became of the cases.

    Attributes:
        counts: Of inputs: made, accepted by cwcli, compared with what the official libraries say, and exit codes.
        findings: Number of a case -> what is wrong with it.
        n_cases: Cases that were begun.
    """

    counts: Counter[str] = field(default_factory=Counter)
    findings: dict[int, str] = field(default_factory=dict)
    n_cases: int = 0


def drive(
    level: str,
    seed: int,
    *,
    first: int = 0,
    n_inputs: int | None = None,
    n_cases: int | None = None,
    until_s: float | None = None,
    kernels: Path | None = None,
    environment: dict[str, str] | None = None,
) -> Report:
    """Check cases one after the other.

    Args:
        level: One of `worker.CASES`.
        seed: Of the cases.
        first: Number of the first case.
        n_inputs, n_cases: Stop after so many.
        until_s: Stop then, by `time.monotonic`.
        kernels: Folder with sanitized kernels.
        environment: Of the processes.
    """
    report = Report()
    case = first

    def is_done() -> bool:
        return (
            (n_inputs is not None and report.counts["inputs"] >= n_inputs)
            or (n_cases is not None and report.n_cases >= n_cases)
            or (until_s is not None and time.monotonic() >= until_s)
            or len(report.findings) >= MOST_FINDINGS
        )

    while not is_done():
        stop = case + CASES_A_PROCESS if n_cases is None else first + n_cases
        command = [sys.executable, "-m", "tests.fuzz.worker", level, "--seed", str(seed)]
        command += ["--first", str(case), "--stop", str(min(stop, case + CASES_A_PROCESS))]
        command += ["--kernels", str(kernels)] if kernels else []
        with tempfile.TemporaryFile("w+") as said:
            process = subprocess.Popen(
                command, stdout=subprocess.PIPE, stderr=said, text=True, cwd=ROOT, env=environment or dict(os.environ)
            )
            begun: int | None = None
            assert process.stdout is not None
            for line in process.stdout:
                told = json.loads(line)
                case = told["case"]
                if len(told) == 1:
                    begun = case
                    continue
                begun = None
                report.n_cases += 1
                report.counts.update(told.get("counts", {}))
                if "finding" in told:
                    report.findings[case] = told["finding"]
                case += 1
                if is_done():
                    process.kill()
                    break
            code = process.wait()
            if begun is not None:
                report.n_cases += 1
                report.findings[begun] = _death(code, said)
                case = begun + 1
            elif code not in (0, -signal.SIGKILL):
                said.seek(0)
                raise RuntimeError(f"the worker ended with {code}:\n{said.read()[-MOST_SHOWN:]}")
    return report


def _death(code: int, said: object) -> str:
    said.seek(0)  # type: ignore[attr-defined]
    shown: str = said.read()  # type: ignore[attr-defined]
    if code == -signal.SIGPROF:
        return "took more than 10 s of processor time"
    name = signal.Signals(-code).name if code < 0 else str(code)
    at = max(shown.find("ERROR: AddressSanitizer"), shown.find("runtime error:"), len(shown) - MOST_SHOWN, 0)
    return f"the process died of {name}\n{shown[at : at + MOST_SHOWN]}"
