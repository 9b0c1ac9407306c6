"""From the bytes of a file to its structure: by the summary, or record by record."""

from __future__ import annotations

from cwcli.errors import InputError
from cwcli.input import InputFile
from cwcli.logs.format.faults import RECOVER_HINT, Faults
from cwcli.logs.format.index import Structure
from cwcli.logs.format.records import HEADER, MAGIC, RecordError, read_header, read_prefix
from cwcli.logs.format.summary import find_footer, is_complete, read_summary
from cwcli.logs.format.walk import DamageError, scan


def open_structure(data: InputFile, name: str, faults: Faults, *, recover: bool, verify: bool) -> Structure:
    """What a file holds.

    Args:
        data: The file.
        name: For messages.
        faults: Counts what is wrong with it.
        recover: Count damage instead of raising.
        verify: Check the summary's CRC.

    Raises:
        InputError: It is not an MCAP file, or damaged; with `recover`, if there is nothing to be had.
    """
    if data[: len(MAGIC)] != MAGIC:
        raise InputError("it is not an MCAP file", where=name, hint=_hint_for(bytes(data[:16])))
    profile, library, data_start = _header(data, name, faults, recover=recover)
    structure = _structure(data, name, data_start, faults, recover=recover, verify=verify)
    structure.profile, structure.library = profile, library
    if recover and not structure.channels:
        raise InputError("nothing in it can be read", where=name)
    return structure


def _structure(
    data: InputFile, name: str, data_start: int, faults: Faults, *, recover: bool, verify: bool
) -> Structure:
    found = find_footer(data)
    summary: Structure | None = None
    if found is None:
        if not recover:
            what = f"the file is cut short: it ends at byte {len(data)} without a footer"
            raise InputError(what, where=name, hint=RECOVER_HINT)
        faults.truncated = True
    else:
        try:
            summary = read_summary(data, *found, data_start, verify=verify)
        except RecordError as error:
            if not recover:
                what = f"{error} (summary at byte {found[0].summary_start})"
                raise InputError(what, where=name, hint=RECOVER_HINT) from error
            faults.summary_damaged = True
    if summary is not None and is_complete(summary):
        return summary
    try:
        structure = scan(data, data_start, faults, recover=recover)
    except DamageError as error:
        raise InputError(f"{error} (at byte {error.at})", where=name, hint=RECOVER_HINT) from error
    if summary is not None and summary.statistics is not None and structure.statistics is not None:
        n_missing = summary.statistics.n_messages - structure.statistics.n_messages
        if n_missing > 0 and not recover:
            raise InputError(f"{n_missing} messages of its summary are not in it", where=name, hint=RECOVER_HINT)
        faults.messages_lost += max(n_missing, 0)
    return structure


def _header(data: InputFile, name: str, faults: Faults, *, recover: bool) -> tuple[str, str, int]:
    """Profile, library, and where the data section begins."""
    at = len(MAGIC)
    try:
        opcode, start, end = read_prefix(data, at, len(data))
        if opcode != HEADER:
            raise RecordError("the first record is not a header")
        profile, library = read_header(data, start, end)
    except RecordError as error:
        if not recover:
            raise InputError(f"the header is damaged: {error} (at byte {at})", where=name, hint=RECOVER_HINT) from error
        from cwcli.logs.format.resync import next_record

        following = next_record(data, at + 1, range(1 << 16))
        faults.bytes_lost += following - at
        return "", "", following
    return profile, library, end


def _hint_for(head: bytes) -> str:
    """What a file that is not MCAP may be."""
    if head.startswith(b"#ROSBAG"):
        return "it is a ROS 1 bag; `mcap convert` makes an MCAP file of it"
    if head.startswith(b"SQLite format 3"):
        return "it is a ROS 2 database; `ros2 bag convert` or `mcap convert` makes an MCAP file of it"
    if head.startswith((b"\x28\xb5\x2f\xfd", b"\x1f\x8b")):
        return "it is compressed as a whole; decompress it first, or pipe it in (`zstdcat FILE | cwcli ... -`)"
    return ""
