"""A file that is no log, imported into a temporary log for a command that reads logs."""

from __future__ import annotations

import os
import shlex
import tempfile
from pathlib import Path

from cwcli.errors import InputError
from cwcli.importing.bounded_import import import_files
from cwcli.importing.readers import find_kind_name
from cwcli.importing.tables import AmbiguousError, Answers
from cwcli.input import InputFile
from cwcli.logs.read.converted import ConvertedFile
from cwcli.logs.read.source_format import SourceFormat


def import_to_temporary_log(path: str) -> ConvertedFile | None:
    """Return the temporary log that a file becomes; None for what is of no kind that is known.

    Raises:
        AmbiguousError: Only the user knows how to read it.
        CwcliError: It is of a known kind and can't be imported.
    """
    try:
        kind = find_kind_name(path)
    except InputError:
        return None
    try:
        with tempfile.TemporaryDirectory(prefix="cwcli-") as folder:
            target = Path(folder) / "imported.mcap"
            import_files([path], Answers(), str(target))
            log = ConvertedFile(os.open(target, os.O_RDONLY), InputFile.open(path))
    except AmbiguousError as error:
        hint = f"cwcli import {shlex.quote(path)} -o log.mcap, with {error.hint}"
        raise AmbiguousError(error.what, where=error.where, found=error.found, hint=hint) from error
    log.source_format = SourceFormat(f"a file of the kind {kind}")
    return log
