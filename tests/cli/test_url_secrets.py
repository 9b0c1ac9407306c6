"""No output of any command holds a secret of a URL: neither what is printed, nor any file or name."""

from __future__ import annotations

import json
import re
import socket
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from cwcli.cli.main import run_command_line
from tests.cli.conftest import SAMPLES
from tests.cli.url_server import SECRET, holds_word, places_of, secret_url, serve_logs


@pytest.fixture(scope="module")
def port(predicted: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """Of a server with a raw log, the same log with states, and a file that is no log."""
    broken = tmp_path_factory.mktemp("broken") / "broken.mcap"
    broken.write_bytes(b"no log at all")
    files = {
        "/drive.mcap": SAMPLES / "intersection.mcap",
        "/other.mcap": SAMPLES / "straight.mcap",
        "/annotated.mcap": predicted,
        "/broken.mcap": broken,
    }
    with serve_logs(files) as number:
        yield number


class Search:
    """Runs commands in this process, in a folder of their own, and searches what they print and write."""

    def __init__(self, folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
        self.folder = folder
        self._capfd = capfd

    def run(self, *arguments: str) -> tuple[int, str]:
        """The exit code and all words of a command, after the search."""
        code = run_command_line(list(arguments))
        out, error = self._capfd.readouterr()
        said = out + error
        assert not holds_word(SECRET, said.encode()), said
        assert "Traceback" not in said and "a bug" not in said, said
        assert places_of(SECRET, self.folder) == []
        return code, said


@pytest.fixture
def search(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Search:
    """With temporary files in the folder that is searched, too."""
    (tmp_path / "tmp").mkdir()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))
    monkeypatch.setattr(tempfile, "tempdir", None)
    return Search(tmp_path, capfd)


def test_the_search_finds_what_is_hidden(tmp_path: Path) -> None:
    """The search itself would find a secret in a name, a chunk, a table, an archive and in base64."""
    import base64
    import zipfile

    import pyarrow as pa
    import pyarrow.parquet as pq
    from mcap.writer import Writer

    with (tmp_path / "log.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel("/x", "json", writer.register_schema("x", "jsonschema", b"{}"))
        writer.add_message(channel, 1, b"z" * 500 + SECRET.encode() + b"z" * 500, 1)
        writer.finish()
    pq.write_table(pa.table({"x": [SECRET] * 9}), tmp_path / "table.parquet", compression="zstd")
    pq.write_table(pa.table({"x": [1]}).replace_schema_metadata({"at": SECRET}), tmp_path / "about.parquet")
    with zipfile.ZipFile(tmp_path / "a.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("x", f"zzzzzzzzzzzzzzzzzzzzzzzz{SECRET}zzzzzzzzzzzzzzzzzzz")
    for shift in range(3):
        (tmp_path / f"b{shift}.txt").write_bytes(base64.b64encode(b"u" * shift + SECRET.encode() + b"u"))
    (tmp_path / f"at-{SECRET.upper()}").mkdir()
    (tmp_path / "clean.txt").write_text("nothing")
    found = {place.rpartition(" ")[2] for place in places_of(SECRET, tmp_path)}
    assert found == {
        "log.mcap", "table.parquet", "about.parquet", "a.zip", "b0.txt", "b1.txt", "b2.txt", f"at-{SECRET.upper()}"
    }  # fmt: skip


SINGLE = [
    ("info", "DRIVE"),
    ("info", "DRIVE", "--json"),
    ("info", "DRIVE", "--doctor"),
    ("info", "DRIVE", "OTHER", "--as-one"),
    ("estimate", "DRIVE", "-o", "out.mcap", "--metrics", "m.parquet"),
    ("estimate", "DRIVE", "--json"),
    ("predict", "ANNOTATED", "-o", "out.mcap", "--replace"),
    ("run", "DRIVE", "-o", "out.mcap", "--metrics-dir", "metrics"),
    ("run", "DRIVE", "-o", "out.mcap", "--json"),
    ("run", "DRIVE", "OTHER", "BROKEN", "-d", "out", "--tables", "--jobs", "2"),
    ("run", "DRIVE", "-d", "out", "--json"),
    ("evaluate", "ANNOTATED", "--junit", "j.xml", "--markdown", "m.md", "--metrics", "m.csv"),
    ("evaluate", "ANNOTATED", "--gate", "data.faults_count < 1"),
    ("evaluate", "ANNOTATED", "--json", "--metrics", "m.parquet"),
    ("compare", "ANNOTATED", "ANNOTATED", "--markdown", "m.md", "--metrics", "m.parquet"),
    ("compare", "ANNOTATED", "ANNOTATED", "--json"),
    ("report", "ANNOTATED", "-o", "page.html"),
    ("report", "ANNOTATED", "-o", "page.html", "--json"),
    ("export", "ANNOTATED", "-o", "states.csv"),
    ("export", "ANNOTATED", "-o", "states.parquet", "--json"),
    ("export", "ANNOTATED", "-o", "track.gpx", "--format", "gpx"),
    ("export", "ANNOTATED", "-o", "track.kml", "--format", "kml"),
    ("export", "ANNOTATED", "-o", "track.json", "--format", "geojson"),
    ("export", "ANNOTATED", "-o", "ros.mcap", "--format", "ros2"),
    ("plot", "ANNOTATED", "-o", "plot.svg"),
    ("layout", "ANNOTATED", "-o", "layout.json"),
    ("join", "DRIVE", "DRIVE", "-o", "joined.mcap"),
    ("join", "DRIVE", "DRIVE", "-o", "joined.mcap", "--json"),
    ("calibrate", "DRIVE", "OTHER", "-o", "car.toml"),
    ("calibrate", "DRIVE", "OTHER", "--json"),
]  # fmt: skip


@pytest.mark.parametrize("command", SINGLE, ids=" ".join)
def test_no_output_holds_a_secret(search: Search, port: int, command: tuple[str, ...]) -> None:
    words = [secret_url(port, f"/{word.lower()}.mcap") if word.isupper() else word for word in command]
    code, said = search.run(*words)
    assert code == (3 if "BROKEN" in command else 0), said


FAILURES = {
    "/status/401/a.mcap": "the server does not allow it",
    "/status/403/a.mcap": "the server does not allow it",
    "/none.mcap": "there is no such file",
    "/status/410/a.mcap": "there is no such file",
    "/status/408/a.mcap": "try again later",
    "/status/429/a.mcap": "try again later",
    "/status/500/a.mcap": "try again later",
    "/status/503/a.mcap": "try again later",
    "/status/400/a.mcap": "status 400",
    "/broken.mcap": "it is not an MCAP file",
    "/cut/drive.mcap": "the connection broke",
}
"""Path on the server -> what is said of it."""


@pytest.mark.parametrize("path", FAILURES)
def test_a_failing_server_is_told_without_secrets(search: Search, port: int, path: str) -> None:
    code, said = search.run("info", secret_url(port, path))
    assert code == 3
    assert said.startswith(f"error: http://***@127.0.0.1:{port}{path}?***#*** (")
    assert FAILURES[path] in said
    assert ("no such file" in said) == (FAILURES[path] == "there is no such file")
    assert "TMPDIR" not in said


@pytest.fixture
def nobody() -> Iterator[int]:
    """A port where nobody listens."""
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        yield closed.getsockname()[1]


@pytest.mark.parametrize("scheme", ["http", "https"])
def test_a_refused_connection_is_told(search: Search, nobody: int, scheme: str) -> None:
    code, said = search.run("info", secret_url(nobody, "/drive.mcap").replace("http:", f"{scheme}:"))
    assert code == 3
    assert "the server refused the connection" in said
    assert "TMPDIR" not in said


def test_an_unknown_scheme_is_told_without_secrets(search: Search, nobody: int) -> None:
    code, said = search.run("info", secret_url(nobody, "/drive.mcap").replace("http:", "nosuch:"))
    assert code == 2
    assert said.startswith("error: logs can't be read from URLs that begin with 'nosuch://'")


READERS = [
    ("estimate", "URL", "-o", "out.mcap"),
    ("evaluate", "URL", "--json"),
    ("report", "URL", "-o", "page.html"),
    ("export", "URL", "-o", "x.csv"),
    ("compare", "URL", "URL"),
    ("join", "URL", "URL", "-o", "x.mcap"),
    ("calibrate", "URL", "-o", "x.toml"),
    ("plot", "URL", "-o", "x.svg"),
    ("layout", "URL", "-o", "x.json"),
    ("run", "URL", "-o", "x.mcap"),
]


@pytest.mark.parametrize("command", READERS, ids=" ".join)
def test_no_error_of_a_command_holds_a_secret(search: Search, port: int, command: tuple[str, ...]) -> None:
    for path in ("/status/403/a.mcap", "/broken.mcap", "/cut/drive.mcap", "/status/500/"):
        url = secret_url(port, path)
        code, said = search.run(*(url if word == "URL" else word for word in command))
        assert code, said
        assert "error" in said


def test_no_error_of_a_run_over_many_holds_a_secret(search: Search, port: int, nobody: int) -> None:
    urls = [secret_url(port, path) for path in FAILURES] + [secret_url(nobody, "/refused.mcap")]
    code, _ = search.run("run", *urls, "-d", "out", "--jobs", "2")
    assert code == 3
    entries = [json.loads(path.read_text()) for path in sorted(search.folder.glob("out/logs/*/entry.json"))]
    assert len(entries) == len(urls)
    assert {entry["error"]["exit_code"] for entry in entries} == {3}


OPTIONS = [
    ("info", "LOG", "--config", "URL"),
    ("info", "LOG", "--expect", "URL"),
    ("info", "LOG", "--dbc", "URL"),
    ("info", "LOG", "--start", "URL"),
    ("info", "LOG", "--map", "URL"),
    ("info", "LOG", "--topic", "URL"),
    ("info", "LOG", "--topic", "ego_speed=URL"),
    ("info", "LOG", "--max-chunk", "URL"),
    ("estimate", "LOG", "--calibration", "URL", "-o", "x.mcap"),
    ("estimate", "LOG", "-o", "URL"),
    ("estimate", "LOG", "--metrics", "URL"),
    ("run", "LOG", "-d", "URL"),
    ("run", "LOG", "--stage", "URL", "-d", "out"),
    ("run", "LOG", "--gate", "URL", "-d", "out"),
    ("evaluate", "LOG", "--truth", "URL"),
    ("evaluate", "LOG", "--gate", "URL"),
    ("evaluate", "LOG", "--junit", "URL"),
    ("report", "LOG", "-o", "page.html", "--tiles", "URL"),
    ("export", "LOG", "-o", "URL"),
    ("export", "LOG", "--id", "URL"),
    ("simulate", "URL", "-o", "x.mcap"),
    ("config", "URL"),
    ("plot", "LOG", "URL", "-o", "x.svg"),
    ("URL",),
    ("info", "LOG", "--URL"),
    ("reproduce", "URL"),
]


@pytest.mark.parametrize("command", OPTIONS, ids=" ".join)
def test_no_refusal_of_an_option_holds_a_secret(search: Search, port: int, command: tuple[str, ...]) -> None:
    url = secret_url(port, "/none.toml")
    search.run(*(str(SAMPLES / "straight.mcap") if word == "LOG" else word.replace("URL", url) for word in command))


def test_a_traceback_holds_no_secret(search: Search, port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """A bug's traceback prints the texts of all chained exceptions."""

    def fail(url: str) -> list[str]:
        try:
            raise OSError(f"403, url={url}")
        except OSError as error:
            raise RuntimeError(f"no {url.partition('?')[2]}") from error

    monkeypatch.setattr("cwcli.logs.read.source.file_names_below_url", fail)
    code = run_command_line(["info", secret_url(port, "/folder").replace("http:", "s3:")])
    said = "".join(search._capfd.readouterr())
    assert (code, "Traceback" in said) == (70, True)
    assert not holds_word(SECRET, said.encode()), said


def test_a_run_recognises_a_log_whose_signature_is_new(search: Search, port: int) -> None:
    """The same file with another password and another signature is the same log, and is not done again."""
    first = secret_url(port, "/drive.mcap").replace("path=", "X-Amz-Date=")
    arguments = ("-d", "out", "--stage", "estimate", "--json", "--jobs", "1")
    search.run("run", first, *arguments)
    before = (search.folder / "out/logs/drive/entry.json").stat().st_mtime_ns
    second = first.replace("sign&", "another&").replace("word@", "other@").replace("tok&", "fresh&")
    assert second != first
    (again,) = json.loads(search.run("run", second, first, *arguments)[1])["logs"]
    assert (again["id"], again["status"]) == ("drive", "unchanged")
    assert again["source"] == f"http://***@127.0.0.1:{port}/drive.mcap?***#***"
    assert (search.folder / "out/logs/drive/entry.json").stat().st_mtime_ns == before


def test_parameters_that_name_a_file_keep_logs_apart(search: Search, port: int) -> None:
    urls = [f"http://127.0.0.1:{port}/drive.mcap?id={SECRET}{number}&sig=1" for number in (1, 2)]
    arguments = ("-d", "out", "--stage", "estimate", "--json", "--jobs", "1")
    done = json.loads(search.run("run", *urls, *arguments)[1])["logs"]
    assert [each["status"] for each in done] == ["done", "done"]
    again = json.loads(search.run("run", *reversed(urls), *arguments)[1])["logs"]
    assert [(each["id"], each["status"]) for each in again] == [(each["id"], "unchanged") for each in done]
    assert all(re.fullmatch("drive-[0-9a-f]{8}", each["id"]) for each in done)
