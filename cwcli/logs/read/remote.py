"""Reads logs that are not on this machine, by their URLs."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

from cwcli.errors import CwcliError, InputError, UsageError, install_hint
from cwcli.logs.read.read_bounds import DEFAULT_READ_BOUNDS, ReadBounds
from cwcli.logs.read.remote_errors import MAX_SHOWN_CHARS_OF_ERROR, unreadable_url_error, words_without_secrets
from cwcli.url import display_name_of_url

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
MIN_BYTES_PER_TIMEOUT = 1000
"""A server that sends fewer bytes within the time counts as stalled. Chosen by hand: a modem sends that each second."""
MAX_BLOCKS_AHEAD = 4
"""Number of blocks that are read ahead of their use. Chosen by hand: at most 16 MiB."""
MAX_QUEUE_WAIT_BETWEEN_STOP_CHECKS_S = 0.5
"""The time in seconds after which a thread looks whether it is still wanted. Chosen by hand."""
BlockOrErrorOrEnd = bytes | BaseException | None
"""A block, the error that ended the reading, or its end."""


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
        first_line = next(iter(str(error).splitlines()), type(error).__name__)
        raise UsageError(
            words_without_secrets(first_line, url)[:MAX_SHOWN_CHARS_OF_ERROR],
            where=display_name_of_url(url),
            hint=f"{install_hint('remote')} reads s3://",
        ) from error
    except Exception as error:  # some stores connect at once
        raise unreadable_url_error(url, error) from error
    return system, str(path)


def iter_blocks_or_raise_on_stall(blocks: Iterator[bytes], url: str, timeout_s: float) -> Iterator[bytes]:
    """Yield the blocks of a remote file, with a bound on the time in which nothing comes, whatever it waits for.

    A host's name that is not found, a server that accepts and says nothing, a header or a file that comes byte by byte:
    the library that reads the store may wait for each without end. So it reads in a thread, which is left behind where
    fewer than `MIN_BYTES_PER_TIMEOUT` bytes come within the time.

    Args:
        blocks: They are read in a thread.
        timeout_s: Longest time in seconds until the first block, and in which `MIN_BYTES_PER_TIMEOUT` bytes must come.

    Raises:
        InputError: It stalls.
    """
    items: queue.Queue[BlockOrErrorOrEnd] = queue.Queue(MAX_BLOCKS_AHEAD)
    is_left = threading.Event()
    threading.Thread(target=_put_blocks_into_queue, args=(blocks, items, is_left), daemon=True).start()
    try:
        deadline_s, n_bytes = time.monotonic() + timeout_s, 0
        while True:
            try:
                item = items.get(timeout=max(deadline_s - time.monotonic(), 0))
            except queue.Empty:
                what = (
                    f"it can't be read: the server did not send {MIN_BYTES_PER_TIMEOUT:,} bytes within {timeout_s:g} s"
                )
                raise InputError(
                    what, where=display_name_of_url(url), hint="try again later, or wait longer with --timeout"
                ) from None
            if item is None:
                return
            if isinstance(item, BaseException):
                raise item
            n_bytes += len(item)
            yield item
            if n_bytes >= MIN_BYTES_PER_TIMEOUT:
                deadline_s, n_bytes = time.monotonic() + timeout_s, 0
    finally:
        is_left.set()


def _put_blocks_into_queue(
    blocks: Iterator[bytes], items: queue.Queue[BlockOrErrorOrEnd], is_left: threading.Event
) -> None:
    """Put the blocks into a queue, until they end or nobody wants them."""

    def put_unless_left(item: BlockOrErrorOrEnd) -> None:
        while not is_left.is_set():
            with suppress(queue.Full):
                items.put(item, timeout=MAX_QUEUE_WAIT_BETWEEN_STOP_CHECKS_S)
                return

    try:
        for block in blocks:
            put_unless_left(block)
            if is_left.is_set():
                return
        put_unless_left(None)
    except BaseException as error:
        put_unless_left(error)
    finally:
        close = getattr(blocks, "close", None)
        if close is not None:
            with suppress(Exception):
                close()
