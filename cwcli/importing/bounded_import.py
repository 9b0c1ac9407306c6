"""Imports files in a process of its own that can take no more than its bounds: their libraries have none.

The process reads the files and writes the log; what it says of them comes back as an `ImportReport`.
"""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from cwcli.bounded_process import ERROR_CLASS_BY_NAME, Limits, cpu_limit_for_file_size_s, run_bounded
from cwcli.errors import InputError
from cwcli.importing.readers import load_kind
from cwcli.importing.readers.base import FileHead
from cwcli.importing.run import plan_import, write_import
from cwcli.importing.tables import AmbiguousError, Answers, Guess
from cwcli.input import InputFile
from cwcli.lazy_dataclass import dataclass
from cwcli.work_share import part_of_work, report_work_share_to

IMPORT_FUNCTION = "cwcli.importing.bounded_import:import_requested_files_in_own_process"
"""The function that the process runs."""
BASE_MEMORY_LIMIT_BYTES, EXTRA_MEMORY_BYTES_PER_INPUT_FILE_BYTE = 400_000_000, 20
"""Memory of the process, and more for each byte of the files: a table is held as columns of numbers. Chosen by hand:
the libraries and a drive of ten minutes take 150 MB."""
MAX_MEMORY_BYTES = 900_000_000
"""Greatest memory of the process, whatever the size of the files: large columns lie in a file. Chosen by hand."""
EXTRA_MEMORY_BYTES_FOR_VIDEO = 400_000_000
"""Memory more for a video. Chosen by hand: OpenCV reserves 240 MB that it does not use, and a decoder holds 16 pictures
of 12 MB at 3840 by 2160."""
BASE_OUTPUT_LOG_LIMIT_BYTES, EXTRA_OUTPUT_LOG_BYTES_PER_INPUT_FILE_BYTE = 100_000_000, 200
"""Size of the log, and more for each byte of the files: a video becomes images of its frames. Chosen by hand: a second
of H.265 becomes 30 times its size."""
MAX_OPEN_FILES = 256
"""The greatest number of files that the process has open at once. Chosen by hand."""
STAT_BLOCK_BYTES = 512
"""Bytes of a block as `stat` counts them (POSIX.1-2017, sys/stat.h as on Linux and macOS)."""
READING_TIME_SHARE = 0.12
"""Share of the time of an import that goes by until the log is written; measured on a CSV of 3,000,000 rows."""
PROGRESS_REPORT_INTERVAL_S = 0.3
"""Time between two reports, s. Chosen by hand."""


class ShareReport:
    """Writes the share that is done into a pipe; nothing where there is none, or where nobody reads it."""

    def __init__(self, descriptor: int | None, reading_share: float) -> None:
        self._descriptor = descriptor
        self._reading_share = reading_share
        self._last_s = 0.0

    @contextmanager
    def report_reading_progress_of_files(self, files: Sequence[str]) -> Iterator[None]:
        """Report in the block how far the files are read, by the positions of the open ones."""
        stop = threading.Event()
        sizes = {os.path.realpath(path): max(Path(path).stat().st_size, 1) for path in files if Path(path).is_file()}

        def report_positions_until_end() -> None:
            most: dict[str, int] = {}
            while not stop.wait(PROGRESS_REPORT_INTERVAL_S):
                for path, position in _positions_of_open_files():
                    if path in sizes:
                        most[path] = max(most.get(path, 0), position)
                self.report_share(self._reading_share * min(sum(most.values()) / sum(sizes.values()), 1.0))

        if self._descriptor is not None and sizes:
            threading.Thread(target=report_positions_until_end, daemon=True).start()
        try:
            yield
        finally:
            stop.set()

    def report_share(self, share: float) -> None:
        """Report the share of the whole import that is done."""
        now_s = time.monotonic()
        if self._descriptor is None or now_s - self._last_s < PROGRESS_REPORT_INTERVAL_S:
            return
        self._last_s = now_s
        with suppress(OSError):
            os.write(self._descriptor, f"{share:.4f}\n".encode())


@dataclass(frozen=True)
class ImportReport:
    """What an import has made, or would make.

    Attributes:
        kinds: File -> kind.
        tables: Name of each table and its guesses.
        topics: Topic, schema, number of messages and table of each channel.
        notes: Table -> what the user should know.
        unused: Table -> columns that are no quantity.
        mapping_text: The mapping file.
    """

    kinds: Mapping[str, str]
    tables: Sequence[tuple[str, Sequence[Guess]]]
    topics: Sequence[tuple[str, str, int, str]]
    notes: Mapping[str, Sequence[str]]
    unused: Mapping[str, Sequence[str]]
    mapping_text: str


def import_files(
    files: Sequence[str],
    answers: Answers,
    target: str | None,
    *,
    mapping_file: str | None = None,
    force: bool = False,
    progress: Callable[[float, float], None] | None = None,
) -> ImportReport:
    """Import files in a process of its own.

    Args:
        target: The log, "-" for standard output, None to write none.
        mapping_file: The mapping file that is written with it.
        progress: Called now and then with the share that is done and the whole, 1, in a thread of its own.

    Raises:
        CwcliError: As `plan_import` and `write_import`; an `InputError` where the files take more than their bounds.
        BrokenPipeError: The reader of standard output has gone away.
    """
    n_bytes = sum(map(_bytes_on_disk_or_0, {*files, *answers.dbc, answers.frame_times}))
    name = ", ".join(files)
    has_video = any(load_kind("video").accepts(FileHead(path)) for path in files)
    memory_bytes = (
        BASE_MEMORY_LIMIT_BYTES
        + EXTRA_MEMORY_BYTES_PER_INPUT_FILE_BYTE * n_bytes
        + (EXTRA_MEMORY_BYTES_FOR_VIDEO if has_video else 0)
    )
    limits = Limits(
        cpu_limit_for_file_size_s(n_bytes),
        BASE_OUTPUT_LOG_LIMIT_BYTES + EXTRA_OUTPUT_LOG_BYTES_PER_INPUT_FILE_BYTE * n_bytes,
        data_bytes=min(memory_bytes, MAX_MEMORY_BYTES),
        n_files=MAX_OPEN_FILES,
        has_threads=True,
    )
    answer_by_name = {each.name: getattr(answers, each.name) for each in fields(answers)}
    request: dict[str, Any] = {
        "files": list(files),
        "answers": answer_by_name | {"columns": [[*key, *value] for key, value in answers.columns.items()]},
        "target": target,
        "mapping_file": mapping_file,
        "force": force,
        "stdout": None,
        "progress": None,
    }
    classes = ERROR_CLASS_BY_NAME | {AmbiguousError.__name__: AmbiguousError}
    descriptors = []
    try:
        if target == "-":
            sys.stdout.flush()
            # the process has its own standard output, for the answer
            request["stdout"] = os.dup(sys.stdout.fileno())
            descriptors = [request["stdout"]]
        if progress is not None:
            request["progress"] = shares_out = open_pipe_for_shares(progress)
            descriptors.append(shares_out)
        answer = run_bounded(IMPORT_FUNCTION, request, limits, name, descriptors=descriptors, classes=classes)
    finally:
        for descriptor in descriptors:
            os.close(descriptor)
    try:
        return _import_report_from_process_answer(answer)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError("the process that reads it gave no usable answer", where=name) from error


def import_requested_files_in_own_process(request: dict[str, Any]) -> dict[str, Any]:
    """Import the files of a request, in the process of its own; return what a report holds.

    Raises:
        CwcliError: As `plan_import` and `write_import`.
    """
    from cwcli.array_memory import bound_array_memory_and_get_old_handler

    if request["stdout"] is not None:
        os.dup2(request["stdout"], 1)
    bound_array_memory_and_get_old_handler()
    report = ShareReport(request["progress"], READING_TIME_SHARE if request["target"] is not None else 1.0)
    requested_answers = request["answers"]
    columns = {(table, quantity): (column, unit) for table, quantity, column, unit in requested_answers["columns"]}
    answers = Answers(**{**requested_answers, "columns": columns, "dbc": tuple(requested_answers["dbc"])})
    with ExitStack() as opened:
        names = dict.fromkeys((*request["files"], *answers.dbc, answers.frame_times))
        inputs = [opened.enter_context(InputFile.open(name)) for name in names if Path(name).is_file()]
        with report.report_reading_progress_of_files(request["files"]):
            plan = plan_import(request["files"], answers)
        if request["target"] is not None:
            with report_work_share_to(report.report_share), part_of_work(READING_TIME_SHARE, 1.0, "messages"):
                write_import(
                    plan,
                    request["target"],
                    mapping_file=request["mapping_file"],
                    force=request["force"],
                    inputs=inputs,
                )
            sys.stdout.flush()
    return {
        "kinds": dict(plan.kinds),
        "tables": [(name, [asdict(guess) for guess in guesses]) for name, guesses in plan.tables],
        "topics": plan.topics,
        "notes": {name: list(notes) for name, notes in plan.notes.items()},
        "unused": {name: list(columns) for name, columns in plan.unused.items()},
        "mapping_text": plan.mapping_text(),
    }


def _import_report_from_process_answer(answer: dict[str, Any]) -> ImportReport:
    """Return the report that an answer holds.

    Raises:
        KeyError, TypeError, ValueError: It has another form.
    """
    texts = ("quantity", "column", "unit", "confidence", "why")
    tables = [
        (str(name), [Guess(**{key: str(guess[key]) for key in texts}) for guess in guesses])
        for name, guesses in answer["tables"]
    ]
    topics = [(str(topic), str(schema), int(n), str(table)) for topic, schema, n, table in answer["topics"]]
    notes, unused = (
        {str(name): [str(each) for each in entries] for name, entries in answer[key].items()}
        for key in ("notes", "unused")
    )
    kinds = {str(path): str(kind) for path, kind in answer["kinds"].items()}
    return ImportReport(kinds, tables, topics, notes, unused, str(answer["mapping_text"]))


def _bytes_on_disk_or_0(path: str) -> int:
    """Return how many bytes of a file lie on the disk, 0 where there is no file: holes allow for nothing."""
    with suppress(OSError, ValueError):
        status = Path(path).stat()
        n_bytes_on_disk = getattr(status, "st_blocks", status.st_size) * STAT_BLOCK_BYTES
        return min(status.st_size, n_bytes_on_disk)
    return 0


def open_pipe_for_shares(progress: Callable[[float, float], None]) -> int:
    """Return the end of a pipe into which shares are written, a line each; the caller closes it."""
    reading, writing = os.pipe()

    def forward_progress_lines() -> None:
        with os.fdopen(reading) as lines:
            for line in lines:
                with suppress(ValueError):
                    progress(float(line), 1.0)

    threading.Thread(target=forward_progress_lines, daemon=True).start()
    return writing


def _positions_of_open_files() -> Iterator[tuple[str, int]]:
    """Yield name and position of each open file of this process; none where the system does not tell (proc(5))."""
    with suppress(OSError):
        for descriptor in Path("/proc/self/fd").iterdir():
            with suppress(OSError, ValueError):
                name = str(descriptor.readlink())
                first = Path(f"/proc/self/fdinfo/{descriptor.name}").read_text().splitlines()[0]
                yield name, int(first.partition(":")[2])
