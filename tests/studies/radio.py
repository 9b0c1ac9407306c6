"""V2X off the radio at length: `python -m tests.studies.radio [N_BSM] [N_ETSI] [N_MUTATED] [N_SCENES]`.

Any BSM of an independent encoder and any CAM and DENM of the official one, decoded field by field; mutated BSMs; the
speed of each decoder, pycrate beside it; and changed ids among ten neighbours.
"""

from __future__ import annotations

import sys
import time

import numpy as np
from pycrate_asn1dir import ITS_CAM_2

from cwcli.signals.radio import bsm, cam
from cwcli.signals.radio.messages import Octets, decode
from cwcli.signals.radio.program import Program
from tests.unit.signals.pseudonyms import score
from tests.unit.signals.radio import packing, test_bsm, test_cam
from tests.unit.signals.radio.vectors import CAM_ASN1TOOLS, CAM_PYCRATE

SEED = 11


def main() -> None:
    """Run everything."""
    n_bsm, n_etsi, n_mutated, n_scenes = [*map(int, sys.argv[1:]), *(2000, 500, 20_000, 60)[len(sys.argv) - 1 :]]
    test_bsm.check_random(n_bsm, SEED)
    print(f"{n_bsm} random BSMs are decoded exactly")
    for message in ("cam", "denm"):
        test_cam.check_random(message, n_etsi, SEED)
        print(f"{n_etsi} random {message.upper()}s are decoded exactly")
    print(f"{n_mutated} mutated BSMs: {test_bsm.check_mutated(n_mutated, SEED)}")
    print(f"BSM: {rate(bsm.core_program(), packing.bsm(dict.fromkeys(packing.CORE, 1))):,.0f} messages/s")
    for name, message in (("asn1tools #179, 23 path points", CAM_ASN1TOOLS), ("pycrate #156", CAM_PYCRATE)):
        print(f"CAM ({name}): {rate(cam.program(), message):,.0f} messages/s; pycrate {official_rate(message):,.0f}")
    n_changes, n_right, n_wrong = score(n_scenes, SEED)
    print(f"{n_scenes} scenes: {n_right} of {n_changes} changed ids found, {n_wrong} wrong")


def rate(program: Program, message: bytes, n: int = 200_000) -> float:
    """Messages decoded per second of processor time."""
    octets = Octets(np.frombuffer(message * n, np.uint8), *(len(message) * (np.arange(n) + k) for k in (0, 1)))
    start_s = time.process_time()
    assert not decode(program, octets).status.any()
    return n / (time.process_time() - start_s)


def official_rate(message: bytes, n: int = 2000) -> float:
    """As `rate`, by pycrate."""
    start_s = time.process_time()
    for _ in range(n):
        ITS_CAM_2.CAM_PDU_Descriptions.CAM.from_uper(message)
    return n / (time.process_time() - start_s)


if __name__ == "__main__":
    main()
