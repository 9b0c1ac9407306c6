"""Where results go: a file that appears whole or not at all, or standard output.

A file is written without a name, or under a hidden one, in the target's folder (`cwcli.temporary`), flushed to the disk
and renamed. A killed run never leaves one under the target's name. Devices and named pipes are written directly.

No target is a file that the run reads (`cwcli.input`), under whatever name, and a file gets its name only if the logs
that are read are still what they were. Everything that cwcli writes goes through here.
"""

from __future__ import annotations

import errno
import os
import stat
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from functools import partial
from pathlib import Path

from cwcli.errors import OutputError, UsageError
from cwcli.input import InputFile, check_unchanged, is_input_of_run, remember_input_file
from cwcli.output_stream import Bytes, OutputStream, translate_os_errors
from cwcli.temporary import TemporaryFile

PLOT_FILE_FORMATS = ("png", "svg")
"""The formats in which plots are written, by the ending of their files."""
STDOUT = "-"
"""The target that stands for standard output."""
NO_SUCH_FILE_ERRNOS = (errno.ENOENT, errno.ENOTDIR, errno.EBADF, errno.ELOOP)
"""Error numbers of the operating system for a path at which there is no file."""


def refuse_unwritable_target(target: str | Path, *, force: bool = False) -> None:
    """Refuse a target that can't or must not be written, before any work is done.

    Args:
        target: File name, or `-` for standard output.
        force: Allow a file that exists, unless it is an input of this run.

    Raises:
        OutputError: It is a directory, exists, is an input, or its folder is missing or not writable.
        UsageError: It is a URL, or standard output is a terminal.
    """
    if str(target) == STDOUT:
        _stdout_descriptor()
    else:
        _real_path_and_whether_device(target, force=force, inputs=())


def refuse_unwritable_targets(
    files: Sequence[str | Path | None],
    folders: Sequence[str | Path | None] = (),
    *,
    force: bool = False,
    inputs: Sequence[str] = (),
) -> None:
    """Refuse targets that a command can't or must not write, before any work is done; `None` is skipped.

    Args:
        files: As in `refuse_unwritable_target`.
        folders: Folders that exist, or that `make_folder` can make.
        force: Allow files that exist, unless they are inputs of this run.
        inputs: Files that the command will read: names, or `-` for standard input.

    Raises:
        OutputError: One can't or must not be written.
        UsageError: Two are the same file, one is a URL, or standard output is a terminal.
    """
    for each in inputs:
        remember_input_file(each)
    places: set[object] = set()
    for check, targets in (
        (partial(refuse_unwritable_target, force=force), files),
        (_refuse_folder_that_cannot_be_made, folders),
    ):
        for target in targets:
            if target is not None:
                check(target)
                place = _identity_of_file_or_path(target)
                if place in places:
                    raise UsageError("two outputs are the same file", where=str(target), hint="name another one")
                places.add(place)


def _identity_of_file_or_path(target: str | Path) -> object:
    """Return a value that is equal for all names of one file."""
    with suppress(OSError):
        found = os.fstat(_stdout_descriptor()) if str(target) == STDOUT else Path(target).stat()
        return found.st_dev, found.st_ino
    return os.path.realpath(target)


def _refuse_url(name: str) -> None:
    """Refuse a URL, which would become folders whose names hold its password."""
    if "://" in name:
        raise UsageError("the output must lie on this machine", where=name, hint="copy it there afterwards")


def _refuse_folder_that_cannot_be_made(folder: str | Path) -> None:
    """Refuse a folder that neither exists nor can be made; raise `OutputError` or `UsageError`."""
    _refuse_url(str(folder))
    path = Path(folder)
    try:
        path.stat()
    except FileNotFoundError:
        pass
    except (OSError, ValueError) as error:
        raise _folder_creation_error(path, error) from error
    if path.exists() and not path.is_dir():
        raise OutputError("it is not a folder", where=str(path))
    if not path.absolute().parent.is_dir():
        raise OutputError(f"the folder {path.parent} does not exist", where=str(path), hint="create it first")


def make_folder(path: str | Path, *, parents: bool = False) -> None:
    """Make a folder unless it exists, with `parents` also those above it.

    Raises:
        OutputError: It can't be made.
    """
    try:
        Path(path).mkdir(parents=parents, exist_ok=True)
    except (OSError, ValueError, RecursionError) as error:  # a zero byte in the name; a thousand folders in each other
        raise _folder_creation_error(path, error) from error


def _folder_creation_error(path: str | Path, error: Exception) -> OutputError:
    return OutputError(f"the folder can't be made: {getattr(error, 'strerror', None) or error}", where=str(path))


def _real_path_and_whether_device(target: str | Path, *, force: bool, inputs: Sequence[InputFile]) -> tuple[Path, bool]:
    """Return a target's real path, and whether it is a device or a pipe; raise as `refuse_unwritable_target`."""
    name = str(target)
    _refuse_url(name)
    try:
        with translate_os_errors(name):
            path = Path(os.path.realpath(target))
            return path, _refuse_unwritable_path_and_tell_if_device(path, name, force, inputs)
    except ValueError as error:  # a zero byte in the name
        raise OutputError(str(error), where=name) from error


def _refuse_unwritable_path_and_tell_if_device(path: Path, name: str, force: bool, inputs: Sequence[InputFile]) -> bool:
    """Refuse a path that must not be written; return whether it is a device, a pipe or a socket."""
    found = _stat_or_none(path)
    mode = None if found is None else found.st_mode
    if found is not None and is_input_of_run(found, inputs):
        raise OutputError("the output is the input itself", where=name, hint="name another file")
    if (mode is not None and stat.S_ISDIR(mode)) or name.endswith(os.sep):
        raise OutputError("the output is a directory", where=name, hint="name a file with -o")
    if mode is not None and not stat.S_ISREG(mode):
        return True
    if not path.parent.is_dir():
        raise OutputError(f"the folder {Path(name).parent} does not exist", where=name, hint="create it first")
    if mode is not None and not force:
        raise OutputError("the file exists", where=name, hint="name another file, or overwrite it with --force")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise OutputError(f"the folder {Path(name).parent} is not writable", where=name)
    return False


def _stat_or_none(path: Path) -> os.stat_result | None:
    """Return the status of a file; None if it does not exist."""
    try:
        return path.stat()
    except OSError as error:
        if error.errno in NO_SUCH_FILE_ERRNOS:
            return None
        raise


class AtomicGroup:
    """Files that appear together: none of them has its name before all are written and the block ends without an error.

    with AtomicGroup() as together:
        write_file("a.csv", data, together=together)
        write_file("b.csv", data, together=together)
    """

    def __init__(self) -> None:
        self._files: list[tuple[TemporaryFile, Callable[[], object], bool]] = []

    def __enter__(self) -> AtomicGroup:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        try:
            if error is None:
                self._check_all_then_publish_each()
        finally:
            for file, _, _ in self._files:
                file.discard()

    def add_written_file(self, file: TemporaryFile, check: Callable[[], object], *, durable: bool) -> None:
        """Add a file that is completely written.

        Args:
            file: The file, which has no name yet.
            check: Raises if the target must not be written after all.
            durable: Sync the folder, so that the name survives a loss of power.
        """
        if file.target in {known.target for known, _, _ in self._files}:
            raise AssertionError(f"two files are to get the name {file.target}")
        self._files.append((file, check, durable))

    def _check_all_then_publish_each(self) -> None:
        """Check every target, then give each file its name."""
        for _, check, _ in self._files:
            check()
        while self._files:
            file, _, durable = self._files[0]
            with translate_os_errors(str(file.target)):
                file.publish()
            del self._files[0]
            if durable:
                _sync_folder(file.target.parent)


@contextmanager
def open_output(
    target: str | Path,
    *,
    force: bool = False,
    inputs: Sequence[InputFile] = (),
    durable: bool = True,
    together: AtomicGroup | None = None,
) -> Iterator[OutputStream]:
    """Open a target for binary writing; the file appears under its name when the block ends without an error.

    Args:
        target, force: As in `refuse_unwritable_target`.
        inputs: Open files that are no part of a run (`cwcli.input.remember_inputs`) but must not be overwritten, nor
            change.
        durable: Wait until the file is on the disk. Without, it is whole whatever happens to the process, but may not
            survive a loss of power.
        together: The file appears together with the others of this group instead.

    Raises:
        OutputError, UsageError: As in `refuse_unwritable_target`, or the medium fails (no space, input/output error).
        InputError: A log that is read changed meanwhile.
        BrokenPipeError: Nobody reads standard output any more.
    """
    if str(target) == STDOUT:
        output = OutputStream(_stdout_descriptor(inputs), "<stdout>")
        yield output
        output.flush()
        return
    path, is_special = _real_path_and_whether_device(target, force=force, inputs=inputs)
    if is_special:  # a device, a pipe or a socket can't be replaced by a file
        with _open_device_or_pipe(path, str(target)) as output:
            yield output
        return
    with nullcontext(together) if together is not None else AtomicGroup() as group:
        with _write_temporary_file(path, str(target), durable=durable) as (file, output):
            yield output

        def check_target_and_inputs() -> None:
            _real_path_and_whether_device(target, force=force, inputs=inputs)
            check_unchanged(inputs)

        group.add_written_file(file, check_target_and_inputs, durable=durable)


@contextmanager
def _open_device_or_pipe(path: Path, name: str) -> Iterator[OutputStream]:
    """Open a device, a pipe or a socket, which gets the bytes at once."""
    with translate_os_errors(name):
        descriptor = os.open(path, os.O_WRONLY | getattr(os, "O_CLOEXEC", 0))
    try:
        output = OutputStream(descriptor, name)
        yield output
        output.flush()
    finally:
        os.close(descriptor)


@contextmanager
def _write_temporary_file(path: Path, name: str, *, durable: bool) -> Iterator[tuple[TemporaryFile, OutputStream]]:
    """Open a temporary file; it is complete when the block ends without an error, and removed otherwise."""
    with translate_os_errors(name):
        file = TemporaryFile(path)
    output = OutputStream(file.descriptor, name, works_aside=True)
    try:
        try:
            if durable:
                output.sync_in_background()
            yield file, output
            output.sync() if durable else output.flush()
        finally:
            output.wait_until_idle()
    except BaseException:
        file.discard()
        raise


def write_file(
    target: str | Path,
    data: Bytes,
    *,
    force: bool = False,
    together: AtomicGroup | None = None,
) -> None:
    """Write a whole file at once.

    Raises:
        As `open_output`.
    """
    with open_output(target, force=force, together=together) as output:
        output.write(data)


def _stdout_descriptor(inputs: Sequence[InputFile] = ()) -> int:
    """Return the descriptor of standard output; refuse a terminal and a file that the run reads."""
    try:
        sys.stdout.flush()
        descriptor = sys.stdout.fileno()
    except (AttributeError, OSError, ValueError) as error:
        raise OutputError("standard output is closed", where="<stdout>") from error
    if os.isatty(descriptor):
        raise UsageError(
            "refusing to write binary data to the terminal", hint="name a file with -o, or send it into a pipe"
        )
    if is_input_of_run(os.fstat(descriptor), inputs):
        raise OutputError("the output goes into the input itself", where="<stdout>", hint="write to another file")
    return descriptor


def _sync_folder(folder: Path) -> None:
    """Sync a folder, so that a rename survives a loss of power; file systems that can't are passed over."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
