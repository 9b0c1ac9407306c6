"""Logs on `s3://`, read from moto's S3 server on this machine."""

from __future__ import annotations

import atexit
import contextlib
import json
import os
import re
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from functools import cache
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import ClassVar

import pytest

from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_BAD_INPUT
from tests.cli.fleet_logs import cut, tree
from tests.cli.warm_process import WarmProcess

SAMPLES = Path(__file__).parents[2] / "sample_logs"


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

    (tmp_path / "work").mkdir()

    def cwcli(*arguments: str) -> subprocess.CompletedProcess[str]:
        return call_cwcli(bucket, tmp_path / "work", *arguments)

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
    working = tmp_path / "working"
    working.mkdir()
    environment = {**os.environ, **bucket, "PYTHONPATH": str(samples.parent), "TMPDIR": str(working)}
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
    assert [*working.iterdir()] == []  # not even what the killed run had there
    denied = subprocess.run(
        [*command, "s3://nobucket/run"],
        check=False, capture_output=True, text=True, env=environment, cwd=tmp_path, timeout=600,
    )  # fmt: skip
    assert denied.returncode == 6
    assert "s3://nobucket/run: it can't be read: there is no such file" in " ".join(denied.stderr.split())


@pytest.fixture(scope="module")
def run_in_store(bucket: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run over two logs, in `out` of the folder and in s3://runs/out."""
    folder = tmp_path_factory.mktemp("runs")
    logs = [cut(SAMPLES / name, folder / name, seconds=8.0) for name in ("rear-end.mcap", "straight.mcap")]
    done = call_cwcli(bucket, folder, "run", *map(str, logs), "-d", "out", "--jobs", "1", "-q")
    assert done.returncode == 0, done.stderr
    script = (
        "import fsspec; s3 = fsspec.filesystem('s3'); s3.mkdir('runs'); s3.put('out/', 'runs/out/', recursive=True)"
    )
    subprocess.run([sys.executable, "-c", script], check=True, env={**os.environ, **bucket}, cwd=folder, timeout=600)
    return folder


def call_cwcli(bucket: dict[str, str], folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, **bucket, "PYTHONPATH": str(SAMPLES.parent), "TMPDIR": str(folder)}
    done = process_with_s3fs().run([*arguments], folder, environment, 600.0)
    return subprocess.CompletedProcess(done.args, done.returncode, done.stdout.decode(), done.stderr.decode())


@cache
def process_with_s3fs() -> WarmProcess:
    """What most commands are forked from: importing the library takes longer than what they do."""
    process = WarmProcess("s3fs", "aiobotocore.session")
    atexit.register(process.close)
    return process


@pytest.mark.parametrize(
    "command",
    [
        ("evaluate", "{run}", "--all"),
        ("evaluate", "{run}", "--truth", "none", "--json"),  # scored again, from the annotated logs
        ("find", "{run}", "all"),
        ("compare", "{run}", "out", "--messages"),
        ("report", "{run}", "-o", "-"),
    ],
    ids=" ".join,
)
def test_a_run_in_a_store_is_read_like_one_on_this_machine(
    bucket: dict[str, str], run_in_store: Path, command: tuple[str, ...]
) -> None:
    for url in ("s3://runs/out", "s3://runs/out/"):
        texts = []
        for name in ("out", url):
            done = call_cwcli(bucket, run_in_store, *(part.format(run=name) for part in command))
            assert done.returncode == 0, done.stderr
            texts.append(done.stdout)
        assert texts[1].replace(url, "out") == texts[0]
    assert sorted(path.name for path in run_in_store.iterdir()) == ["out", "rear-end.mcap", "straight.mcap"]


def require_keys_of_known_users(bucket: dict[str, str], after_n_requests: str) -> None:
    """Let the store allow some more requests with the keys of nobody."""
    url, headers = f"{bucket['AWS_ENDPOINT_URL']}/moto-api/reset-auth", {"Content-Type": "text/plain"}
    request = urllib.request.Request(url, data=after_n_requests.encode(), headers=headers)
    urllib.request.urlopen(request, timeout=600).close()


@pytest.mark.parametrize("command", ["evaluate", "report", "find", "compare"])
def test_a_run_in_a_store_that_can_not_be_read_is_one_line(
    bucket: dict[str, str], run_in_store: Path, command: str
) -> None:
    """No such bucket, no such folder, no run in it, and a store that does not allow it."""
    more = {"report": ("-o", "page.html"), "find": ("all",), "compare": ("out",)}.get(command, ())

    def call_and_get_error(url: str) -> str:
        done = call_cwcli(bucket, run_in_store, command, url, *more)
        assert done.returncode == 3, done.stderr
        assert done.stdout == ""
        return " ".join(done.stderr.split())

    assert "error: s3://nobody/out: it can't be read: there is no such file (The specified bucket" in (
        call_and_get_error("s3://nobody/out")
    )
    assert "error: s3://runs/nothing: " in call_and_get_error("s3://runs/nothing")
    require_keys_of_known_users(bucket, after_n_requests="0")
    try:
        denied = call_and_get_error("s3://runs/out")
    finally:
        require_keys_of_known_users(bucket, after_n_requests="inf")
    assert "error: s3://runs/out: it can't be read: the server does not allow it (status 403)" in denied
    assert not (run_in_store / "page.html").exists()


class BreakingStore(BaseHTTPRequestHandler):
    """Passes requests on to a store; breaks off in the middle of the files whose names match a pattern."""

    behind: ClassVar[str]
    broken: ClassVar[str]

    def do_GET(self) -> None:
        """Answer with what the store behind answers, or half of it."""
        self.pass_on(None)

    def pass_on(self, data: bytes | None) -> None:
        """Send the request with its data to the store behind, and its answer back."""
        headers = {"Content-Type": "application/octet-stream", **self.headers}  # else urllib calls it a form
        request = urllib.request.Request(f"{self.behind}{self.path}", data, headers, method=self.command)
        try:
            answer = urllib.request.urlopen(request, timeout=600)
        except urllib.error.HTTPError as error:
            answer = error
        with answer:
            body = b"" if self.command == "HEAD" else answer.read()
            self.send_response(answer.status)
            for name, value in answer.headers.items():
                if name.lower() not in {"transfer-encoding", "connection", "date", "server"}:
                    self.send_header(name, value)
            self.end_headers()
            self.wfile.write(body[: len(body) // 2] if re.search(self.broken, self.path) else body)

    do_HEAD = do_GET

    def log_message(self, *arguments: object) -> None:
        """Say nothing."""


@pytest.mark.parametrize(
    ("command", "broken", "where"),
    [
        (("evaluate", "s3://runs/out"), "/manifest.json", "s3://runs/out"),
        (("report", "s3://runs/out", "-o", "page.html"), "/metrics.parquet", "s3://runs/out"),
        (("find", "s3://runs/out", "all"), "/annotated.mcap", "s3://runs/out/logs/rear-end/annotated.mcap"),
    ],
)
def test_a_store_that_dies_in_mid_read_is_one_line(
    bucket: dict[str, str], run_in_store: Path, command: tuple[str, ...], broken: str, where: str
) -> None:
    with served(type("Breaking", (BreakingStore,), {"broken": broken}), bucket) as environment:
        done = call_cwcli(environment, run_in_store, *command)
    assert done.returncode == 3, done.stderr
    said = " ".join(done.stderr.split())
    assert said.startswith(f"error: {where}") and "the connection broke before the whole file had come" in said
    assert sorted(path.name for path in run_in_store.iterdir()) == ["out", "rear-end.mcap", "straight.mcap"]


class ThrottlingStore(BreakingStore):
    """Passes requests on to a store; answers those that `is_throttled` picks by their number as S3 says it is busy."""

    broken = "$^"
    protocol_version = "HTTP/1.1"  # a client that sends a file waits for `100 Continue`
    n_requests: ClassVar[int] = 0

    @staticmethod
    def is_throttled(number: int) -> bool:
        """Whether the store is busy: at every third request."""
        return number % 3 == 0

    def do_PUT(self) -> None:
        """Answer with what the store behind answers, or that it is busy."""
        ThrottlingStore.n_requests += 1
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        if self.is_throttled(ThrottlingStore.n_requests):
            words = b"<Error><Code>SlowDown</Code><Message>Please reduce your request rate.</Message></Error>"
            self.send_response(503)
            self.send_header("Content-Length", str(len(words)))
            self.end_headers()
            self.wfile.write(b"" if self.command == "HEAD" else words)
        else:
            self.pass_on(body or None)

    do_GET = do_HEAD = do_POST = do_DELETE = do_PUT


@contextlib.contextmanager
def served(handler: type[BaseHTTPRequestHandler], bucket: dict[str, str]) -> Iterator[dict[str, str]]:
    """Serve what stands before a store; yields the environment that leads to it."""
    own = type("Handler", (handler,), {"behind": bucket["AWS_ENDPOINT_URL"]})
    with ThreadingHTTPServer(("127.0.0.1", 0), own) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield {**bucket, "AWS_ENDPOINT_URL": f"http://127.0.0.1:{server.server_port}"}
        server.shutdown()


def test_shards_in_a_store_that_throttles_are_merged_into_what_one_run_writes(
    bucket: dict[str, str], run_in_store: Path, tmp_path: Path
) -> None:
    """Three shards of two logs are run into S3 and merged there, while every third request is told to slow down."""
    logs = sorted(str(path) for path in run_in_store.glob("*.mcap"))
    with served(ThrottlingStore, bucket) as environment:
        for k in (1, 2, 3):
            out = f"s3://runs/busy/{k}"
            done = call_cwcli(environment, tmp_path, "run", *logs, "--shard", f"{k}/3", "-d", out, "-q")
            assert done.returncode == 0, done.stderr
        shards = [f"s3://runs/busy/{k}" for k in (1, 2, 3)]
        done = call_cwcli(environment, tmp_path, "merge", *shards, "-d", "s3://runs/busy/whole", "-q")
        assert done.returncode == 0, done.stderr
    assert ThrottlingStore.n_requests > 30
    script = "import fsspec; fsspec.filesystem('s3').get('runs/busy/whole/', 'copy/', recursive=True)"
    subprocess.run([sys.executable, "-c", script], check=True, env={**os.environ, **bucket}, cwd=tmp_path, timeout=600)
    assert tree(tmp_path / "copy") == tree(run_in_store / "out")


@pytest.mark.long
@pytest.mark.usefixtures("run_in_store")  # which makes the bucket `runs`
def test_a_thousand_logs_in_eight_shards_in_a_store_equal_one_run(bucket: dict[str, str], tmp_path: Path) -> None:
    (tmp_path / "logs").mkdir()
    for k in range(1000):
        cut(SAMPLES / "straight.mcap", tmp_path / "logs" / f"d{k:03}.mcap", start_s=0.05 * (k % 300), seconds=2.0)
    run = ("run", "logs", "--no-annotate", "--stage", "estimate", "-q")
    assert call_cwcli(bucket, tmp_path, *run, "-d", "whole").returncode == 0
    shards = [f"s3://runs/thousand/{k}" for k in range(1, 9)]
    for k, out in enumerate(shards, start=1):
        done = call_cwcli(bucket, tmp_path, *run, "--shard", f"{k}/8", "-d", out)
        assert done.returncode == 0, done.stderr
    done = call_cwcli(bucket, tmp_path, "merge", *shards, "-d", "s3://runs/thousand/whole", "-q")
    assert done.returncode == 0, done.stderr
    script = "import fsspec; fsspec.filesystem('s3').get('runs/thousand/whole/', 'copy/', recursive=True)"
    subprocess.run([sys.executable, "-c", script], check=True, env={**os.environ, **bucket}, cwd=tmp_path, timeout=600)
    assert tree(tmp_path / "copy") == tree(tmp_path / "whole")


def test_a_store_that_throttles_without_end_is_one_line(
    bucket: dict[str, str], run_in_store: Path, tmp_path: Path
) -> None:
    log = str(run_in_store / "straight.mcap")
    always = type("Always", (ThrottlingStore,), {"is_throttled": staticmethod(lambda number: True)})
    with served(always, bucket) as environment:
        few = {**environment, "AWS_MAX_ATTEMPTS": "2"}  # of botocore: what happens is the same, after a shorter wait
        done = call_cwcli(few, tmp_path, "run", log, "-d", "s3://runs/never", "-q")
    assert done.returncode == 6, done.stderr
    assert "s3://runs/never: it can't be read: the server can't answer now" in " ".join(done.stderr.split())


def test_a_user_name_that_is_no_utf_8_is_hidden(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["info", "s3://us\udcffer:pw@127.0.0.1:1/x"]) == EXIT_BAD_INPUT
    assert capsys.readouterr().err.startswith("error: s3://***@127.0.0.1:1/x: it can't be read: ")
