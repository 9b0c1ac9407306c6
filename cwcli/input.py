"""Files that are read: opened once, read by ranges, checked to be the same to the end, and remembered.

A log is not mapped into memory: where somebody shortens a mapped file, the system ends the process with a signal. Read
by ranges, it takes as long, and every trouble is an error with a name.

What a run has read is remembered (`remember_inputs`), so that no output of it, whatever its name, is one of its
inputs (`cwcli.output`).
"""

from __future__ import annotations

import errno
import os
import select
import stat
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import field
from functools import cached_property
from pathlib import Path
from threading import Thread
from types import TracebackType
from typing import TYPE_CHECKING, Self

from cwcli.errors import InputError, OutputError
from cwcli.lazy_dataclass import dataclass

if TYPE_CHECKING:
    from concurrent.futures import Future

MIN_READ_BYTES = 1 << 13
"""Least number of bytes that one read takes; the next records are mostly among them. Chosen by hand."""
BYTES_HASHED_AT_ONCE = 1 << 20
"""Number of bytes that are hashed at a time, 1 MiB; chosen by hand."""
FILE_STAMP_TICK_NS = 10_000_000
"""Time in ns within which two changes of a file may get the same time stamp: the kernel ticks a hundred times a
second."""
MAX_CHUNK_BYTES = 256_000_000
"""Greatest size of a chunk, stored or unpacked, that is read by default [bytes]; chosen by hand."""
MAX_UNPACKED_TO_STORED_SIZE_RATIO = 64.0
"""Greatest ratio of unpacked to stored bytes of a whole file that is read by default; chosen by hand."""
NO_LIMIT_BYTES = 1 << 62
"""Number of bytes that stands for no limit: no file reaches 4 EiB. Chosen by hand."""
MAX_SETTINGS_BYTES = 16_000_000
"""Greatest size of a file that is read whole: settings, calibrations, definitions [bytes]; chosen by hand."""
MAX_NET_OR_TABLE_FILE_BYTES = 4_000_000_000
"""Greatest size of a net or a table that is read whole [bytes]; chosen by hand."""
MAX_STRETCHES_BETWEEN_HOLES = 100_000
"""Greatest number of stretches between holes that are counted; nobody leaves so many. Chosen by hand."""
BYTES_PER_MEGABYTE = 1_000_000
"""Bytes in a megabyte, for messages to users."""
PIPE_WRITER_TIMEOUT_S = 60.0
"""Time in s within which somebody must write into a named pipe. Chosen by hand, as the default of `--timeout`."""
STANDARD_OUTPUT_AND_ERROR_FILE_DESCRIPTORS = (1, 2)
"""File descriptors of standard output and standard error (POSIX)."""
OUTPUT_ERRORS = (OutputError, BrokenPipeError)
"""Errors that no change of an input explains."""


class InputFile:
    """An open file; `file[a:b]` reads its bytes a to b.

    Args:
        descriptor: Open for reading; closed with this.
        name: Name of the file in messages.
        path: The path, which must lead to the same file until it is closed; None where it has none.

    Attributes:
        name: Name of the file in messages.
        descriptor: Open until `close`; -1 where it has no file of its own.
        max_chunk_bytes: Greatest size of a chunk, stored or unpacked.
        max_ratio: All chunks together may unpack to this many times the file's size, and `max_chunk_bytes` more.
        refused_from: Byte at which the chunks beyond that limit begin; None where there are none.
        state: Device, number, size in bytes and time of the last change in ns, when it was opened.
        notes: Note on how the file was opened -> how often it applies.

    Raises:
        InputError: It is empty.
    """

    def __init__(self, descriptor: int, name: str, path: Path | None = None) -> None:
        self.name = name
        self.descriptor = descriptor
        self.max_chunk_bytes = MAX_CHUNK_BYTES
        self.max_ratio = MAX_UNPACKED_TO_STORED_SIZE_RATIO
        self.refused_from: int | None = None
        self.notes: dict[str, int] = {}
        self._path = path
        self._inputs: InputsOfRun | None = None
        self._digest: Future[str] | None = None
        self._is_checked = False
        self._held = (0, memoryview(b""))
        try:
            found = _stat_after_clock_tick(descriptor)
            self.state = _file_identity_size_and_time(found)
            self._size = found.st_size
            if not self._size:
                raise InputError("the file is empty", where=name)
            self._inputs = _remember_run_input_and_get_inputs(found, name)
            if self._inputs is not None:
                self._inputs.open.add(self)
        except BaseException:
            self.close()
            raise

    @classmethod
    def open(cls, path: str | Path, name: str = "") -> InputFile:
        """Open a file by its path.

        Raises:
            InputError: It can't be read, or is empty.
        """
        name = name or str(path)
        return cls(_open_file_for_reading(path, name), name, Path(path))

    def __len__(self) -> int:
        return self._size

    def __getitem__(self, place: slice) -> memoryview:
        """Return a range of bytes, cut at the end of the file.

        Raises:
            InputError: The file is shorter than it was, or can't be read.
        """
        start, stop, _ = place.indices(self._size)
        first, held_bytes = self._held
        if not first <= start <= stop <= first + len(held_bytes):
            if stop - start >= MIN_READ_BYTES:
                return memoryview(self._read(start, stop))
            first, held_bytes = start, memoryview(self._read(start, min(start + MIN_READ_BYTES, self._size)))
            self._held = first, held_bytes
        return held_bytes[start - first : stop - first]

    @cached_property
    def n_stored_bytes(self) -> int:
        """The number of bytes that hold the content, without holes; of a compressed file, those on the disk."""
        return count_bytes_outside_holes(self.descriptor, self._size)

    @property
    def max_unpacked_bytes(self) -> int:
        """Greatest number of bytes to which the whole file may unpack."""
        return self.max_chunk_bytes + self.max_unpacked_bytes_of(self.n_stored_bytes)

    def max_unpacked_bytes_of(self, n_bytes: int) -> int:
        """Return the number of bytes to which `n_bytes` of the file may unpack, by `max_ratio` alone."""
        return int(min(self.max_ratio * n_bytes, NO_LIMIT_BYTES))

    @property
    def disk_files(self) -> Sequence[InputFile]:
        """The files on the disk of which this one consists: itself alone."""
        return (self,)

    def part_and_offset(self, at: int) -> tuple[InputFile, int]:
        """Return the file that holds the byte at `at`, and the byte's offset in it."""
        return self, at

    def read_into(self, buffer: memoryview, start: int) -> memoryview:
        """Fill a buffer with the bytes from `start` on, and return it; raise as slicing does."""
        self._is_checked = False
        n = 0
        while n < len(buffer):
            try:
                count = os.preadv(self.descriptor, [buffer[n:]], start + n)
            except OSError as error:
                raise self._read_error(error, start + n) from error
            if not count:
                raise self._changed_file_error(f"it had {self._size} bytes and ends at byte {start + n}")
            n += count
        return buffer

    def begin_sha256(self) -> Future[str]:
        """Return the future SHA-256 of the bytes in hexadecimal; several files are hashed as if concatenated.

        It is computed once, in a thread that continues after `close`.
        """
        if self._digest is None:
            from concurrent.futures import Future

            self._digest = Future()
            Thread(target=self._compute_sha256, args=(self._digest,), daemon=True).start()
        return self._digest

    def check_unchanged(self) -> None:
        """Check that the file has not changed since it was opened, and that its path still leads to it.

        Raises:
            InputError: It has changed, and the data read may be a mixture.
        """
        if self._path is None and self.descriptor < 0:
            return
        try:
            found = os.fstat(self.descriptor) if self._path is None else self._path.stat()
        except OSError as error:
            raise self._changed_file_error(f"it is gone ({error.strerror})") from error
        current_identity = _file_identity_size_and_time(found)
        if current_identity[:2] != self.state[:2]:
            raise self._changed_file_error("another file has its name now")
        if found.st_size != self._size:
            raise self._changed_file_error(f"it had {self._size} bytes and has {found.st_size}")
        if current_identity != self.state:
            raise self._changed_file_error("something was written into it")
        self._is_checked = True

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Check for a change if data was read since the last check or an error may come from one; close the file."""
        may_matter = isinstance(error, Exception | None) and not isinstance(error, OUTPUT_ERRORS)
        try:
            for file in self.disk_files if may_matter else ():
                if file.descriptor >= 0 and (error is not None or not file._is_checked):
                    file.check_unchanged()
        finally:
            self.close()

    def __del__(self) -> None:
        self.close()

    def close(self) -> None:
        """Close the file, as soon as the thread that hashes it is done."""
        self._held = (0, memoryview(b""))
        if self._inputs is not None:
            self._inputs.open.discard(self)
        if self._digest is None:
            self._close()
        else:
            self._digest.add_done_callback(lambda _: self._close())

    def _close(self) -> None:
        descriptor, self.descriptor = self.descriptor, -1
        if descriptor >= 0:
            os.close(descriptor)

    def _read(self, start: int, stop: int) -> bytes:
        """Read the bytes from start to stop; raise as slicing does."""
        self._is_checked = False
        try:
            data = os.pread(self.descriptor, stop - start, start)
        except OSError as error:
            raise self._read_error(error, start) from error
        if len(data) < stop - start:  # the system reads 2 GB at most in one go
            rest = bytearray(stop - start - len(data))
            data += self.read_into(memoryview(rest), start + len(data))
        return data

    def _compute_sha256(self, digest: Future[str]) -> None:
        """Compute the hash and set the future's result, or its error, so that nobody waits for ever."""
        try:
            import hashlib

            running_hash = hashlib.sha256()
            block = memoryview(bytearray(BYTES_HASHED_AT_ONCE))
            for file in self.disk_files:
                for at in range(0, len(file), BYTES_HASHED_AT_ONCE):
                    running_hash.update(file.read_into(block[: len(file) - at], at))
            digest.set_result(running_hash.hexdigest())
        except BaseException as error:
            digest.set_exception(error)

    def _read_error(self, error: OSError, at: int) -> InputError:
        return InputError(f"it can't be read: {error.strerror} (at byte {at})", where=self.name)

    def _changed_file_error(self, what: str) -> InputError:
        return InputError(
            f"the log changed while it was read: {what}",
            where=self.name,
            hint="run it again when nothing writes to it any more, or on a copy",
        )


@dataclass
class InputsOfRun:
    """The files that a run has read.

    Attributes:
        names: Device and inode number of each file -> its name.
        open: The logs that are open.
    """

    names: dict[tuple[int, int], str] = field(default_factory=dict)
    open: set[InputFile] = field(default_factory=set)


_INPUTS_OF_RUN: ContextVar[InputsOfRun | None] = ContextVar("inputs", default=None)
"""The inputs of the current run; None outside of `remember_inputs`."""


@contextmanager
def remember_inputs() -> Iterator[None]:
    """Remember the files that are read inside the block, together with those of the enclosing block."""
    outside = _INPUTS_OF_RUN.get()
    token = _INPUTS_OF_RUN.set(InputsOfRun(dict(outside.names) if outside else {}))
    try:
        yield
    finally:
        _INPUTS_OF_RUN.reset(token)


def remember_input_file(name: str | Path) -> None:
    """Remember a file that will be read, `-` for standard input, if it exists.

    Raises:
        OutputError: Standard output or standard error goes into it.
    """
    with suppress(OSError, ValueError):  # whoever reads it tells what is wrong
        _remember_run_input_and_get_inputs(os.fstat(0) if str(name) == "-" else os.stat(name), str(name))  # noqa: PTH116 - a name may hold a zero byte


def is_input_of_run(status: os.stat_result, more_inputs: Sequence[InputFile] = ()) -> bool:
    """Return whether the file is an input of this run, or one of the files in `more_inputs`."""
    inputs = _INPUTS_OF_RUN.get()
    place = _file_identity_size_and_time(status)[:2]
    of_more = (file.state[:2] for each in more_inputs for file in each.disk_files)
    return (inputs is not None and place in inputs.names) or place in of_more


def check_unchanged(more_inputs: Sequence[InputFile] = ()) -> None:
    """Check that the open logs of this run, and the files in `more_inputs`, have not changed.

    Raises:
        InputError: One has.
    """
    inputs = _INPUTS_OF_RUN.get()
    for each in (*(inputs.open if inputs is not None else ()), *more_inputs):
        each.check_unchanged()


def names_of_inputs_in_folders(*folders: Path) -> list[str]:
    """Return the names of this run's inputs that lie in one of the folders or below it."""
    inputs = _INPUTS_OF_RUN.get()
    prefixes = tuple(os.path.realpath(folder) + os.sep for folder in folders)
    names = inputs.names.values() if inputs is not None else ()
    real_names = RealPaths()
    return [name for name in names if real_names.resolve(name).startswith(prefixes)]


class RealPaths:
    """Resolves links in the names of many files; a folder that several share is resolved once."""

    def __init__(self) -> None:
        self._real_folders: dict[str, str] = {}

    def resolve(self, name: str) -> str:
        """Return the absolute name of a file without links, as `os.path.realpath`."""
        folder, own = os.path.split(name)
        if own in {"", ".", ".."} or os.path.islink(name):  # noqa: PTH114 - a zero byte in the name is no error here
            return os.path.realpath(name)
        if folder not in self._real_folders:
            self._real_folders[folder] = os.path.realpath(folder)
        return os.path.join(self._real_folders[folder], own)  # noqa: PTH118 - a `Path` takes ten times as long


def is_file(name: str | Path) -> bool:
    """Whether a user's name is that of a file; a name that is too long, or may not be looked at, is none."""
    with suppress(OSError, ValueError):
        return Path(name).is_file()
    return False


def is_folder(name: str | Path) -> bool:
    """Whether a user's name is that of a folder, as `is_file`."""
    with suppress(OSError, ValueError):
        return Path(name).is_dir()
    return False


def exists(name: str | Path) -> bool:
    """Whether there is anything of a user's name, also a device, a pipe or a socket, as `is_file`."""
    with suppress(OSError, ValueError):
        return Path(name).exists()
    return False


def read_file(path: str | Path, max_bytes: int = -1, *, limit: int = MAX_SETTINGS_BYTES) -> bytes:
    """Read a file, or its first bytes, and remember it as an input.

    Args:
        max_bytes: Number of its first bytes; -1 for all.
        limit: A whole file with more bytes is refused, and a device with more than settings may have.

    Raises:
        OSError, ValueError: It can't be read, or is too large; a zero byte is in the name.
        OutputError: Standard output or standard error goes into it.
    """
    # pathlib would strip a trailing slash from a folder's name
    with open(path, "rb", opener=open_descriptor_within_wait) as file:
        found = os.fstat(file.fileno())
        _remember_run_input_and_get_inputs(found, str(path))
        if max_bytes >= 0:
            return file.read(max_bytes)
        if stat.S_ISCHR(found.st_mode):
            limit = min(limit, MAX_SETTINGS_BYTES)
        # Python takes memory for as many bytes as are asked for
        data = file.read(min(limit, found.st_size) + 1 if stat.S_ISREG(found.st_mode) else limit + 1)
        if len(data) > limit:
            raise OSError(errno.EFBIG, f"it has more than {limit / BYTES_PER_MEGABYTE:g} MB")
        return data


def _remember_run_input_and_get_inputs(status: os.stat_result, name: str) -> InputsOfRun | None:
    """Remember a regular file as an input of the run; return the run's inputs, None outside of a run."""
    inputs = _INPUTS_OF_RUN.get()
    if inputs is not None and stat.S_ISREG(status.st_mode):
        for stream in STANDARD_OUTPUT_AND_ERROR_FILE_DESCRIPTORS:
            with suppress(OSError):
                if os.path.samestat(status, os.fstat(stream)):
                    raise OutputError("the output goes into the input itself", where=name, hint="write to another file")
        inputs.names[status.st_dev, status.st_ino] = name
    return inputs


def _open_file_for_reading(path: str | Path, name: str) -> int:
    """Open a file for reading and return its descriptor; raise `InputError` if that fails."""
    try:
        return open_descriptor_within_wait(path)
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        raise InputError(f"it can't be read: {getattr(error, 'strerror', None) or error}", where=name) from error


def open_descriptor_within_wait(path: str | Path, flags: int = os.O_RDONLY) -> int:
    """Open a file for reading and return its descriptor; a named pipe of Linux waits `PIPE_WRITER_TIMEOUT_S` at most.

    Raises:
        OSError: It can't be opened, or nobody writes into it.
    """
    flags |= getattr(os, "O_CLOEXEC", 0)
    if not sys.platform.startswith("linux"):
        return os.open(path, flags)
    descriptor = os.open(path, flags | os.O_NONBLOCK)  # else it would wait here until somebody writes
    try:
        if stat.S_ISFIFO(os.fstat(descriptor).st_mode):
            poll = select.poll()
            poll.register(descriptor, select.POLLIN)
            if not poll.poll(PIPE_WRITER_TIMEOUT_S * 1000):
                raise OSError(errno.ETIMEDOUT, f"nobody has written into this pipe for {PIPE_WRITER_TIMEOUT_S:g} s")
        os.set_blocking(descriptor, True)
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


def count_bytes_outside_holes(descriptor: int, size: int) -> int:
    """Return how many bytes of a file of this size are stored, and no hole; all, where nobody can tell."""
    n_bytes = at = old = 0
    try:
        old = os.lseek(descriptor, 0, os.SEEK_CUR)
        for _ in range(MAX_STRETCHES_BETWEEN_HOLES):
            start = os.lseek(descriptor, at, os.SEEK_DATA)
            at = os.lseek(descriptor, start, os.SEEK_HOLE)
            n_bytes += at - start
    except (OSError, AttributeError) as error:
        if getattr(error, "errno", None) != errno.ENXIO:  # else no data follow
            return size
    finally:
        with suppress(OSError):
            os.lseek(descriptor, old, os.SEEK_SET)
    return n_bytes


def _stat_after_clock_tick(descriptor: int) -> os.stat_result:
    """Return the file's state after waiting until any further change gets a later time than the last one."""
    since_ns = time.time_ns() - os.fstat(descriptor).st_mtime_ns
    if 0 <= since_ns < FILE_STAMP_TICK_NS:
        time.sleep((FILE_STAMP_TICK_NS - since_ns) / 1e9)
    return os.fstat(descriptor)


def _file_identity_size_and_time(status: os.stat_result) -> tuple[int, int, int, int]:
    """Return device, inode number, size in bytes and time of the last change [ns]."""
    return status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns
