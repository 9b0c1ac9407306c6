"""Where results go: a file that appears whole or not at all, or standard output.

A file is written under a hidden temporary name in the target's folder, flushed to the disk and renamed. A killed run
leaves at most that temporary file, never one under the target's name. Devices and named pipes are written directly.
"""

from __future__ import annotations

import errno
import os
import secrets
import stat
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Thread

from cwcli.errors import InputError, OutputError, UsageError

STDOUT = "-"
BUFFER_BYTES = 1 << 20
WRITEBACK_BYTES = 16 << 20
MAX_NAME_IN_TEMPORARY = 200

REASONS = {
    errno.ENOSPC: "no space is left on the disk",
    errno.EDQUOT: "the disk quota is used up",
    errno.EFBIG: "the file would be larger than is allowed",
    errno.EACCES: "permission denied",
    errno.EROFS: "the disk is read-only",
    errno.ENAMETOOLONG: "the file name is too long",
}

NOT_IN_KERNEL = (errno.EXDEV, errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP, errno.EBADF, errno.EPERM)
"""Another kind of file or file system: copy through memory instead."""

Bytes = bytes | bytearray | memoryview


class Output:
    """An open target. Errors of the medium become `OutputError`; a closed pipe stays a `BrokenPipeError`.

    Attributes:
        name: For messages.
        position: Bytes written so far.
    """

    def __init__(self, descriptor: int, name: str) -> None:
        self._descriptor = descriptor
        self._pending = bytearray()
        self.name = name
        self.position = 0
        self._copies_in_kernel = hasattr(os, "copy_file_range")
        self._writeback: _Writeback | None = None

    def write(self, data: Bytes) -> int:
        """Append the data; returns its length in bytes."""
        view = memoryview(data).cast("B")
        if len(view) + len(self._pending) < BUFFER_BYTES:
            self._pending += view
        else:
            self.flush()
            self._write_through(view)
        self.position += len(view)
        return len(view)

    def copy(self, source: int, start: int, length: int) -> None:
        """Append `length` bytes of an open file from `start`, inside the kernel where it can.

        Args:
            source: File descriptor.
            start, length: In bytes.

        Raises:
            InputError: The source ends early or can't be read.
        """
        self.flush()
        self.position += length
        end = start + length
        while start < end:
            n = self._copy_some(source, start, end - start)
            if n == 0:
                raise InputError("the input became shorter while it was copied")
            start += n

    def _copy_some(self, source: int, start: int, length: int) -> int:
        """Copy some bytes; returns how many."""
        if self._copies_in_kernel:
            try:
                n = os.copy_file_range(source, self._descriptor, length, start)
                self._moved(n)
                return n
            except OSError as error:
                if error.errno not in NOT_IN_KERNEL:
                    raise OutputError(_reason(error), where=self.name) from error
                self._copies_in_kernel = False
        try:
            data = os.pread(source, min(BUFFER_BYTES, length), start)
        except OSError as error:
            raise InputError(f"the input can't be read: {error.strerror}") from error
        self._write_through(memoryview(data))
        return len(data)

    def flush(self) -> None:
        """Hand everything to the operating system."""
        pending, self._pending = self._pending, bytearray()
        self._write_through(memoryview(pending))

    def _write_through(self, view: memoryview) -> None:
        while view:
            with _medium(self.name):
                n = os.write(self._descriptor, view)
            self._moved(n)
            view = view[n:]

    def _moved(self, n: int) -> None:
        if self._writeback is not None:
            with _medium(self.name):
                self._writeback.advance(n)

    def sync_in_background(self) -> None:
        """Let the disk work while the rest is computed, so that `sync` has little left to wait for."""
        self._writeback = _Writeback(self._descriptor)

    def settle(self) -> None:
        """Wait until nothing uses the descriptor any more."""
        if self._writeback is not None:
            with suppress(OSError):
                self._writeback.finish()

    def sync(self) -> None:
        """Flush, and wait until the data is on the disk."""
        self.flush()
        with _medium(self.name):
            if self._writeback is not None:
                self._writeback.finish()
            os.fsync(self._descriptor)


class _Writeback:
    """Hands a growing file to the disk, a part at a time, in a thread."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._waiting_bytes = 0
        self._thread: Thread | None = None
        self._error: OSError | None = None

    def advance(self, n: int) -> None:
        """Note that n more bytes were written.

        Raises:
            OSError: An earlier part could not be stored.
        """
        self._waiting_bytes += n
        if self._waiting_bytes < WRITEBACK_BYTES or (self._thread is not None and self._thread.is_alive()):
            return
        self.finish()
        self._waiting_bytes = 0
        self._thread = Thread(target=self._store, daemon=True)
        self._thread.start()

    def finish(self) -> None:
        """Wait for the thread.

        Raises:
            OSError: A part could not be stored.
        """
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        if self._error is not None:
            raise self._error

    def _store(self) -> None:
        try:
            os.fsync(self._descriptor)
        except OSError as error:
            self._error = error


def check_target(target: str | Path, *, force: bool = False, inputs: Sequence[Path] = ()) -> None:
    """Refuse a target that can't or must not be written, before any work is done.

    Args:
        target: File name, or `-` for standard output.
        force: Allow a file that exists.
        inputs: Files that are read meanwhile: never overwritten, under whatever name.

    Raises:
        OutputError: It is a directory, exists, is an input, or its folder is missing or not writable.
        UsageError: Standard output is a terminal.
    """
    if str(target) == STDOUT:
        _stdout_descriptor()
        return
    name = str(target)
    try:
        with _medium(name):
            _check_file(_real_path(target), name, force, inputs)
    except ValueError as error:  # a zero byte in the name
        raise OutputError(str(error), where=name) from error


def _check_file(path: Path, name: str, force: bool, inputs: Sequence[Path]) -> None:
    for each in inputs:
        if path.exists() and each.exists() and path.samefile(each):
            raise OutputError("the output is the input itself", where=name, hint="name another file with -o")
    if path.is_dir() or name.endswith(os.sep):
        raise OutputError("the output is a directory", where=name, hint="name a file with -o")
    if _is_special(path):
        return
    if not path.parent.is_dir():
        raise OutputError(f"the folder {Path(name).parent} does not exist", where=name, hint="create it first")
    if path.exists() and not force:
        raise OutputError("the file exists", where=name, hint="name another file, or overwrite it with --force")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise OutputError(f"the folder {Path(name).parent} is not writable", where=name)


@contextmanager
def open_output(
    target: str | Path, *, force: bool = False, inputs: Sequence[Path] = (), durable: bool = True
) -> Iterator[Output]:
    """Open a target for binary writing; the file appears under its name when the block ends without an error.

    Args:
        target, force, inputs: As in `check_target`.
        durable: Wait until the file is on the disk. Without, it is whole whatever happens to the process, but may not
            survive a loss of power.

    Raises:
        OutputError, UsageError: As in `check_target`, or the medium fails (no space, input/output error).
        BrokenPipeError: Nobody reads standard output any more.
    """
    check_target(target, force=force, inputs=inputs)
    if str(target) == STDOUT:
        output = Output(_stdout_descriptor(), "<stdout>")
        yield output
        output.flush()
        return
    path, name = _real_path(target), str(target)
    special = _is_special(path)
    written = path if special else path.parent / f".{path.name[:MAX_NAME_IN_TEMPORARY]}.{secrets.token_hex(4)}.part"
    flags = os.O_WRONLY | (0 if special else os.O_CREAT | os.O_EXCL)
    with _medium(name):
        descriptor = os.open(written, flags | getattr(os, "O_CLOEXEC", 0), 0o666)
    output = Output(descriptor, name)
    try:
        try:
            if durable and not special:
                output.sync_in_background()
            yield output
            output.sync() if durable and not special else output.flush()
        finally:
            output.settle()
            os.close(descriptor)
        if not special:
            check_target(target, force=force, inputs=inputs)
            with _medium(name):
                written.replace(path)
    except BaseException:
        if not special:
            with suppress(OSError):
                written.unlink()
        raise
    if durable and not special:
        _sync_folder(path.parent)


def write_file(
    target: str | Path, data: Bytes, *, force: bool = False, inputs: Sequence[Path] = (), durable: bool = True
) -> None:
    """Write a whole file at once.

    Raises:
        As `open_output`.
    """
    with open_output(target, force=force, inputs=inputs, durable=durable) as output:
        output.write(data)


def _real_path(target: str | Path) -> Path:
    return Path(os.path.realpath(target))


def _is_special(path: Path) -> bool:
    """A device, a pipe or a socket: something that can't be replaced by a file."""
    try:
        mode = path.stat().st_mode
    except OSError:
        return False
    return not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))


def _stdout_descriptor() -> int:
    try:
        sys.stdout.flush()
        descriptor = sys.stdout.fileno()
    except (AttributeError, OSError, ValueError) as error:
        raise OutputError("standard output is closed", where="<stdout>") from error
    if os.isatty(descriptor):
        raise UsageError(
            "refusing to write binary data to the terminal", hint="name a file with -o, or send it into a pipe"
        )
    return descriptor


@contextmanager
def _medium(name: str) -> Iterator[None]:
    """Errors of the operating system, other than a closed pipe, as `OutputError`."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        raise OutputError(_reason(error), where=name) from error


def _reason(error: OSError) -> str:
    return REASONS.get(error.errno or 0, error.strerror or str(error))


def _sync_folder(folder: Path) -> None:
    """Make the rename last. Not every file system can; the file itself is safe already."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
