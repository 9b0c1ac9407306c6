"""Logs from web servers that break every promise: told in one line without a secret; and from those that keep them."""

from __future__ import annotations

import re
import urllib.request
from email.message import Message
from pathlib import Path

import pytest

from cwcli.cli.main import run_command_line
from cwcli.errors import InputError
from cwcli.logs.read.http_blocks import _Redirects
from cwcli.logs.read.reader import Log
from tests.unit.logs_read.builders import small_log
from tests.unit.logs_read.hostile_servers import (
    HOSTILE_SERVERS,
    SECRET,
    SECRETS,
    Answer,
    good_deflate,
    good_gzip,
    head,
    partial,
    redirect,
    resumed,
    send,
    serve,
)

QUICK = {
    "accepts and says nothing",
    "sends a body byte by byte",
    "sends zeros without end",
    "redirects without end",
    "redirects to a file",
    "sends brotli",
    "redirects to a path of 60 kB",
    "redirects to the password",
}
"""Those of a default run."""
LOG = small_log(30)
MOST_CHARS = 600
"""That a server can make an error long."""


@pytest.mark.parametrize(
    "name", [pytest.param(each, marks=() if each in QUICK else pytest.mark.long) for each in HOSTILE_SERVERS]
)
def test_hostile_server_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    answer, words = HOSTILE_SERVERS[name]
    with serve(answer) as url, pytest.raises(InputError) as told:
        Log.open(url, timeout_s=3.0, max_pipe_bytes=20_000_000)
    said = f"{told.value} {told.value.hint}"
    assert re.search(words, said), said
    assert not [each for each in SECRETS if each in said]
    assert "\n" not in said and len(said) < MOST_CHARS
    assert list(tmp_path.iterdir()) == []


KEPT: dict[str, Answer] = {
    "whole": send(head(Content_Length=str(len(LOG))) + LOG),
    "without a length": send(head() + LOG),
    "in gzip": good_gzip(LOG),
    "in deflate": good_deflate(LOG),
    "resumed": resumed(LOG, lambda rest, first: partial(rest, first, len(LOG))),
}


@pytest.mark.parametrize("name", KEPT)
def test_log_of_a_good_server_is_the_log(name: str) -> None:
    with serve(KEPT[name]) as url, Log.open(url, timeout_s=5.0) as log:
        assert bytes(log.file[: len(log.file)]) == LOG


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (resumed(LOG, lambda rest, first: partial(rest, first + 1, len(LOG))), "another range or another file"),
        (resumed(LOG, lambda rest, first: partial(rest, first, len(LOG) + 1)), "another range or another file"),
        (resumed(LOG, lambda rest, first: partial(rest, first, len(LOG), '"two"')), "another range or another file"),
        (resumed(LOG, lambda rest, first: head(Content_Length=str(len(LOG))) + LOG), "the connection broke"),
        (resumed(LOG, lambda rest, first: head("416 Range Not Satisfiable")), "can't be read"),
    ],
    ids=["another place", "another length", "another version", "no range", "no such range"],
)
def test_rest_of_another_file_is_refused(answer: Answer, words: str) -> None:
    with serve(answer) as url, pytest.raises(InputError, match=words):
        Log.open(url, timeout_s=5.0)


def test_redirect_is_followed_without_the_password() -> None:
    asked: list[str] = []

    def answer(connection: object, head_of_request: str, number: int) -> None:
        asked.append(head_of_request)
        send(head(Content_Length=str(len(LOG))) + LOG)(connection, head_of_request, number)  # type: ignore[arg-type]

    with serve(answer) as target:
        port = target.rpartition(":")[2].partition("/")[0]
        with serve(redirect(f"http://127.0.0.1:{port}/other")) as url, Log.open(url, timeout_s=5.0) as log:
            assert len(log.file) == len(LOG)
    assert asked[0].startswith("GET /other ")
    assert "authorization" not in asked[0].lower()


@pytest.mark.parametrize("target", ["http://host/x", "file:///x", "ftp://host/x"])
def test_redirect_from_https_goes_to_https_alone(target: str) -> None:
    request = urllib.request.Request("https://host/drive.mcap")
    with pytest.raises(InputError, match="which is not followed"):
        _Redirects(request.full_url).redirect_request(request, None, 302, "", Message(), target)  # type: ignore[arg-type]
    following = _Redirects(request.full_url).redirect_request(request, None, 302, "", Message(), "https://other/x")  # type: ignore[arg-type]
    assert following is not None and following.full_url == "https://other/x"


def test_timeout_is_an_option(capsys: pytest.CaptureFixture[str]) -> None:
    with serve(HOSTILE_SERVERS["accepts and says nothing"][0]) as url:
        assert run_command_line(["info", url, "--timeout", "4"]) == 3
    said = capsys.readouterr().err
    # on a busy machine the connection itself may take that long
    assert "did not send 1,000 bytes within 4 s" in said or "the server did not answer in time" in said
    assert "--timeout" in said and SECRET not in said
