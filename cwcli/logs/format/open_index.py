"""Builds the index of a file from its summary, or record by record."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from cwcli.errors import InputError
from cwcli.input import InputFile
from cwcli.logs.format.chunks import bound_chunks
from cwcli.logs.format.faults import RECOVER_HINT, Faults, no_mcap
from cwcli.logs.format.index import Index
from cwcli.logs.format.join_indexes import join_indexes
from cwcli.logs.format.joined_file import JoinedFile
from cwcli.logs.format.part_order import arrange, left_out
from cwcli.logs.format.records import HEADER, MAGIC, ChunkIndex, RecordError, read_header, read_prefix
from cwcli.logs.format.summary import find_footer, is_complete, read_summary
from cwcli.logs.format.walk import walk


def open_index(file: InputFile, faults: Faults, *, recover: bool, verify: bool) -> Index:
    """Return the index of a file for reading: its summary, if that is complete.

    Args:
        file: The log.
        faults: Counts the faults of the file.
        recover: Count damage instead of raising.
        verify: Check the summary's CRC.

    Raises:
        InputError: It is not an MCAP file, or is damaged; with `recover`, if nothing in it can be read.
    """
    if isinstance(file, JoinedFile):
        joined = _of_parts(file, partial(open_index, faults=faults, recover=recover, verify=verify), recover=recover)
        faults.note_parts(file.notes)
        return joined
    faults.note_parts(file.notes)
    start, head = _read_head(file, faults, recover=recover)
    index = summary = _read_summary(file, start, faults, recover=recover, verify=verify)
    if index is None or not is_complete(index):
        index = walk(file, start, faults, summary, recover=recover)
        _check_count(file.name, index, summary, faults, recover=recover)
    else:
        bound_chunks(file, index.items_of(ChunkIndex))
        index.is_counted = index.statistics is not None and bool(index.statistics.channel_counts)
    n_messages = index.statistics.n_messages if index.statistics else 0
    if recover and not index.channels and (n_messages or faults.counts()):
        raise InputError("nothing in it can be read", where=file.name)
    index.profile, index.library, index.header_length = head
    return index


def index_every_record(file: InputFile, faults: Faults, *, recover: bool) -> Index:
    """Return the index of a file for copying: every record of the data section, and all schemas and channels.

    A damaged summary is no error, because nothing of it is copied.

    Args:
        file: The log.
        faults: Counts what is lost.
        recover: Leave damaged records out, instead of raising.

    Raises:
        InputError: It is not an MCAP file, or its data section is damaged and `recover` is off.
    """
    if isinstance(file, JoinedFile):
        return _of_parts(file, partial(index_every_record, faults=faults, recover=recover), recover=recover)
    start, head = _read_head(file, faults, recover=recover)
    summary = _read_summary(file, start, Faults(), recover=True, verify=True)
    index = walk(file, start, faults, summary, recover=recover, define_all=True)
    if not index.has_end and not recover:
        raise _cut_short(file)
    index.is_listed = summary is not None and is_complete(summary)
    index.profile, index.library, index.header_length = head
    return index


def _of_parts(file: JoinedFile, read: Callable[[InputFile], Index], *, recover: bool) -> Index:
    """Return the joined index of a log's parts; with `recover`, of those that can be read.

    Raises:
        InputError: One is damaged and `recover` is off, or none can be read.
    """
    found: list[tuple[InputFile, Index]] = []
    for part in file.parts:
        part.max_chunk_bytes, part.max_ratio = file.max_chunk_bytes, file.max_ratio
        try:
            found.append((part, read(part)))
        except InputError as error:
            if not recover or file.is_arranged:
                raise
            left_out(file, part, error)
            last = error
    if not found:
        raise last
    indexes = [index for _, index in found]
    if not file.is_arranged:
        file.drop_all_but([part for part, _ in found])
        indexes = arrange(file, indexes)
    return join_indexes(file, indexes)


def _read_head(file: InputFile, faults: Faults, *, recover: bool) -> tuple[int, tuple[str, str, int]]:
    """Return the start of the data section, and profile, library and length of magic and header (0 if damaged).

    Raises:
        InputError: It is not an MCAP file, or its header is damaged and `recover` is off.
    """
    at = len(MAGIC)
    if file[:at] != MAGIC:
        raise no_mcap(file.name, bytes(file[:16]))
    try:
        opcode, start, end = read_prefix(file, at, len(file))
        if opcode != HEADER:
            raise RecordError("the first record is not a header")
        return end, (*read_header(file, start, end), end)
    except RecordError as error:
        if not recover:
            what = f"the header is damaged: {error} (at byte {at})"
            raise InputError(what, where=file.name, hint=RECOVER_HINT) from error
    from cwcli.logs.format.resync import next_record

    following = next_record(file, at + 1, range(1 << 16))
    faults.bytes_lost += following - at
    return following, ("", "", 0)


def _read_summary(file: InputFile, data_start: int, faults: Faults, *, recover: bool, verify: bool) -> Index | None:
    """Return the index from the summary, or None if there is no usable summary.

    Raises:
        InputError: The file is cut short, or the summary damaged, and `recover` is off.
    """
    found = find_footer(file)
    if found is None:
        if not recover:
            raise _cut_short(file)
        faults.truncated = True
        return None
    try:
        return read_summary(file, *found, data_start, verify=verify)
    except RecordError as error:
        if not recover:
            what = f"{error} (summary at byte {found[0].summary_start})"
            raise InputError(what, where=file.name, hint=RECOVER_HINT) from error
        faults.summary_damaged = True
        return None


def _check_count(name: str, index: Index, summary: Index | None, faults: Faults, *, recover: bool) -> None:
    """Count messages that an incomplete summary counts and the file lacks.

    Raises:
        InputError: Some are missing and `recover` is off.
    """
    if summary is not None and summary.statistics is not None and index.statistics is not None:
        n_missing = summary.statistics.n_messages - index.statistics.n_messages
        if n_missing > 0 and not recover:
            raise InputError(f"{n_missing} messages of its summary are not in it", where=name, hint=RECOVER_HINT)
        faults.messages_lost += max(n_missing, 0)


def _cut_short(file: InputFile) -> InputError:
    what = f"the file is cut short: it ends at byte {len(file)} without a footer"
    return InputError(what, where=file.name, hint=RECOVER_HINT)
