"""The bounds of reading one log, which hold for every container."""

from __future__ import annotations

from cwcli.errors import InputError
from cwcli.input import MAX_CHUNK_BYTES, MAX_UNPACKED_TO_STORED_SIZE_RATIO, NO_LIMIT_BYTES, InputFile
from cwcli.lazy_dataclass import dataclass

BYTES_PER_GIGABYTE = 1_000_000_000
"""The number of bytes in a gigabyte, for messages to users."""
COPY_BLOCK_BYTES = 1 << 20
"""Bytes that are copied at a time. Chosen by hand."""
DEFAULT_MAX_INPUT_BYTES_OF_PIPE_OR_URL = 64 * BYTES_PER_GIGABYTE
"""The default limit of bytes read from a pipe or a URL (`--max-input`). Chosen by hand."""
MAX_HOLE_BYTES = BYTES_PER_GIGABYTE
"""The greatest size of holes that any file may have. Chosen by hand: to read and hash them takes a second or two."""
DEFAULT_TIMEOUT_S = 60.0
"""The default of `--timeout` in seconds. Chosen by hand: stores answer within seconds."""


@dataclass(frozen=True)
class ReadBounds:
    """What reading a log may cost.

    Attributes:
        max_chunk_bytes: Greatest size of a chunk or a message, stored or unpacked.
        max_input_bytes: Greatest number of bytes that come out of a pipe, a URL or a file of another format.
        max_ratio: A file may unpack to this many times its size, and `max_chunk_bytes` more.
        recover: Damage is counted and what is intact is read; else damage is an error.
        timeout_s: Longest time in seconds in which a remote file must go on.
    """

    max_chunk_bytes: int = MAX_CHUNK_BYTES
    max_input_bytes: int = DEFAULT_MAX_INPUT_BYTES_OF_PIPE_OR_URL
    max_ratio: float = MAX_UNPACKED_TO_STORED_SIZE_RATIO
    recover: bool = False
    timeout_s: float = DEFAULT_TIMEOUT_S

    def max_unpacked_bytes(self, n_bytes: int) -> int:
        """Return the number of bytes to which a file of `n_bytes` may unpack."""
        by_ratio = self.max_chunk_bytes + min(self.max_ratio * n_bytes, NO_LIMIT_BYTES)
        return int(min(by_ratio, max(self.max_input_bytes, n_bytes)))

    def refuse_holes(self, file: InputFile) -> None:
        """Refuse a file of holes, whose zeros take time, too.

        Raises:
            InputError: They are more than the file may unpack to.
        """
        n_bytes = len(file) - file.n_stored_bytes
        if n_bytes > MAX_HOLE_BYTES + self.max_ratio * file.n_stored_bytes:
            what = f"{n_bytes:,} of its {len(file):,} bytes are a hole"
            raise InputError(what, where=file.name, hint="--max-ratio reads more")


DEFAULT_READ_BOUNDS = ReadBounds()
"""The bounds of the command line's defaults."""
