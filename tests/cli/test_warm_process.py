"""A command that is forked from a warm process does what one does that Python starts anew."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.conftest import ROOT, SAMPLES, TIMEOUT_S
from tests.cli.warm_process import WarmProcess

LOG = str(SAMPLES / "intersection.mcap")


@pytest.mark.parametrize(
    "arguments",
    [
        ["--version"],
        ["info", "-", "--json"],
        ["estimate", LOG, "-o", "-", "--quiet"],
        ["run", LOG, "-d", "out", "--jobs", "2"],
        ["run", LOG, "--no-such-option"],
        ["estimate", "there is none.mcap"],
    ],
    ids=lambda words: " ".join(words).replace(str(SAMPLES), ""),
)
def test_a_forked_command_is_like_one_that_is_started(
    warm_process: WarmProcess, tmp_path: Path, arguments: list[str]
) -> None:
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    (tmp_path / "one").mkdir()
    (tmp_path / "two").mkdir()
    data = Path(LOG).read_bytes()
    forked = warm_process.run(arguments, tmp_path / "one", environment, TIMEOUT_S, input=data)
    started = subprocess.run(
        [sys.executable, "-m", "cwcli", *arguments],
        input=data, capture_output=True, check=False, cwd=tmp_path / "two", env=environment, timeout=TIMEOUT_S,
    )  # fmt: skip
    assert (forked.returncode, forked.stdout, forked.stderr) == (started.returncode, started.stdout, started.stderr)
    files = [sorted(path.relative_to(folder) for path in folder.rglob("*")) for folder in tmp_path.iterdir()]
    assert files[0] == files[1]


def test_what_python_reads_at_its_start_is_not_asked_of_a_warm_process(warm_process: WarmProcess) -> None:
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    assert warm_process.serves(environment, {})
    assert not warm_process.serves(environment | {"PYTHONHASHSEED": "7"}, {})
    assert not warm_process.serves(environment | {"LC_ALL": "C"}, {})
    assert not warm_process.serves(environment | {"TZ": "Asia/Tokyo"}, {})
    assert not warm_process.serves(environment | {"OMP_NUM_THREADS": "2"}, {})
    assert not warm_process.serves(environment, {"stdout": None})
