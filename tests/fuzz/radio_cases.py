"""Cases of the level `radio`: mutated CPM, VAM and BSM (UPER), compared with asn1tools and the message's bits.

What cwcli decodes must be what the other decoder says; what it does not decode has a reason, which is counted.
"""

from __future__ import annotations

from collections import Counter
from functools import cache
from typing import Any

import asn1tools

from cwcli.signals.radio.messages import DECODE_FAULT_TEXTS, DecodedMessages, decode_messages
from cwcli.signals.radio.standard_messages import CPM, VAM
from tests.fuzz.mutate import Rng
from tests.unit.signals.radio import test_bsm, test_cpm, test_vam
from tests.unit.signals.radio.test_bsm import mutated, octets_of

N_INPUTS = 32
CPM_CONTAINER = 5
"""The number of the container of perceived objects (TS 103 324)."""


def check_case(rng: Rng) -> dict[str, int]:
    """Mutate messages of one kind and check them; counts of inputs."""
    return (_check_cpm, _check_vam, _check_bsm)[int(rng.integers(3))](rng)


def _check_bsm(rng: Rng) -> dict[str, int]:
    counts = test_bsm.check_mutated(N_INPUTS, int(rng.integers(1 << 31)))
    return {"inputs": N_INPUTS, "accepted": counts["decoded"], "compared": counts["decoded"]}


def _check_vam(rng: Rng) -> dict[str, int]:
    codec = _vam()
    messages = [mutated(rng, codec.encode("VAM", test_vam.any_vam(rng))) for _ in range(N_INPUTS)]
    decoded = decode_messages(VAM.program, octets_of(messages))
    counts = _counts(decoded)
    for row, message in enumerate(messages):
        said = None if decoded.status[row] else _decoded(codec, "VAM", message)
        if said is None:
            continue
        counts["compared"] += 1
        for path in VAM.components.values():
            assert decoded.component_codes(path)[row] == test_cpm.code_of(said, path), (path, message.hex())
    return dict(counts)


def _check_cpm(rng: Rng) -> dict[str, int]:
    codec = test_cpm.official()
    messages = [mutated(rng, test_cpm.packed(test_cpm.any_cpm(rng))) for _ in range(N_INPUTS)]
    decoded = decode_messages(CPM.program, octets_of(messages))
    counts = _counts(decoded)
    rows_of_objects = decoded.rows[CPM.objects_path]
    for row, message in enumerate(messages):
        said = None if decoded.status[row] else _decoded(codec, "CPM", message)
        objects = None if said is None else _objects(codec, said)
        if objects is None:
            continue
        counts["compared"] += 1
        mine = rows_of_objects == row
        assert int(mine.sum()) == len(objects), message.hex()
        for path in CPM.components.values():
            below = path.removeprefix(f"{CPM.objects_path}.")
            codes = decoded.component_codes(path)
            if below == path:
                assert codes[row] == test_cpm.code_of(said, path), (path, message.hex())
            else:
                expected = [test_cpm.code_of(each, below) for each in objects]
                assert codes[mine].tolist() == expected, (path, message.hex())
    return dict(counts)


def _objects(codec: Any, said: dict[str, Any]) -> list[Any] | None:
    """The perceived objects of a message; None where there are several containers of them, or one can't be decoded."""
    containers = [each for each in said["payload"]["cpmContainers"] if each["containerId"] == CPM_CONTAINER]
    if not containers:
        return []
    inside = _decoded(codec, "PerceivedObjectContainer", containers[0]["containerData"])
    return None if inside is None or len(containers) > 1 else inside["perceivedObjects"]


def _counts(decoded: DecodedMessages) -> Counter[str]:
    """Check that each message is decoded or has a known reason."""
    assert set(decoded.status.tolist()) <= {0, *DECODE_FAULT_TEXTS}
    n = len(decoded.status)
    return Counter({"inputs": n, "accepted": int((decoded.status == 0).sum())})


def _decoded(codec: Any, name: str, message: bytes) -> Any:
    """Decode by asn1tools; None where it refuses the message, or takes codes beyond the type's ranges."""
    try:
        said = codec.decode(name, message, check_constraints=True)
    except Exception:  # it raises what it comes upon
        return None
    return said


@cache
def _vam() -> Any:
    return asn1tools.compile_string(test_vam.TYPE, "uper")
