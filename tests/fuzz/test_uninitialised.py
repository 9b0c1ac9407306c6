"""No kernel takes a decision or a value from memory that nobody has written: the whole pipeline under memcheck.

Such a value is right on most runs and NaN on one of thousands (0 times what the stack held).
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

ROOT = Path(__file__).parents[2]
SIX_STATES = """
from cwcli.reproduction.song2016.methods import measure_vehicle, paper_predicted_points_m
from cwcli.reproduction.song2016.methods import paper_filter_states_with_derivatives
from cwcli.simulation.scenario import EGO_VEHICLE_KEY, load_scenario
run = measure_vehicle(load_scenario("straight"), EGO_VEHICLE_KEY, 0)
paper_predicted_points_m(paper_filter_states_with_derivatives(run), "jerk", 2.5)
"""
RUN_OF_A_DRIVE = """
import sys
from cwcli.cli.main import main
sys.argv = ["cwcli", "run", {log!r}, "-o", {output!r}, "--quiet"]
main()
"""
WITHOUT_WIDE_REGISTERS = "X86_V3 X86_V4 AVX512_ICL AVX512_SPR"
"""NumPy's CPU features that memcheck knows too little of: it takes their masked loads for uninitialised."""


def errors_in_kernels(code: str, tmp_path: Path) -> list[str]:
    """Run Python code under memcheck; return the reads of unwritten or foreign memory in a kernel, one line each."""
    report = tmp_path / "memcheck.xml"
    memcheck = ("valgrind", "--xml=yes", f"--xml-file={report}", "--error-limit=no", "--leak-check=no", "--quiet")
    subprocess.run(
        [*memcheck, sys.executable, "-c", code],
        env={
            **os.environ,
            "PYTHONMALLOC": "malloc",
            "OPENBLAS_NUM_THREADS": "1",
            "NPY_DISABLE_CPU_FEATURES": WITHOUT_WIDE_REGISTERS,
        },
        cwd=ROOT,
        check=True,
        stdout=subprocess.DEVNULL,
        timeout=3600,
    )
    found = []
    for error in ElementTree.parse(report).getroot().iter("error"):
        if error.findtext("kind", "").startswith("Leak"):
            continue
        frames = [(frame.findtext("obj", ""), frame.findtext("fn", "")) for frame in error.iter("frame")]
        if any("cwcli/kernels/" in file for file, _ in frames):
            found.append(f"{error.findtext('kind')}: {' < '.join(name for _, name in frames[:4])}")
    return found


def test_a_run_and_the_paper_s_filter_read_nothing_unwritten(tmp_path: Path) -> None:
    log, output = ROOT / "sample_logs" / "intersection.mcap", tmp_path / "out.mcap"
    code = SIX_STATES + RUN_OF_A_DRIVE.format(log=str(log), output=str(output))
    assert errors_in_kernels(code, tmp_path) == []
