"""Which URLs are read, and that all others are one line with exit code 2."""

from __future__ import annotations

from pathlib import Path

import fsspec
import pytest

from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_BAD_INPUT, EXIT_USAGE, InputError, UsageError
from cwcli.logs.read.remote import URL_SCHEME_ALIASES, URL_SCHEMES, file_system_and_path
from cwcli.logs.read.remote_errors import unreadable_url_error

OTHERS = sorted(
    {each for each in fsspec.available_protocols() if each not in (*URL_SCHEMES, *URL_SCHEME_ALIASES, "file", "local")}
)


@pytest.mark.parametrize("scheme", [*OTHERS, "local", "simplecache::s3", "nosuch", "HTTPS", "a b"])
def test_an_unknown_scheme_is_one_line(scheme: str, capsys: pytest.CaptureFixture[str]) -> None:
    """fsspec knows some forty: `github` and `jupyter` raise what they like, `zip` and `reference` open other files."""
    assert run_command_line(["info", f"{scheme}://host/drive.mcap"]) == EXIT_USAGE
    printed = capsys.readouterr().err.splitlines()
    assert printed[0] == f"error: logs can't be read from URLs that begin with '{scheme}://'"
    assert [
        line.startswith("  hint:  copy the log to this machine, or to one of https://") for line in printed[1:]
    ] == [True]


def test_many_logs_of_an_unknown_scheme_are_refused_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["run", "github://org/drives/*.mcap", "-d", str(tmp_path / "out")]) == EXIT_USAGE
    assert "URLs that begin with 'github://'" in capsys.readouterr().err


def test_a_user_name_that_is_no_utf_8_is_hidden(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["info", "https://us\udcffer:pw@127.0.0.1:1/x"]) == EXIT_BAD_INPUT
    assert capsys.readouterr().err.startswith("error: https://***@127.0.0.1:1/x: it can't be read: ")


def test_whatever_a_store_raises_is_a_known_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(url: str) -> None:
        raise KeyError(url)

    monkeypatch.setattr("fsspec.core.url_to_fs", fails)
    with pytest.raises(InputError, match=r"it can.t be read"):
        file_system_and_path("https://host/drive.mcap")


def test_a_store_that_repeats_a_token_of_the_environment_is_told_without_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AWS_SESSION_TOKEN", "pl4nt3d/pl4nt3d+")
    monkeypatch.setenv("CWCLI_TEST_KEY", "the")  # too short for a secret
    said = str(unreadable_url_error("s3://bucket/drive.mcap", OSError("the token 'pl4nt3d/pl4nt3d+' is not known")))
    assert said == "s3://bucket/drive.mcap: it can't be read: the token '***' is not known"


@pytest.mark.parametrize(
    ("variables", "words", "shown"),
    [
        ({"A_TOKEN": "abcdefgh", "B_TOKEN": "abcdefgh12345"}, "no abcdefgh12345, abcdefgh", "no ***, ***"),
        ({"A_TOKEN": "user-abcdefgh"}, "no user-abcdefgh of user", "no *** of ***"),  # the URL's user begins it, too
        (
            {"GOOGLE_APPLICATION_CREDENTIALS": "/home/u/key.json", "AWS_WEB_IDENTITY_TOKEN_FILE": "/run/token"},
            "File /home/u/key.json was not found, nor /run/token",
            "File /home/u/key.json was not found, nor /run/token",
        ),
        (
            {"SIGNING_KEY": "-----BEGIN KEY-----\nMIIEvQIB\nADANBgkq\n-----END KEY-----\n"},
            "not a key: -----BEGIN KEY-----\nMIIEvQIB\nADANBgkq\n-----END KEY-----\n.",
            "not a key: *** .",
        ),
        (
            {"AZURE_STORAGE_CONNECTION_STRING": "AccountName=drives;AccountKey=c2VjcmV0LWtleQ==;EndpointSuffix=x.net"},
            "drives: c2VjcmV0LWtleQ== in AccountName=drives;AccountKey=c2VjcmV0LWtleQ==;EndpointSuffix=x.net",
            "drives: *** in ***",
        ),
        (
            {"AZURE_STORAGE_CONNECTION_STRING": "SharedAccessSignature=sv=2022&sig=ab%2Bcd"},
            "no sv=2022&sig=ab%2Bcd",
            "no ***",
        ),
        (
            {"AZURE_STORAGE_SAS_TOKEN": "?sv=2022&sig=abcd%2Befgh"},
            "no sig=abcd%2Befgh, no abcd+efgh",
            "no sig=***, no ***",
        ),
        ({"A_TOKEN": "password"}, "no password1234", "no ***"),  # it begins the password of the URL
        ({}, "a" * 301, "a" * 300),
    ],
    ids=[
        "longest first",
        "longer than the user",
        "files",
        "lines",
        "account key",
        "signature",
        "parts of a signature",
        "shorter than the password",
        "long words",
    ],
)
def test_secrets_of_the_environment_are_hidden_whole(
    monkeypatch: pytest.MonkeyPatch, variables: dict[str, str], words: str, shown: str
) -> None:
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    said = str(unreadable_url_error("s3://user:password1234@bucket/drive.mcap", OSError(words)))
    assert said == f"s3://***@bucket/drive.mcap: it can't be read: {shown}"


def test_long_words_are_understood_before_they_are_cut() -> None:
    path = "bucket/" + "folder/" * 40 + "d" * 60 + ".mcap"
    missing = unreadable_url_error(f"s3://{path}", FileNotFoundError(path))
    assert missing.what == "it can't be read: there is no such file"
    no_bucket = FileNotFoundError(path)
    no_bucket.__cause__ = OSError("x" * 290 + " The specified bucket does not exist")
    found = unreadable_url_error(f"s3://{path}", no_bucket)
    assert found.what == f"it can't be read: there is no such file ({'x' * 290} The speci)"


def test_what_a_store_says_of_a_url_that_it_cannot_use_hides_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(url: str) -> None:
        raise ValueError("account key c2VjcmV0LWtleQ== is no base64")

    monkeypatch.setenv("AZURE_STORAGE_CONNECTION_STRING", "AccountName=drives;AccountKey=c2VjcmV0LWtleQ==")
    monkeypatch.setattr("fsspec.core.url_to_fs", fails)
    with pytest.raises(UsageError, match=r"account key \*\*\* is no base64"):
        file_system_and_path("az://box/drive.mcap")
