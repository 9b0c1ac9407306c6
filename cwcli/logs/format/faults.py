"""What is wrong with a file, counted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from cwcli.errors import InputError
from cwcli.input import InputFile

MAX_RECORDS = 1 << 16
"""Beside messages and chunks; metadata records that stand side by side are one."""
RECOVER_HINT = "--recover reads what is intact"


def damaged(file: InputFile, at: int, why: object) -> InputError:
    """The error that a file is damaged at an offset; `why` may have a hint of its own."""
    part, at = file.place(at)
    return InputError(f"damaged at byte {at}: {why}", where=part.name, hint=getattr(why, "hint", RECOVER_HINT))


def no_mcap(name: str, head: bytes) -> InputError:
    """The error that a file that begins like this is something else."""
    return InputError("it is not an MCAP file", where=name, hint=_hint_for(head))


def _hint_for(head: bytes) -> str:
    """What a file that is not MCAP may be."""
    if head.startswith(b"#ROSBAG"):
        return "it is a ROS 1 bag; name the file, which is converted on the way in"
    if head.startswith(b"SQLite format 3"):
        return "it is a ROS 2 database; name the file, which is converted on the way in"
    if head.startswith((b"\x28\xb5\x2f\xfd", b"\x1f\x8b")):
        return "it is compressed as a whole; decompress it first, or pipe it in (`zstdcat FILE | cwcli ... -`)"
    return ""


def check_record_count(name: str, n: int) -> None:
    """Check the number of records beside messages and chunks.

    Raises:
        InputError: It is more than any recorder writes; each costs time whenever the log is opened.
    """
    if n > MAX_RECORDS:
        what = f"it holds more than {MAX_RECORDS:,} schemas, channels, attachments and parts with metadata"
        raise InputError(what, where=name, hint="`mcap filter` makes a log without them")


@dataclass
class Faults:
    """Counts of what could not be read, or was read in spite of a fault. They grow while the log is read.

    Attributes:
        parts: What is wrong with the file, or with the parts of a recording, as such -> how often.
        crc_mismatches: Chunks whose CRC does not fit; all their messages are left out.
        chunks_lost: Chunks that can't be decompressed, or whose CRC does not fit.
        chunks_partial: Cut chunks whose first part was read.
        broken_indexes: Chunks whose message index does not fit what they hold; they are read without it.
        bytes_lost: Bytes of the file that hold nothing readable.
        messages_lost: Messages in lost chunks and behind damaged records, as far as the file tells.
        miscounted: Channels of which the file holds other numbers of messages than its summary says.
        data_crc_mismatch: Messages outside chunks were read, and the CRC over all of them does not fit: one of them may
            be wrong.
        truncated: The file ends before its end.
        summary_damaged: The summary can't be trusted; the file was read record by record.
        undecodable: Topic -> reason -> messages.
    """

    parts: dict[str, int] = field(default_factory=dict)
    crc_mismatches: int = 0
    chunks_lost: int = 0
    chunks_partial: int = 0
    broken_indexes: int = 0
    bytes_lost: int = 0
    messages_lost: int = 0
    miscounted: set[int] = field(default_factory=set)
    data_crc_mismatch: bool = False
    truncated: bool = False
    summary_damaged: bool = False
    undecodable: dict[str, dict[str, int]] = field(default_factory=dict)

    def note_parts(self, notes: Mapping[str, int]) -> None:
        """Note what is wrong with a file, or a recording, as such."""
        for what, count in notes.items():
            self.parts[what] = self.parts.get(what, 0) + count

    def note_undecodable(self, topic: str, reason: str, count: int) -> None:
        """Note how many messages of a topic one reading of it could not decode so far.

        The same messages, or some of them, may be read again: the reading that found most of them counts.
        """
        if count:
            reasons = self.undecodable.setdefault(topic, {})
            reasons[reason] = max(reasons.get(reason, 0), count)

    def counts(self) -> dict[str, int]:
        """Reason, as the user reads it -> count, for everything that happened."""
        named = {
            **self.parts,
            "file cut short": int(self.truncated),
            "summary damaged": int(self.summary_damaged),
            "CRC of all messages wrong": int(self.data_crc_mismatch),
            "chunks lost": self.chunks_lost,
            "of these with a wrong CRC": self.crc_mismatches,
            "chunks read in part": self.chunks_partial,
            "message indexes that do not fit": self.broken_indexes,
            "channels whose messages the summary counts wrongly": len(self.miscounted),
            "bytes lost": self.bytes_lost,
            "messages lost": self.messages_lost,
        }
        for topic, reasons in self.undecodable.items():
            for reason, count in reasons.items():
                named[f"undecodable messages on {topic} ({reason})"] = count
        return {reason: count for reason, count in named.items() if count}
