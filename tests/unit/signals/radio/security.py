"""Messages inside IEEE 1609.2, written octet by octet: it shares nothing with the decoder."""

from __future__ import annotations

VERSION, UNSECURED, SIGNED = b"\x03", b"\x80", b"\x81"
SHA256 = b"\x00"
PAYLOAD_OF_DATA = b"\x40"
HEADER_OF_PSID_AND_TIME = b"\x40" + b"\x01\x20" + (5).to_bytes(8, "big")
"""The header's presence bits, the PSID 32 with its length, and the generation time 5."""
DIGEST_OF_SIGNER = b"\x80" + b"\x07" * 8
SIGNATURE_OF_NIST_P256 = b"\x80" + b"\x80" + b"\x01" * 32 + b"\x02" * 32
"""Choice of the curve, the point by its x alone, and the number s."""
SHORT_LENGTH = 128


def secured(message: bytes, *, signed: bool) -> bytes:
    """A message as `Ieee1609Dot2Data` in canonical OER, as unsecured or as signed data; of at most 255 octets."""
    n = len(message)
    size = bytes([n]) if n < SHORT_LENGTH else bytes([0x81, n])
    plain = VERSION + UNSECURED + size + message
    if not signed:
        return plain
    payload = PAYLOAD_OF_DATA + plain + HEADER_OF_PSID_AND_TIME
    return VERSION + SIGNED + SHA256 + payload + DIGEST_OF_SIGNER + SIGNATURE_OF_NIST_P256
