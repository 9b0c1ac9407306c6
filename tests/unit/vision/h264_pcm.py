"""H.264 made by hand: every macroblock is either raw samples (I_PCM) or copied from the picture before (P_Skip).

No compression, so the decoded samples are known exactly. Source: ITU-T H.264, 7.3 (syntax), baseline profile.
"""

from __future__ import annotations

import re

MB_PX = 16
I_PCM_IN_I, I_PCM_IN_P = 25, 30
IDR_SLICE, SLICE, SPS, PPS = 5, 1, 7, 8
GREY_CHROMA = 128


class Bits:
    """Collects bits, most significant first."""

    def __init__(self) -> None:
        self.text: list[str] = []

    def u(self, n: int, value: int) -> Bits:
        self.text.append(f"{value:0{n}b}")
        return self

    def ue(self, value: int) -> Bits:
        coded = f"{value + 1:b}"
        self.text.append("0" * (len(coded) - 1) + coded)
        return self

    def align(self) -> Bits:
        self.text.append("0" * (-len("".join(self.text)) % 8))
        return self

    def raw(self, data: bytes) -> Bits:
        self.text.append("".join(f"{byte:08b}" for byte in data))
        return self

    def nal(self, kind: int) -> bytes:
        """As a NAL unit with its start code, trailing bits and emulation prevention."""
        text = "".join(self.u(1, 1).align().text)
        payload = int(text, 2).to_bytes(len(text) // 8, "big")
        payload = re.sub(rb"\x00\x00(?=[\x00-\x03])", b"\x00\x00\x03", payload)
        return b"\x00\x00\x00\x01" + bytes([0x60 | kind]) + payload


def parameters(width_mbs: int, height_mbs: int) -> bytes:
    """The sequence's and the picture's parameter sets; pictures come out in the order of decoding."""
    sps = Bits().u(8, 66).u(8, 0).u(8, 40).ue(0).ue(0).ue(2).ue(1).u(1, 0)
    sps.ue(width_mbs - 1).ue(height_mbs - 1).u(1, 1).u(1, 1).u(1, 0).u(1, 0)
    pps = Bits().ue(0).ue(0).u(1, 0).u(1, 0).ue(0).ue(0).ue(0).u(1, 0).u(2, 0).ue(0).ue(0).ue(0)
    pps.u(1, 1).u(1, 0).u(1, 0)
    return sps.nal(SPS) + pps.nal(PPS)


def macroblock(bits: Bits, kind: int, luma: int) -> None:
    """One macroblock of raw samples, all of one grey."""
    bits.ue(kind).align().raw(bytes([luma]) * 256 + bytes([GREY_CHROMA]) * 128)


def key_picture(width_mbs: int, height_mbs: int, luma: int) -> bytes:
    """A picture of one grey that needs no other."""
    bits = Bits().ue(0).ue(7).ue(0).u(4, 0).ue(0).u(2, 0).ue(0).ue(1)
    for _ in range(width_mbs * height_mbs):
        macroblock(bits, I_PCM_IN_I, luma)
    return bits.nal(IDR_SLICE)


def changed_picture(width_mbs: int, height_mbs: int, frame_number: int, changed: int, luma: int) -> bytes:
    """The picture before with one macroblock changed.

    Args:
        width_mbs, height_mbs: Size in macroblocks.
        frame_number: 1, 2, ... since the key picture.
        changed: Number of the macroblock.
        luma: Its new samples, 16 to 235.
    """
    bits = Bits().ue(0).ue(5).ue(0).u(4, frame_number % 16).u(1, 0).u(1, 0).u(1, 0).ue(0).ue(1)
    bits.ue(changed)
    macroblock(bits, I_PCM_IN_P, luma)
    rest = width_mbs * height_mbs - changed - 1
    if rest:
        bits.ue(rest)
    return bits.nal(SLICE)
