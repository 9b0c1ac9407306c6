def is_on_disk(fd: int) -> bool:
    """Whether a file's pages are on a disk: not on tmpfs or ramfs, whose files are memory. False but on Linux."""

def spill_beyond(fd: int, bound_bytes: int, most_mapped_bytes: int, capacity_bytes: int) -> object | None:
    """A handler for the memory of NumPy's arrays, to be used by `use`; once in a process.

    Args:
        fd: Of the file, open as long as the process lives.
        bound_bytes: Of large arrays that lie in memory.
        most_mapped_bytes: Of the file's pages that the process holds, about.
        capacity_bytes: Of the file, at most.

    Returns:
        The handler; None where NumPy or the system lets none.
    """

def use(capsule: object) -> object:
    """Let the arrays that this thread makes from now on have their memory from a handler; returns the one before."""

def counts() -> dict[str, int]:
    """Bytes: held in memory by large arrays, in_file, most_in_file (at a time), file (its size), unused (of it)."""
