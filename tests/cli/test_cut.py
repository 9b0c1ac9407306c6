"""`cwcli cut` on the command line: times, topics, refusals, and a clip that the next command reads."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cwcli.errors import EXIT_DONE, EXIT_NOT_WRITTEN, EXIT_USAGE
from tests.cli.conftest import SAMPLES, Run

DRIVE = str(SAMPLES / "intersection.mcap")


def test_cut_writes_a_log_that_estimate_reads(cwcli: Run, tmp_path: Path) -> None:
    clip = str(tmp_path / "clip.mcap")
    done = cwcli(
        "cut", DRIVE, "--start", "2", "--end", "6", "--topics", "/gps/*,/vehicle/*,/imu/*", "-o", clip, "--json"
    )
    assert done.returncode == EXIT_DONE
    counts = json.loads(done.stdout)["messages"]
    assert counts == {"/gps/fix": 80, "/gps/heading": 80, "/imu/data": 80, "/vehicle/velocity": 80}
    assert cwcli("estimate", clip, "-o", str(tmp_path / "out.mcap")).returncode == EXIT_DONE


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "nothing is cut"),
        (("--start", "5", "--end", "5"), "--end 5 is not after --start 5"),
        (("--start", "999"), "--start 999 is after the end of the log"),
        (("--start", "5 m"), "neither seconds nor an ISO 8601 time"),
        (("--topics", "/gps/fx"), "did you mean /gps/fix?"),
    ],
)
def test_nonsense_is_refused(cwcli: Run, tmp_path: Path, arguments: tuple[str, ...], words: str) -> None:
    done = cwcli("cut", DRIVE, *arguments, "-o", str(tmp_path / "out.mcap"))
    assert done.returncode == EXIT_USAGE
    assert words in " ".join(done.stderr.decode().split())
    assert not list(tmp_path.iterdir())


def test_input_is_never_overwritten(cwcli: Run, tmp_path: Path) -> None:
    copy = tmp_path / "drive.mcap"
    copy.write_bytes(Path(DRIVE).read_bytes())
    done = cwcli("cut", str(copy), "--start", "1", "-o", str(copy), "--force")
    assert done.returncode == EXIT_NOT_WRITTEN
    assert copy.read_bytes() == Path(DRIVE).read_bytes()
