"""What a run that fails late or is killed leaves behind: nothing."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import cwcli.metrics.table
from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_NOT_WRITTEN, OutputError

ROOT = Path(__file__).parents[2]
FIRST_BYTES = 20_000


def test_tables_that_cannot_be_written_leave_no_annotated_log(
    intersection: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def no_space(*arguments: object) -> None:
        raise OutputError("no space is left on the disk", where="metrics")

    monkeypatch.setattr(cwcli.metrics.table, "write_table_to_sink", no_space)
    target = tmp_path / "annotated.mcap"
    arguments = ["estimate", str(intersection), "-o", str(target), "--metrics", str(tmp_path / "estimate.parquet")]
    assert run_command_line(arguments) == EXIT_NOT_WRITTEN
    assert "no space is left" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere temporary files have names")
def test_a_run_killed_while_it_reads_a_pipe_leaves_no_copy(intersection: Path, tmp_path: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "cwcli", "info", "-"],
        stdin=subprocess.PIPE,
        cwd=ROOT,
        env={**os.environ, "TMPDIR": str(tmp_path)},
    )
    assert process.stdin is not None
    process.stdin.write(intersection.read_bytes()[:FIRST_BYTES])
    process.stdin.flush()
    spool = wait_for_spool(process.pid, tmp_path)
    os.kill(process.pid, signal.SIGKILL)
    assert process.wait(timeout=600) == -signal.SIGKILL
    process.stdin.close()
    assert spool.startswith(str(tmp_path))
    assert list(tmp_path.iterdir()) == []


def wait_for_spool(pid: int, folder: Path) -> str:
    """The name that the system gives the open temporary file of a process."""
    import time

    deadline = time.monotonic() + 600
    while time.monotonic() < deadline:
        for link in Path(f"/proc/{pid}/fd").iterdir():
            try:
                name = str(link.readlink())
            except OSError:
                continue
            if name.startswith(str(folder)):
                return name
        time.sleep(0.02)
    raise AssertionError("no temporary file was opened")
