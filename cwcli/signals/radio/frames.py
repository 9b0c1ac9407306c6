"""Finding the messages inside the octets that a radio handed over: the type and start of each.

Formats: `j2735` (a MessageFrame of SAE J2735, bare or inside IEEE 1609.2, 1609.3 or both), `btp` (ETSI's basic
transport: the port in the first two octets, the message from the fifth on) and `its` (ETSI's message by itself). What
is signed is unwrapped, not verified.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.kernels import radio_frames
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import BoolArray, Columns, Field, Ragged
from cwcli.signals.leaf_fields import find_field
from cwcli.signals.radio.messages import Octets, UInt8Array
from cwcli.signals.radio.wsmp import extract_wsmp_payloads

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
