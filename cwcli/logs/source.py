"""The bytes of a log: a file, mapped into memory, or a pipe, copied into a temporary file first."""

from __future__ import annotations

import mmap
import os
import stat
import sys
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from threading import Thread
from typing import IO

from cwcli.errors import InputError, OutputError, UsageError

STDIN = "-"
STDIN_NAME = "<stdin>"
COPY_BYTES = 1 << 20
HASH_BLOCK_BYTES = 1 << 20


class Source:
    """A log's bytes.

    The pages of a mapped file belong to the page cache: they do not count as the process's own memory.

    Attributes:
        name: For messages.
        path: The file; a temporary one for a pipe, open as `spool` and gone when that is closed.
        data: All bytes.
    """

    def __init__(self, name: str, path: Path, spool: IO[bytes] | None = None) -> None:
        self.name = name
        self.path = path
        self._spool = spool
        self._digest: Future[str] | None = None
        try:
            with path.open("rb") as file:
                if os.fstat(file.fileno()).st_size == 0:
                    raise InputError("the file is empty" if spool is None else "nothing came in", where=name)
                self._mapped = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise InputError(f"it can't be read: {reason}", where=name) from error
        finally:
            if spool is not None and not hasattr(self, "_mapped"):
                spool.close()
        self.data = memoryview(self._mapped)

    def know_sha256(self, digest: str) -> None:
        """Take what `begin_sha256` would find from someone who has computed it."""
        self._digest = Future()
        self._digest.set_result(digest)

    def begin_sha256(self) -> Future[str]:
        """SHA-256 of the bytes, in hexadecimal; computed once, in a thread that goes on after `close`."""
        if self._digest is None:
            digest: Future[str] = Future()
            Thread(target=_hash, args=(memoryview(self.data), digest), daemon=True).start()
            self._digest = digest
        return self._digest

    def close(self) -> None:
        """Unmap the file, unless arrays or frames that were handed out still look into it; remove a temporary one."""
        try:
            self.data.release()
            self._mapped.close()
        except BufferError:
            pass
        if self._spool is not None:
            self._spool.close()


def _hash(data: memoryview, digest: Future[str]) -> None:
    """Keep the hash, or the error: whoever waits for it must not wait for ever."""
    try:
        import hashlib

        made = hashlib.sha256()
        with data:
            for at in range(0, len(data), HASH_BLOCK_BYTES):
                with data[at : at + HASH_BLOCK_BYTES] as block:
                    made.update(block)
        digest.set_result(made.hexdigest())
    except BaseException as error:
        digest.set_exception(error)


def open_source(source: str | Path, name: str | None = None) -> Source:
    """Open a log's bytes.

    Args:
        source: File name, or `-` for standard input. Named pipes are read like standard input.
        name: For messages, where the file is a copy of something with another name.

    Raises:
        InputError: It does not exist, is a directory, is empty, or can't be read.
        OutputError: The temporary copy of a pipe can't be written.
        UsageError: Standard input is a terminal.
    """
    if str(source) == STDIN:
        if sys.stdin is None or sys.stdin.closed:
            raise InputError("standard input is closed", where=STDIN_NAME)
        if sys.stdin.isatty():
            raise UsageError("standard input is a terminal", hint="name a log, or pipe one in")
        return _spooled(sys.stdin.buffer, STDIN_NAME)
    path = Path(source)
    name = str(source) if name is None else name
    try:
        mode = path.stat().st_mode
    except OSError as error:
        raise InputError(f"it can't be read: {error.strerror}", where=name) from error
    except ValueError as error:
        raise InputError(f"it can't be read: {error}", where=name) from error
    if stat.S_ISDIR(mode):
        raise InputError("it is a directory", where=name, hint="name an .mcap file in it")
    if stat.S_ISREG(mode):
        return Source(name, path)
    try:
        with path.open("rb") as pipe:
            return _spooled(pipe, name)
    except OSError as error:
        raise InputError(f"it can't be read: {error.strerror}", where=name) from error


def _spooled(pipe: IO[bytes], name: str) -> Source:
    """Everything that comes out of a pipe, in a temporary file.

    Where the system can, the file has no name, so that not even a killed run leaves it behind.
    """
    import tempfile

    spool: IO[bytes] | None = None
    try:
        spool = tempfile.TemporaryFile(prefix="cwcli-", suffix=".mcap")  # noqa: SIM115 - the source closes it
        path = Path(f"/proc/self/fd/{spool.fileno()}")
        if not path.exists():
            spool.close()
            spool = tempfile.NamedTemporaryFile(prefix="cwcli-", suffix=".mcap")  # noqa: SIM115
            path = Path(spool.name)
        while True:
            try:
                block = pipe.read(COPY_BYTES)
            except OSError as error:
                raise InputError(f"it can't be read: {error.strerror}", where=name) from error
            if not block:
                break
            spool.write(block)
        spool.flush()
    except OSError as error:
        _close(spool)
        raise OutputError(
            f"the temporary copy of {name} can't be written: {error.strerror}",
            where=tempfile.gettempdir(),
            hint="point TMPDIR to a folder with more room",
        ) from error
    except BaseException:
        _close(spool)
        raise
    return Source(name, path, spool)


def _close(spool: IO[bytes] | None) -> None:
    """Close a file that can't be written: what is still in its buffer is lost on purpose."""
    if spool is not None:
        with suppress(OSError):
            spool.close()
