"""WAVE short messages around SAE's, written octet by octet after IEEE 1609.3."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.signals.build import build_signal
from cwcli.signals.canonical import RemoteSignal
from cwcli.signals.quality import Quality
from cwcli.signals.radio import frames
from cwcli.signals.role import Role
from tests.unit.signals.radio.security import secured
from tests.unit.signals.radio.test_bsm import octets_of
from tests.unit.signals.v2x_messages import packed_bsm, radio

CHANNEL = bytes([15, 1, 172])
POWER = bytes([4, 1, 20])
"""Extensions: channel number and transmit power."""


def wave(payload: bytes, *, psid: bytes = b"\x20", network: bytes = b"", transport: bytes = b"") -> bytes:
    """A payload in both headers; `network` and `transport` are their extensions, three octets each."""
    head = bytes([0x0B, len(network) // 3]) + network if network else b"\x03"
    to = b"\x01" + psid + bytes([len(transport) // 3]) + transport if transport else b"\x00" + psid
    n = len(payload)
    size = bytes([n]) if n < 128 else (0x8000 | n).to_bytes(2, "big")
    return head + to + size + payload


def remote(*messages: bytes) -> tuple[RemoteSignal, Quality]:
    signal, quality = build_signal(Role.REMOTE, radio("carma_driver_msgs/ByteArray", "content", *messages))
    assert isinstance(signal, RemoteSignal)
    return signal, quality


@pytest.mark.parametrize(
    "more",
    [
        {},
        {"psid": b"\x80\x02"},
        {"psid": b"\xe0\x00\x00\x15"},
        {"network": CHANNEL + POWER},
        {"network": POWER, "transport": CHANNEL},
    ],
    ids=["plain", "psid-2", "psid-4", "network", "both"],
)
@pytest.mark.parametrize("security", [None, False, True], ids=["bare", "unsecured", "signed"])
def test_what_is_inside_is_read(security: bool | None, more: dict[str, bytes]) -> None:
    message = packed_bsm() if security is None else secured(packed_bsm(), signed=security)
    signal, quality = remote(wave(message, **more))
    assert signal.station.values == ("2a3c603c",)
    assert quality.used == 1
    assert any("not verified" in note for note in quality.notes) == (security is True)


def test_a_long_one_has_its_length_in_two_octets() -> None:
    payload = bytes(range(256)) * 2
    found = frames.extract_wsmp_payloads(octets_of([wave(payload), payload[5:], wave(b"\x07")]))
    inside = [found.data[a:b].tobytes() for a, b in zip(found.starts, found.ends, strict=True)]
    assert inside == [payload, payload[5:], b"\x07"]


def test_what_is_cut_or_promises_more_is_truncated() -> None:
    whole = wave(packed_bsm(), network=CHANNEL, transport=POWER)
    _, quality = remote(*(whole[:n] for n in range(len(whole))))
    assert quality.used == 0
    assert quality.rejected["truncated frame"] == len(whole)
    _, quality = remote(b"\x03\x02" + wave(packed_bsm())[2:], b"\x0b\xff" + bytes(40), b"\x03\x00\xf5" + bytes(40))
    assert quality.rejected == {"truncated frame": 2, "not a frame of the format": 1}


def test_any_octets_stay_inside_their_message() -> None:
    rng = np.random.default_rng(3)
    some = [bytes([3 + 8 * int(rng.integers(2)), *rng.integers(0, 256, int(rng.integers(0, 30)))]) for _ in range(5000)]
    octets = octets_of(some)
    found = frames.extract_wsmp_payloads(octets)
    assert ((found.starts >= octets.starts) & (found.ends <= octets.ends) & (found.ends >= found.starts)).all()
