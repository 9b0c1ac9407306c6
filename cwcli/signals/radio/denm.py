"""ETSI Decentralized Environmental Notification Message in the packed encoding (EN 302 637-3 V1.3.1, BTP port 2002).

It tells of an event on the road, not of its sender. Release 2 (TS 103 831) packs what is read here alike.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from cwcli.signals.radio.messages import MISSING, Decoded
from cwcli.signals.radio.program import Program, compile_type
from cwcli.signals.radio.tables import load

MESSAGE_ID = 1
PROTOCOL_VERSIONS = (2,)
STATION = "header.stationID"
CAUSE = "denm.situation.eventType.causeCode"
CAUSES: dict[int, str] = {
    1: "traffic condition",
    2: "accident",
    3: "roadworks",
    6: "adhesion",
    9: "surface condition",
    10: "obstacle on the road",
    11: "animal on the road",
    12: "people on the road",
    14: "wrong-way driving",
    15: "rescue work",
    17: "extreme weather",
    18: "visibility",
    19: "precipitation",
    26: "slow vehicle",
    27: "end of a queue",
    91: "vehicle breakdown",
    92: "post crash",
    93: "human problem",
    94: "stationary vehicle",
    95: "emergency vehicle approaching",
    96: "dangerous curve",
    97: "collision risk",
    98: "signal violation",
    99: "dangerous situation",
}
"""CauseCodeType (TS 102 894-2); 99 has emergency braking among its sub-causes."""


@cache
def program() -> Program:
    """Sender and cause."""
    return compile_type(load("denm"), (STATION, CAUSE))


def told(decoded: Decoded) -> str:
    """In words: `3 DENMs of 2 stations: 2 stationary vehicle, 1 roadworks`; "" without any."""
    is_ok = decoded.status == 0
    n = int(np.count_nonzero(is_ok))
    if not n:
        return ""
    causes, counts = np.unique(decoded.codes(CAUSE)[is_ok], return_counts=True)
    order = np.argsort(-counts, kind="stable")
    said = ", ".join(f"{counts[k]} {_name(int(causes[k]))}" for k in order)
    return f"{n} DENMs of {len(np.unique(decoded.codes(STATION)[is_ok]))} stations: {said}"


def _name(cause: int) -> str:
    return "without a cause" if cause == MISSING else CAUSES.get(cause, f"cause {cause}")
