"""What the tests of the command line share."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from cwcli.stages import STAGES
from tests.cli.warm_process import WarmProcess

ROOT = Path(__file__).parents[2]
SAMPLES = ROOT / "sample_logs"
TIMEOUT_S = 600

Run = Callable[..., subprocess.CompletedProcess[bytes]]


@pytest.fixture(scope="session")
def intersection() -> Path:
    """A bundled log with an ego and one other vehicle, 10 s."""
    return SAMPLES / "intersection.mcap"


def with_details(*arguments: str | Path) -> tuple[str | Path, ...]:
    """Return the arguments with `--details`, where the command runs stages and prints their tables."""
    runs_stages = arguments[:1] and str(arguments[0]) in (*STAGES, "run", "demo")
    unwanted = {"--json", "--quiet", "-q", "--help", "-h", "--details"}
    if not runs_stages or unwanted & set(map(str, arguments)):
        return arguments
    return (arguments[0], "--details", *arguments[1:])


@pytest.fixture(scope="session")
def warm_process() -> Iterator[WarmProcess]:
    """What the commands of all tests are forked from."""
    process = WarmProcess()
    yield process
    process.close()


@pytest.fixture
def cwcli(tmp_path: Path, warm_process: WarmProcess) -> Run:
    """Runs `cwcli` as a process of its own, in an empty folder, without a terminal.

    It is forked from one that has imported everything, where nothing but its streams and variables are asked for.

    A command that runs stages prints its tables below the digest, because most tests look for them; `details=False`
    leaves them out, as a user gets it.
    """

    def run(*arguments: str | Path, details: bool = True, **settings: Any) -> subprocess.CompletedProcess[bytes]:
        arguments = with_details(*arguments) if details else arguments
        environment = {key: value for key, value in os.environ.items() if not key.startswith("CWCLI_")}
        environment |= {"PYTHONPATH": str(ROOT), **settings.pop("env", {})}
        if warm_process.serves(environment, settings):
            return warm_process.run([*map(str, arguments)], tmp_path, environment, TIMEOUT_S, **settings)
        return subprocess.run(
            [sys.executable, "-m", "cwcli", *map(str, arguments)],
            capture_output="stdout" not in settings,
            check=False,
            cwd=tmp_path,
            env=environment,
            timeout=TIMEOUT_S,
            **settings,
        )

    return run


@pytest.fixture(scope="session")
def predicted(intersection: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The intersection with states and paths."""
    folder = tmp_path_factory.mktemp("predicted")
    for command, source, target in (("estimate", intersection, "e.mcap"), ("predict", folder / "e.mcap", "p.mcap")):
        subprocess.run(
            [sys.executable, "-m", "cwcli", command, str(source), "-o", str(folder / target), "--quiet"],
            check=True,
            cwd=ROOT,
        )
    return folder / "p.mcap"
