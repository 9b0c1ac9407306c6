"""Reads a remote file with a bound on the time in which nothing comes, whatever it waits for.

A host's name that is not found, a server that accepts and says nothing, a header or a file that comes byte by byte:
the library that reads the store may wait for each without end. So it reads in a thread, which is left behind where
fewer than `MIN_BYTES_PER_TIMEOUT` bytes come within the time.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Iterator
from contextlib import suppress

from cwcli.errors import InputError
from cwcli.url import display_name_of_url

MIN_BYTES_PER_TIMEOUT = 1000
"""A server that sends fewer bytes within the time counts as stalled. Chosen by hand: a modem sends that each second."""
MAX_BLOCKS_AHEAD = 4
"""Number of blocks that are read ahead of their use. Chosen by hand: at most 16 MiB."""
MAX_QUEUE_WAIT_BETWEEN_STOP_CHECKS_S = 0.5
"""The time in seconds after which a thread looks whether it is still wanted. Chosen by hand."""

BlockOrErrorOrEnd = bytes | BaseException | None
"""A block, the error that ended the reading, or its end."""


def iter_blocks_or_raise_on_stall(blocks: Iterator[bytes], url: str, timeout_s: float) -> Iterator[bytes]:
    """Yield the blocks of a remote file.

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
