"""Orders the parts of a recording by time, and notes missing, repeated and overlapping parts."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

from cwcli.errors import InputError
from cwcli.input import InputFile
from cwcli.logs.format.index import LogIndex
from cwcli.logs.format.joined_file import JoinedFile
from cwcli.logs.format.records import Statistics
from cwcli.signals.units import NS_PER_S
from cwcli.text import format_first_names

if TYPE_CHECKING:
    from cwcli.signals.columns import FirstAndLastNs

MAX_GAP_WITHOUT_NOTE_NS = 1_000_000_000
"""The longest time in ns between two parts without a note. A recorder continues with the next part at once; after a
longer gap something may be missing. Chosen by hand."""
MAX_PART_NUMBER = 10_000
"""The greatest number in a file name that counts as the number of a part; a larger one is a time or a date. Chosen by
hand."""
_NUMBERED_FILE_NAME = re.compile(r"^(.*?)(\d+)((?:\.[A-Za-z]\w*)*)$")
"""The pattern of a file name that ends with a number: stem, number, suffixes."""


def order_parts_and_leave_out_repeated(file: JoinedFile, indexes: Sequence[LogIndex]) -> list[LogIndex]:
    """Order the parts by their first messages, leave out repeated ones, and return the indexes in the new order.

    `file.notes` gets parts that are missing by their numbers, gaps between parts, repeated parts, parts that overlap in
    time, and wrong message counts in the recorder's listing.

    Args:
        indexes: One per part, in the order in which the parts were named.

    Raises:
        InputError: Two parts that have to be compared can't be read.
    """
    remaining_parts: list[tuple[InputFile, LogIndex]] = []
    repeated: list[InputFile] = []
    for part, index in zip(file.parts, indexes, strict=True):
        if any(_is_same_file_content(part, index, *other) for other in remaining_parts):
            repeated.append(part)
        else:
            remaining_parts.append((part, index))
    remaining_parts.sort(key=lambda each: _first_and_last_log_time_ns(each[1]) or (0, 0))
    parts = [part for part, _ in remaining_parts]
    _note_parts(file, "repeated parts", repeated)
    if not file.listed_message_counts:
        _note_missing_part_numbers(file, parts)
    else:
        _note_wrong_listed_counts(file, remaining_parts)
    _note_overlaps_and_gaps(
        file, [(part, span) for part, index in remaining_parts if (span := _first_and_last_log_time_ns(index))]
    )
    if len({index.profile for _, index in remaining_parts}) > 1:
        file.notes["parts with different profiles"] = len(remaining_parts)
    file.set_final_part_order(parts)
    return [index for _, index in remaining_parts]


def _first_and_last_log_time_ns(index: LogIndex) -> FirstAndLastNs | None:
    """Return first and last log time in ns; None for a part without messages."""
    found = index.statistics
    return (found.start_ns, found.end_ns) if found and found.n_messages else None


def _is_same_file_content(part: InputFile, index: LogIndex, other: InputFile, of_other: LogIndex) -> bool:
    """Tell whether two parts have the same bytes."""
    if part.disk_files[0].state[:2] == other.disk_files[0].state[:2]:
        return True
    if len(part) != len(other) or index.statistics != of_other.statistics:
        return False
    return part.begin_sha256().result() == other.begin_sha256().result()


def _note_parts(file: JoinedFile, what: str, parts: Sequence[InputFile]) -> None:
    """Add a note that names these parts, if there are any."""
    if parts:
        file.notes[f"{what} ({format_first_names([_base_name(part) for part in parts])})"] = len(parts)


def _note_missing_part_numbers(file: JoinedFile, parts: Sequence[InputFile]) -> None:
    """Note parts that are missing by the numbers in the file names."""
    found = [_NUMBERED_FILE_NAME.match(_base_name(part)) for part in parts]
    if len(parts) < 2 or None in found or len({(each[1], each[3]) for each in found if each}) > 1:
        return
    numbers = {int(each[2]) for each in found if each}
    is_counted = found[0] is not None and found[0][1].endswith("_")  # as rosbag2 numbers them, from 0
    first = 1 if is_counted else min(numbers)
    missing = sorted(set(range(first, max(numbers))) - numbers) if max(numbers) < MAX_PART_NUMBER else []
    if missing:
        names = format_first_names([str(number) for number in missing])
        file.notes[f"parts missing by the numbers in the names ({names})"] = len(missing)


def _note_overlaps_and_gaps(file: JoinedFile, parts: Sequence[tuple[InputFile, FirstAndLastNs]]) -> None:
    """Note parts that overlap in time, and gaps between parts."""
    overlaps: list[str] = []
    gaps: list[str] = []
    end_ns = 0
    for (before, (_, before_ns)), (after, (start_ns, after_ns)) in pairwise(parts):
        end_ns = max(end_ns, before_ns)
        both = f"{_base_name(before)} and {_base_name(after)}"
        if start_ns < end_ns:
            overlaps.append(f"{both}: {(min(end_ns, after_ns) - start_ns) / NS_PER_S:.3f} s")
        elif start_ns - end_ns > MAX_GAP_WITHOUT_NOTE_NS:
            gaps.append(f"{both}: {(start_ns - end_ns) / NS_PER_S:.1f} s")
    if overlaps:
        file.notes[f"parts that overlap in time ({format_first_names(overlaps)})"] = len(overlaps)
    if gaps:
        file.notes[f"gaps between parts ({format_first_names(gaps)})"] = len(gaps)


def _note_wrong_listed_counts(file: JoinedFile, parts: Sequence[tuple[InputFile, LogIndex]]) -> None:
    """Note parts that hold another number of messages than the recorder's listing says."""
    wrong = []
    total = 0
    for part, index in parts:
        counted: Statistics | None = index.statistics
        n = counted.n_messages if counted else 0
        total += n
        listed = file.listed_message_counts.get(_base_name(part))
        if listed is not None and listed != n:
            wrong.append(f"{_base_name(part)}: {listed} instead of {n}")
    is_whole = len(parts) == len(file.listed_message_counts)
    if not wrong and is_whole and file.n_listed_messages not in (None, total):
        wrong.append(f"all: {file.n_listed_messages} instead of {total}")
    if wrong:
        file.notes[f"wrong numbers of messages in metadata.yaml ({format_first_names(wrong)})"] = len(wrong)


def _base_name(part: InputFile) -> str:
    return Path(part.name).name


def note_unreadable_part(file: JoinedFile, part: InputFile, error: InputError) -> None:
    """Add a note about a part that can't be read."""
    what = f"parts that can't be read ({_base_name(part)}: {error.what})"
    file.notes[what] = file.notes.get(what, 0) + 1
