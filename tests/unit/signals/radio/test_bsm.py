"""BSM off the radio: published messages, any message of an independent encoder, and broken ones."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.signals.bsm_flags import EVENT_FLAG_NAMES, HARD_BRAKING_FLAG_NAME
from cwcli.signals.radio.messages import (
    CODE_OF_MISSING_COMPONENT,
    DECODE_FAULT_TEXTS,
    DecodedMessages,
    Octets,
    decode_messages,
)
from cwcli.signals.radio.program import compile_asn1_type, load_message_type
from cwcli.signals.radio.standard_messages import BSM_EVENT_FLAGS_PATH
from tests.unit.signals.radio import packing
from tests.unit.signals.radio.vectors import BSM_ODE, CORE_ODE, CRUMBS_ODE, PREDICTION_ODE

N_RANDOM = 1500
N_MUTATED = 20_000
CRUMB_NAMES = ("latOffset", "lonOffset", "elevationOffset", "timeOffset")
CRUMBS_PATH = "partII.partII-Value.pathHistory.crumbData"
PREDICTION_PATH = "partII.partII-Value.pathPrediction"
CORE_PROGRAM = compile_asn1_type(
    load_message_type("bsm"),
    (*packing.CORE, BSM_EVENT_FLAGS_PATH, *(f"{PREDICTION_PATH}.{name}" for name in ("radiusOfCurve", "confidence"))),
)
"""All components of part I, and some of part II, more than cwcli reads."""
HISTORY_PROGRAM = compile_asn1_type(
    load_message_type("bsm"), tuple(f"{CRUMBS_PATH}.{name}" for name in CRUMB_NAMES), (CRUMBS_PATH,)
)
"""The points of the path history."""


def octets_of(messages: list[bytes]) -> Octets:
    ends = np.cumsum([len(each) for each in messages]).astype(np.int64)
    starts = ends - np.array([len(each) for each in messages], np.int64)
    return Octets(np.frombuffer(b"".join(messages), np.uint8), starts, ends)


def core_of(decoded: DecodedMessages, row: int) -> dict[str, int]:
    return {name: int(decoded.component_codes(name)[row]) for name in packing.CORE}


def crumbs_of(decoded: DecodedMessages, row: int) -> list[tuple[int, ...]]:
    mine = decoded.rows[CRUMBS_PATH] == row
    columns = [decoded.component_codes(f"{CRUMBS_PATH}.{name}")[mine].tolist() for name in CRUMB_NAMES]
    return list(zip(*columns, strict=True))


def check_random(n: int, seed: int) -> None:
    """Every component of any message is what was packed (also run with 100,000 by `tests.studies.radio`)."""
    rng = np.random.default_rng(seed)
    values = [packing.random_bsm(rng) for _ in range(n)]
    octets = octets_of([packing.bsm(each) for each in values])
    core, history = (
        decode_messages(CORE_PROGRAM, octets),
        decode_messages(HISTORY_PROGRAM, octets),
    )
    assert not core.status.any()
    assert not history.status.any()
    radius, confidence = (core.component_codes(f"{PREDICTION_PATH}.{name}") for name in ("radiusOfCurve", "confidence"))
    first = np.searchsorted(history.rows[CRUMBS_PATH], np.arange(n + 1))
    crumbs = np.stack([history.component_codes(f"{CRUMBS_PATH}.{name}") for name in CRUMB_NAMES], axis=1)
    for row, value in enumerate(values):
        assert core_of(core, row) == {name: value[name] for name in packing.CORE}
        safety = value.get("safety", {})
        assert core.component_codes(BSM_EVENT_FLAGS_PATH)[row] == safety.get("events", CODE_OF_MISSING_COMPONENT)
        assert (radius[row], confidence[row]) == safety.get(
            "prediction", (CODE_OF_MISSING_COMPONENT, CODE_OF_MISSING_COMPONENT)
        )
        expected = [[crumb[name] for name in CRUMB_NAMES] for crumb in value.get("all_crumbs", [])]
        assert crumbs[first[row] : first[row + 1]].tolist() == expected


def check_mutated(n: int, seed: int) -> dict[str, int]:
    """Broken messages are decoded to what stands in their bits, or counted; how many by reason."""
    rng = np.random.default_rng(seed)
    values = [packing.random_bsm(rng) for _ in range(500)]
    messages = [mutated(rng, packing.bsm(values[int(rng.integers(len(values)))])) for _ in range(n)]
    decoded = decode_messages(CORE_PROGRAM, octets_of(messages))
    history = decode_messages(HISTORY_PROGRAM, octets_of(messages))
    assert (decoded.status == history.status).all()
    for row, message in enumerate(messages):
        core = core_of(decoded, row)
        if decoded.status[row]:
            assert set(core.values()) == {CODE_OF_MISSING_COMPONENT}
            continue
        bits = "".join(f"{each:08b}" for each in message)
        assert packing.core_bits(core) == bits[3 : 3 + packing.N_CORE_BITS]
        for name, (offset, _, high) in packing.CORE.items():
            assert -offset <= core[name] <= high
    counts = np.bincount(decoded.status, minlength=max(DECODE_FAULT_TEXTS) + 1)
    assert counts.sum() == n
    assert not set(np.flatnonzero(counts)) - {0, *DECODE_FAULT_TEXTS}
    return {"decoded": int(counts[0])} | {reason: int(counts[code]) for code, reason in DECODE_FAULT_TEXTS.items()}


def mutated(rng: np.random.Generator, message: bytes) -> bytes:
    """With bits turned, octets cut off, put in or replaced."""
    octets = bytearray(message)
    for _ in range(int(rng.integers(1, 4))):
        at = int(rng.integers(0, max(len(octets), 1)))
        what = rng.integers(4)
        if what == 0 and octets:
            octets[at] ^= 1 << int(rng.integers(8))
        elif what == 1:
            del octets[at:]
        elif what == 2:
            octets[at:at] = rng.integers(0, 256, int(rng.integers(1, 4)), dtype=np.uint8).tobytes()
        elif octets:
            octets[at] = int(rng.integers(256))
    return bytes(octets)


def test_a_published_message_is_what_its_publisher_decoded() -> None:
    octets = octets_of([BSM_ODE[4:]])  # 00 14: BSM; 80 b8: 184 octets
    core, history = (
        decode_messages(CORE_PROGRAM, octets),
        decode_messages(HISTORY_PROGRAM, octets),
    )
    assert core_of(core, 0) == CORE_ODE
    assert crumbs_of(history, 0) == CRUMBS_ODE
    assert [int(core.component_codes(f"{PREDICTION_PATH}.{name}")[0]) for name in ("radiusOfCurve", "confidence")] == [
        *PREDICTION_ODE
    ]
    assert core.component_codes(BSM_EVENT_FLAGS_PATH)[0] == CODE_OF_MISSING_COMPONENT


def test_any_message_of_an_independent_encoder_is_decoded_exactly() -> None:
    check_random(N_RANDOM, seed=1)


def test_broken_messages_are_decoded_or_counted() -> None:
    counts = check_mutated(N_MUTATED, seed=2)
    assert counts["decoded"] > 1000
    assert counts["truncated message"] > 1000
    assert counts["code outside its range"] > 100


def test_hard_braking_is_the_eighth_flag() -> None:
    assert EVENT_FLAG_NAMES.index(HARD_BRAKING_FLAG_NAME) + 1 == 8


@pytest.mark.parametrize("n_octets", range(37))
def test_a_cut_message_is_truncated(n_octets: int) -> None:
    whole = packing.bsm(dict.fromkeys(packing.CORE, 0))
    assert len(whole) == 37
    decoded = decode_messages(CORE_PROGRAM, octets_of([whole, whole[:n_octets], whole]))
    assert [DECODE_FAULT_TEXTS.get(int(code), "") for code in decoded.status] == ["", "truncated message", ""]


@pytest.mark.parametrize(("name", "code"), [("coreData.heading", 28_801), ("coreData.brakes.brakeBoost", 3)])
def test_a_code_beyond_the_type_is_no_value(name: str, code: int) -> None:
    message = packing.bsm(dict.fromkeys(packing.CORE, 0) | {name: code})
    decoded = decode_messages(CORE_PROGRAM, octets_of([message]))
    assert DECODE_FAULT_TEXTS[int(decoded.status[0])] == "code outside its range"


def test_an_open_type_that_is_longer_than_its_contents_is_told() -> None:
    contents = packing.safety_bits({"prediction": (5, 6)}) + "0" * 16
    message = packing.bsm(dict.fromkeys(packing.CORE, 0) | {"part_two": [(0, contents)]})
    decoded = decode_messages(CORE_PROGRAM, octets_of([message]))
    assert DECODE_FAULT_TEXTS[int(decoded.status[0])] == "length disagrees with the contents"
