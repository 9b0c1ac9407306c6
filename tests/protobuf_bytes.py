"""Protobuf wire format, written by hand for tests."""

from __future__ import annotations


def encode_varint(value: int) -> bytes:
    """Encode a number that is not negative as a varint of protobuf: seven bits a byte, the lowest first."""
    encoded = bytearray()
    while value > 0x7F:
        encoded.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*encoded, value])
