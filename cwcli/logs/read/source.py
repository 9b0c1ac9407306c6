"""Opens the bytes of a log: a file, the parts of a recording, or a pipe, which is copied into a temporary file."""

from __future__ import annotations

import os
import stat
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import IO, TYPE_CHECKING

from cwcli.errors import InputError, OutputError, UsageError
from cwcli.input import InputFile, open_descriptor_within_wait
from cwcli.logs.format.faults import not_mcap_error
from cwcli.logs.format.records import MCAP_MAGIC
from cwcli.logs.read.converted import ROS1_BAG_MAGIC, SQLITE_MAGIC, ZSTD_MAGIC, convert_if_needed
from cwcli.logs.read.read_bounds import BYTES_PER_GIGABYTE, COPY_BLOCK_BYTES, DEFAULT_READ_BOUNDS, ReadBounds
from cwcli.logs.read.remote import FILE_SCHEME, file_names_below_url, is_remote_url, iter_remote_blocks
from cwcli.url import display_name_of_url

if TYPE_CHECKING:
    from cwcli.logs.read.recording import Opener

STDIN_ARGUMENT = "-"
"""The name that stands for standard input."""
STDIN_NAME = "<stdin>"
"""The name of standard input in messages."""

LOG_MAGICS = (MCAP_MAGIC, ROS1_BAG_MAGIC, SQLITE_MAGIC, ZSTD_MAGIC)
"""The first bytes of the files that are read as logs."""

Source = str | Path | Sequence[str]
"""The name of a log, or the names of its parts."""


def open_source(
    source: Source, name: str | None = None, *, pipes: bool = True, bounds: ReadBounds = DEFAULT_READ_BOUNDS
) -> InputFile:
    """Open a log's bytes.

    Args:
        source: File name, or `-` for standard input. Named pipes are read like standard input. A folder with a
            recorder's metadata.yaml, or with one log. Several names, also of folders, are parts of one log.
        name: Name for messages, if the file is a copy of something with another name.
        pipes: Read pipes and devices, too.
        bounds: What reading may cost, for each part; a pipe or a URL may have no end.

    Raises:
        InputError: It does not exist, is a folder that is no log, is empty, or can't be read.
        OutputError: The temporary copy of a pipe can't be written.
        UsageError: Standard input is a terminal.
    """
    opener = partial(open_source, pipes=False, bounds=bounds)
    if not isinstance(source, str | Path):
        return _open_parts(source, name, opener)
    if str(source) == STDIN_ARGUMENT:
        return _open_standard_input(bounds.max_input_bytes)
    name = display_name_of_url(str(source)) if name is None else name
    if is_remote_url(str(source)):
        return _copy_remote_log(str(source), name, opener, bounds)
    path = Path(str(source).removeprefix(FILE_SCHEME))
    try:
        mode = path.stat().st_mode
        if stat.S_ISDIR(mode):
            from cwcli.logs.read.recording import open_recording_folder

            return open_recording_folder(str(path), name, opener, as_one=False)
        if stat.S_ISREG(mode):
            return convert_if_needed(InputFile.open(path, name), bounds)
        if not pipes:  # it may never end, and can't be read twice
            raise InputError("it is a pipe or a device, no file", where=name, hint="copy it into a file first")
        with open(path, "rb", opener=open_descriptor_within_wait) as pipe:
            return _copy_pipe_to_temporary_file(pipe, name, bounds.max_input_bytes)
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        raise InputError(f"it can't be read: {getattr(error, 'strerror', None) or error}", where=name) from error


def _open_parts(names: Sequence[str], name: str | None, opener: Opener) -> InputFile:
    """Open several files, or the files of one folder, as the parts of one log."""
    from cwcli.logs.read.recording import name_of_joined_log, open_parts, open_recording_folder

    name = name_of_joined_log(names) if name is None else name
    if len(names) == 1 and _is_folder(names[0]):
        return open_recording_folder(names[0].removeprefix(FILE_SCHEME), name, opener, as_one=True)
    return open_parts(names, name, opener)


def _is_folder(name: str) -> bool:
    if is_remote_url(name):
        return bool(file_names_below_url(name))
    with suppress(OSError, ValueError):
        return Path(name.removeprefix(FILE_SCHEME)).is_dir()
    return False


def _copy_remote_log(url: str, name: str, opener: Opener, bounds: ReadBounds) -> InputFile:
    """A copy of a remote log on this machine, gone when it is closed; or of the logs of a folder."""
    may_be_folder = "." not in url.rpartition("/")[2] and not url.startswith(("http:", "https:"))
    if url.endswith("/") or (may_be_folder and file_names_below_url(url)):
        from cwcli.logs.read.recording import open_recording_folder

        return open_recording_folder(url, name, opener, as_one=False)
    return convert_if_needed(spool_to_temporary_file(iter_remote_log(url, bounds, name), name), bounds)


def iter_remote_log(url: str, bounds: ReadBounds, name: str) -> Iterator[bytes]:
    """Yield the bytes of a remote log.

    Raises:
        InputError: It can't be read, stalls, does not begin as a log, or has more bytes than the bounds allow.
    """
    blocks = _iter_with_first_bytes_checked(iter_remote_blocks(url, bounds), LOG_MAGICS, name)
    return iter_within_size_limit(bounds.max_input_bytes, blocks, name)


def _open_standard_input(max_bytes: int) -> InputFile:
    """Open standard input: the file itself, or a temporary copy of a pipe.

    Raises:
        InputError: It is closed, or can't be read.
        UsageError: It is a terminal.
    """
    if sys.stdin is None or sys.stdin.closed:
        raise InputError("standard input is closed", where=STDIN_NAME)
    if sys.stdin.isatty():
        raise UsageError("standard input is a terminal", hint="name a log, or pipe one in")
    with suppress(OSError, ValueError):  # no file
        descriptor = sys.stdin.fileno()
        is_file = stat.S_ISREG(os.fstat(descriptor).st_mode)
        if is_file and os.lseek(descriptor, 0, os.SEEK_CUR) == 0:
            return InputFile(os.dup(descriptor), STDIN_NAME)
    return _copy_pipe_to_temporary_file(sys.stdin.buffer, STDIN_NAME, max_bytes)


def _copy_pipe_to_temporary_file(pipe: IO[bytes], name: str, max_bytes: int) -> InputFile:
    """Copy a pipe into a temporary file, after a check that it begins as a log."""
    return spool_to_temporary_file(
        iter_within_size_limit(
            max_bytes,
            _iter_with_first_bytes_checked(iter(lambda: _read_pipe_block(pipe, name), b""), (MCAP_MAGIC,), name),
            name,
        ),
        name,
    )


def _iter_with_first_bytes_checked(pieces: Iterator[bytes], magics: tuple[bytes, ...], name: str) -> Iterator[bytes]:
    """Yield the pieces.

    Raises:
        InputError: They do not begin with one of these.
    """
    head = b""
    n_needed = max(map(len, magics))
    for piece in pieces:
        if len(head) < n_needed:
            head += piece[: n_needed - len(head)]
            if not any(head[: len(each)] == each[: len(head)] for each in magics):
                raise not_mcap_error(name, head)
        yield piece


def iter_within_size_limit(max_bytes: int, pieces: Iterator[bytes], name: str) -> Iterator[bytes]:
    """Yield the pieces.

    Raises:
        InputError: They have more than `max_bytes` in all.
    """
    n_bytes = 0
    for piece in pieces:
        n_bytes += len(piece)
        if n_bytes > max_bytes:
            what = f"more than {max_bytes / BYTES_PER_GIGABYTE:g} GB were received"
            raise InputError(what, where=name, hint="--max-input reads more; a file has no such bound")
        yield piece


def spool_to_temporary_file(pieces: Iterable[bytes], name: str) -> InputFile:
    """Write pieces of bytes to a temporary file and return it.

    The file has no name on the disk, so that not even a killed run leaves it behind.

    Raises:
        InputError: There are no bytes, or as the pieces raise.
        OutputError: There is no room for it.
    """
    import tempfile

    try:
        with tempfile.TemporaryFile(prefix="cwcli-", suffix=".mcap") as spool:
            for piece in pieces:
                spool.write(piece)
            spool.flush()
            if not spool.tell():
                raise InputError("no data was received", where=name)
            return InputFile(os.dup(spool.fileno()), name)
    except OSError as error:
        raise OutputError(
            f"the temporary copy of {name} can't be written: {error.strerror}",
            where=tempfile.gettempdir(),
            hint="point TMPDIR to a folder with more room",
        ) from error


def _read_pipe_block(pipe: IO[bytes], name: str) -> bytes:
    try:
        return pipe.read(COPY_BLOCK_BYTES)
    except OSError as error:
        raise InputError(f"it can't be read: {error.strerror}", where=name) from error
