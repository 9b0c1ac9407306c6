"""The states of the logs' files: by them a later run knows, without reading a log, that it has not changed.

The hash of a log decides whether it is done again. It is not computed again where the file is, to the file system, the
one that was hashed: device, number (inode), size, time of the last change of its content, and time of its last change
of any kind, which no program can set. A copied, moved, linked or touched log has another state and is hashed again.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Mapping
from typing import Any, NamedTuple

INPUT_STATES_KEY = "inputs"
"""Key of `run_times.json` under which the states stand, because they differ from one machine to the next."""


class FileState(NamedTuple):
    """What the file system tells of a regular file; times are in ns since 1970.

    Attributes:
        device, inode: Which file it is.
        size_bytes: Its size.
        modified_ns: Last change of its content (mtime).
        changed_ns: Last change of its content, name or rights (ctime); on Windows, when it was created.
    """

    device: int
    inode: int
    size_bytes: int
    modified_ns: int
    changed_ns: int


def read_file_state(file: str | int) -> FileState | None:
    """Read the state of a file, by its path or its descriptor; None if it is no regular file or can't be read."""
    try:
        found = os.stat(file)  # noqa: PTH116 - it may be a descriptor, or a name with a zero byte
    except (OSError, ValueError):
        return None
    if not stat.S_ISREG(found.st_mode):
        return None
    return FileState(found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns)


def file_states_from_run_times(run_times: Mapping[str, Any] | None) -> dict[str, FileState]:
    """Take the states from the content of `run_times.json`, by id of the log; what is no state is left out."""
    recorded = (run_times or {}).get(INPUT_STATES_KEY)
    states = {}
    for id, values in recorded.items() if isinstance(recorded, dict) else ():
        is_state = isinstance(values, dict) and values.keys() == set(FileState._fields)
        if is_state and all(type(value) is int for value in values.values()):
            states[id] = FileState(**values)
    return states


def file_states_to_document(states: Mapping[str, FileState]) -> dict[str, dict[str, int]]:
    """Convert the states to the form of `run_times.json`, sorted by id."""
    return {id: state._asdict() for id, state in sorted(states.items())}
