"""Logs that are not on this machine: what their URLs stand for, and their bytes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from cwcli.errors import UsageError, install_hint
from cwcli.logs.read.remote_errors import unreadable
from cwcli.url import name_url, redact_urls

FILE_SCHEME = "file://"
MAX_SCHEME_CHARS = 40
"""Of an unknown scheme that are shown."""
COPY_BYTES = 4 << 20
SCHEMES = ("https", "http", "s3", "gs", "az", "abfs")
ALIASES = ("s3a", "gcs", "abfss", "adl", "memory")
"""Schemes of URLs that are read, and other names of the same stores; `memory` is for tests. fsspec knows many more,
which run other programs, hold files in files, or need options that a URL does not carry: each fails in its own way."""


def is_remote(source: str) -> bool:
    """Whether a name is a URL of something that is not a file on this machine."""
    return "://" in source and not source.startswith(FILE_SCHEME)


def names_below(url: str) -> list[str]:
    """The names of the files right below a URL; none where it is no folder.

    Raises:
        InputError: The store does not answer, or knows no such bucket.
        UsageError: It needs a package that is not installed.
    """
    system, path = file_system(url)
    try:
        if not url.endswith("/") and system.isfile(path):
            return []
        found = system.ls(path.rstrip("/"), detail=True)
    except NotADirectoryError:
        return []
    except Exception as error:  # each store has its own errors
        raise unreadable(url, error) from error
    return [str(each["name"]).rpartition("/")[2] for each in found if each.get("type") == "file"]


def blocks(url: str) -> Iterator[bytes]:
    """The bytes of a remote file, piece by piece.

    Raises:
        InputError: It can't be read.
        UsageError: It needs a package that is not installed.
    """
    system, path = file_system(url)
    try:
        with system.open(path, "rb") as remote:
            while block := remote.read(COPY_BYTES):
                yield block
    except GeneratorExit:
        raise
    except Exception as error:  # each store has its own errors
        raise unreadable(url, error) from error


def file_system(url: str) -> tuple[Any, str]:
    """The store of a URL, and what it calls the file.

    Raises:
        InputError: The store does not answer.
        UsageError: Its scheme is not read, it is no URL, or it needs a package that is not installed.
    """
    scheme = url.partition("://")[0]
    if scheme not in (*SCHEMES, *ALIASES):
        known = ", ".join(f"{each}://" for each in SCHEMES)
        raise UsageError(
            f"logs can't be read from URLs that begin with '{scheme[:MAX_SCHEME_CHARS]}://'",
            hint=f"copy the log to this machine, or to one of {known}",
        )
    try:
        from fsspec.core import url_to_fs
    except ImportError as error:
        raise UsageError(
            "remote logs need a package that is not installed", where=name_url(url), hint=install_hint("remote")
        ) from error
    try:
        system, path = url_to_fs(url)
    except (ImportError, ValueError) as error:  # the store's own package is missing, or it can't make sense of the URL
        raise UsageError(
            redact_urls(next(iter(str(error).splitlines()), type(error).__name__), url),
            where=name_url(url),
            hint=f"{install_hint('remote')} reads s3://",
        ) from error
    except Exception as error:  # some stores connect at once
        raise unreadable(url, error) from error
    return system, str(path)
