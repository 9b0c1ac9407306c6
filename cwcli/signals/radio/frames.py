"""Finding the messages inside the octets that a radio handed over: the type and start of each.

Formats: `j2735` (a MessageFrame of SAE J2735, bare or inside IEEE 1609.2, 1609.3 or both), `btp` (ETSI's basic
transport: the port in the first two octets, the message from the fifth on) and `its` (ETSI's message by itself). What
is signed is unwrapped, not verified.

WAVE short messages (IEEE 1609.3-2016, WSMP version 3) have a network header: version in the low three bits, a flag for
extensions above them, the subtype in the high four (0). Their transport header is what addresses it (0: a PSID; 1: one
with extensions), the PSID, a length. Extensions are skipped.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.kernels import radio_frames
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import BoolArray, Columns, Field, Ragged
from cwcli.signals.leaf_fields import find_field
from cwcli.signals.radio.messages import Octets, UInt8Array

KERNEL_FORMAT_CODES: dict[str, int] = {
    "j2735": radio_frames.FORMAT_J2735,
    "btp": radio_frames.FORMAT_BTP,
    "its": radio_frames.FORMAT_ITS,
}
"""The kernel's code of each format of received octets."""
OCTET_FIELD_NAMES = ("content", "data", "payload", "message", "msg", "buffer", "bytes", "packet")
"""The fields that can hold a radio's octets, in order of preference."""
FRAME_FAULT_TEXTS: dict[int, str] = {
    radio_frames.FRAME_SHORT: "truncated frame",
    radio_frames.FRAME_ENCRYPTED: "encrypted (IEEE 1609.2)",
    radio_frames.FRAME_NO_PAYLOAD: "IEEE 1609.2 without a message",
    radio_frames.FRAME_UNKNOWN: "not a frame of the format",
}
"""The reason why octets hold no message, by status code."""
WSMP_VERSION = 3
"""The version of the WAVE short message protocol that is read."""
WSMP_EXTENSIONS_BIT = 0x08
"""The bit in the first octet of the network header that says that extensions follow (IEEE 1609.3-2016)."""
ADDRESS_TYPE_PSID, ADDRESS_TYPE_PSID_WITH_EXTENSIONS = 0, 1
"""Codes of the transport header's first field: addressed by a PSID, and by a PSID that extensions follow
(IEEE 1609.3-2016)."""
MAX_HEADER_EXTENSIONS = 16
"""The largest number of extensions that a header can have; chosen by hand."""


class _OctetCursor:
    """A reading position in each message; past a message's end it reads zeros and marks the message as short."""

    def __init__(self, octets: Octets) -> None:
        self.octets = octets
        self.at = octets.starts.copy()
        self.is_short: BoolArray = np.zeros(len(octets), np.bool_)

    def peek_octet(self) -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
        """Return the next octet of each message."""
        last = len(self.octets.data) - 1
        value = self.octets.data[np.minimum(self.at, last)].astype(np.int64)
        return np.where(self.at < self.octets.ends, value, 0)

    def take_octet(self, is_wanted: BoolArray | None = None) -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
        """Return the next octet of the messages that are wanted and move on there; 0 for the others."""
        if is_wanted is None:
            is_wanted = np.ones(len(self.at), np.bool_)
        value = np.where(is_wanted, self.peek_octet(), 0)
        self.is_short |= is_wanted & (self.at >= self.octets.ends)
        self.at += is_wanted
        return value

    def skip_psid(self) -> None:
        """Skip an identifier of one to four octets: its first octet begins with as many ones as more follow."""
        first = self.take_octet()
        self.at += (first >= 0x80).astype(np.int64) + (first >= 0xC0) + (first >= 0xE0)
        self.is_short |= (first >= 0xF0) | (self.at > self.octets.ends)

    def skip_extensions(self, is_wanted: BoolArray) -> None:
        """Skip the extensions: their number, and of each an identifier, a length and so many octets."""
        left = self.take_octet(is_wanted)
        self.is_short |= left > MAX_HEADER_EXTENSIONS
        for _ in range(MAX_HEADER_EXTENSIONS):
            has_one = (left > 0) & ~self.is_short
            if not has_one.any():
                break
            self.take_octet(has_one)
            self.at += self.take_octet(has_one)
            left = left - has_one


@dataclass(frozen=True)
class UnwrappedFrames:
    """The messages that were found in n rows.

    Attributes:
        octets: The messages.
        message: Shape (n,): J2735's message id, the BTP port or ETSI's message id, by format.
        security: Shape (n,): `radio_frames.SECURITY_*`.
        status: Shape (n,): 0, or the code of a fault.
    """

    octets: Octets
    message: npt.NDArray[np.int32]
    security: UInt8Array
    status: UInt8Array

    @property
    def is_signed_mask(self) -> BoolArray:
        """Where a signature was skipped, shape (n,)."""
        signed: BoolArray = self.security == radio_frames.SECURITY_SIGNED
        return signed


def unwrap_frames(columns: Columns, form: str) -> UnwrappedFrames:
    """Find the messages in the octets of a channel.

    Args:
        columns: The channel with a field of octets; rows without octets count as truncated.
        form: The format: `j2735`, `btp` or `its`.
    """
    octets = _octets_of_rows(find_field(columns, *OCTET_FIELD_NAMES), len(columns))
    if form == "j2735":
        octets = extract_wsmp_payloads(octets)
    n = len(octets)
    begins, stops = np.zeros(n, np.int64), np.zeros(n, np.int64)
    message, security, status = np.zeros(n, np.int32), np.zeros(n, np.uint8), np.zeros(n, np.uint8)
    radio_frames.frames(
        octets.data,
        octets.starts,
        octets.ends,
        form=KERNEL_FORMAT_CODES[form],
        begins=begins,
        stops=stops,
        message=message,
        security=security,
        status=status,
    )
    return UnwrappedFrames(Octets(octets.data, begins, stops), message, security, status)


def _octets_of_rows(field: Field | None, n: int) -> Octets:
    """Return the octets of each row; a row with a number that is no octet has none."""
    if isinstance(field, np.ndarray) and field.ndim == 2:
        field = Ragged(field.reshape(-1), np.arange(n + 1, dtype=np.int64) * field.shape[1])
    if not isinstance(field, Ragged):
        return Octets(np.zeros(0, np.uint8), np.zeros(n, np.int64), np.zeros(n, np.int64))
    starts, ends = field.offsets[:-1], field.offsets[1:]
    if field.values.dtype == np.uint8:
        return Octets(np.ascontiguousarray(field.values), starts, ends.copy())
    values = field.values.astype(np.float64)
    is_octet = (values >= 0) & (values <= 255) & (values == np.floor(values))
    n_bad = np.concatenate([[0], np.cumsum(~is_octet)])
    has_bad = n_bad[ends] > n_bad[starts]
    return Octets(np.where(is_octet, values, 0).astype(np.uint8), starts, np.where(has_bad, starts, ends))


def extract_wsmp_payloads(octets: Octets) -> Octets:
    """Return the payloads of WAVE short messages, and other messages as they are.

    One that ends before its payload, or promises more than there is, has no octets.
    """
    if not len(octets.data):
        return octets
    walk = _OctetCursor(octets)
    head = walk.take_octet()
    following = walk.peek_octet()
    # without extensions IEEE 1609.2 begins with the same octet, and goes on with another one
    is_wsmp = (head == WSMP_VERSION | WSMP_EXTENSIONS_BIT) | (
        (head == WSMP_VERSION) & (following <= ADDRESS_TYPE_PSID_WITH_EXTENSIONS)
    )
    is_wsmp &= octets.ends > octets.starts + 1
    if not is_wsmp.any():
        return octets
    walk.skip_extensions((head & WSMP_EXTENSIONS_BIT) != 0)
    to = walk.take_octet()
    walk.skip_psid()
    walk.skip_extensions(to == ADDRESS_TYPE_PSID_WITH_EXTENSIONS)
    size = walk.take_octet()
    is_long = size >= 0x80
    more = walk.take_octet(is_long)
    size = np.where(is_long, ((size & 0x3F) << 8) | more, size)
    is_good = ~walk.is_short & (to <= ADDRESS_TYPE_PSID_WITH_EXTENSIONS) & (walk.at + size <= octets.ends)
    starts = np.where(is_wsmp, np.where(is_good, walk.at, octets.starts), octets.starts)
    ends = np.where(is_wsmp, np.where(is_good, walk.at + size, octets.starts), octets.ends)
    return Octets(octets.data, starts, ends)
