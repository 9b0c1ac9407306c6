"""A file that is being written and has not got its name yet.

Linux knows files without a name: a killed run leaves nothing behind, and its space is free again. Elsewhere, and on
file systems that have none, it is a hidden file `.<name>.<random>.part` in the target's folder, which a killed run
leaves there.
"""

from __future__ import annotations

import os
import secrets
from contextlib import suppress
from pathlib import Path

MAX_CHARACTERS_OF_TARGET_FILE_NAME_IN_TEMPORARY_NAME = 200
"""Number of characters of the target's name in the hidden name. Chosen by hand: most file systems allow 255 bytes."""
NEW_FILE_PERMISSIONS = 0o666
"""Permissions of a new file (POSIX, rw for all), from which the system takes the user's umask away."""


class TemporaryFile:
    """A new file in the folder of its target, open for writing.

    Attributes:
        target: The name that it will get.
        descriptor: Open until the file is published or discarded.

    Raises:
        OSError: It can't be made.
    """

    def __init__(self, target: Path) -> None:
        self.target = target
        self._hidden = (
            target.parent
            / f".{target.name[:MAX_CHARACTERS_OF_TARGET_FILE_NAME_IN_TEMPORARY_NAME]}.{secrets.token_hex(4)}.part"
        )
        descriptor = _open_unnamed_file_or_none(target.parent)
        self._is_nameless = descriptor is not None
        if descriptor is None:
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_CLOEXEC", 0)
            descriptor = os.open(self._hidden, flags, NEW_FILE_PERMISSIONS)
        self.descriptor = descriptor

    def publish(self) -> None:
        """Give the file its name, by a rename that replaces a file of that name.

        Raises:
            OSError: It could not be renamed, and was removed.
        """
        try:
            if self._is_nameless:
                # a directory descriptor makes Python call `linkat`, which follows the link in /proc
                os.link(_proc_path_of_descriptor(self.descriptor), self._hidden, src_dir_fd=self.descriptor)
                self._is_nameless = False
            os.close(self.descriptor)
            self.descriptor = -1
            self._hidden.replace(self.target)
        except BaseException:
            self.discard()
            raise

    def discard(self) -> None:
        """Close and remove the file unless it was published."""
        if self.descriptor >= 0:
            with suppress(OSError):
                os.close(self.descriptor)
            self.descriptor = -1
        if not self._is_nameless:
            with suppress(OSError):
                self._hidden.unlink()


def _open_unnamed_file_or_none(folder: Path) -> int | None:
    """Open a file without a name and return its descriptor; None where the system has no such files."""
    flag = getattr(os, "O_TMPFILE", None)
    if flag is None:
        return None
    try:
        descriptor = os.open(folder, flag | os.O_WRONLY | os.O_CLOEXEC, NEW_FILE_PERMISSIONS)
    except OSError:
        return None  # what is really wrong comes out with the hidden file
    if not os.path.exists(_proc_path_of_descriptor(descriptor)):  # noqa: PTH110 - the link itself is meant
        os.close(descriptor)
        return None
    return descriptor


def _proc_path_of_descriptor(descriptor: int) -> str:
    """Return the link in /proc that stands for an open file."""
    return f"/proc/self/fd/{descriptor}"
