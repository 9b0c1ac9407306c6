"""Reads logs that are not on this machine, by their URLs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from cwcli.errors import CwcliError, UsageError, install_hint
from cwcli.logs.read.read_bounds import DEFAULT_READ_BOUNDS, ReadBounds
from cwcli.logs.read.remote_errors import unreadable_url_error
from cwcli.logs.read.stalls import iter_blocks_or_raise_on_stall
from cwcli.url import display_name_of_url, redact_urls

FILE_SCHEME = "file://"
"""The scheme of URLs of files on this machine."""
MAX_SHOWN_SCHEME_CHARS = 40
"""The number of characters of an unknown scheme that an error shows. Chosen by hand."""
COPY_BLOCK_BYTES = 4 << 20
"""Bytes that are read at a time. Chosen by hand."""
WEB_PREFIXES = ("https://", "http://")
"""The beginnings of URLs that are read without fsspec."""
URL_SCHEMES = ("https", "http", "s3", "gs", "az", "abfs")
"""The schemes of the URLs from which logs can be read: web servers and the stores of fsspec's packages."""
URL_SCHEME_ALIASES = ("s3a", "gcs", "abfss", "adl", "memory")
"""Further names of the same stores; `memory` is for tests. Other schemes of fsspec run programs, read archives, or need
options that a URL can't give."""


def is_remote_url(source: str) -> bool:
    """Tell whether a name is a URL of something that is not a file on this machine."""
    return "://" in source and not source.startswith(FILE_SCHEME)


def file_names_below_url(url: str) -> list[str]:
    """Return the names of the files directly below a URL; empty if it is not a folder.

    Raises:
        InputError: The store does not answer, or knows no such bucket.
        UsageError: It needs a package that is not installed.
    """
    system, path = file_system_and_path(url)
    try:
        if not url.endswith("/") and system.isfile(path):
            return []
        found = system.ls(path.rstrip("/"), detail=True)
    except NotADirectoryError:
        return []
    except Exception as error:  # each store has its own errors
        raise unreadable_url_error(url, error) from error
    return [str(each["name"]).rpartition("/")[2] for each in found if each.get("type") == "file"]


def iter_remote_blocks(url: str, bounds: ReadBounds = DEFAULT_READ_BOUNDS) -> Iterator[bytes]:
    """Yield the bytes of a remote file in blocks.

    Raises:
        InputError: It can't be read, or stalls.
        UsageError: It needs a package that is not installed.
    """
    if url.startswith(WEB_PREFIXES):
        from cwcli.logs.read.http_blocks import iter_http_blocks

        blocks = iter_http_blocks(url, bounds)
    else:
        blocks = _iter_store_blocks(*file_system_and_path(url))
    try:
        yield from iter_blocks_or_raise_on_stall(blocks, url, bounds.timeout_s)
    except (GeneratorExit, CwcliError):
        raise
    except Exception as error:  # each store has its own errors
        raise unreadable_url_error(url, error) from error


def _iter_store_blocks(system: Any, path: str) -> Iterator[bytes]:
    """Yield the bytes of a file in a store of fsspec."""
    with system.open(path, "rb") as remote:
        while block := remote.read(COPY_BLOCK_BYTES):
            yield block


def file_system_and_path(url: str) -> tuple[Any, str]:
    """Return the file system of a URL (of fsspec), and the path of the file in it.

    Raises:
        InputError: The store does not answer.
        UsageError: Its scheme is not read, it is no URL, or it needs a package that is not installed.
    """
    scheme = url.partition("://")[0]
    if scheme not in (*URL_SCHEMES, *URL_SCHEME_ALIASES):
        known = ", ".join(f"{each}://" for each in URL_SCHEMES)
        raise UsageError(
            f"logs can't be read from URLs that begin with '{scheme[:MAX_SHOWN_SCHEME_CHARS]}://'",
            hint=f"copy the log to this machine, or to one of {known}",
        )
    try:
        from fsspec.core import url_to_fs
    except ImportError as error:
        raise UsageError(
            "remote logs need a package that is not installed",
            where=display_name_of_url(url),
            hint=install_hint("remote"),
        ) from error
    try:
        system, path = url_to_fs(url)
    except (ImportError, ValueError) as error:  # the store's own package is missing, or it can't make sense of the URL
        raise UsageError(
            redact_urls(next(iter(str(error).splitlines()), type(error).__name__), url),
            where=display_name_of_url(url),
            hint=f"{install_hint('remote')} reads s3://",
        ) from error
    except Exception as error:  # some stores connect at once
        raise unreadable_url_error(url, error) from error
    return system, str(path)
