"""Reads bags and databases in a process of their own, which can take no more than its bounds.

The process (`cwcli.logs.read.reader_child`) gets the open files and a temporary file for the log that they become. It
is bounded in memory, processor time, the size of its files and their number, gives up the network where the system lets
it, and is killed with its parent. What it has written is then read and checked as any log.
"""

from __future__ import annotations

import json
import os
import secrets
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import IO, Any

from cwcli.errors import InputError, OutputError, UsageError
from cwcli.input import InputFile
from cwcli.logs.read.read_bounds import BYTES_PER_GIGABYTE, ReadBounds
from cwcli.logs.read.source_format import SourceFormat

MEMORY_BYTES = 128_000_000
"""Memory of the process beyond its start and one chunk (`--max-chunk`). Chosen by hand: ordinary bags take 40 MB."""
CPU_S, CPU_S_PER_MEGABYTE = 4, 8
"""Processor time of the process in seconds, and seconds more for each megabyte of the file. Chosen by hand: about a
hundred times what ordinary bags take."""
BYTES_PER_MEGABYTE = 1_000_000
"""The number of bytes in a megabyte."""
MAX_OPEN_FILES = 64
"""The greatest number of files that the process has open at once. Chosen by hand."""
MAX_ANSWER_BYTES = 16_000_000
"""The greatest size of what the process says of the file. Chosen by hand."""
MAX_NOTES = 100_000
"""The greatest number of notes on a file. Chosen by hand."""
ROOM_HINT = "point TMPDIR to a folder with more room"
"""The advice to a user whose temporary file can't be written."""


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
    cpu_s = CPU_S + CPU_S_PER_MEGABYTE * len(file) // BYTES_PER_MEGABYTE
    limits = {
        "memory": MEMORY_BYTES + bounds.max_chunk_bytes,
        "cpu": cpu_s,
        # a private copy of a database with its journals, and a log of what is in them
        "file": max(bounds.max_input_bytes, sum(map(len, (file, *(journals or ()))))) + BYTES_PER_MEGABYTE,
        "files": MAX_OPEN_FILES,
    }
    request: dict[str, Any] = {
        "format": source.name,
        "name": file.name,
        "file": file.descriptor,
        "journals": None if journals is None else [(each.descriptor, each.name) for each in journals],
        "target": target.fileno(),
        "folder": None,
        "parent": os.getpid(),
        "bounds": {each.name: getattr(bounds, each.name) for each in fields(bounds)},
        "limits": limits,
    }
    descriptors = [file.descriptor, target.fileno(), *(each.descriptor for each in journals or ())]
    # SQLite opens a database by its name: one without a name, or with a journal, is copied
    if journals is not None and (journals or type(file) is not InputFile):
        # the process makes the folder when it has seen that it still has a parent, which removes it
        request["folder"] = str(Path(tempfile.gettempdir()) / f"cwcli-{secrets.token_hex(8)}")
        try:
            code, answer = _run_child(request, descriptors)
        finally:
            shutil.rmtree(request["folder"], ignore_errors=True)
    else:
        code, answer = _run_child(request, descriptors)
    error = _error_of_child(code, answer, file.name, limits, bounds)
    if error is not None:
        raise error
    _take_answer(answer, source, file.name)


def _run_child(request: dict[str, Any], descriptors: Sequence[int]) -> tuple[int, dict[str, Any]]:
    """Run the process; return how it ended, and its answer, which is empty if it gave none.

    Raises:
        OutputError: No process can be started.
    """
    # it imports from where this process does, and not from the current folder, as `-c` alone would
    path = f"import sys; sys.path[:] = {sys.path!r}"
    code = f"{path}; from cwcli.logs.read.reader_child import serve_request; serve_request()"
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    try:
        process = subprocess.Popen(
            [sys.executable, "-c", code],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            pass_fds=descriptors,
            env=environment,
        )
    except OSError as error:
        raise OutputError(f"no process can be started to read it: {error.strerror}", where=request["name"]) from error
    with process:
        try:
            assert process.stdin is not None and process.stdout is not None
            try:
                process.stdin.write(json.dumps(request).encode())
                process.stdin.close()
            except BrokenPipeError:
                pass  # it has ended; how, is told below
            said = process.stdout.read(MAX_ANSWER_BYTES + 1)
        finally:
            if process.poll() is None:
                _wait_or_kill(process)
    try:
        answer = json.loads(said) if len(said) <= MAX_ANSWER_BYTES else None
    except (ValueError, RecursionError):
        answer = None
    return process.returncode, answer if isinstance(answer, dict) else {}


def _wait_or_kill(process: subprocess.Popen[bytes]) -> None:
    """Wait for a process that has closed its output; kill one that has not."""
    try:
        process.wait(1.0)
    except (subprocess.TimeoutExpired, KeyboardInterrupt):
        process.kill()


def _error_of_child(
    code: int, answer: dict[str, Any], name: str, limits: dict[str, int], bounds: ReadBounds
) -> InputError | OutputError | UsageError | None:
    """Return the error by which the process has ended; None if it has read the file."""
    told = answer.get("error")
    if code == 0 and isinstance(told, dict):
        return _error_of_answer(told, name, limits, bounds)
    if code == 0 and answer:
        return None
    if code == -getattr(signal, "SIGXCPU", 0):
        what = f"reading it takes more than the {limits['cpu']} s of processor time that a file of its size may take"
        return InputError(what, where=name, hint="it is damaged, or made to do harm")
    how = signal.Signals(-code).name if -code in set(signal.Signals) else f"code {code}"
    return InputError(
        f"the process that reads it ended with {how}", where=name, hint="it is damaged, or made to do harm"
    )


def _error_of_answer(
    told: dict[str, Any], name: str, limits: dict[str, int], bounds: ReadBounds
) -> InputError | OutputError | UsageError:
    kind = told.get("kind")
    if kind == "memory":
        what = f"reading it takes more than {limits['memory'] / BYTES_PER_MEGABYTE:,.0f} MB of memory"
        return InputError(what, where=name, hint="it is damaged, or --max-chunk allows more")
    if kind == "size":
        what = f"it becomes more than {bounds.max_input_bytes / BYTES_PER_GIGABYTE:g} GB"
        return InputError(what, where=name, hint="--max-input reads more")
    if kind == "system":
        number = told.get("errno")
        reason = os.strerror(number) if isinstance(number, int) else "unknown"
        return OutputError(f"{name} can't be converted: {reason}", where=tempfile.gettempdir(), hint=ROOM_HINT)
    what, where, hint = (str(told.get(each, "")) for each in ("what", "where", "hint"))
    return (UsageError if kind == "usage" else InputError)(what, where=where, hint=hint)


def _take_answer(answer: dict[str, Any], source: SourceFormat, name: str) -> None:
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
        and len(notes) <= MAX_NOTES
        and all(isinstance(each, int) for each in notes.values())
    )
    if not is_usable:
        raise InputError("the process that reads it gave no usable answer", where=name)
    for each in compressions:
        source.add_compression(each)
    source.n_chunks = n_chunks
    source.notes.update(notes)
