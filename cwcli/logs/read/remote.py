"""Logs that are not on this machine: what their URLs stand for, and their bytes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from cwcli.errors import InputError, UsageError, install_hint

FILE_SCHEME = "file://"
COPY_BYTES = 4 << 20


def is_remote(source: str) -> bool:
    """Whether a name is a URL of something that is not a file on this machine."""
    return "://" in source and not source.startswith(FILE_SCHEME)


def names_below(url: str) -> list[str]:
    """The names of the files right below a URL; none where it is no folder.

    Raises:
        InputError: The store does not answer, or knows no such bucket.
        UsageError: It needs a package that is not installed.
    """
    system, path = file_system(url)
    try:
        if not url.endswith("/") and system.isfile(path):
            return []
        found = system.ls(path.rstrip("/"), detail=True)
    except NotADirectoryError:
        return []
    except Exception as error:  # each store has its own errors
        raise unreadable(url, error) from error
    return [str(each["name"]).rpartition("/")[2] for each in found if each.get("type") == "file"]


def blocks(url: str) -> Iterator[bytes]:
    """The bytes of a remote file, piece by piece.

    Raises:
        InputError: It can't be read.
        UsageError: It needs a package that is not installed.
    """
    system, path = file_system(url)
    try:
        with system.open(path, "rb") as remote:
            while block := remote.read(COPY_BYTES):
                yield block
    except GeneratorExit:
        raise
    except Exception as error:  # each store has its own errors
        raise unreadable(url, error) from error


def file_system(url: str) -> tuple[Any, str]:
    """The store of a URL, and what it calls the file.

    Raises:
        UsageError: It needs a package that is not installed.
    """
    try:
        from fsspec.core import url_to_fs
    except ImportError as error:
        raise UsageError(
            "remote logs need a package that is not installed", where=url, hint=install_hint("remote")
        ) from error
    try:
        system, path = url_to_fs(url)
    except (ImportError, ValueError) as error:  # the store's own package, or a scheme that nobody knows
        raise UsageError(str(error).splitlines()[0], where=url, hint=f"{install_hint('remote')} reads s3://") from error
    return system, str(path)


def unreadable(url: str, error: Exception) -> InputError:
    """The error that a URL can't be read, for the store's reason."""
    reason = " ".join(str(error).split()) or type(error).__name__
    if isinstance(error, FileNotFoundError) and reason.rpartition("/")[2] == url.rstrip("/").rpartition("/")[2]:
        why = " ".join(str(error.__cause__ or "").split())
        reason = f"there is no such file{f' ({why})' if why else ''}"
    return InputError(f"it can't be read: {reason}", where=url)
