"""`cwcli run --ray`: a cluster writes what one process writes."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.conftest import Run
from tests.cli.fleet_logs import tree
from tests.cli.test_fleet import logs, reference, start

__all__ = ["logs", "reference"]  # fixtures


@pytest.mark.long
def test_a_cluster_writes_the_same_bytes_as_one_process(logs: Path, reference: Path, tmp_path: Path) -> None:
    target = str(tmp_path / "out")
    process = start(logs.parent, "logs/*.mcap", "-d", target, "--tables", "--ray", "local", "--jobs", "2")
    _, error = process.communicate(timeout=600)
    assert process.returncode == 3, error.decode()
    assert tree(tmp_path / "out") == tree(reference)


@pytest.mark.parametrize("address", ["127.0.0.1:1", "auto"])
def test_a_cluster_that_does_not_answer_is_an_error(
    cwcli: Run, intersection: Path, tmp_path: Path, address: str
) -> None:
    done = cwcli("run", intersection, "-d", "out", "--ray", address)
    assert (done.returncode, done.stdout) == (2, b"")
    assert done.stderr.startswith(b"error: ")
    assert b"no Ray cluster answers" in done.stderr
    assert b"Traceback" not in done.stderr
    assert not (tmp_path / "out/logs").exists()
