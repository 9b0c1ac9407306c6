"""WAVE short messages (IEEE 1609.3-2016, WSMP version 3): finding their payloads in received octets.

Network header: version in the low three bits, a flag for extensions above them, the subtype in the high four (0).
Transport header: what addresses it (0: a PSID; 1: one with extensions), the PSID, a length. Extensions are skipped.
"""

from __future__ import annotations

import numpy as np

from cwcli.signals.columns import BoolArray
from cwcli.signals.radio.messages import Octets

WSMP_VERSION = 3
"""The version of the WAVE short message protocol that is read."""
WSMP_EXTENSIONS_BIT = 0x08
"""The bit in the first octet of the network header that says that extensions follow (IEEE 1609.3-2016)."""
ADDRESS_TYPE_PSID, ADDRESS_TYPE_PSID_WITH_EXTENSIONS = 0, 1
"""Codes of the transport header's first field: addressed by a PSID, and by a PSID that extensions follow
(IEEE 1609.3-2016)."""
MAX_HEADER_EXTENSIONS = 16
"""The largest number of extensions that a header can have; chosen by hand."""


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
