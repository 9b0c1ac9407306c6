"""CAM off the radio: published messages, and any message of an independent encoder."""

from __future__ import annotations

from importlib.resources import files
from typing import Any

import numpy as np
import pytest
from pycrate_asn1dir import ITS_CAM_2, ITS_DENM_3

from cwcli.signals.radio.messages import CODE_OF_MISSING_COMPONENT, DECODE_FAULT_TEXTS, decode_messages
from cwcli.signals.radio.program import Asn1Type, compile_asn1_type, load_message_type
from cwcli.signals.radio.standard_messages import CAM
from tests.unit.signals.radio.test_bsm import mutated, octets_of
from tests.unit.signals.radio.vectors import CAM_ASN1TOOLS, CAM_OF_ISSUE, CAM_PYCRATE
from tools.message_tables import messages, table

N_RANDOM = 150
OFFICIAL = {"cam": ITS_CAM_2.CAM_PDU_Descriptions.CAM, "denm": ITS_DENM_3.DENM_PDU_Descriptions.DENM}


def any_value(rng: np.random.Generator, node: Asn1Type, official: Any, path: str, found: dict[str, int]) -> Any:  # noqa: PLR0911
    """A value for the official encoder, and in `found` what the decoder should make of its components."""
    match node:
        case ["int", low, high, extensible]:
            assert low is not None
            assert high is not None
            limits: list[Any] = [low, high, rng.integers(low, high, endpoint=True)]
            value = int(rng.choice(limits))
            found[path] = high + 5 if extensible and rng.random() < 0.2 else value
            return bool(value) if official.TYPE == "BOOLEAN" else found[path]
        case ["enum", n, _]:
            found[path] = int(rng.integers(n))
            return official._root[found[path]]
        case ["sized", unit_bits, low, high, _]:
            size = int(rng.integers(low if high is not None else 1, (9 if high is None else high) + 1))
            units = rng.integers(0, 2 if unit_bits == 1 else 10, size)
            if unit_bits == 1:
                found[path] = int("".join(map(str, units[:low])) or "0", 2)
                return int("".join(map(str, units)) or "0", 2), size
            return units.astype(np.uint8).tobytes() if official.TYPE == "OCTET STRING" else "".join(map(str, units))
        case ["sequence", parts, _]:
            made = {}
            for name, part, is_optional in parts:
                if not is_optional or rng.random() < 0.5:
                    inner = f"{path}.{name}" if path else name
                    made[name] = any_value(rng, part, official._cont[name], inner, found)
            return made
        case ["choice", alternatives, _]:
            found[path] = int(rng.integers(len(alternatives)))
            name, part = alternatives[found[path]]
            return name, any_value(rng, part, official._cont[name], f"{path}.{name}", found)
        case ["list", element, low, high, _]:
            n = int(rng.integers(low, min(low + 4, high or low + 4) + 1))
            return [any_value(rng, element, official._cont, path, {}) for _ in range(n)]
        case _:
            assert node == ["null"]
            return 0


def paths_of(node: Asn1Type, path: str = "") -> list[str]:
    """Every component outside lists."""
    match node:
        case ["sequence" | "choice" as kind, parts, _]:
            own = [path] if kind == "choice" else []
            inner = ((part, f"{path}.{name}" if path else name) for name, part, *_ in parts)
            return own + [each for part, name in inner for each in paths_of(part, name)]
        case ["int" | "enum", *_] | ["sized", 1, *_]:
            return [path]
        case _:
            return []


def check_random(message: str, n: int, seed: int) -> None:
    """Every component of any message is what the official encoder packed."""
    rng = np.random.default_rng(seed)
    node, official = load_message_type(message), OFFICIAL[message]
    packed, expected = [], []
    for _ in range(n):
        found: dict[str, int] = {}
        official.set_val(any_value(rng, node, official, "", found))
        packed.append(official.to_uper())
        expected.append(found)
    names = paths_of(node)
    decoded = decode_messages(compile_asn1_type(node, names), octets_of(packed))
    assert not decoded.status.any()
    for row, found in enumerate(expected):
        assert {name: int(decoded.component_codes(name)[row]) for name in names} == dict.fromkeys(
            names, CODE_OF_MISSING_COMPONENT
        ) | found


def check_mutated(message: str, n: int, seed: int) -> dict[str, int]:
    """Any octets are decoded or counted, and what is decoded lies inside the type's ranges."""
    rng = np.random.default_rng(seed)
    node, official = load_message_type(message), OFFICIAL[message]
    some = []
    for _ in range(50):
        official.set_val(any_value(rng, node, official, "", {}))
        some.append(official.to_uper())
    broken = [mutated(rng, some[int(rng.integers(len(some)))]) for _ in range(n)]
    names = paths_of(node)
    decoded = decode_messages(compile_asn1_type(node, names), octets_of(broken))
    assert set(decoded.status.tolist()) <= {0, *DECODE_FAULT_TEXTS}
    for name in names:
        codes = decoded.component_codes(name)
        assert (codes[decoded.status != 0] == CODE_OF_MISSING_COMPONENT).all()
        if name.endswith(("latitude", "longitude")):
            assert (np.abs(codes[codes != CODE_OF_MISSING_COMPONENT]) <= 1_800_000_001).all()
    counts = np.bincount(decoded.status, minlength=max(DECODE_FAULT_TEXTS) + 1)
    return {"decoded": int(counts[0])} | {reason: int(counts[code]) for code, reason in DECODE_FAULT_TEXTS.items()}


@pytest.mark.parametrize("message", sorted(OFFICIAL))
def test_broken_messages_are_decoded_or_counted(message: str) -> None:
    counts = check_mutated(message, 2000, seed=4)
    assert counts["decoded"] > 100
    assert counts["truncated message"] > 100


@pytest.mark.parametrize("message", sorted(OFFICIAL))
def test_any_message_of_the_official_encoder_is_decoded_exactly(message: str) -> None:
    check_random(message, N_RANDOM, seed=3)


@pytest.mark.parametrize("message", messages())
def test_the_tables_are_those_of_the_official_modules(message: str) -> None:
    assert files("cwcli.signals.radio").joinpath(f"{message}.json").read_text(encoding="utf-8") == table(message)


def test_a_published_message_is_what_its_publisher_decoded() -> None:
    decoded = decode_messages(CAM.program, octets_of([CAM_ASN1TOOLS, CAM_PYCRATE]))
    assert not decoded.status.any()
    assert {name: int(decoded.component_codes(name)[0]) for name in CAM_OF_ISSUE} == CAM_OF_ISSUE
    assert decoded.component_codes("header.stationID")[1] == 55_552
    assert decoded.component_codes("cam.generationDeltaTime")[1] == 45_543
    official = OFFICIAL["cam"]
    for row, message in enumerate((CAM_ASN1TOOLS, CAM_PYCRATE)):
        official.from_uper(message)
        for path in ("latitude", "longitude"):
            at = ["cam", "camParameters", "basicContainer", "referencePosition", path]
            assert decoded.component_codes(".".join(at))[row] == official.get_val_at(at)
