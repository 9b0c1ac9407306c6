"""An open output: a file descriptor with a buffer, whose errors are reported in plain words."""

from __future__ import annotations

import errno
import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from threading import Thread

from cwcli.errors import InputError, OutputError

WRITE_BUFFER_BYTES = 1 << 20
"""Number of bytes that are collected before they are written, 1 MiB; chosen by hand."""
BYTES_BETWEEN_BACKGROUND_SYNCS = 16 << 20
"""Number of bytes after which the disk is asked to store them in the background, 16 MiB; chosen by hand."""
MIN_BYTES_FOR_THREAD = 1 << 18
"""Fewest bytes that are handed to the thread, 256 KiB: less is written before a thread takes over. Chosen by hand."""
MAX_QUEUED_TASKS = 64
"""Greatest number of writes and copies that wait for the thread: with full buffers 64 MiB of data; chosen by hand."""

ERROR_TEXT_BY_ERRNO = {
    errno.ENOSPC: "no space is left on the disk",
    errno.EDQUOT: "the disk quota is used up",
    errno.EFBIG: "the file would be larger than is allowed",
    errno.EACCES: "permission denied",
    errno.EROFS: "the disk is read-only",
    errno.ENAMETOOLONG: "the file name is too long",
}
"""Error number of the operating system -> the words for it in messages."""

KERNEL_COPY_REFUSAL_ERRNOS = (errno.EXDEV, errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP, errno.EBADF, errno.EPERM)
"""Error numbers with which the kernel refuses to copy between files; the data is then copied through memory."""

Bytes = bytes | bytearray | memoryview


class OutputStream:
    """An open target. Errors of the medium become `OutputError`; a closed pipe stays a `BrokenPipeError`.

    Args:
        name: Name of the target in messages.
        works_aside: Write and copy in a thread while the next data is computed. A later call raises its errors, and
            `wait_until_idle` must be called in the end.

    Attributes:
        name: Name of the target in messages.
        position: Bytes written so far.
    """

    def __init__(self, descriptor: int, name: str, *, works_aside: bool = False) -> None:
        self._descriptor = descriptor
        self._pending = bytearray()
        self.name = name
        self.position = 0
        self._copies_in_kernel = hasattr(os, "copy_file_range")
        self._writeback: _BackgroundSync | None = None
        self._aside = ThreadPoolExecutor(1, thread_name_prefix="output") if works_aside else None
        self._waiting: deque[Future[None]] = deque()

    def write(self, data: Bytes) -> int:
        """Append the data; returns its length in bytes."""
        view = memoryview(data).cast("B")
        if len(view) + len(self._pending) < WRITE_BUFFER_BYTES:
            self._pending += view
        else:
            self.flush()
            self._write_unbuffered(view)
        self.position += len(view)
        return len(view)

    def tell(self) -> int:
        """Return how many bytes were written; a library that writes to a file asks for it."""
        return self.position

    def copy_from_file(self, source: int, start: int, length: int) -> None:
        """Append `length` bytes of an open file from `start`, inside the kernel where it can.

        Args:
            source: File descriptor; must stay open until `flush` or `sync`.
            start, length: In bytes.

        Raises:
            InputError: The source ends early or can't be read.
        """
        self._write_buffer()
        self.position += length
        self._run_task_now_or_in_background(length, lambda: self._copy_bytes_from_file_now(source, start, length))

    def flush(self) -> None:
        """Hand everything to the operating system."""
        self._write_buffer()
        while self._waiting:
            self._waiting.popleft().result()

    def _write_buffer(self) -> None:
        """Write the buffered bytes, or queue them for the thread."""
        pending, self._pending = self._pending, bytearray()
        if pending:
            self._run_task_now_or_in_background(len(pending), lambda: self._write_unbuffered(memoryview(pending)))

    def _run_task_now_or_in_background(self, n_bytes: int, task: Callable[[], None]) -> None:
        """Queue a task for the thread; run a short one at once if nothing waits."""
        while self._waiting and (self._waiting[0].done() or len(self._waiting) > MAX_QUEUED_TASKS):
            self._waiting.popleft().result()
        if self._aside is None or (n_bytes < MIN_BYTES_FOR_THREAD and not self._waiting):
            task()
        else:
            self._waiting.append(self._aside.submit(task))

    def _copy_bytes_from_file_now(self, source: int, start: int, length: int) -> None:
        """Copy a range of the source, part by part."""
        end = start + length
        while start < end:
            n = self._copy_some_bytes_and_count_them(source, start, end - start)
            if n == 0:
                raise InputError("the input became shorter while it was copied")
            start += n

    def _copy_some_bytes_and_count_them(self, source: int, start: int, length: int) -> int:
        """Copy up to `length` bytes, and return how many were copied."""
        if self._copies_in_kernel:
            try:
                n = os.copy_file_range(source, self._descriptor, length, start)
                self._report_written_bytes_to_sync(n)
                return n
            except OSError as error:
                if error.errno not in KERNEL_COPY_REFUSAL_ERRNOS:
                    raise OutputError(os_error_text(error), where=self.name) from error
                self._copies_in_kernel = False
        try:
            data = os.pread(source, min(WRITE_BUFFER_BYTES, length), start)
        except OSError as error:
            raise InputError(f"the input can't be read: {error.strerror}") from error
        self._write_unbuffered(memoryview(data))
        return len(data)

    def _write_unbuffered(self, view: memoryview) -> None:
        """Write all bytes to the descriptor, past the buffer."""
        while view:
            with translate_os_errors(self.name):
                n = os.write(self._descriptor, view)
            self._report_written_bytes_to_sync(n)
            view = view[n:]

    def _report_written_bytes_to_sync(self, n: int) -> None:
        """Tell the background sync how many bytes were written."""
        if self._writeback is not None:
            with translate_os_errors(self.name):
                self._writeback.note_written_bytes(n)

    def sync_in_background(self) -> None:
        """Start storing written data on the disk in the background, which leaves `sync` little to wait for."""
        self._writeback = _BackgroundSync(self._descriptor)

    def wait_until_idle(self) -> None:
        """Wait until nothing uses the descriptor any more."""
        if self._aside is not None:
            self._aside.shutdown(cancel_futures=True)
        if self._writeback is not None:
            with suppress(OSError):
                self._writeback.wait_for_thread()

    def sync(self) -> None:
        """Flush, and wait until the data is on the disk."""
        self.flush()
        with translate_os_errors(self.name):
            if self._writeback is not None:
                self._writeback.wait_for_thread()
            os.fsync(self._descriptor)


class _BackgroundSync:
    """Stores a growing file on the disk in a thread, a part at a time."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._waiting_bytes = 0
        self._thread: Thread | None = None
        self._error: OSError | None = None

    def note_written_bytes(self, n: int) -> None:
        """Note that n more bytes were written.

        Raises:
            OSError: An earlier part could not be stored.
        """
        self._waiting_bytes += n
        if self._waiting_bytes < BYTES_BETWEEN_BACKGROUND_SYNCS or (
            self._thread is not None and self._thread.is_alive()
        ):
            return
        self.wait_for_thread()
        self._waiting_bytes = 0
        self._thread = Thread(target=self._sync_parts, daemon=True)
        self._thread.start()

    def wait_for_thread(self) -> None:
        """Wait for the thread.

        Raises:
            OSError: A part could not be stored.
        """
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        if self._error is not None:
            raise self._error

    def _sync_parts(self) -> None:
        """Store the file on the disk, and keep the error for the next call."""
        try:
            os.fsync(self._descriptor)
        except OSError as error:
            self._error = error


@contextmanager
def translate_os_errors(name: str) -> Iterator[None]:
    """Raise errors of the operating system, other than a closed pipe, as `OutputError`."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        raise OutputError(os_error_text(error), where=name) from error


def os_error_text(error: OSError) -> str:
    """Return the words for an error of the operating system."""
    return ERROR_TEXT_BY_ERRNO.get(error.errno or 0, error.strerror or str(error))
