"""Builds the index of a file from its summary, or record by record."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from cwcli.errors import InputError
from cwcli.input import InputFile
from cwcli.logs.format.chunks import set_first_refused_chunk
from cwcli.logs.format.faults import RECOVER_HINT, Faults, not_mcap_error
from cwcli.logs.format.index import LogIndex
from cwcli.logs.format.join_indexes import join_indexes
from cwcli.logs.format.joined_file import JoinedFile
from cwcli.logs.format.part_order import note_unreadable_part, order_parts_and_leave_out_repeated
from cwcli.logs.format.records import (
    MCAP_MAGIC,
    Channel,
    ChunkIndex,
    Opcode,
    RecordError,
    Schema,
    read_opcode_and_content_range,
    read_profile_and_library,
)
from cwcli.logs.format.summary import find_footer_and_its_offset, is_complete_summary, read_summary_if_present
from cwcli.logs.format.walk import index_data_section


def open_index(file: InputFile, faults: Faults, *, recover: bool) -> LogIndex:
    """Return the index of a file for reading: its summary, if that is complete.

    Args:
        recover: Count damage instead of raising.

    Raises:
        InputError: It is not an MCAP file, or is damaged; with `recover`, if nothing in it can be read.
    """
    if isinstance(file, JoinedFile):
        index_of_parts = _index_parts(file, partial(open_index, faults=faults, recover=recover), recover=recover)
        faults.add_file_faults(file.notes)
        return index_of_parts
    faults.add_file_faults(file.notes)
    start, head = _read_data_start_and_header(file, faults, recover=recover)
    index = summary = _read_summary_if_usable(file, start, faults, recover=recover)
    if index is None or not is_complete_summary(index):
        index = index_data_section(file, start, faults, summary, recover=recover)
        _check_message_count(file.name, index, summary, faults, recover=recover)
    else:
        set_first_refused_chunk(file, index.items_of_type(ChunkIndex))
        index.has_message_counts = index.statistics is not None and bool(index.statistics.channel_counts)
    n_messages = index.statistics.n_messages if index.statistics else 0
    if recover and not index.channels and (n_messages or faults.counts_by_reason()):
        raise InputError("nothing in it can be read", where=file.name)
    index.profile, index.library, index.header_length = head
    return index


def index_every_record(file: InputFile, faults: Faults, *, recover: bool) -> LogIndex:
    """Return the index of a file for copying: every record of the data section, and all schemas and channels.

    A damaged summary is no error, because nothing of it is copied.

    Args:
        recover: Leave damaged records out, instead of raising.

    Raises:
        InputError: It is not an MCAP file, or its data section is damaged and `recover` is off.
    """
    if isinstance(file, JoinedFile):
        return _index_parts(file, partial(index_every_record, faults=faults, recover=recover), recover=recover)
    start, head = _read_data_start_and_header(file, faults, recover=recover)
    summary = _read_summary_if_usable(file, start, Faults(), recover=True)
    index = index_data_section(file, start, faults, summary, recover=recover, define_all=True)
    if not index.has_end and not recover:
        raise _cut_short_error(file)
    index.has_complete_summary = summary is not None and is_complete_summary(summary)
    index.profile, index.library, index.header_length = head
    return index


def _index_parts(file: JoinedFile, read: Callable[[InputFile], LogIndex], *, recover: bool) -> LogIndex:
    """Return the joined index of a log's parts; with `recover`, of those that can be read.

    Raises:
        InputError: One is damaged and `recover` is off, or none can be read.
    """
    found: list[tuple[InputFile, LogIndex]] = []
    known: dict[object, Schema | Channel] = {}
    definitions = LogIndex()
    for part in file.parts:
        part.max_chunk_bytes, part.max_ratio = file.max_chunk_bytes, file.max_ratio
        try:
            found.append((part, read(part)))
        except InputError as error:
            if not recover or file.has_final_part_order:
                raise
            note_unreadable_part(file, part, error)
            last = error
            continue
        _share_equal_definitions(found[-1][1], known, definitions, file)
    if not found:
        raise last
    indexes = [index for _, index in found]
    if not file.has_final_part_order:
        file.keep_only_parts([part for part, _ in found])
        indexes = order_parts_and_leave_out_repeated(file, indexes)
    return join_indexes(file, indexes)


def _share_equal_definitions(
    index: LogIndex, known: dict[object, Schema | Channel], counter: LogIndex, file: InputFile
) -> None:
    """Let the schemas and channels of a part that earlier ones have, too, take no memory, and count the others.

    Raises:
        InputError: All together take too much.
    """
    parts: tuple[dict[int, Any], ...] = (index.schemas, index.channels)
    for definitions in parts:
        for number, each in definitions.items():
            *content, last = each[1:]
            first = known.setdefault((*content, last if isinstance(last, bytes) else tuple(sorted(last.items()))), each)
            if first is each:
                counter.count_definition(each, file)
            else:
                definitions[number] = first._replace(id=number)


def _read_data_start_and_header(file: InputFile, faults: Faults, *, recover: bool) -> tuple[int, tuple[str, str, int]]:
    """Return the start of the data section, and profile, library and length of magic and header (0 if damaged).

    Raises:
        InputError: It is not an MCAP file, or its header is damaged and `recover` is off.
    """
    at = len(MCAP_MAGIC)
    if file[:at] != MCAP_MAGIC:
        raise not_mcap_error(file.name, bytes(file[:16]))
    try:
        opcode, start, end = read_opcode_and_content_range(file, at, len(file))
        if opcode != Opcode.HEADER:
            raise RecordError("the first record is not a header")
        return end, (*read_profile_and_library(file, start, end), end)
    except RecordError as error:
        if not recover:
            what = f"the header is damaged: {error} (at byte {at})"
            raise InputError(what, where=file.name, hint=RECOVER_HINT) from error
    from cwcli.logs.format.resync import find_next_record_offset_or_end

    following = find_next_record_offset_or_end(file, at + 1, range(1 << 16))
    faults.bytes_lost += following - at
    return following, ("", "", 0)


def _read_summary_if_usable(file: InputFile, data_start: int, faults: Faults, *, recover: bool) -> LogIndex | None:
    """Return the index from the summary, or None if there is no usable summary.

    Raises:
        InputError: The file is cut short, or the summary damaged, and `recover` is off.
    """
    found = find_footer_and_its_offset(file)
    if found is None:
        if not recover:
            raise _cut_short_error(file)
        faults.truncated = True
        return None
    try:
        return read_summary_if_present(file, *found, data_start, verify=True)
    except RecordError as error:
        if not recover:
            what = f"{error} (summary at byte {found[0].summary_start})"
            raise InputError(what, where=file.name, hint=RECOVER_HINT) from error
        faults.summary_damaged = True
        return None


def _check_message_count(
    name: str, index: LogIndex, summary: LogIndex | None, faults: Faults, *, recover: bool
) -> None:
    """Count messages that an incomplete summary counts and the file lacks.

    Raises:
        InputError: Some are missing and `recover` is off.
    """
    if summary is not None and summary.statistics is not None and index.statistics is not None:
        n_missing = summary.statistics.n_messages - index.statistics.n_messages
        if n_missing > 0 and not recover:
            raise InputError(f"{n_missing} messages of its summary are not in it", where=name, hint=RECOVER_HINT)
        faults.messages_lost += max(n_missing, 0)


def _cut_short_error(file: InputFile) -> InputError:
    what = f"the file is cut short: it ends at byte {len(file)} without a footer"
    return InputError(what, where=file.name, hint=RECOVER_HINT)
