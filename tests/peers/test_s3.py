"""Logs on `s3://`, read from moto's S3 server on this machine."""

from __future__ import annotations

import contextlib
import json
import os
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.cli.fleet_logs import tree


@pytest.fixture(scope="module")
def bucket() -> Iterator[dict[str, str]]:
    """An S3 server on this machine with a bucket; yields the environment that leads to it."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    server = subprocess.Popen(
        [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    endpoint = f"http://127.0.0.1:{port}"
    environment = {
        "AWS_ENDPOINT_URL": endpoint,
        "AWS_ACCESS_KEY_ID": "test",
        "AWS_SECRET_ACCESS_KEY": "test",
        "AWS_DEFAULT_REGION": "us-east-1",
    }
    try:
        until = time.monotonic() + 60
        while time.monotonic() < until:
            with contextlib.suppress(OSError), urllib.request.urlopen(f"{endpoint}/moto-api/", timeout=2):
                break
            time.sleep(0.1)
        yield environment
    finally:
        server.terminate()
        server.wait()


def test_s3_urls(bucket: dict[str, str], tmp_path: Path) -> None:
    sample = Path(__file__).parents[2] / "sample_logs" / "straight.mcap"
    script = f"""
import fsspec
s3 = fsspec.filesystem("s3")
s3.mkdir("bucket")
for name in ("b", "a"):
    s3.put_file({str(sample)!r}, f"bucket/drives/{{name}}.mcap")
s3.pipe_file("bucket/drives/broken.mcap", b"no log")
"""
    environment = {**os.environ, **bucket, "PYTHONPATH": str(sample.parents[1])}
    subprocess.run([sys.executable, "-c", script], check=True, env=environment, timeout=600)
    done = subprocess.run(
        [sys.executable, "-m", "cwcli", "run", "s3://bucket/drives/*.mcap", "-d", "out", "--stage", "estimate"],
        check=False, capture_output=True, text=True, env=environment, cwd=tmp_path, timeout=600,
    )  # fmt: skip
    assert done.returncode == 3, done.stderr
    assert "s3://bucket/drives/broken.mcap: " in " ".join(done.stderr.split())
    assert sorted(path.name for path in (tmp_path / "out/logs").iterdir()) == ["a", "b", "broken"]
    annotated = [(tmp_path / f"out/logs/{name}/annotated.mcap").read_bytes() for name in ("a", "b")]
    assert annotated[0] == annotated[1]
    assert not (tmp_path / "out/.scratch").exists()
    missing = subprocess.run(
        [sys.executable, "-m", "cwcli", "run", "s3://nobucket/*.mcap", "-d", "out2"],
        check=False, capture_output=True, text=True, env=environment, cwd=tmp_path, timeout=600,
    )  # fmt: skip
    assert missing.returncode in (2, 3)
    assert missing.stderr.startswith("error: s3://nobucket/*.mcap: ")
    assert "bucket does not exist" in missing.stderr
    assert not (tmp_path / "out2").exists()


def test_s3_urls_in_every_command(bucket: dict[str, str], tmp_path: Path) -> None:
    """A file, a folder in parts, and what is not there."""
    sample = Path(__file__).parents[2] / "sample_logs" / "straight.mcap"
    script = f"""
import fsspec
s3 = fsspec.filesystem("s3")
s3.mkdir("cars")
s3.put_file({str(sample)!r}, "cars/drive/drive_0.mcap")
listing = "{{rosbag2_bagfile_information: {{relative_file_paths: [drive_0.mcap, drive_1.mcap]}}}}"
s3.pipe_file("cars/drive/metadata.yaml", listing.encode())
"""
    environment = {**os.environ, **bucket, "PYTHONPATH": str(sample.parents[1])}
    subprocess.run([sys.executable, "-c", script], check=True, env=environment, timeout=600)

    def cwcli(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "cwcli", *arguments],
            check=False, capture_output=True, text=True, env=environment, cwd=tmp_path, timeout=600,
        )  # fmt: skip

    expected = json.loads(cwcli("info", str(sample), "--json").stdout)
    for url in ("s3://cars/drive/drive_0.mcap", "s3://cars/drive/", "s3://cars/drive"):
        found = json.loads(cwcli("info", url, "--json").stdout)
        assert (found["name"], found["messages"]) == (url, expected["messages"])
        faults = {} if url.endswith(".mcap") else {"parts missing that metadata.yaml lists (drive_1.mcap)": 1}
        assert found["faults"] == faults
    done = cwcli("estimate", "s3://cars/drive/drive_0.mcap", "-o", "out.mcap", "--quiet")
    assert done.returncode == 0, done.stderr
    for url, reason in (
        ("s3://nobody/drive.mcap", "bucket does not exist"),
        ("s3://nobody/drive/", "bucket does not exist"),
        ("s3://cars/nothing.mcap", "there is no such file"),
    ):
        missing = cwcli("estimate", url)
        assert missing.returncode == 3
        assert missing.stderr.startswith(f"error: {url}: ")
        assert reason in missing.stderr


def test_a_run_into_s3_that_was_killed_goes_on(bucket: dict[str, str], tmp_path: Path) -> None:
    """`-d s3://`: killed after its first log was sent, run again, and equal to a run on this machine."""
    samples = Path(__file__).parents[2] / "sample_logs"
    logs = [str(samples / name) for name in ("straight.mcap", "curve.mcap", "rear-end.mcap")]
    environment = {**os.environ, **bucket, "PYTHONPATH": str(samples.parent)}
    options = ["--stage", "estimate", "--jobs", "1", "-q"]
    command = [sys.executable, "-m", "cwcli", "run", *logs, *options, "-d"]
    script = "import fsspec, sys; s3 = fsspec.filesystem('s3'); {}"

    def in_store(work: str) -> str:
        done = subprocess.run(
            [sys.executable, "-c", script.format(work)],
            check=True, capture_output=True, text=True, env=environment, cwd=tmp_path, timeout=600,
        )  # fmt: skip
        return done.stdout

    in_store("s3.mkdir('results')")
    process = subprocess.Popen([*command, "s3://results/run"], env=environment, cwd=tmp_path)
    until = time.monotonic() + 300
    while "entry.json" not in in_store("print(s3.find('results/run'))") and process.poll() is None:
        assert time.monotonic() < until
    process.kill()
    process.wait()
    for target in ("s3://results/run", "local"):
        subprocess.run([*command, target], check=True, env=environment, cwd=tmp_path, timeout=600)
    in_store("s3.get('results/run/', 'copy/', recursive=True)")
    assert tree(tmp_path / "copy") == tree(tmp_path / "local")
    denied = subprocess.run(
        [*command, "s3://nobucket/run"],
        check=False, capture_output=True, text=True, env=environment, cwd=tmp_path, timeout=600,
    )  # fmt: skip
    assert denied.returncode == 6
    assert "s3://nobucket/run: it can't be read: there is no such file" in " ".join(denied.stderr.split())
