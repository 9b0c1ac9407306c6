"""V2X off the radio at length: `python -m tests.studies.radio [N] [N_MUTATED] [N_SCENES]`.

N random BSMs, SDSMs and CPMs of independent encoders and CAMs and DENMs of the official one, decoded field by field;
mutated messages of each kind, together N_MUTATED; the speed of each decoder, pycrate beside it; and changed ids among
ten neighbours.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from pycrate_asn1dir import ITS_CAM_2

from cwcli.signals.radio.standard_messages import CAM, CPM
from cwcli.signals.radio.messages import Octets, decode_messages
from cwcli.signals.radio.program import Program
from cwcli.signals.radio.standard_messages import BSM, SDSM
from tests.unit.signals.pseudonyms import score
from tests.peers import test_cam
from tests.unit.signals.radio import packing, test_bsm, test_cpm, test_sdsm
from tests.unit.signals.radio.sdsm_packing import any_sdsm
from tests.unit.signals.radio.vectors import CAM_ASN1TOOLS, CAM_PYCRATE

SEED = 11
PART = 10_000
RANDOM: dict[str, Callable[[int, int], object]] = {
    "BSM": test_bsm.check_random,
    "SDSM": test_sdsm.check_random,
    "CPM": test_cpm.check_random,
    "CAM": partial(test_cam.check_random, "cam"),
    "DENM": partial(test_cam.check_random, "denm"),
}
MUTATED: dict[str, Callable[[int, int], dict[str, int]]] = {
    "BSM": test_bsm.check_mutated,
    "SDSM": test_sdsm.check_mutated,
    "CPM": test_cpm.check_mutated,
    "CAM": partial(test_cam.check_mutated, "cam"),
    "DENM": partial(test_cam.check_mutated, "denm"),
}


def main() -> None:
    """Run everything."""
    n_random, n_mutated, n_scenes = [*map(int, sys.argv[1:]), *(500, 20_000, 60)[len(sys.argv) - 1 :]]
    for name, check in RANDOM.items():
        for seed, n in parts_of(n_random):
            check(n, seed)
        print(f"{n_random} random {name}s are decoded exactly", flush=True)
    for name, count in MUTATED.items():
        total: Counter[str] = Counter()
        for seed, n in parts_of(n_mutated // len(MUTATED)):
            total.update(count(n, seed))
        print(f"{n_mutated // len(MUTATED)} mutated {name}s: {dict(total)}", flush=True)
    print(f"BSM: {rate(BSM.program, packing.bsm(dict.fromkeys(packing.CORE, 1))):,.0f} messages/s")
    objects = packing_of_objects()
    print(f"CPM (ten objects): {rate(CPM.program, objects['CPM'], 20_000):,.0f} messages/s")
    print(f"SDSM (five objects): {rate(SDSM.program, objects['SDSM'], 20_000):,.0f} messages/s")
    for name, message in (("asn1tools #179, 23 path points", CAM_ASN1TOOLS), ("pycrate #156", CAM_PYCRATE)):
        print(f"CAM ({name}): {rate(CAM.program, message):,.0f} messages/s; pycrate {official_rate(message):,.0f}")
    n_changes, n_right, n_wrong = score(n_scenes, SEED)
    print(f"{n_scenes} scenes: {n_right} of {n_changes} changed ids found, {n_wrong} wrong")


def parts_of(n: int) -> Iterator[tuple[int, int]]:
    """Seeds and sizes of parts that fit into memory."""
    for first in range(0, n, PART):
        yield SEED + first, min(PART, n - first)


def rate(program: Program, message: bytes, n: int = 200_000) -> float:
    """Messages decoded per second of processor time."""
    octets = Octets(np.frombuffer(message * n, np.uint8), *(len(message) * (np.arange(n) + k) for k in (0, 1)))
    start_s = time.process_time()
    assert not decode_messages(program, octets).status.any()
    return n / (time.process_time() - start_s)


def packing_of_objects() -> dict[str, bytes]:
    """A CPM of ten objects and an SDSM of five."""
    rng = np.random.default_rng(SEED)
    made = test_cpm.any_cpm(rng) | {"objects": [test_cpm.any_object(rng) for _ in range(10)]}
    while len((told := any_sdsm(rng))[1]) != 5:
        pass
    return {"CPM": test_cpm.packed(made), "SDSM": told[2]}


def official_rate(message: bytes, n: int = 2000) -> float:
    """As `rate`, by pycrate."""
    start_s = time.process_time()
    for _ in range(n):
        ITS_CAM_2.CAM_PDU_Descriptions.CAM.from_uper(message)
    return n / (time.process_time() - start_s)


if __name__ == "__main__":
    main()
