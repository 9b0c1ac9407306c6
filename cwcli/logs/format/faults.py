"""Counts of the faults of a file, and the errors about it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field

from cwcli.errors import InputError
from cwcli.input import InputFile
from cwcli.lazy_dataclass import dataclass

IMPORTABLE_MAGICS = (
    b"PAR1",
    b"PK\x03\x04",
    b"LOGG",
    b"\xb5\x62",
    b"\xef\xbb\xbf",
    b"\xff\xfe",
    b"\xfe\xff",
    b"RIFF",
    b"\x1a\x45\xdf\xa3",
)
"""The first bytes of Parquet, zip, BLF, UBX, text with a byte order mark, AVI and Matroska."""
BYTE_VALUES_OCCURRING_IN_TEXT = frozenset([9, 10, 13, *range(32, 127), *range(160, 256)])
"""The bytes that occur in text in ASCII and Latin-1: tab, line ends and printable characters."""
MAX_NON_MESSAGE_RECORDS = 1 << 16
"""The greatest number of schemas, channels, attachments and runs of metadata in a file; one with more is refused.
Chosen by hand: many times what recorders write."""
RECOVER_HINT = "--recover reads the intact parts"
"""The advice to a user whose log is damaged."""


def damaged_file_error(file: InputFile, at: int, why: object) -> InputError:
    """Return the error that a file is damaged at an offset; a `hint` attribute of `why` replaces the usual one."""
    part, at = file.part_and_offset(at)
    return InputError(f"damaged at byte {at}: {why}", where=part.name, hint=getattr(why, "hint", RECOVER_HINT))


def not_mcap_error(name: str, head: bytes) -> InputError:
    """Return the error that a file with this beginning is not MCAP."""
    hint = _guess_file_format_hint(head)
    if not hint and is_importable_head(head):
        import shlex

        is_unfit = name.startswith("<") or "://" in name or name.endswith(".mcap")
        named = "FILE" if is_unfit else shlex.quote(name)
        hint = f"if it is a table, a track or another recording: cwcli import {named} -o log.mcap"
    return InputError("it is not an MCAP file", where=name, hint=hint)


def is_importable_head(head: bytes) -> bool:
    """Tell whether a file with these first bytes can be of a kind that `cwcli import` reads."""
    if head.startswith(IMPORTABLE_MAGICS) or head[4:8] == b"ftyp":
        return True
    return (
        bool(head) and not head.startswith(b"#ROSBAG") and all(byte in BYTE_VALUES_OCCURRING_IN_TEXT for byte in head)
    )


def _guess_file_format_hint(head: bytes) -> str:
    """Return advice for the file format that the first bytes suggest, "" for an unknown one."""
    if head.startswith(b"#ROSBAG"):
        return "it is a ROS 1 bag; name the file, which is converted on the way in"
    if head.startswith(b"SQLite format 3"):
        return "it is a ROS 2 database; name the file, which is converted on the way in"
    if head.startswith((b"\x28\xb5\x2f\xfd", b"\x1f\x8b")):
        return "it is compressed as a whole; decompress it first, or pipe it in (`zstdcat FILE | cwcli ... -`)"
    return ""


def check_non_message_record_count(name: str, n: int) -> None:
    """Check the number of records other than messages and chunks: each costs time whenever the log is opened.

    Raises:
        InputError: It exceeds `MAX_NON_MESSAGE_RECORDS`.
    """
    if n > MAX_NON_MESSAGE_RECORDS:
        what = f"it holds more than {MAX_NON_MESSAGE_RECORDS:,} schemas, channels, attachments and parts with metadata"
        raise InputError(what, where=name, hint="`mcap filter` makes a log without them")


@dataclass
class Faults:
    """Counts of what could not be read, or was read in spite of a fault. They grow while the log is read.

    Attributes:
        file_faults: Faults of the file or of the parts of a recording, as text -> how often.
        crc_mismatches: Chunks with a wrong CRC; all their messages are left out.
        chunks_lost: Chunks that can't be decompressed, or have a wrong CRC.
        chunks_partial: Cut chunks whose first part was read.
        broken_indexes: Chunks whose message index differs from their messages; they are read without it.
        bytes_lost: Bytes of the file that can't be read.
        messages_lost: Messages in lost chunks and behind damaged records, as far as the file says.
        miscounted_channel_ids: Ids of channels with another number of messages than the summary says.
        data_crc_mismatch: Messages outside chunks were read, and the CRC over all of them is wrong.
        summary_damaged: The summary is damaged; the file was read record by record.
        undecodable: Topic -> reason -> messages.
    """

    file_faults: dict[str, int] = field(default_factory=dict)
    crc_mismatches: int = 0
    chunks_lost: int = 0
    chunks_partial: int = 0
    broken_indexes: int = 0
    bytes_lost: int = 0
    messages_lost: int = 0
    miscounted_channel_ids: set[int] = field(default_factory=set)
    data_crc_mismatch: bool = False
    truncated: bool = False
    summary_damaged: bool = False
    undecodable: dict[str, dict[str, int]] = field(default_factory=dict)

    def add_file_faults(self, notes: Mapping[str, int]) -> None:
        """Add faults of a file, or of the parts of a recording: text -> how often."""
        for what, count in notes.items():
            self.file_faults[what] = self.file_faults.get(what, 0) + count

    def keep_largest_undecodable_count(self, topic: str, reason: str, count: int) -> None:
        """Set how many messages of a topic could not be decoded for a reason.

        A topic may be read several times; the largest count of one pass is kept.
        """
        if count:
            reasons = self.undecodable.setdefault(topic, {})
            reasons[reason] = max(reasons.get(reason, 0), count)

    def counts_by_reason(self) -> dict[str, int]:
        """Return fault, in words for the user -> count, for all faults that occurred."""
        named = {
            **self.file_faults,
            "file cut short": int(self.truncated),
            "summary damaged": int(self.summary_damaged),
            "CRC of all messages wrong": int(self.data_crc_mismatch),
            "chunks lost": self.chunks_lost,
            "of these with a wrong CRC": self.crc_mismatches,
            "chunks read in part": self.chunks_partial,
            "message indexes that differ from their chunk": self.broken_indexes,
            "channels with a wrong message count in the summary": len(self.miscounted_channel_ids),
            "bytes lost": self.bytes_lost,
            "messages lost": self.messages_lost,
        }
        for topic, reasons in self.undecodable.items():
            for reason, count in reasons.items():
                named[f"undecodable messages on {topic} ({reason})"] = count
        return {reason: count for reason, count in named.items() if count}
