"""Reads bags and databases in a process of their own, which can take no more than its bounds.

The process (`cwcli.bounded_process`) gets the open files and a temporary file for the log that they become. What it has
written is then read and checked as any log.
"""

from __future__ import annotations

import secrets
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import IO, Any

from cwcli.bounded_process import BYTES_PER_MEGABYTE, Limits, cpu_limit_for_file_size_s, run_bounded
from cwcli.errors import InputError
from cwcli.input import InputFile
from cwcli.logs.read.read_bounds import ReadBounds
from cwcli.logs.read.source_format import SourceFormat

CONVERSION_FUNCTION = "cwcli.logs.read.reader_child:convert_file_of_request"
"""The function that the process runs."""
MAX_PROCESS_MEMORY_BEYOND_START_AND_CHUNK_BYTES = 128_000_000
"""Memory of the process beyond its start and one chunk (`--max-chunk`). Chosen by hand: ordinary bags take 40 MB."""
MAX_LOG_TO_FILE_SIZE_RATIO = 1.5
"""Greatest size of the log as a multiple of the file's, where that is more than `--max-input`. Chosen by hand: a
message takes 47 bytes more than its payload, and in a database less."""
MAX_NOTES_ON_FILE = 100_000
"""The greatest number of notes on a file. Chosen by hand."""


def convert_in_process(
    file: InputFile,
    source: SourceFormat,
    journals: Sequence[InputFile] | None,
    bounds: ReadBounds,
    target: IO[bytes],
) -> None:
    """Write a bag or a database as a log, in a process of its own.

    Args:
        file: The bag or database.
        source: Gets the compressions, the number of chunks, and what could not be read.
        journals: The journals of a database; None for a bag of ROS 1.
        bounds: What it may cost.
        target: A file on the disk.

    Raises:
        InputError: It can't be read, or takes more than its bounds.
        OutputError: There is no room for the log.
        UsageError: A package is not installed.
    """
    # a private copy of a database with its journals, and a log of what is in them
    n_bytes = sum(map(len, (file, *(journals or ()))))
    most_bytes = int(max(bounds.max_input_bytes, MAX_LOG_TO_FILE_SIZE_RATIO * n_bytes)) + BYTES_PER_MEGABYTE
    limits = Limits(
        cpu_limit_for_file_size_s(file.n_stored_bytes),
        most_bytes,
        address_bytes=MAX_PROCESS_MEMORY_BEYOND_START_AND_CHUNK_BYTES + bounds.max_chunk_bytes,
    )
    request: dict[str, Any] = {
        "format": source.name,
        "name": file.name,
        "file": file.descriptor,
        "journals": None if journals is None else [(each.descriptor, each.name) for each in journals],
        "target": target.fileno(),
        "stored_bytes": file.n_stored_bytes,
        "most_bytes": most_bytes,
        "bounds": {each.name: getattr(bounds, each.name) for each in fields(bounds)},
    }
    descriptors = [file.descriptor, target.fileno(), *(each.descriptor for each in journals or ())]
    # SQLite opens a database by its name: one without a name, or with a journal, is copied
    folder = None
    if journals is not None and (journals or type(file) is not InputFile):
        # the process makes the folder when it has seen that it still has a parent, which removes it
        folder = str(Path(tempfile.gettempdir()) / f"cwcli-{secrets.token_hex(8)}")
    try:
        answer = run_bounded(CONVERSION_FUNCTION, request, limits, file.name, descriptors=descriptors, folder=folder)
    finally:
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)
    _store_checked_answer_in_source_format(answer, source, file.name)


def _store_checked_answer_in_source_format(answer: dict[str, Any], source: SourceFormat, name: str) -> None:
    """Take over what the process says of the file, after a check of its form.

    Raises:
        InputError: It has another form.
    """
    compressions: Any = answer.get("compressions")
    n_chunks: Any = answer.get("n_chunks")
    notes: Any = answer.get("notes")
    is_usable = (
        isinstance(compressions, list)
        and all(isinstance(each, str) for each in compressions)
        and isinstance(n_chunks, int)
        and isinstance(notes, dict)
        and len(notes) <= MAX_NOTES_ON_FILE
        and all(isinstance(each, int) for each in notes.values())
    )
    if not is_usable:
        raise InputError("the process that reads it gave no usable answer", where=name)
    for each in compressions:
        source.add_compression(each)
    source.n_chunks = n_chunks
    source.notes.update(notes)
