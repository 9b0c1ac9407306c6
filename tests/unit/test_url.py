"""What of a URL is shown, and by what name a log with a URL is known."""

from __future__ import annotations

import pytest

from cwcli.errors import InputError
from cwcli.url import display_name_of_url, redact_url, redact_urls


@pytest.mark.parametrize(
    ("url", "shown"),
    [
        ("drive.mcap", "drive.mcap"),
        ("s3://bucket/drives/*.mcap", "s3://bucket/drives/*.mcap"),
        ("s3://bucket/drive-?.mcap", "s3://bucket/drive-?.mcap"),
        ("s3://key:word@bucket/drive.mcap?versionId=7", "s3://***@bucket/drive.mcap?***"),
        ("https://host:8443/drive.mcap", "https://host:8443/drive.mcap"),
        ("https://host/a@b/drive.mcap", "https://host/a@b/drive.mcap"),
        ("http://[::1]:80/a@b.mcap", "http://[::1]:80/a@b.mcap"),
        ("HTTPS://user:pass@host/drive.mcap#part", "HTTPS://***@host/drive.mcap#***"),
        ("https://token@host/drive.mcap?", "https://***@host/drive.mcap?***"),
        ("https://host/drive.mcap?c2VjcmV0==", "https://host/drive.mcap?***"),
        ("https://user:pa/ss@host/drive.mcap", "https://***@host/drive.mcap"),
        ("https://user:pa?ss#1@host/drive.mcap?sig=2", "https://***@host/drive.mcap?***"),
        ("https://user:p@ss@host/drive.mcap", "https://***@host/drive.mcap"),
        (
            "abfs://container@account.dfs.core.windows.net/a.mcap",
            "abfs://container@account.dfs.core.windows.net/a.mcap",
        ),
        ("abfs://name:key@account/a.mcap", "abfs://***@account/a.mcap"),
        ("simplecache::https://u:p@host/a.mcap?t=1", "simplecache::https://***@host/a.mcap?***"),
        ("zip://in.mcap::https://u:p@host/a.zip?t=1", "zip://in.mcap::https://***@host/a.zip?***"),
        ("https://host/?from=https://u:p@other/x", "https://host/?***"),
        ("a://" * 15_000 + "u:p@host/x", "a://" * 15_000 + "***@host/x"),
    ],
)
def test_a_url_is_shown_without_its_secrets(url: str, shown: str) -> None:
    assert redact_url(url) == shown
    assert redact_url(shown) == shown


def test_words_of_others_lose_the_secrets_of_their_urls() -> None:
    url = "https://u:p%40ss@host/a.mcap?X-Amz-Signature=ab%2Fcd&sig=e+f"
    words = f"403, url='{url}' (https://other/x?token=1), next: p@ss, ab/cd, 'e f', ab%2Fcd."
    expected = "403, url='https://***@host/a.mcap?***' (https://other/x?***), next: ***, ***, '***', ***."
    assert redact_urls(words, url) == expected
    # as a header carries them: RFC 7617, section 2
    assert redact_urls("QWxhZGRpbjpvcGVuIHNlc2FtZQ==", "https://Aladdin:open%20sesame@host/x") == "***=="
    assert redact_urls("no URL: a?b=c#d e@f", "drive.mcap") == "no URL: a?b=c#d e@f"
    # a byte of the command line that is no UTF-8: base64 of 75 73 FF 65 72 3A 70 77
    assert redact_urls("dXP/ZXI6cHc= us\udcffer", "https://us\udcffer:pw@host/x") == "***= ***"


def test_two_signatures_of_one_file_are_one_name() -> None:
    names = {
        display_name_of_url(
            f"https://{user}@host/drive.mcap?X-Amz-Signature={secret}&X-Amz-Date={secret}&Expires={secret}"
        )
        for user, secret in (("a:b", "1"), ("c:d", "2"))
    }
    assert names == {"https://***@host/drive.mcap?***"}
    shared = "https://account.blob.core.windows.net/drives/a.mcap?sv=2022&se={0}&sr=b&sp=r&sig={0}"
    assert display_name_of_url(shared.format(1)) == display_name_of_url(shared.format(2))
    assert display_name_of_url("drive.mcap") == "drive.mcap"


def test_parameters_that_name_the_file_keep_names_apart() -> None:
    first, again, second = (
        display_name_of_url(f"https://host/download?id={number}&token={token}")
        for number, token in ((7, 1), (7, 2), (8, 1))
    )
    assert first == again != second
    assert first.startswith("https://host/download?*** (")
    assert redact_url(first) == first
    assert "7" not in first.partition("(")[0]


def test_errors_show_no_secret_and_keep_the_place_behind_a_url() -> None:
    error = InputError(
        "403 for https://u:p@host/x?sig=1", where="https://u:p@host/x?sig=1: /gps/fix at 3 s",
        found=("https://u:p@host/y",), hint="try https://u:p@host/",
    )  # fmt: skip
    assert str(error) == "https://***@host/x?***: /gps/fix at 3 s: 403 for https://***@host/x?***"
    assert (error.found, error.hint) == (("https://***@host/y",), "try https://***@host/")
