"""Folders of an object store: copied to this machine, or written from here file by file."""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

from cwcli.errors import InputError, OutputError, UsageError
from cwcli.fleet.folder import ANNOTATED_LOG_NAME, LOG_ENTRY_FILE_NAME, LOGS_FOLDER, MANIFEST_NAME, RUN_TIMES_NAME
from cwcli.logs.read.remote import WEB_PREFIXES, file_system_and_path, iter_remote_blocks
from cwcli.logs.read.remote_errors import unreadable_url_error
from cwcli.output import make_folder, open_output
from cwcli.url import display_name_of_url

RUN_FILE_PATTERN = re.compile(
    r"(manifest\.json|run_times\.json|views\.sql|[^/]+\.parquet|(details|tables)/[^/]+\.parquet"
    r"|logs/[^/]+/(annotated\.mcap|entry\.json|tables\.arrows))"
)
"""Pattern of the files in the output folder of a run, by their paths in it (`cwcli.fleet.folder`)."""
WORKING_FOLDER_PREFIX = "cwcli-store-"
"""Beginning of the names of working folders in the folder for temporary files."""
_lock_by_working_folder: dict[Path, int | None] = {}
"""The descriptor that holds the lock of each working folder of this process."""
FILES_WRITTEN_LAST = (RUN_TIMES_NAME, MANIFEST_NAME)
"""Files of a run that say what the others hold, in the order in which they are sent after them."""


def copy_remote_folder(url: str, target: Path, is_wanted: Callable[[str], bool] = lambda name: True) -> None:
    """Copy the files below a URL of a store to a folder of this machine.

    Args:
        is_wanted: Tells by its path in the folder whether a file is copied.

    Raises:
        InputError: There are none, they can't be read, or one has a name that leads elsewhere.
        OutputError: They can't be written.
        UsageError: The URL is of the web, which has no folders, or it needs a package that is not installed.
    """
    system, base = _file_system_and_folder(url)
    names = list(_iter_names_below(system, base, url))
    if not names:
        raise InputError("there is no such folder", where=display_name_of_url(url))
    copy_remote_files(url, filter(is_wanted, names), target)


def copy_remote_files(url: str, names: Iterable[str], target: Path) -> None:
    """Copy files below a URL of a store, by their paths in the folder, to a folder of this machine.

    Raises:
        InputError: They can't be read.
        OutputError: They can't be written.
    """
    system, base = _file_system_and_folder(url)
    for name in names:
        _copy_remote_file(system, base + name, target / name)


def make_working_folder() -> Path:
    """Make a folder for copies of what lies in a store, and remove those that killed runs have left.

    Each is locked while its run lasts, so that an unlocked one is nobody's.

    Raises:
        OutputError: It can't be made.
    """
    for left in Path(tempfile.gettempdir()).glob(f"{WORKING_FOLDER_PREFIX}*"):
        lock = _lock_folder_or_none(left)
        if lock is not None:
            shutil.rmtree(left, ignore_errors=True)
            os.close(lock)
    try:
        folder = Path(tempfile.mkdtemp(prefix="cwcli-new-"))  # no other run removes it before it is locked
        lock = _lock_folder_or_none(folder)
        if lock is not None:
            folder = folder.rename(folder.with_name(WORKING_FOLDER_PREFIX + folder.name.removeprefix("cwcli-new-")))
        inner = folder / "run"  # which the run locks itself
        inner.mkdir()
        _lock_by_working_folder[inner] = lock
    except OSError as error:
        what = f"no working folder can be made: {error.strerror}"
        raise OutputError(what, where=tempfile.gettempdir(), hint="set TMPDIR to a folder with space") from error
    return inner


def remove_working_folder(folder: Path) -> None:
    """Remove a folder that `make_working_folder` has made, and its lock."""
    shutil.rmtree(folder.parent, ignore_errors=True)
    lock = _lock_by_working_folder.pop(folder, None)
    if lock is not None:
        os.close(lock)


def _lock_folder_or_none(folder: Path) -> int | None:
    """Lock a folder of this user; return the descriptor that holds the lock, or None where that can't be done."""
    try:
        import fcntl
    except ImportError:  # Windows
        return None
    try:
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    except OSError:
        return None
    try:
        if os.fstat(descriptor).st_uid != os.getuid():
            raise OSError
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:  # another run's, another user's, or a file system without locks
        os.close(descriptor)
        return None
    return descriptor


def _file_system_and_folder(url: str) -> tuple[Any, str]:
    """Return the file system of a URL (of fsspec), and the path of the folder in it with a slash at its end."""
    if url.startswith(WEB_PREFIXES):
        raise UsageError("a web server has no folders", where=display_name_of_url(url), hint="copy it to this machine")
    system, path = file_system_and_path(url)
    return system, path.rstrip("/") + "/"


def _iter_names_below(system: Any, base: str, url: str) -> Iterator[str]:
    """Yield the path of each file below a folder of a store, relative to the folder.

    Raises:
        InputError: They can't be listed, or one leads out of the folder.
    """
    try:
        names = [str(name) for name in system.find(base)]
    except Exception as error:  # each store has its own errors
        raise unreadable_url_error(url, error) from error
    for name in names:
        parts = name.removeprefix(base).split("/")
        if not name.startswith(base) or {"", ".", ".."} & {*parts} or any(set(each) & {"\\", "\0"} for each in parts):
            raise InputError(f"the name {name!r} leads out of the folder", where=display_name_of_url(url))
        yield "/".join(parts)


def _copy_remote_file(system: Any, name: str, target: Path) -> None:
    make_folder(target.parent, parents=True)
    with open_output(target, force=True, durable=False) as output:
        for block in iter_remote_blocks(system.unstrip_protocol(name)):
            output.write(block)


class _FileState(NamedTuple):
    """Size in bytes and time of the last change of a file on this machine, in ns."""

    n_bytes: int
    changed_ns: int


class StoreFolder:
    """The output folder of a run in an object store, with a working folder on this machine.

    The working folder begins with what the store has of earlier runs. Annotated logs, which no rerun reads, are stood
    for by empty files of their sizes. Files are sent whole, a log's entry after its other files and the manifest last,
    so that a run that was killed goes on where it was. A store has no locks: two runs must not write into one folder.

    Args:
        url: The folder in the store.

    Attributes:
        path: The working folder; it is there while the context lasts.

    Raises:
        OutputError: The store can't be read, or the working folder can't be written.
        UsageError: The URL is of the web, or needs a package that is not installed.
    """

    def __init__(self, url: str) -> None:
        self._url = url
        self._system, self._base = _file_system_and_folder(url)
        self._states: dict[str, _FileState] = {}
        self.path = Path()

    def __enter__(self) -> Self:
        self.path = make_working_folder()
        try:
            self._fetch_earlier_run()
        except BaseException as error:
            remove_working_folder(self.path)
            if isinstance(error, InputError):  # the store is where the results go, not an input
                raise OutputError(error.what, where=error.where, hint=error.hint) from error
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        remove_working_folder(self.path)

    def _fetch_earlier_run(self) -> None:
        """Fetch the files of an earlier run."""
        for name in _iter_names_below(self._system, self._base, self._url):
            if not RUN_FILE_PATTERN.fullmatch(name):
                continue
            own = self.path / name
            if own.name == ANNOTATED_LOG_NAME:
                self._make_empty_file_of_size(name, self._size_in_store(name))
            else:
                _copy_remote_file(self._system, self._base + name, own)
            self._states[name] = _file_state(own)

    def _size_in_store(self, name: str) -> int:
        """Return the size of a file in the store, in bytes."""
        try:
            return int(self._system.size(self._base + name))
        except Exception as error:  # each store has its own errors
            raise unreadable_url_error(self._url, error) from error

    def _make_empty_file_of_size(self, name: str, n_bytes: int) -> None:
        """Put an empty file of a size in the place of a file, sparse where the file system can."""
        own = self.path / name
        make_folder(own.parent, parents=True)
        own.unlink(missing_ok=True)
        own.touch()
        os.truncate(own, n_bytes)

    def send_log(self, id: str) -> None:
        """Send the changed files of a log, and free the space of its annotated log on this machine.

        Raises:
            OutputError: The store does not take them.
        """
        folder = f"{LOGS_FOLDER}/{id}/"
        entry = folder + LOG_ENTRY_FILE_NAME
        changed = [name for name in self._names_of_files_changed_since_sent() if name.startswith(folder)]
        if not changed and not self._names_of_files_no_longer_here(folder):
            return
        if entry in self._states:  # so that files of two runs never look like one
            self._remove_from_store(entry)
        self._send_files([*(name for name in changed if name != entry), entry])
        for name in self._names_of_files_no_longer_here(folder):
            self._remove_from_store(name)
        annotated = folder + ANNOTATED_LOG_NAME
        if annotated in changed:
            self._make_empty_file_of_size(annotated, self._states[annotated].n_bytes)
            self._states[annotated] = _file_state(self.path / annotated)

    def send_manifest(self) -> None:
        """Send the manifest alone, which shows at once whether the store takes it.

        Raises:
            OutputError: The store does not take it.
        """
        self._send_files([MANIFEST_NAME])

    def send_all(self) -> None:
        """Send all changed files, the manifest last, and remove from the store what the run has removed.

        Raises:
            OutputError: The store does not take them.
        """
        for id in sorted(
            {
                name.split("/")[1]
                for name in self._names_of_files_changed_since_sent()
                if name.startswith(f"{LOGS_FOLDER}/")
            }
        ):
            self.send_log(id)
        changed = self._names_of_files_changed_since_sent()
        last = [name for name in FILES_WRITTEN_LAST if name in changed]
        self._send_files([name for name in changed if name not in last])
        self._send_files(last)
        for name in self._names_of_files_no_longer_here(""):
            self._remove_from_store(name)

    def _names_of_files_changed_since_sent(self) -> list[str]:
        """List the files of the working folder that the store does not have as they are, sorted."""
        paths = (Path(folder) / name for folder, _, names in os.walk(self.path) for name in names)
        found = {path.relative_to(self.path).as_posix(): path for path in paths}
        return sorted(
            name
            for name, path in found.items()
            if RUN_FILE_PATTERN.fullmatch(name) and self._states.get(name) != _file_state(path)
        )

    def _names_of_files_no_longer_here(self, folder: str) -> list[str]:
        """List the files below a folder that the store has and the working folder has no longer."""
        return [name for name in self._states if name.startswith(folder) and not (self.path / name).is_file()]

    def _send_files(self, names: list[str]) -> None:
        for name in names:
            state = _file_state(self.path / name)
            try:
                self._system.put_file(str(self.path / name), self._base + name)
            except Exception as error:  # each store has its own errors
                raise self._unwritable_error(name, error) from error
            self._states[name] = state

    def _remove_from_store(self, name: str) -> None:
        try:
            self._system.rm_file(self._base + name)
        except FileNotFoundError:
            pass
        except Exception as error:  # each store has its own errors
            raise self._unwritable_error(name, error) from error
        del self._states[name]

    def _unwritable_error(self, name: str, error: Exception) -> OutputError:
        reason = unreadable_url_error(self._url, error)
        what = reason.what.removeprefix("it can't be read: ")
        where = f"{display_name_of_url(self._url).rstrip('/')}/{name}"
        hint = reason.hint or "the same command goes on where it was"
        return OutputError(f"it can't be written: {what}", where=where, hint=hint)


def _file_state(path: Path) -> _FileState:
    found = path.stat()
    return _FileState(found.st_size, found.st_mtime_ns)
