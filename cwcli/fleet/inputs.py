"""The logs of a run: files, folders, patterns and URLs."""

from __future__ import annotations

import glob
import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from cwcli.errors import OutputError, UsageError
from cwcli.input import RealPaths
from cwcli.logs.read.read_bounds import ReadBounds
from cwcli.logs.read.recording import METADATA_FILE_NAME, is_recording_folder, log_names_in_folder, names_of_entries
from cwcli.logs.read.remote import (
    FILE_SCHEME,
    file_names_below_url,
    file_system_and_path,
    is_remote_url,
)
from cwcli.logs.read.remote_errors import unreadable_url_error
from cwcli.logs.read.source import iter_remote_log
from cwcli.url import display_name_of_url, path_of_url


def expand_sources(arguments: Sequence[str], results: Sequence[str] = ()) -> list[tuple[str, str]]:
    """Expand arguments to the logs they name, each once, as (name to show, absolute path or full URL).

    A folder with a recorder's metadata.yaml is one log; another one stands for the logs that lie right in it. Patterns
    (`*`, `?`, `[...]`, `**`) are expanded here where the shell has not done it. A file of that very name comes first.
    A log that is named twice, also through a link or with two signatures of one URL, counts once.

    Args:
        results: Folders that the run writes and removes; patterns and folders skip the files in them.

    Raises:
        UsageError: A pattern matches nothing, a folder holds no log, a name is empty or lies in `results`, or a URL
            needs a package that is not installed.
        InputError: A folder can't be listed, or a remote store does not answer.
    """
    result_folders = [os.path.realpath(folder) + os.sep for folder in results]
    found: dict[str, tuple[str, str]] = {}
    real_paths = RealPaths()
    for argument in arguments:
        named = {
            source: source if is_remote_url(source) else real_paths.resolve(source.removeprefix(FILE_SCHEME))
            for source in _expand_argument(argument)
        }
        outside = {source: path for source, path in named.items() if not path.startswith(tuple(result_folders))}
        if not outside:
            raise UsageError("the log is in the output folder", where=argument, hint="name another folder with -d")
        for source, path in outside.items():
            name = display_name_of_url(source) if is_remote_url(source) else source
            found.setdefault(name if is_remote_url(source) else path, (name, path))
    return list(found.values())


def _expand_argument(argument: str) -> list[str]:
    if not argument:
        raise UsageError("the name of a log is empty", hint="is a variable of the shell not set?")
    if argument == "-":
        raise UsageError(
            "standard input holds one log; a run over many needs files", hint="leave -d away, or name files"
        )
    if is_remote_url(argument):
        return _expand_remote_pattern(argument)
    plain = argument.removeprefix(FILE_SCHEME)
    if os.path.isdir(plain):  # noqa: PTH112 - a zero byte in the name is no error here
        return _logs_in_folder(argument, Path(plain))
    if not glob.has_magic(plain) or os.path.lexists(plain):
        return [argument]
    matches = sorted(name for name in glob.glob(plain, recursive=True) if _is_log_path(Path(name)))  # noqa: PTH207
    if not matches:
        raise UsageError("no file matches", where=argument)
    return matches


def _is_log_path(path: Path) -> bool:
    return not path.is_dir() or is_recording_folder(path)


def _logs_in_folder(argument: str, folder: Path) -> list[str]:
    """List the logs of a folder: itself if it is one log, else the log files and log folders directly in it."""
    if is_recording_folder(folder):
        return [argument]
    names = log_names_in_folder(folder)
    names += [each for each in names_of_entries(folder, os.DirEntry.is_dir) if is_recording_folder(folder / each)]
    names.sort()
    if names:
        return [f"{argument.rstrip('/')}/{name}" for name in names]
    deeper = f"{argument.rstrip('/')}/*/*.mcap"
    is_deeper = next(folder.glob("*/*.mcap"), None) is not None
    raise UsageError(
        "the folder holds no log (*.mcap)",
        where=argument,
        hint=f"some lie deeper: cwcli run '{deeper}'" if is_deeper else "name a file, a folder with logs, or a pattern",
    )


def _expand_remote_pattern(url: str) -> list[str]:
    if url.endswith("/") and METADATA_FILE_NAME in file_names_below_url(url):
        return [url]
    system, path = file_system_and_path(f"{url}*.mcap" if url.endswith("/") else url)
    if not glob.has_magic(path_of_url(url) if not url.endswith("/") else path):
        return [url]
    try:
        matches = sorted(name for name in system.glob(path) if not system.isdir(name))
    except Exception as error:  # each store has its own errors
        raise unreadable_url_error(url, error) from error
    if not matches:
        parent = url[: url.index(next(each for each in url if each in "*?["))].rpartition("/")[0]
        try:
            system.ls(file_system_and_path(f"{parent}/")[1])
        except Exception as error:
            if "bucket" in str(error).lower():  # otherwise only the folder is missing: nothing matches
                raise unreadable_url_error(url, error) from error
        raise UsageError("no file matches", where=url)
    return [str(system.unstrip_protocol(name)) for name in matches]


@contextmanager
def temporary_local_copy(url: str, folder: Path, bounds: ReadBounds) -> Iterator[Path]:
    """Copy a remote log to a temporary file that is removed when the context ends.

    Args:
        folder: Where the copy lies meanwhile; it is made if it is not there.

    Raises:
        InputError: It can't be read, is no log, or is larger.
        OutputError: The copy can't be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        descriptor, name = tempfile.mkstemp(suffix=".mcap", dir=folder)
    except OSError as error:
        raise OutputError(f"no copy of {url} can be written: {error.strerror}", where=str(folder)) from error
    copy = Path(name)
    try:
        with os.fdopen(descriptor, "wb") as target:
            for block in iter_remote_log(url, bounds, display_name_of_url(url)):
                try:
                    target.write(block)
                except OSError as error:
                    raise OutputError(
                        f"no copy of {url} can be written: {error.strerror}", where=str(folder)
                    ) from error
        yield copy
    finally:
        copy.unlink(missing_ok=True)
