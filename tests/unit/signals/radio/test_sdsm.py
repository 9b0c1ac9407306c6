"""SDSM off the radio, against an encoder of its own and a message of another implementation."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.signals.build import build_signal
from cwcli.signals.canonical import RemoteSignal
from cwcli.signals.radio.messages import CODE_OF_MISSING_COMPONENT, DECODE_FAULT_TEXTS, decode_messages
from cwcli.signals.radio.standard_messages import SDSM
from cwcli.signals.role import Role
from tests.unit.signals.radio.packing import framed
from tests.unit.signals.radio.sdsm_packing import any_sdsm
from tests.unit.signals.radio.test_bsm import mutated, octets_of
from tests.unit.signals.v2x_messages import radio

PUBLISHED = bytes.fromhex("0029250a010c0c0a101f9c37ea97fc66b10b430c34000a00000020002bba0a000200004400240009")
"""V2X-Hub's test EncodeSDSM: every code of its only object is 1."""


def check_random(n: int, seed: int) -> None:
    """Every component of any message is what the encoder packed."""
    rng = np.random.default_rng(seed)
    made = [any_sdsm(rng) for _ in range(n)]
    decoded = decode_messages(SDSM.program, octets_of([message for *_, message in made]))
    assert not decoded.status.any()
    objects = [(row, one) for row, (_, each, _) in enumerate(made) for one in each]
    assert decoded.rows[SDSM.objects_path].tolist() == [row for row, _ in objects]
    for path in SDSM.components.values():
        below = path.removeprefix(f"{SDSM.objects_path}.")
        owners = [values for values, *_ in made] if below == path else [one for _, one in objects]
        expected = [one.get(below, CODE_OF_MISSING_COMPONENT) for one in owners]
        assert decoded.component_codes(path).tolist() == expected, path


def check_mutated(n: int, seed: int) -> dict[str, int]:
    """Any octets are decoded or counted, and what is decoded lies inside the type's ranges."""
    rng = np.random.default_rng(seed)
    some = [any_sdsm(rng)[2] for _ in range(50)]
    broken = [mutated(rng, some[int(rng.integers(len(some)))]) for _ in range(n)]
    decoded = decode_messages(SDSM.program, octets_of(broken))
    assert set(decoded.status.tolist()) <= {0, *DECODE_FAULT_TEXTS}
    offset = decoded.component_codes(SDSM.components["east_m"])
    assert (np.abs(offset) <= 32_767).all()
    assert not decoded.status[decoded.rows[SDSM.objects_path]].any()
    counts = np.bincount(decoded.status, minlength=max(DECODE_FAULT_TEXTS) + 1)
    return {"decoded": int(counts[0])} | {reason: int(counts[code]) for code, reason in DECODE_FAULT_TEXTS.items()}


def test_any_message_of_an_independent_encoder_is_decoded_exactly() -> None:
    check_random(150, seed=12)


def test_broken_messages_are_decoded_or_counted() -> None:
    counts = check_mutated(3000, seed=13)
    assert counts["decoded"] > 300
    assert counts["truncated message"] > 300


def test_a_published_message_is_what_its_publisher_encoded() -> None:
    signal, quality = build_signal(Role.REMOTE, radio("carma_driver_msgs/ByteArray", "content", PUBLISHED))
    assert isinstance(signal, RemoteSignal)
    assert signal.station.values == ("010c0c0a:1",)
    # lat 38121212, long -77121212 and 10 cm to the north and to the east
    assert signal.latitude_deg.tolist() == pytest.approx([3.8121212 + 0.1 / 110_580], abs=1e-9)
    assert signal.longitude_deg.tolist() == pytest.approx([-7.7121212 + 0.1 / 111_075], abs=1e-9)
    assert signal.speed_mps.tolist() == [0.02]
    assert signal.heading_rad.tolist() == pytest.approx([np.deg2rad(90 - 0.0125)])
    assert signal.heading_sigma_rad.tolist() == pytest.approx([np.deg2rad(10) / 1.959964])
    assert quality.objects is not None
    assert quality.objects.repaired == {"no message time, log time used": 1}


def test_a_message_that_is_cut_is_rejected() -> None:
    rng = np.random.default_rng(14)
    *_, message = any_sdsm(rng)
    _, quality = build_signal(
        Role.REMOTE, radio("carma_driver_msgs/ByteArray", "content", framed(message[:-3], message_id=41))
    )
    assert quality.rejected == {"truncated message": 1}
