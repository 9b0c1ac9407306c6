"""The bytes of a log: a file, mapped into memory, or a pipe, copied into a temporary file first."""

from __future__ import annotations

import mmap
import os
import stat
import sys
from pathlib import Path
from typing import IO

from cwcli.errors import InputError, OutputError, UsageError

STDIN = "-"
STDIN_NAME = "<stdin>"
COPY_BYTES = 1 << 20


class Source:
    """A log's bytes.

    The pages of a mapped file belong to the page cache: they do not count as the process's own memory.

    Attributes:
        name: For messages.
        path: The file; a temporary one for a pipe.
        data: All bytes.
    """

    def __init__(self, name: str, path: Path, *, is_temporary: bool = False) -> None:
        self.name = name
        self.path = path
        self._is_temporary = is_temporary
        try:
            with path.open("rb") as file:
                if os.fstat(file.fileno()).st_size == 0:
                    raise InputError("the file is empty" if not is_temporary else "nothing came in", where=name)
                self._mapped = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise InputError(f"it can't be read: {reason}", where=name) from error
        finally:
            if is_temporary and not hasattr(self, "_mapped"):
                path.unlink(missing_ok=True)
        self.data = memoryview(self._mapped)

    def close(self) -> None:
        """Unmap the file, unless arrays or frames that were handed out still look into it; remove a temporary one."""
        try:
            self.data.release()
            self._mapped.close()
        except BufferError:
            pass
        if self._is_temporary:
            self._is_temporary = False
            self.path.unlink(missing_ok=True)


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
        return Source(STDIN_NAME, _spooled(sys.stdin.buffer, STDIN_NAME), is_temporary=True)
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
            return Source(name, _spooled(pipe, name), is_temporary=True)
    except OSError as error:
        raise InputError(f"it can't be read: {error.strerror}", where=name) from error


def _spooled(pipe: IO[bytes], name: str) -> Path:
    """A temporary file with everything that comes out of a pipe."""
    import tempfile

    path: Path | None = None
    try:
        with tempfile.NamedTemporaryFile(prefix="cwcli-", suffix=".mcap", delete=False) as file:
            path = Path(file.name)
            while True:
                try:
                    block = pipe.read(COPY_BYTES)
                except OSError as error:
                    raise InputError(f"it can't be read: {error.strerror}", where=name) from error
                if not block:
                    return path
                file.write(block)
    except OSError as error:
        _remove(path)
        raise OutputError(
            f"the temporary copy of {name} can't be written: {error.strerror}",
            where=tempfile.gettempdir(),
            hint="point TMPDIR to a folder with more room",
        ) from error
    except BaseException:
        _remove(path)
        raise


def _remove(path: Path | None) -> None:
    if path is not None:
        path.unlink(missing_ok=True)
