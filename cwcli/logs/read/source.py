"""The bytes of a log: a file, or a pipe, copied into a temporary file first."""

from __future__ import annotations

import os
import stat
import sys
from contextlib import suppress
from pathlib import Path
from typing import IO

from cwcli.errors import InputError, OutputError, UsageError
from cwcli.input import InputFile
from cwcli.logs.format.faults import no_mcap
from cwcli.logs.format.records import MAGIC

STDIN = "-"
GIGABYTE = 1_000_000_000
MAX_PIPE_BYTES = 64 * GIGABYTE
STDIN_NAME = "<stdin>"
COPY_BYTES = 1 << 20


def open_source(
    source: str | Path, name: str | None = None, *, pipes: bool = True, max_pipe_bytes: int = MAX_PIPE_BYTES
) -> InputFile:
    """Open a log's bytes.

    Args:
        source: File name, or `-` for standard input. Named pipes are read like standard input.
        name: For messages, where the file is a copy of something with another name.
        pipes: Read what is no file, too.
        max_pipe_bytes: What comes out of a pipe at most: it may have no end.

    Raises:
        InputError: It does not exist, is a directory, is empty, or can't be read.
        OutputError: The temporary copy of a pipe can't be written.
        UsageError: Standard input is a terminal.
    """
    if str(source) == STDIN:
        return _standard_input(max_pipe_bytes)
    path = Path(source)
    name = str(source) if name is None else name
    try:
        mode = path.stat().st_mode
        if stat.S_ISDIR(mode):
            raise InputError("it is a directory", where=name, hint="name an .mcap file in it")
        if stat.S_ISREG(mode):
            return InputFile.open(path, name)
        if not pipes:  # it may never end, and can't be read twice
            raise InputError("it is a pipe or a device, no file", where=name, hint="copy it into a file first")
        with path.open("rb") as pipe:
            return _spooled(pipe, name, max_pipe_bytes)
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        raise InputError(f"it can't be read: {getattr(error, 'strerror', None) or error}", where=name) from error


def _standard_input(max_bytes: int) -> InputFile:
    if sys.stdin is None or sys.stdin.closed:
        raise InputError("standard input is closed", where=STDIN_NAME)
    if sys.stdin.isatty():
        raise UsageError("standard input is a terminal", hint="name a log, or pipe one in")
    with suppress(OSError, ValueError):  # no file
        descriptor = sys.stdin.fileno()
        is_file = stat.S_ISREG(os.fstat(descriptor).st_mode)
        if is_file and os.lseek(descriptor, 0, os.SEEK_CUR) == 0:
            return InputFile(os.dup(descriptor), STDIN_NAME)
    return _spooled(sys.stdin.buffer, STDIN_NAME, max_bytes)


def _spooled(pipe: IO[bytes], name: str, max_bytes: int) -> InputFile:
    """Everything that comes out of a pipe, in a temporary file: of something else than a log only its beginning.

    Its name is gone before it is filled, so that not even a killed run leaves it behind.
    """
    import tempfile

    try:
        with tempfile.TemporaryFile(prefix="cwcli-", suffix=".mcap") as spool:
            while block := _block(pipe, name):
                if not spool.tell() and not block.startswith(MAGIC[: len(block)]):
                    raise no_mcap(name, block[:16])
                spool.write(block)
                if spool.tell() > max_bytes:
                    what = f"more than {max_bytes / GIGABYTE:g} GB came in"
                    raise InputError(what, where=name, hint="--max-input reads more; a file has no such bound")
            spool.flush()
            if not spool.tell():
                raise InputError("nothing came in", where=name)
            return InputFile(os.dup(spool.fileno()), name)
    except OSError as error:
        raise OutputError(
            f"the temporary copy of {name} can't be written: {error.strerror}",
            where=tempfile.gettempdir(),
            hint="point TMPDIR to a folder with more room",
        ) from error


def _block(pipe: IO[bytes], name: str) -> bytes:
    try:
        return pipe.read(COPY_BYTES)
    except OSError as error:
        raise InputError(f"it can't be read: {error.strerror}", where=name) from error
