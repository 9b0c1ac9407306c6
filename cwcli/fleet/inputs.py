"""The logs of a run: files, folders, patterns and URLs."""

from __future__ import annotations

import glob
import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from cwcli.errors import InputError, OutputError, UsageError

FILE_SCHEME = "file://"
COPY_BYTES = 4 << 20


def is_remote(source: str) -> bool:
    """Whether a name is a URL of something that is not a file on this machine."""
    return "://" in source and not source.startswith(FILE_SCHEME)


def expand_sources(arguments: Sequence[str], results: Sequence[str] = ()) -> list[tuple[str, str]]:
    """Every log once, as (source, path): the name for people, and the absolute path or the URL.

    A folder stands for the logs (`*.mcap`) that lie right in it. Patterns (`*`, `?`, `[...]`, `**`) are expanded here
    where the shell has not done it. A file of that very name comes first. What is named twice, also through a link, is
    one log.

    Args:
        arguments: Files, folders, patterns and URLs.
        results: Folders that the run writes, and removes: a pattern or a folder passes by what lies in them.

    Raises:
        UsageError: A pattern matches nothing, a folder holds no log, a name is empty or lies in `results`, or a URL
            needs a package that is not installed.
        InputError: A folder can't be listed, or a remote store does not answer.
    """
    kept = [os.path.realpath(folder) + os.sep for folder in results]
    found: dict[str, tuple[str, str]] = {}
    for argument in arguments:
        named = {source: _path(source) for source in _expanded(argument)}
        outside = {source: path for source, path in named.items() if not path.startswith(tuple(kept))}
        if not outside:
            raise UsageError("the log lies in the output folder", where=argument, hint="name another folder with -d")
        for source, path in outside.items():
            found.setdefault(path, (source, path))
    return list(found.values())


def _path(source: str) -> str:
    return source if is_remote(source) else os.path.realpath(source.removeprefix(FILE_SCHEME))


def _expanded(argument: str) -> list[str]:
    if not argument:
        raise UsageError("the name of a log is empty", hint="is a variable of the shell not set?")
    if argument == "-":
        raise UsageError(
            "standard input holds one log; a run over many needs files", hint="leave -d away, or name files"
        )
    if is_remote(argument):
        return _expanded_remote(argument)
    plain = argument.removeprefix(FILE_SCHEME)
    if os.path.isdir(plain):  # noqa: PTH112 - a zero byte in the name is no error here
        return _in_folder(argument, Path(plain))
    if not glob.has_magic(plain) or os.path.lexists(plain):
        return [argument]
    matches = sorted(name for name in glob.glob(plain, recursive=True) if not Path(name).is_dir())  # noqa: PTH207
    if not matches:
        raise UsageError("no file matches", where=argument)
    return matches


def _in_folder(argument: str, folder: Path) -> list[str]:
    """The logs right in a folder, as a recording of rosbag2 has them."""
    try:
        names = sorted(each.name for each in folder.iterdir() if each.suffix.lower() == ".mcap" and each.is_file())
    except OSError as error:
        raise InputError(f"the folder can't be listed: {error.strerror}", where=argument) from error
    if names:
        return [f"{argument.rstrip('/')}/{name}" for name in names]
    deeper = f"{argument.rstrip('/')}/*/*.mcap"
    is_deeper = next(folder.glob("*/*.mcap"), None) is not None
    raise UsageError(
        "the folder holds no log (*.mcap)",
        where=argument,
        hint=f"some lie deeper: cwcli run '{deeper}'" if is_deeper else "name a file, a folder with logs, or a pattern",
    )


def _expanded_remote(url: str) -> list[str]:
    system, path = _file_system(f"{url}*.mcap" if url.endswith("/") else url)
    if not glob.has_magic(path):
        return [url]
    try:
        matches = sorted(name for name in system.glob(path) if not system.isdir(name))
    except Exception as error:  # each store has its own errors
        raise _unreadable(url, error) from error
    if not matches:
        raise UsageError("no file matches", where=url)
    return [str(system.unstrip_protocol(name)) for name in matches]


@contextmanager
def local_copy(url: str, folder: Path) -> Iterator[Path]:
    """A copy of a remote log, for as long as it is needed.

    Args:
        url: The log.
        folder: Where the copy lies meanwhile; it is made if it is not there.

    Raises:
        InputError: It can't be read.
        OutputError: The copy can't be written.
    """
    system, path = _file_system(url)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        descriptor, name = tempfile.mkstemp(suffix=".mcap", dir=folder)
    except OSError as error:
        raise OutputError(f"no copy of {url} can be written: {error.strerror}", where=str(folder)) from error
    copy = Path(name)
    try:
        with os.fdopen(descriptor, "wb") as target:
            for block in _blocks(system, path, url):
                try:
                    target.write(block)
                except OSError as error:
                    raise OutputError(
                        f"no copy of {url} can be written: {error.strerror}", where=str(folder)
                    ) from error
        yield copy
    finally:
        copy.unlink(missing_ok=True)


def _blocks(system: Any, path: str, url: str) -> Iterator[bytes]:
    try:
        with system.open(path, "rb") as remote:
            while block := remote.read(COPY_BYTES):
                yield block
    except GeneratorExit:
        raise
    except Exception as error:  # each store has its own errors
        raise _unreadable(url, error) from error


def _file_system(url: str) -> tuple[Any, str]:
    try:
        from fsspec.core import url_to_fs
    except ImportError as error:
        raise UsageError(
            "remote logs need a package that is not installed", where=url, hint="pip install 'cwcli[remote]'"
        ) from error
    try:
        system, path = url_to_fs(url)
    except (ImportError, ValueError) as error:  # the store's own package, or a scheme that nobody knows
        raise UsageError(
            str(error).splitlines()[0], where=url, hint="pip install 'cwcli[remote]' reads s3://"
        ) from error
    return system, str(path)


def _unreadable(url: str, error: Exception) -> InputError:
    reason = " ".join(str(error).split()) or type(error).__name__
    return InputError(f"it can't be read: {reason}", where=url)
