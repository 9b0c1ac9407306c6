"""How much memory arrays take: what a long log needs beyond a bound lies in a file.

The states of twenty vehicles over two hours, what is predicted from them and how they met are gigabytes. They are
written once and read in order, so that the system's cache serves them as well from a disk. The file lies in the folder
for temporary files (TMPDIR), has no name, and is gone with the process, however that ends.
"""

from __future__ import annotations

import os
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from typing import Any

from cwcli.kernels import spill

MAX_LARGE_ARRAY_BYTES_IN_MEMORY = 128 << 20
"""Size of the large arrays that lie in memory before further ones go to the file, 128 MiB; chosen by hand."""
MAX_MAPPED_BYTES_OF_ARRAY_FILE = 64 << 20
"""Size of the pages of the large arrays' file that the process holds in memory, about 64 MiB; chosen by hand."""
MAX_ARRAY_FILE_BYTES = 1 << 40
"""Greatest size of the large arrays' file, 1 TiB; chosen by hand, since it takes only the disk space that is used."""
LARGE_ARRAY_FOLDER = "/var/tmp"
"""The folder of the file that holds large arrays where /tmp is in memory."""
_ARRAY_FILE_LOCK = threading.Lock()
"""The lock under which the file is opened."""


@contextmanager
def bounded_array_memory() -> Iterator[None]:
    """Bound the memory of this thread's arrays in the block, as `bound_array_memory_and_get_old_handler` does."""
    before = bound_array_memory_and_get_old_handler()
    try:
        yield
    finally:
        if before is not None:
            spill.use(before)


def bound_array_memory_and_get_old_handler() -> object | None:
    """Put large arrays of this thread into the file from now on, beyond `MAX_LARGE_ARRAY_BYTES_IN_MEMORY`.

    This does nothing outside of Linux, or without a folder on a disk whose file system has files without a name.

    Returns:
        The handler of arrays' memory that was used before; None where nothing is done.
    """
    with _ARRAY_FILE_LOCK:  # of the threads that begin together, one opens the file
        handler = _open_file_and_get_memory_handler()
    return None if handler is None else spill.use(handler)


@cache
def _open_file_and_get_memory_handler() -> Any:
    """Open the file and return the handler for arrays' memory; None where none can be had."""
    for folder in (tempfile.gettempdir, lambda: LARGE_ARRAY_FOLDER):
        with suppress(OSError, AttributeError):  # `gettempdir` finds none where no folder can be written
            descriptor = os.open(folder(), os.O_TMPFILE | os.O_RDWR | os.O_CLOEXEC, 0o600)
            handler = None
            if spill.is_on_disk(descriptor):
                handler = spill.spill_beyond(
                    descriptor, MAX_LARGE_ARRAY_BYTES_IN_MEMORY, MAX_MAPPED_BYTES_OF_ARRAY_FILE, MAX_ARRAY_FILE_BYTES
                )
            if handler is not None:
                return handler
            os.close(descriptor)
    return None
