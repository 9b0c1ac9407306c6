"""What the process that reads a bag or a database does: it converts the file to MCAP, and says what was in it.

See `cwcli.logs.read.reader_process`, which starts it.
"""

from __future__ import annotations

import errno
import os
from typing import Any

from cwcli.errors import InputError, OutputError
from cwcli.input import InputFile
from cwcli.logs.read.bags import convert_bag
from cwcli.logs.read.read_bounds import BYTES_PER_GIGABYTE, ReadBounds
from cwcli.logs.read.source_format import SourceFormat


def convert_file_of_request(request: dict[str, Any]) -> dict[str, Any]:
    """Convert a file to MCAP; return its compressions, its number of chunks, and what could not be read.

    Raises:
        CwcliError: As `convert_bag`.
        OSError: The log can't be written.
    """
    source = SourceFormat(request["format"])
    file = InputFile(request["file"], request["name"])
    file.n_stored_bytes = request["stored_bytes"]
    journals = None
    if request["journals"] is not None:
        journals = [InputFile(descriptor, name) for descriptor, name in request["journals"]]
    bounds = ReadBounds(**request["bounds"])
    try:
        with os.fdopen(request["target"], "wb", closefd=False) as target:
            convert_bag(file, source, journals, bounds, target)
    except (OutputError, OSError) as error:
        cause = error if isinstance(error, OSError) else error.__cause__
        if not isinstance(cause, OSError):
            cause = OSError(errno.EIO, "")
        if cause.errno == errno.EFBIG and os.fstat(request["target"]).st_size >= request["most_bytes"]:
            what = f"it becomes more than {bounds.max_input_bytes / BYTES_PER_GIGABYTE:g} GB"
            raise InputError(what, where=file.name, hint="--max-input reads more") from error
        raise cause from None
    return {"compressions": source.compressions, "n_chunks": source.n_chunks, "notes": source.notes}
