"""Runs a function in a process of its own that can take no more than its bounds.

What reads files of strangers by a large library is run in such a process: bags, databases, files for `cwcli import`,
the first look at a net. It is bounded in memory, processor time, the size of its files and their number, gives up the
network where the system lets it, and is killed with its parent (`cwcli.bounded_child`). It gets a request and gives an
answer, both of JSON; what it answers is checked by the one who asked.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from typing import Any

from cwcli.errors import CwcliError, DataError, InputError, MissingSignalError, OutputError, UsageError
from cwcli.lazy_dataclass import dataclass

BYTES_PER_MEGABYTE = 1_000_000
"""The number of bytes in a megabyte."""
MAX_PROCESS_ANSWER_BYTES = 16_000_000
"""The greatest size of what the process answers. Chosen by hand."""
MAX_WAIT_AFTER_OUTPUT_CLOSES_S = 30.0
"""Seconds in which a process that has closed its output must end. Chosen by hand, for a busy machine."""
MAX_OPEN_FILES = 64
"""The greatest number of files that the process has open at once. Chosen by hand."""
BASE_CPU_TIME_LIMIT_S, CPU_TIME_LIMIT_PER_FILE_MEGABYTE_S = 4, 8
"""Processor time of the process in seconds, and seconds more for each megabyte of the file. Chosen by hand: about a
hundred times what ordinary bags take."""
DISK_SPACE_HINT = "point TMPDIR to a folder with more room"
"""The advice to a user whose temporary file can't be written."""
DAMAGED_OR_HARMFUL_FILE_HINT = "it is damaged, or made to do harm"
"""The advice to a user whose file takes more than it may, or ends the process that reads it."""
KEPT_MEMORY_SETTINGS = {"MALLOC_MMAP_THRESHOLD_": str(4 << 20), "MALLOC_TRIM_THRESHOLD_": str(16 << 20)}
"""Settings of glibc's malloc, in bytes, for every such process: it keeps freed blocks below 4 MiB for the next ones, up
to 16 MiB of them. Chosen by hand for bags and databases, where a chunk and its compressed bytes are 1 MB each: to get
them from the system again took a quarter of the time in which a database of pictures is converted. Imports and nets
run with the same settings."""
ERROR_CLASS_BY_NAME: dict[str, type[CwcliError]] = {
    each.__name__: each for each in (InputError, UsageError, DataError, MissingSignalError, OutputError)
}
"""Name of an error in the answer -> its class."""


@dataclass(frozen=True)
class Limits:
    """What the process may take; None is no limit.

    Attributes:
        cpu_s: Seconds of processor time.
        file_bytes: Greatest size of a file that it writes.
        address_bytes: Address space beyond what it has when it begins.
        data_bytes: Memory of its own, where its libraries reserve address space that they do not use.
        n_files: Open files.
        has_threads: Whether it may start threads.
    """

    cpu_s: int
    file_bytes: int
    address_bytes: int | None = None
    data_bytes: int | None = None
    n_files: int = MAX_OPEN_FILES
    has_threads: bool = False

    @property
    def memory_mb(self) -> int:
        """The limit of memory in megabytes."""
        return (self.address_bytes or self.data_bytes or 0) // BYTES_PER_MEGABYTE


def cpu_limit_for_file_size_s(n_bytes: int) -> int:
    """Return the processor time in seconds that reading a file of this size may take."""
    return BASE_CPU_TIME_LIMIT_S + CPU_TIME_LIMIT_PER_FILE_MEGABYTE_S * n_bytes // BYTES_PER_MEGABYTE


def run_bounded(
    function: str,
    request: Mapping[str, Any],
    limits: Limits,
    name: str,
    *,
    descriptors: Sequence[int] = (),
    folder: str | None = None,
    classes: Mapping[str, type[CwcliError]] = ERROR_CLASS_BY_NAME,
) -> dict[str, Any]:
    """Run a function in a process of its own and return its answer.

    Args:
        function: `module:name`; it takes the request and returns the answer.
        request: What it is given, as JSON.
        limits: What it may take.
        name: The file that it reads, for errors.
        descriptors: Open files that it inherits.
        folder: A folder that it makes for temporary files; the caller removes it.
        classes: Name of an error -> its class.

    Raises:
        CwcliError: One that the function raised; an `InputError` where it took more than its bounds, or has died.
        OutputError: No process can be started, or there is no room.
        BrokenPipeError: The reader of its standard output has gone away.
        RuntimeError: The function has a bug.
    """
    envelope = {
        "function": function,
        "request": dict(request),
        "limits": _fields_of_limits(limits),
        "parent": os.getpid(),
        "folder": folder,
    }
    code, answer = _run_child(envelope, name, descriptors)
    error_fields = answer.get("error")
    if code == 0 and isinstance(error_fields, dict):
        raise _error_of_answer(error_fields, name, limits, classes)
    if code == 0 and isinstance(answer.get("answer"), dict):
        found: dict[str, Any] = answer["answer"]
        return found
    if code == -getattr(signal, "SIGXCPU", 0):
        what = f"reading it takes more than the {limits.cpu_s} s of processor time that a file of its size may take"
        raise InputError(what, where=name, hint=DAMAGED_OR_HARMFUL_FILE_HINT)
    how = signal.Signals(-code).name if -code in set(signal.Signals) else f"code {code}"
    raise InputError(f"the process that reads it ended with {how}", where=name, hint=DAMAGED_OR_HARMFUL_FILE_HINT)


def command_with_limits(command: Sequence[str], limits: Limits, *, has_no_network: bool = False) -> list[str]:
    """Return the command that runs a program of others, which ends with this process and has limits.

    Args:
        command: The program and its arguments.
        limits: What it, and each process that it starts, may take.
        has_no_network: Whether it gives up the network, too: it may then be refused a sandbox of its own.
    """
    envelope = {"limits": _fields_of_limits(limits), "parent": os.getpid(), "has_no_network": has_no_network}
    path = f"import sys; sys.path[:] = {sys.path!r}"
    code = f"{path}; from cwcli.bounded_child import limit_process_and_execute_program as run; run()"
    return [sys.executable, "-c", code, json.dumps(envelope), *command]


def _fields_of_limits(limits: Limits) -> dict[str, Any]:
    return {key: getattr(limits, key) for key in Limits.__annotations__}


def _run_child(envelope: dict[str, Any], name: str, descriptors: Sequence[int]) -> tuple[int, dict[str, Any]]:
    """Run the process; return how it ended, and its answer, which is empty if it gave none.

    Raises:
        OutputError: No process can be started.
    """
    # it imports from where this process does, and not from the current folder, as `-c` alone would
    path = f"import sys; sys.path[:] = {sys.path!r}"
    code = f"{path}; from cwcli.bounded_child import serve_request; serve_request()"
    environment = KEPT_MEMORY_SETTINGS | os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
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
        raise OutputError(f"no process can be started to read it: {error.strerror}", where=name) from error
    with process:
        try:
            assert process.stdin is not None and process.stdout is not None
            try:
                process.stdin.write(json.dumps(envelope).encode())
                process.stdin.close()
            except BrokenPipeError:
                pass  # it has ended; how, is told by its code
            said = process.stdout.read(MAX_PROCESS_ANSWER_BYTES + 1)
        finally:
            if process.poll() is None:
                _wait_or_kill(process)
    try:
        answer = json.loads(said) if len(said) <= MAX_PROCESS_ANSWER_BYTES else None
    except (ValueError, RecursionError):
        answer = None
    return process.returncode, answer if isinstance(answer, dict) else {}


def _wait_or_kill(process: subprocess.Popen[bytes]) -> None:
    """Wait for a process that has closed its output; kill one that has not."""
    try:
        process.wait(MAX_WAIT_AFTER_OUTPUT_CLOSES_S)
    except (subprocess.TimeoutExpired, KeyboardInterrupt):
        process.kill()


def _error_of_answer(
    error_fields: dict[str, Any], name: str, limits: Limits, classes: Mapping[str, type[CwcliError]]
) -> Exception:
    """Return the error by which the function has ended."""
    kind = error_fields.get("kind")
    if kind == "memory":
        what = f"reading it takes more than {limits.memory_mb:,} MB of memory"
        return InputError(what, where=name, hint=DAMAGED_OR_HARMFUL_FILE_HINT)
    if kind == "system":
        number = error_fields.get("errno")
        reason = os.strerror(number) if isinstance(number, int) else "unknown"
        return OutputError(f"{name} can't be converted: {reason}", where=tempfile.gettempdir(), hint=DISK_SPACE_HINT)
    if kind == "pipe":
        return BrokenPipeError()
    if kind == "bug":
        return RuntimeError(f"in the process that reads {name}:\n{error_fields.get('trace')}")
    what, where, hint = (str(error_fields.get(each, "")) for each in ("what", "where", "hint"))
    found = error_fields.get("found")
    listed = tuple(map(str, found)) if isinstance(found, list) else ()
    return classes.get(str(kind), InputError)(what, where=where, found=listed, hint=hint)
